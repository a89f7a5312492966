"""States of the reduced model, or of the full one where an error takes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import build_table
from analysis.shadow.model.tolerance import reduced_error_mm, reduced_within
from protocol.base.errors import ConvergenceError

MESH = ActuatorParameters(axial_elements=6, wall_elements=2, lattice_elements=3)


@pytest.fixture(scope="module")
def shadow() -> Shadow:
    """Return a coarse table of a thin wall, whose states near its limit in vacuum are not stable themselves."""
    thin = replace(
        MESH, wall_modulus_kpa=1525.0548, wall_mm=1.8603874, neck_radius_mm=4.690498, belly_radius_mm=7.2290338
    )
    return Shadow(thin, build_table(thin, TableSettings(4, 4, 3, 1)))


def true_and_stated(shadow: Shadow, pressure: float | None, elongation: float | None) -> tuple[float, float]:
    """Return the error of a reduced state against the full model, and the stated one, mm."""
    state, used = shadow.solution(pressure_kpa=pressure, elongation_mm=elongation)
    assert used == "reduced"
    full = shadow.model.solve(pressure_kpa=pressure, elongation_mm=elongation)
    points = shadow.model.guides.tracked.weights @ (full.displacement_mm - state.displacement_mm)
    error = max(float(np.linalg.norm(points, axis=1).max()), abs(full.elongation_mm - state.elongation_mm))
    return error, reduced_error_mm(shadow.model, state, pressure, elongation)


def test_error_of_a_reduced_state_is_that_of_the_full_model(shadow: Shadow) -> None:
    """The estimate is the true error within 1 %, for states all over the table."""
    for pressure, elongation in ((10.0, 1.0), (-10.0, -0.5), (20.0, None), (None, 1.5)):
        error, stated = true_and_stated(shadow, pressure, elongation)
        assert stated == pytest.approx(error, rel=0.01)


def test_error_far_from_the_nominal_curve_is_that_of_the_full_model() -> None:
    """A soft actuator pulled to 11.5 mm at 5 kPa: one Newton step states 0.6 of the error, as a search found."""
    soft = replace(MESH, wall_modulus_kpa=718.438, wall_mm=1.6, neck_radius_mm=4.653, belly_radius_mm=8.189)
    table = build_table(soft, TableSettings(6, 6, 6, 1))
    error, stated = true_and_stated(Shadow(soft, table), 5.0, float(table.elongation_range_mm[1]))
    assert error > 5e-4
    assert stated == pytest.approx(error, rel=0.01)


def test_error_of_a_soft_actuator_at_high_pressure_is_that_of_the_full_model() -> None:
    """A narrow neck at 51 kPa: two Newton steps state 0.79 of the error, as random scenes found."""
    soft = replace(
        MESH, wall_modulus_kpa=799.29104, wall_mm=2.0204034, neck_radius_mm=3.7618853, belly_radius_mm=7.7228466
    )
    error, stated = true_and_stated(Shadow(soft, build_table(soft, TableSettings(4, 4, 3, 1))), 51.427922, None)
    assert error > 0.02
    assert stated == pytest.approx(error, rel=0.01)


def test_a_reduced_state_that_is_not_stable_is_replaced(shadow: Shadow, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an estimate no tolerance is met by the table: the full model is used, and errs by nothing."""
    corrected = shadow.model.solver.correction

    def unstable(*args: object, **kwargs: object) -> None:
        raise ConvergenceError("the state is not stable", "use the full model")

    monkeypatch.setattr(type(shadow.model.solver), "correction", unstable)
    found = reduced_within(shadow, 10.0, 1.0, 10.0)
    assert (found.used, found.error_mm) == ("full", 0.0)
    monkeypatch.undo()
    assert np.abs(corrected(found.solution, pressure_kpa=10.0, elongation_mm=1.0)).max() < 1e-6


def test_a_reduced_state_whose_newton_steps_do_not_settle_is_replaced(
    shadow: Shadow, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six steps of one size lead to no estimate."""
    state = shadow.solution(pressure_kpa=10.0, elongation_mm=1.0)[0]
    step = 1e-3 * state.displacement_mm
    monkeypatch.setattr(type(shadow.model.solver), "correction", lambda *_, **__: step)
    with pytest.raises(ConvergenceError, match="does not settle"):
        reduced_error_mm(shadow.model, state, 10.0, 1.0)
    assert reduced_within(shadow, 10.0, 1.0, 10.0).used == "full"


def test_tolerance_decides_between_the_models(shadow: Shadow) -> None:
    """Just above the estimate the reduced model is used, just below it the full one."""
    stated = reduced_error_mm(shadow.model, shadow.solution(pressure_kpa=10.0, elongation_mm=1.0)[0], 10.0, 1.0)
    assert reduced_within(shadow, 10.0, 1.0, 1.001 * stated).used == "reduced"
    assert reduced_within(shadow, 10.0, 1.0, 0.999 * stated).used == "full"


def test_full_state_does_not_depend_on_the_one_before(shadow: Shadow) -> None:
    """From a state held in vacuum the way to a free elongation is not stable; from rest it is."""
    states = [(-26.069163, 1.2130089), (None, 0.50704257)]
    before, after = (shadow.solution(pressure_kpa=p, elongation_mm=q, model="full")[0] for p, q in states)
    with pytest.raises(ConvergenceError):
        shadow.model.solve(elongation_mm=0.50704257, start=before)
    fresh = shadow.model.solve(elongation_mm=0.50704257)
    assert after.elongation_mm == pytest.approx(fresh.elongation_mm, abs=1e-6)
    assert after.pressure_kpa == pytest.approx(fresh.pressure_kpa, abs=1e-3)
