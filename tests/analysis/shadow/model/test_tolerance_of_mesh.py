"""As fine a mesh as an error of the elongation takes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from analysis.errors import AnalysisError, RequestError
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.tolerance import CALIBRATED, error_estimates, mesh_of, solve_within, table_within


def test_an_error_of_second_order_is_estimated_exactly() -> None:
    """Elongations that differ from 3 mm by 0.1 / k^2 have the calibrated part of just that error estimated."""
    found = error_estimates([3.0 + 0.1 / k**2 for k in range(1, 6)])
    assert found == pytest.approx([CALIBRATED[min(k, 4)] * 0.1 / k**2 for k in range(2, 6)])


def test_a_change_of_sign_does_not_hide_an_error() -> None:
    """Two equal elongations by chance leave a quarter of what the estimate before leads to."""
    first, second = error_estimates([1.0, 1.1, 1.1])
    assert second == pytest.approx(CALIBRATED[3] * 0.25 * first / CALIBRATED[2] / (3 / 2) ** 2)


def test_a_coarse_tolerance_takes_a_coarse_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of a millimetre is met by the second or third mesh, and the error of the default mesh is below it."""
    monkeypatch.setattr(FullModel, "check_limits", lambda *_: None)  # a search of its own, tested with the model
    found = solve_within(ActuatorParameters(), 20.0, 0.1)
    assert found.error_mm <= 0.1
    assert found.elements in (mesh_of(2), mesh_of(3))
    assert abs(found.solution.elongation_mm - FullModel().solver.solve(pressure_kpa=20.0).elongation_mm) < 0.1


@pytest.mark.parametrize(("tolerance_mm", "pressure_kpa"), [(0.0, 10.0), (math.nan, 10.0), (0.1, math.nan)])
def test_numbers_without_sense_are_refused(tolerance_mm: float, pressure_kpa: float) -> None:
    """No tolerance, or no pressure."""
    with pytest.raises(AnalysisError):
        solve_within(ActuatorParameters(), pressure_kpa, tolerance_mm)


def test_a_table_is_as_small_as_its_tolerance_takes(
    short: ActuatorParameters, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second of two tables meets half of the first one's error; neither meets nothing."""
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    monkeypatch.setattr("analysis.shadow.model.tolerance.TABLES", ((2, 2, 2), (4, 4, 4)))
    monkeypatch.setattr("analysis.shadow.model.tolerance.HELD_OUT", 5)
    coarse, size = table_within(short, 10.0)
    assert (size.pressures, size.held_out) == (2, 5)
    fine, size = table_within(short, float(coarse.errors_mm[-1]) / 2.0)
    assert size.pressures == 4
    assert fine.errors_mm[-1] <= coarse.errors_mm[-1] / 2.0
    with pytest.raises(RequestError) as refused:
        table_within(short, 1e-12)
    assert "allow" in refused.value.remedy


@pytest.mark.nightly
def test_a_tolerance_beyond_the_finest_mesh_is_refused_with_the_best() -> None:
    """The refusal states an error that can be met."""
    with pytest.raises(RequestError) as refused:
        solve_within(ActuatorParameters(), 20.0, 1e-9)
    assert "or more" in refused.value.remedy
