"""Stability: the limits of the actuator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from protocol.base.errors import RequestError


def test_limit_lies_below_the_papers_range(actuator: FullModel) -> None:
    """Under vacuum the bladders go oval between -40 kPa, which the paper uses, and -50 kPa."""
    limit = actuator.vacuum_limit
    assert -50.0 < limit.pressure_kpa < -40.0
    assert limit.wave_number == 2
    assert "oval" in limit.mode


def test_limit_does_not_depend_on_the_mesh(actuator: FullModel) -> None:
    """A finer mesh finds the same critical pressure within 0.5 %."""
    finer = FullModel(replace(ActuatorParameters(), axial_elements=12, wall_elements=3, lattice_elements=5))
    assert finer.vacuum_limit.pressure_kpa == pytest.approx(actuator.vacuum_limit.pressure_kpa, rel=5e-3)


def test_lowest_eigenvalue_falls_from_one_to_zero(actuator: FullModel) -> None:
    """It is 1 at rest, falls under vacuum, and is zero at the limit."""
    pressures = (0.0, -15.0, -30.0, -40.0, actuator.vacuum_limit.pressure_kpa)
    values = [actuator.stability.lowest_eigenvalue(actuator.solver.solve(pressure_kpa=p)) for p in pressures]
    assert values[0] == pytest.approx(1.0, abs=2e-5)
    assert (np.diff(values) < 0).all()
    assert values[-1] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.fault(46, how="less pressure, or elongation, than the limit point's", times=4)
def test_beyond_the_limit_is_refused_with_the_critical_pressure(actuator: FullModel) -> None:
    """By pressure or by elongation, the refusal names the critical pressure."""
    named = f"{actuator.vacuum_limit.pressure_kpa:.1f} kPa"
    for given in ({"pressure_kpa": -60.0}, {"elongation_mm": -6.0}, {"pressure_kpa": -60.0, "elongation_mm": -2.0}):
        with pytest.raises(RequestError) as refusal:
            actuator.solve(**given)
        assert named in refusal.value.cause
        assert named in refusal.value.remedy
    with pytest.raises(RequestError):
        actuator.solve(pressure_kpa=500.0)


SMALL = ActuatorParameters(cells=2, axial_elements=4, wall_elements=1, lattice_elements=2)


def test_the_margin_of_a_nearly_incompressible_wall_is_that_of_rubber() -> None:
    """At half the critical pressure about a half for either; with the stiffness at rest of that wall it would be 0."""
    margins = []
    for nu in (0.49, 0.499999):
        model = FullModel(replace(SMALL, wall_poisson=nu))
        state = model.solve(pressure_kpa=0.5 * model.vacuum_limit.pressure_kpa)
        margins.append(model.stability.lowest_eigenvalue(state))
    assert margins[1] == pytest.approx(margins[0], abs=0.02)
    assert 0.3 < margins[0] < 0.7


@pytest.mark.parametrize(
    ("values", "cause"),
    [
        ({"lattice_modulus_kpa": 1e15}, "rounding hides a pressure of 1 kPa"),
        ({"lattice_modulus_kpa": 1e12, "wall_modulus_kpa": 1e12}, "rounding hides a pressure of 1 kPa"),
        ({"grading": 1e-9, "lattice_elements": 4}, "ill-conditioned"),
        ({"wall_mm": 1e-5}, "ill-conditioned"),
    ],
)
def test_an_ill_conditioned_actuator_is_refused_and_has_no_critical_pressure(
    values: dict[str, float], cause: str
) -> None:
    """Stiffnesses that double precision cannot resolve: the cause is named, and what to change."""
    model = FullModel(replace(SMALL, **values))  # type: ignore[arg-type]
    for request in (lambda: model.solve(pressure_kpa=-1.0), lambda: model.vacuum_limit):
        with pytest.raises(RequestError, match=cause) as refusal:
            request()
        assert "moduli" in refusal.value.remedy


def test_a_thin_wall_buckles_early() -> None:
    """A bladder of a thin wall goes oval under less vacuum than the default one."""
    thin = FullModel(ActuatorParameters(cells=2, wall_mm=1.6, axial_elements=6, lattice_elements=3))
    assert -40.0 < thin.vacuum_limit.pressure_kpa < 0.0
    assert thin.vacuum_limit.wave_number >= 2
