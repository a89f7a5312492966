"""Type B contributions: the GUM's own examples, what a file may state, and when an elongation is traceable."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.calibration.type_b import (
    EXPECTED,
    TypeBContribution,
    contributions,
    not_assessed,
    reference_terms,
    traceability,
)
from protocol.base.errors import RequestError

FULL = {
    "scale": {"expanded_percent": 0.2, "k": 2, "certificate": "DKD 4711", "dof": 50},
    "parallax": {"half_width_mm": 0.1, "distribution": "rectangular"},
    "pressure_gauge": {"half_width_kpa": 0.3, "distribution": "rectangular", "sensitivity_mm_per_kpa": 0.072},
    "temperature": {"half_width_k": 2.0, "distribution": "arcsine", "sensitivity_mm_per_k": 0.01},
}


def one(**table: object) -> TypeBContribution:
    """Return the contribution of one table."""
    return contributions({"parallax": table})[0]


@pytest.mark.parametrize(
    ("table", "u"),
    [
        ({"expanded_mm": 240e-6, "k": 3}, 80e-6),  # GUM 4.3.3: 240 µg at three standard deviations
        ({"half_width_mm": 0.40e-6, "distribution": "rectangular"}, 0.23e-6),  # GUM 4.3.7, example 1
        ({"half_width_mm": 1.0, "distribution": "triangular"}, 1 / math.sqrt(6)),  # GUM 4.3.9
        ({"half_width_mm": 0.5, "distribution": "arcsine"}, 0.35),  # GUM H.1.3.4: 0.5 K, u = 0.35 K
        ({"u_mm": 0.05}, 0.05),
    ],
)
def test_standard_uncertainty_is_that_of_the_guide(table: dict[str, object], u: float) -> None:
    """Expanded uncertainty over k; half width over sqrt(3), sqrt(6) and sqrt(2); to the guide's digits."""
    assert one(**table).u == pytest.approx(u, rel=0.011)


def test_half_widths_have_the_spread_of_their_distributions() -> None:
    """A million draws of each distribution: their standard deviation within 0.3 %."""
    rng, n = np.random.default_rng(2), 1_000_000
    draws = {
        "rectangular": rng.uniform(-1, 1, n),
        "triangular": rng.triangular(-1, 0, 1, n),
        "arcsine": np.sin(rng.uniform(0, 2 * np.pi, n)),
    }
    for name, values in draws.items():
        assert one(half_width_mm=1.0, distribution=name).u == pytest.approx(values.std(), rel=3e-3)


def test_a_relative_contribution_is_of_the_elongation() -> None:
    """0.1 % of x is zero at rest and 4 µm at -4 mm; 2 K at 0.01 mm/K, arcsine, is 14 µm everywhere."""
    scale, _, _, temperature = contributions(FULL)
    np.testing.assert_allclose(scale.u_mm([0.0, -4.0]), [0.0, 0.004])
    np.testing.assert_allclose(temperature.u_mm([0.0, -4.0]), 2.0 / math.sqrt(2.0) * 0.01)
    constant, relative = reference_terms(contributions(FULL))
    together = math.hypot(constant, relative * 3.0)
    assert float(together) == pytest.approx(math.sqrt(sum(float(c.u_mm(3.0)) ** 2 for c in contributions(FULL))))
    assert reference_terms(()) == (0.0, 0.0)


def test_a_table_is_read_again_as_it_was_written() -> None:
    """Name, standard uncertainty, sensitivity, degrees of freedom and certificate survive."""
    found = contributions(FULL)
    assert contributions({c.name: c.as_table() for c in found}) == found


@pytest.mark.parametrize(
    ("table", "cause"),
    [
        ({}, "gives none of them"),
        ({"u_mm": 0.1, "half_width_mm": 0.1, "distribution": "rectangular"}, "gives half_width_mm and u_mm"),
        ({"half_width_mm": 0.1}, "'distribution'"),
        ({"half_width_mm": 0.1, "distribution": "normal"}, "no half width"),
        ({"half_width_mm": 0.1, "distribution": "even"}, "'distribution' is 'even'"),
        ({"expanded_mm": 0.1}, "'k' belongs"),
        ({"u_mm": 0.1, "k": 2}, "'k' belongs"),
        ({"u_mm": -0.1}, "'u_mm' is -0.1"),
        ({"u_mm": math.nan}, "'u_mm' is nan"),
        ({"u_mm": "0.1"}, "'u_mm' is '0.1'"),
        ({"u_kpa": 0.1}, "'sensitivity_mm_per_kpa' is missing"),
        ({"u_mm": 0.1, "dof": 0}, "'dof' is 0"),
        ({"u_inch": 0.1}, "'u_inch' is not a known key"),
    ],
)
def test_a_statement_that_is_none_is_refused_by_name_and_key(table: dict[str, object], cause: str) -> None:
    """Nothing, too much, no distribution, no coverage factor, a wrong number, an unknown key: each is named."""
    with pytest.raises(RequestError) as refused:
        one(**table)
    assert refused.value.cause.startswith("type_b.parallax: ")
    assert cause in refused.value.cause
    assert refused.value.remedy


def test_traceable_only_with_every_contribution_and_a_certificate() -> None:
    """All four and the scale's certificate; without any one of them the reason names it."""
    assert traceability(contributions(FULL)).traceable
    assert traceability(contributions(FULL)).text == "traceable to DKD 4711"
    for name, label in EXPECTED.items():
        rest = contributions({key: table for key, table in FULL.items() if key != name})
        assert not_assessed(rest) == (label,)
        assert not traceability(rest).traceable
        assert f"no uncertainty is given for {label}" in traceability(rest).text
        assert traceability(rest).missing == (label,)
    bare = FULL | {"scale": {"u_percent": 0.1}}
    assert traceability(contributions(bare)).text == "not traceable: the scale of grid or photograph has no certificate"
