"""The full model: the paper's range, and what it rejects."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from boat_daq.cli import app
from protocol.base.errors import DataError, RequestError


def test_defaults_meet_the_papers_range(actuator: FullModel) -> None:
    """+3.8 mm at +50 kPa and -2.7 mm at -40 kPa, to a thousandth of a millimetre."""
    assert actuator.solve(pressure_kpa=50.0).elongation_mm == pytest.approx(3.8, abs=1e-3)
    assert actuator.solve(pressure_kpa=-40.0).elongation_mm == pytest.approx(-2.7, abs=1e-3)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_a_calibration_gives_outside_its_range_is_refused(actuator: FullModel, value: float) -> None:
    """NaN and infinities are named as such, for either quantity."""
    for given in ({"pressure_kpa": value}, {"elongation_mm": value}, {"pressure_kpa": 1.0, "elongation_mm": value}):
        with pytest.raises(DataError) as refusal:
            actuator.solve(**given)
        assert "calibration" in refusal.value.remedy


def test_nothing_given_is_refused(actuator: FullModel) -> None:
    """One of the two is needed."""
    with pytest.raises(RequestError):
        actuator.solve()


def test_less_than_vacuum_is_refused() -> None:
    """A wall that never buckles is still refused what no pump can do."""
    thick = ActuatorParameters(cells=1, neck_radius_mm=2.0, belly_radius_mm=2.5, wall_mm=6.0, axial_elements=4)
    with pytest.raises(RequestError, match="vacuum"):
        FullModel(thick).solve(pressure_kpa=-102.0)


def test_a_softer_lattice_moves_more() -> None:
    """One standard deviation of E moves the tip by a tenth of a millimetre and more at +50 kPa."""
    soft = FullModel(replace(ActuatorParameters(), lattice_modulus_kpa=18.34 - 1.86)).solver
    assert soft.solve(pressure_kpa=50.0).elongation_mm - 3.8 == pytest.approx(0.144, abs=0.01)


def test_a_coarse_mesh_has_a_warning() -> None:
    """The default mesh has no warning; a coarse one has, in Python and on the command line."""
    assert FullModel().warnings == ()
    assert FullModel(ActuatorParameters(cells=2, lattice_elements=2)).warnings == ()
    assert "1 in the lattice" in FullModel(ActuatorParameters(cells=2, lattice_elements=1)).warnings[0].text
    solved = CliRunner().invoke(app, ["shadow", "solve", "--pressure", "10", "--json"])
    assert json.loads(solved.stdout)["notes"] == []
