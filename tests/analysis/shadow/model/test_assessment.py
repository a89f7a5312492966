"""What a reader of one state has to know: margin, imperfect print, contradictions."""

from __future__ import annotations

import math

import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.assessment import assess, collapse_kpa, nominal_band
from analysis.shadow.model.full import FullModel
from analysis.warning import WarningCode

SMALL = ActuatorParameters(cells=2, axial_elements=4, wall_elements=1, lattice_elements=2)


@pytest.fixture(scope="module")
def small() -> FullModel:
    """An actuator that is solved quickly; it buckles at -48.8 kPa."""
    return FullModel(SMALL)


def codes(model: FullModel, error_mm: float = 0.01, **given: float) -> list[WarningCode]:
    """The warnings of a state, without that of the coarse mesh."""
    found = assess(model, model.solve(**given), error_mm)
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


def test_an_imperfect_print_grows_before_the_perfect_shape_buckles(small: FullModel) -> None:
    """More at more vacuum, less than it was under pressure; a large oval has a warning."""
    growth = [assess(small, small.solve(pressure_kpa=p)).growth_mm for p in (30.0, -20.0, -40.0)]
    assert -0.01 < growth[0] < 0.0 < growth[1] < growth[2]
    assert codes(small, pressure_kpa=-48.7, error_mm=0.0) == []
    assert codes(small, pressure_kpa=-40.0, error_mm=1.0) == [WarningCode.LARGE_OVAL]


@pytest.mark.nightly
def test_a_worse_print_collapses_earlier(actuator: FullModel) -> None:
    """By Koiter's power of two thirds near the limit: ten times the error, between 4 and 5.5 times the distance."""
    critical = actuator.vacuum_limit.pressure_kpa
    near, far = (collapse_kpa(actuator, error) - critical for error in (1e-3, 1e-2))
    assert 0.1 < near < 0.5
    assert 4.0 < far / near < 5.5
    beyond = assess(actuator, actuator.solve(pressure_kpa=critical + 0.5 * far), 0.01)
    assert math.isnan(beyond.growth_mm)
    assert [warning.code for warning in beyond.warnings] == [WarningCode.COLLAPSE]
