"""The margin of one state and its warnings."""

from __future__ import annotations

import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel, assess, nominal_band
from analysis.warning import WarningCode

SMALL = ActuatorParameters(cells=2, axial_elements=4, wall_elements=1, lattice_elements=2)


@pytest.fixture(scope="module")
def small() -> FullModel:
    """An actuator that is solved quickly; it buckles at -48.8 kPa."""
    return FullModel(SMALL)


def codes(model: FullModel, **given: float) -> list[WarningCode]:
    """The warnings of a state, without that of the coarse mesh."""
    found = assess(model, model.solve(**given))
    return [w.code for w in found.warnings if w.code is not WarningCode.COARSE_MESH]


def test_contradictory_pressure_and_elongation_have_a_warning(small: FullModel) -> None:
    """At 20 kPa 20 mm needs a force; the free actuator's own elongation, and one within its band, need no warning."""
    free, half = nominal_band(small, 20.0)
    assert codes(small, pressure_kpa=20.0) == []
    assert codes(small, pressure_kpa=20.0, elongation_mm=free + 0.9 * half) == []
    assert codes(small, pressure_kpa=20.0, elongation_mm=free + 1.1 * half) == [WarningCode.CONTRADICTORY_STATE]
    text = assess(small, small.solve(pressure_kpa=20.0, elongation_mm=20.0)).warnings[-1].text
    assert "20 kPa and 20 mm contradict each other" in text
    assert " N at the tip" in text
