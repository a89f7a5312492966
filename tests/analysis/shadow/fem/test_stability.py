"""Stability: the limits of the actuator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel


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


def test_a_thin_wall_buckles_early() -> None:
    """A bladder of a thin wall goes oval under less vacuum than the default one."""
    thin = FullModel(ActuatorParameters(cells=2, wall_mm=1.6, axial_elements=6, lattice_elements=3))
    assert -40.0 < thin.vacuum_limit.pressure_kpa < 0.0
    assert thin.vacuum_limit.wave_number >= 2
