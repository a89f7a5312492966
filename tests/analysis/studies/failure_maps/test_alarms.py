"""Where the monitor's test breaks down: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.alarms import NORMAL
from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "message"),
    [
        ("alarms-false", 0.0, 3.0, WORKS, ""),  # heavy tails alone do no harm
        ("alarms-false", 0.5, NORMAL, WARNS, "if cycles are correlated"),
        ("alarms-shift", 2.0, 20.0, WORKS, ""),
        ("alarms-shift", 1.0, 20.0, WARNS, "not promised to be found"),
        ("alarms-shift", 10.0, 9.0, WORKS, ""),
        ("alarms-shift", 10.0, 8.0, REFUSES, "too short"),
    ],
)
def test_borders_of_the_alarms(name: str, x: float, y: float, outcome: CellOutcome, message: str) -> None:
    """The stated rate and nine shifts in ten on one side; a warning on the other."""
    check_point(name, x, y, outcome, message)
