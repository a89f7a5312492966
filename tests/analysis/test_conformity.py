"""Statements of conformity: the probability of JCGM 106, the zones of ILAC-G8, and how often a pass is false."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from analysis.conformity import Conformity, conformity_statement

K = 1.959964


@pytest.mark.parametrize(
    ("value", "u", "limits"),
    [(9.0, 1.0, (-math.inf, 10.0)), (10.5, 1.0, (-math.inf, 10.0)), (-5.47, 0.05, (-math.inf, -5.4)),
     (13.6, 1.8, (12.5, 16.3)), (12.0, 1.8, (12.5, 16.3)), (0.0, 3.0, (-0.5, 0.5))],
)  # fmt: skip
def test_probability_of_conformity_is_the_integral_of_the_normal_density(
    value: float, u: float, limits: tuple[float, float]
) -> None:
    """One limit and two, inside and outside: the closed form by the error function, and the density by quadrature.

    JCGM 106:2012, 7.2 to 7.4: p = Phi((high - y) / u) - Phi((low - y) / u), the integral of the density of the
    measurand between the limits.
    """
    found = conformity_statement(value, (K * u, K * u), limits).probability
    low, high = (0.5 * (1.0 + math.erf((limit - value) / (u * math.sqrt(2.0)))) for limit in limits)
    assert found == pytest.approx(high - low, abs=1e-6)
    ends = np.clip(limits, value - 12.0 * u, value + 12.0 * u)
    density = integrate.quad(lambda x: math.exp(-0.5 * ((x - value) / u) ** 2), *ends, epsabs=1e-12)[0]
    assert found == pytest.approx(density / (u * math.sqrt(2.0 * math.pi)), abs=1e-6)


@pytest.mark.parametrize(
    ("value", "expected"),
    [(8.9, "pass"), (9.0, "pass"), (9.1, "conditional_pass"), (10.0, "conditional_pass"),
     (10.1, "conditional_fail"), (11.0, "conditional_fail"), (11.1, "fail")],
)  # fmt: skip
def test_the_four_zones_of_a_guard_band(value: float, expected: str) -> None:
    """Upper limit 10 with U = 1: borders at 9, 10 and 11; a lower limit mirrors them."""
    assert conformity_statement(value, (1.0, 1.0), (-math.inf, 10.0)).conformity == expected
    assert conformity_statement(-value, (1.0, 1.0), (-10.0, math.inf)).conformity == expected


def test_a_hysteresis_of_4_95_against_4_9_is_no_fail() -> None:
    """An interval of 4.893 to 4.987 holds the limit: a conditional fail with 4 % probability of conformity."""
    found = conformity_statement(4.95, (4.95 - 4.893, 4.987 - 4.95), (-math.inf, 4.9))
    assert found.conformity is Conformity.CONDITIONAL_FAIL
    assert found.guard_band == pytest.approx(0.057)
    assert found.probability == pytest.approx(0.043, abs=0.002)


def test_the_half_that_faces_the_limit_counts() -> None:
    """A long interval away from the limit changes nothing; without the half that faces it nothing is certain."""
    assert conformity_statement(9.0, (5.0, 0.5), (-math.inf, 10.0)).conformity is Conformity.PASS
    assert conformity_statement(9.0, (math.nan, 0.5), (-math.inf, 10.0)).conformity is Conformity.PASS
    unknown = conformity_statement(9.0, (0.5, math.nan), (-math.inf, 10.0))
    assert unknown.conformity is Conformity.CONDITIONAL_PASS
    assert math.isnan(unknown.probability)
    for value, expected in ((9.5, "conditional_pass"), (10.0, "conditional_pass"), (10.1, "conditional_fail")):
        assert conformity_statement(value, (math.nan, math.nan), (-math.inf, 10.0)).conformity == expected


@pytest.mark.parametrize(
    ("value", "probability", "expected"), [(9.5, 1.0, "pass"), (10.0, 1.0, "pass"), (10.5, 0.0, "fail")]
)
def test_a_value_without_uncertainty_is_certain(value: float, probability: float, expected: str) -> None:
    """U = 0: within the limit, itself included, or beyond it; without any limit every value passes."""
    found = conformity_statement(value, (0.0, 0.0), (-math.inf, 10.0))
    assert (found.probability, found.conformity) == (probability, expected)
    free = conformity_statement(value, (1.0, 1.0), (-math.inf, math.inf))
    assert (free.probability, free.conformity, free.guard_band) == (1.0, "pass", 0.0)


def test_a_void_value_is_undetermined() -> None:
    """NaN has no statement."""
    assert conformity_statement(math.nan, (1.0, 1.0), (0.0, 1.0)).conformity is Conformity.UNDETERMINED


@settings(max_examples=100)
@given(
    st.floats(-50, 50), st.floats(0.01, 5), st.floats(0.01, 5), st.floats(-20, 0), st.floats(0.1, 20),
)  # fmt: skip
def test_a_pass_is_probable_and_a_fail_is_not(
    value: float, below: float, above: float, low: float, width: float
) -> None:
    """Whatever the limits: with w = U a pass has p >= 95 %, a fail p <= 2.5 %, and p decides which half it is."""
    found = conformity_statement(value, (below, above), (low, low + width))
    if found.conformity is Conformity.PASS:
        assert found.probability >= 0.95 - 1e-9
    if found.conformity is Conformity.FAIL:
        assert found.probability <= 0.025 + 1e-9


def test_false_acceptance_is_as_rare_as_the_rule_promises() -> None:
    """Items exactly at their limit, measured with u = 1, pass in 2.5 %: at the 1,000 quantiles of what is measured."""
    values = stats.norm.ppf((np.arange(1000) + 0.5) / 1000, loc=10.0)
    passed = [conformity_statement(float(v), (K, K), (-math.inf, 10.0)).conformity == "pass" for v in values]
    assert np.mean(passed) == pytest.approx(0.025, abs=0.001)
