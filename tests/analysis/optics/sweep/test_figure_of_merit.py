"""Figures of merit against numpy's polynomials, constructed cases and simulated noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.optics.sweep.figure_of_merit import merit, pareto, resolution, uncertainty
from protocol.base.errors import DataError

FLOOR = resolution(250)
COUNTS = st.lists(st.integers(0, 250), min_size=15, max_size=15).map(lambda v: np.array(v, dtype=float))


@given(COUNTS)
def test_andr_is_numpys_cubic(ndr: np.ndarray) -> None:
    """aNDR, Delta and RMSE are those of numpy.polyfit of degree 3."""
    fit = np.polyval(np.polyfit(np.arange(15), ndr, 3), np.arange(15))
    m = merit(ndr, FLOOR)
    np.testing.assert_allclose(m.andr, fit, atol=1e-8)
    assert m.delta == pytest.approx(fit[0] - fit[-1], abs=1e-8)
    assert m.rmse == pytest.approx(np.sqrt(np.mean((ndr - fit) ** 2)), abs=1e-8)


@given(COUNTS)
def test_repaired_equals_printed_where_that_is_defined(ndr: np.ndarray) -> None:
    """Wherever NDR rises at least once and scatters above the resolution the two P are one number."""
    m = merit(ndr, FLOOR)
    if m.n_sign > 0 and not m.floored:
        assert m.p == m.p_printed


def test_monotone_design_has_a_p_and_a_mark() -> None:
    """A falling NDR has no printed P; the repaired one is Delta / RMSE and marked as monotone."""
    ndr = 150 - np.arange(15.0) ** 1.3 + np.tile([0.5, -0.5, 0.2], 5) * 0.4
    m = merit(ndr, FLOOR)
    assert m.n_sign == 0
    assert m.monotone
    assert np.isnan(m.p_printed)
    assert m.p == pytest.approx(m.delta / max(float(m.rmse), FLOOR))


def test_an_exact_cubic_is_floored_not_infinite() -> None:
    """RMSE 0 is replaced by the resolution of the ray count and marked."""
    m = merit(150 - 0.01 * np.arange(15.0) ** 3, FLOOR)
    assert m.floored
    assert m.p == pytest.approx(float(m.delta) / FLOOR)


def test_n_sign_counts_rises_only() -> None:
    """Equal neighbours are no rise."""
    ndr = np.array([10, 10, 9, 11, 11, 8, 7, 6, 7, 5, 5, 4, 3, 2, 1.0])
    assert merit(ndr, FLOOR).n_sign == 2


def test_interval_holds_p_and_shrinks_with_the_noise() -> None:
    """Every interval holds its P; with next to no noise it closes on it, and a clear winner has no ties."""
    rng = np.random.default_rng(3)
    base = np.linspace(130, 90, 15) + rng.normal(0, 2, (6, 15))
    base[0] = np.linspace(160, 60, 15) + 0.5 * np.sin(np.arange(15))
    wide, narrow = (uncertainty(base, np.full_like(base, s), FLOOR) for s in (3.0, 1e-6))
    p = merit(base, FLOOR).p
    for each in (wide, narrow):
        assert np.all((each.p_ci[:, 0] <= p) & (p <= each.p_ci[:, 1]))
    assert np.all(np.ptp(narrow.p_ci, axis=1) < 1e-3 * p)
    assert np.all(np.ptp(wide.p_ci, axis=1) > 0.5 * p)
    assert narrow.tied.sum() == 1


def test_equal_designs_tie() -> None:
    """Two designs with the same truth tie."""
    ndr = np.tile(np.linspace(140, 80, 15) + np.sin(np.arange(15.0)), (2, 1))
    assert uncertainty(ndr, np.full_like(ndr, 1.0), FLOOR).tied.all()


def test_pareto_keeps_what_nothing_betters() -> None:
    """A design worse in all three is dropped, those best in one stay."""
    front = pareto(np.array([10.0, 5, 4, 9]), np.array([5.0, 1, 6, 5]), np.array([3.0, 3, 4, 2]))
    np.testing.assert_array_equal(front, [True, True, False, True])


def test_too_few_states_are_refused() -> None:
    """A cubic through four states leaves no residuals."""
    with pytest.raises(DataError, match="too few"):
        merit(np.ones((2, 4)), FLOOR)


def test_the_error_of_a_ranking_is_that_of_a_sweep_traced_again() -> None:
    """No noise leaves the order; noise far above the differences leaves no correlation."""
    states, slopes = np.arange(15.0), np.linspace(1.0, 3.0, 40)
    ndr = 200.0 - slopes[:, None] * states + np.where(states % 2, 1.0, -1.0)
    still, loud = (uncertainty(ndr, np.full_like(ndr, sd), 0.1).rank_error for sd in (1e-9, 500.0))
    assert still < 1e-6
    assert 0.7 < loud < 1.3
