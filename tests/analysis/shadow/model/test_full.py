"""The actuator as a whole, its fit, its guides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import ConvergenceError, DataError, RequestError
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.guides import both_guides, embed, make_guides, rest_centreline
from tests.analysis.shadow.geometry_fit import fit_geometry


def test_defaults_meet_the_papers_range(actuator: FullModel) -> None:
    """+3.8 mm at +50 kPa and -2.7 mm at -40 kPa, to a thousandth of a millimetre."""
    assert actuator.solve(pressure_kpa=50.0).elongation_mm == pytest.approx(3.8, abs=1e-3)
    assert actuator.solve(pressure_kpa=-40.0).elongation_mm == pytest.approx(-2.7, abs=1e-3)


def test_the_fit_finds_the_defaults_from_elsewhere() -> None:
    """From another wall and neck the fit returns to the default geometry, with its sensitivities."""
    fit = fit_geometry(replace(ActuatorParameters(), wall_modulus_kpa=1100.0, neck_radius_mm=4.6))
    assert fit.parameters.wall_modulus_kpa == pytest.approx(ActuatorParameters().wall_modulus_kpa, rel=1e-3)
    assert fit.parameters.neck_radius_mm == pytest.approx(ActuatorParameters().neck_radius_mm, abs=1e-2)
    assert np.abs(fit.residual_mm).max() < 1e-4
    assert fit.sensitivity[0, 0] < 0 < fit.sensitivity[1, 0]  # a stiffer wall moves less, either way


def test_a_fit_that_cannot_be_is_said() -> None:
    """A bladder that is nearly a straight tube does not meet both targets: the best misfit is shown."""
    tube = ActuatorParameters(belly_radius_mm=4.3, neck_radius_mm=4.2, axial_elements=4, lattice_elements=2)
    with pytest.raises(ConvergenceError, match="misfit"):
        fit_geometry(tube)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_a_calibration_gives_outside_its_range_is_refused(actuator: FullModel, value: float) -> None:
    """NaN and infinities are named as such, for either quantity."""
    for asked in ({"pressure_kpa": value}, {"elongation_mm": value}, {"pressure_kpa": 1.0, "elongation_mm": value}):
        with pytest.raises(DataError) as refusal:
            actuator.solve(**asked)
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


def test_guides_are_carried_exactly(actuator: FullModel) -> None:
    """Embedded points follow a displacement field that is linear in r and z to rounding."""
    inside = rest_centreline(actuator.parameters, actuator.length_mm)
    inside = inside[(inside[:, 1] > 0) & (inside[:, 1] < actuator.length_mm)]
    carried = embed(actuator.mesh, inside, actuator.length_mm).positions(actuator.mesh.nodes * (0.02, 0.05))
    np.testing.assert_allclose(carried, inside * (1.02, 1.05), atol=1e-10)


def test_guides_are_as_in_the_paper(actuator: FullModel) -> None:
    """Seven tracked points, centrelines every 0.5 mm, both ends in a common junction, guide 2 the mirror of guide 1."""
    guides = actuator.guides
    assert guides.tracked.rest_mm.shape == (7, 2)
    steps = np.linalg.norm(np.diff(guides.centreline.rest_mm, axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.5, atol=0.003)
    pair = both_guides(guides.tracked.rest_mm)
    np.testing.assert_array_equal(pair[1], pair[0] * (-1, 1))
    np.testing.assert_allclose(pair[:, [0, -1], 0], 0.0, atol=1e-12)


def test_rigid_ends_carry_the_junctions(actuator: FullModel) -> None:
    """The base's junction stays, the tip's moves with the plate."""
    state = actuator.solve(pressure_kpa=50.0)
    moved = actuator.tracked(state) - actuator.guides.tracked.rest_mm
    np.testing.assert_allclose(moved[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(moved[-1], (0.0, state.elongation_mm), atol=1e-12)


def test_a_guide_outside_the_lattice_is_refused(actuator: FullModel) -> None:
    """One that would run through the bladder is refused, with the place."""
    with pytest.raises(RequestError, match="leaves the lattice"):
        make_guides(replace(actuator.parameters, guide_bow_mm=9.0), actuator.mesh)
