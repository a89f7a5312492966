"""As fine a mesh as an error of the elongation takes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.tolerance import (
    ALONG,
    CONTRACTION_SHARE,
    FACTOR,
    LEAST_MM,
    LEAST_SHARE,
    ORDER,
    SAFE_ORDER,
    ToleranceError,
    error_estimate,
    mesh_within,
    on_mesh,
    solve_within,
    table_within,
)
from protocol.base.errors import BoatDaqError


def test_the_error_of_the_order_is_contained_by_its_factor() -> None:
    """Elongations that differ from 0 by 0.1 / n^1.5 mm have the factor times just that error estimated."""
    known: dict[int, float] = {}
    for along in ALONG:
        known[along] = 0.1 / along**ORDER
        if len(known) > 1:
            last = FACTOR * 0.1 / along**ORDER
            most = (along / ALONG[1]) ** (ORDER - SAFE_ORDER) * last  # the first change, by the lower order
            assert last <= error_estimate(known) * (1.0 + 1e-9)
            assert error_estimate(known) <= max(most, LEAST_MM) * (1.0 + 1e-9)


def test_a_change_of_sign_does_not_hide_an_error() -> None:
    """Two equal elongations by chance leave what the change before leads to, by the order that is trusted."""
    before = error_estimate({12: 1.0, 16: 1.01})
    assert error_estimate({12: 1.0, 16: 1.01, 20: 1.01}) == pytest.approx(before * (16 / 20) ** SAFE_ORDER)


def test_equal_elongations_have_an_error() -> None:
    """Where nothing changes, the error of the elements across is stated at rest, else a share that falls with them."""
    assert error_estimate({16: 0.0, 20: 0.0}) == LEAST_MM > 0.0
    first, last = error_estimate({16: 2.0, 20: 2.0}), error_estimate({16: 2.0, 20: 2.0, 40: 2.0})
    assert first == pytest.approx(2.0 * LEAST_SHARE * 16 / 20)
    assert last == pytest.approx(first / 2.0)
    assert error_estimate({16: -2.0, 20: -2.0}) == pytest.approx(first + 2.0 * CONTRACTION_SHARE)


def test_a_contraction_states_what_the_elements_across_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a soft actuator in vacuum, among the worst of 1,000, it was 2.2 times the stated error, and is 1.3 times."""
    monkeypatch.setattr(FullModel, "check_limits", lambda *_: None)
    soft = replace(
        ActuatorParameters(), wall_modulus_kpa=826.378, wall_mm=1.70116, neck_radius_mm=3.44328, belly_radius_mm=7.53828
    )
    found = solve_within(soft, -16.6233, 0.003)
    fine = FullModel(on_mesh(soft, ALONG[-1], 8)).solver.solve(pressure_kpa=-16.6233)
    error = abs(found.solution.elongation_mm - fine.elongation_mm)
    assert found.error_mm - CONTRACTION_SHARE * abs(fine.elongation_mm) < error / 1.9
    assert error < 1.4 * found.error_mm


def test_a_coarse_tolerance_takes_a_coarse_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tenth of a millimetre is met by the second mesh, and the error of the default mesh is below it."""
    monkeypatch.setattr(FullModel, "check_limits", lambda *_: None)  # a search of its own, tested with the model
    found = solve_within(ActuatorParameters(), 20.0, 0.1)
    assert found.error_mm <= 0.1
    assert found.solved == ALONG[:2]
    assert abs(found.solution.elongation_mm - FullModel().solver.solve(pressure_kpa=20.0).elongation_mm) < 0.1


def test_a_mesh_that_would_not_do_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """After the first two, whose error is 1.9 times the tolerance, the next one is as fine as that takes."""
    monkeypatch.setattr(FullModel, "check_limits", lambda *_: None)
    coarse = solve_within(ActuatorParameters(), 20.0, 0.1)
    found = solve_within(ActuatorParameters(), 20.0, coarse.error_mm / 1.9)
    assert found.solved[:2] == ALONG[:2]
    assert found.solved[2] >= 1.9 * ALONG[1]
    assert found.elements == (found.solved[-1], 2, 2)
    assert found.error_mm <= coarse.error_mm / 1.9


@pytest.mark.parametrize(("tolerance_mm", "pressure_kpa"), [(0.0, 10.0), (math.nan, 10.0), (0.1, math.nan)])
def test_numbers_without_sense_are_refused(tolerance_mm: float, pressure_kpa: float) -> None:
    """No tolerance, or no pressure."""
    with pytest.raises(BoatDaqError):
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
    with pytest.raises(ToleranceError) as refused:
        table_within(short, 1e-12)
    assert f"allow {refused.value.allowed_mm:g} mm" in refused.value.remedy
    assert table_within(short, refused.value.allowed_mm)[0].errors_mm[-1] <= refused.value.allowed_mm


def test_all_pressures_can_meet_the_allowed_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The end with the larger error decides, in either order; either end alone allows what it can meet."""
    monkeypatch.setattr(FullModel, "check_limits", lambda *_: None)
    monkeypatch.setattr("analysis.shadow.model.tolerance.ALONG", (4, 6))
    short = ActuatorParameters(cells=2)
    allowed = []
    for pressures in ((2.0,), (20.0,), (2.0, 20.0), (20.0, 2.0)):
        with pytest.raises(ToleranceError) as refused:
            mesh_within(short, pressures, 1e-9)
        allowed.append(refused.value.allowed_mm)
        assert f"allow {allowed[-1]:g} mm" in refused.value.remedy
    assert allowed[0] < allowed[1] == allowed[2] == allowed[3]
    assert mesh_within(short, (2.0, 20.0), allowed[2])[1] <= allowed[2]
    with pytest.raises(ToleranceError):
        mesh_within(short, (2.0, 20.0), allowed[0])


@pytest.mark.nightly
def test_a_tolerance_beyond_the_finest_mesh_is_refused_with_the_best() -> None:
    """The refusal states an error that can be met: with it, the state is solved."""
    with pytest.raises(ToleranceError) as refused:
        solve_within(ActuatorParameters(), 20.0, 1e-9)
    allowed = refused.value.allowed_mm
    assert solve_within(ActuatorParameters(), 20.0, allowed).error_mm <= allowed
