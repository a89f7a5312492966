"""Parameters of the actuator: checked, hashed, fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from protocol.base.errors import ConvergenceError, RequestError
from tests.analysis.shadow.geometry_fit import fit_geometry


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cells", 0),
        ("cells", 2.5),
        ("cells", True),
        ("pitch_mm", float("nan")),
        ("wall_mm", -1.0),
        ("wall_mm", 30.0),
        ("neck_radius_mm", 9.0),
        ("envelope_radius_mm", 9.0),
        ("guide_bow_mm", 26.0),
        ("axial_elements", 100_000),
        ("wall_poisson", 0.5),
        ("lattice_modulus_kpa", 0.0),
        ("pitch_mm", "12.5"),
    ],
)
def test_impossible_parameters_are_named(name: str, value: float) -> None:
    """The refusal names the parameter or what is wrong with it, and has a remedy."""
    with pytest.raises(RequestError) as refusal:
        replace(ActuatorParameters(), **{name: value})  # type: ignore[arg-type]
    assert refusal.value.cause
    assert refusal.value.remedy


def test_digest_follows_every_value() -> None:
    """Equal parameters share a table, any change gets its own."""
    base = ActuatorParameters()
    assert base.digest == ActuatorParameters().digest
    assert base.digest != replace(base, wall_mm=2.2000001).digest


def test_the_fit_finds_the_defaults_from_elsewhere() -> None:
    """From another wall and neck the fit returns to the default geometry, with its sensitivities."""
    fit = fit_geometry(replace(ActuatorParameters(), wall_modulus_kpa=1100.0, neck_radius_mm=4.6))
    assert fit.parameters.wall_modulus_kpa == pytest.approx(ActuatorParameters().wall_modulus_kpa, rel=1e-3)
    assert fit.parameters.neck_radius_mm == pytest.approx(ActuatorParameters().neck_radius_mm, abs=1e-2)
    assert np.abs(fit.residual_mm).max() < 1e-4
    assert fit.sensitivity[0, 0] < 0 < fit.sensitivity[1, 0]  # a stiffer wall moves less, either way


def test_an_impossible_fit_is_rejected_with_its_misfit() -> None:
    """A bladder that is nearly a straight tube does not meet both targets: the best misfit is shown."""
    tube = ActuatorParameters(cells=2, belly_radius_mm=4.3, neck_radius_mm=4.2, axial_elements=4, lattice_elements=2)
    with pytest.raises(ConvergenceError, match="misfit"):
        fit_geometry(tube)
