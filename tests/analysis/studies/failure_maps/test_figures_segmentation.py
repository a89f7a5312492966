"""Where a staircase is no longer found: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point
from tests.conftest import mostly_at_night


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "message"),
    mostly_at_night(
        ("segmentation-noise", 0.3, 0.5, REFUSES, "does not fit the plateaus"),
        ("segmentation-alone", 10.0, 0.1, WARNS, "the pressure noise"),
        ("segmentation-lost", 1.0, 10.0, WARNS, "samples lost"),
        ("segmentation-lost", 40.0, 100.0, REFUSES, "does not fit the plateaus"),
        ("segmentation-wire", 0.1, 10.0, WARNS, "too small to be a cycle"),
        ("segmentation-wire", 1.0, 3.0, REFUSES, "does not fit the plateaus"),
        ("segmentation-start", -20.0, 1.0, WORKS, ""),
        ("segmentation-start", 20.0, 0.5, REFUSES, "does not fit the plateaus"),
        ("segmentation-small", 10.0, 0.05, WARNS, "noise alone accounts for"),
        ("segmentation-small", 1.0, 1.0, REFUSES, "no complete cycle"),
        ("segmentation-noise", 0.3, 0.8, WORKS, ""),
        ("segmentation-noise", 2.0, 2.0, WARNS, "the pressure noise of 2 kPa is 2.2 % of the pressure span"),
        ("segmentation-noise", 20.0, 2.0, REFUSES, "plateaus"),
        ("segmentation-alone", 0.3, 0.1, WORKS, ""),
        ("segmentation-wire", 0.0, 3.0, WORKS, ""),
        ("segmentation-start", 5.0, 2.0, WORKS, ""),
        ("segmentation-small", 20.0, 0.05, WORKS, ""),
        by_day=10,
    ),
)
def test_borders_of_the_segmentation(name: str, x: float, y: float, outcome: CellOutcome, message: str) -> None:
    """Figures of the formula within 0.5 % FSO on one side; a message about the pressure on the other."""
    check_point(name, x, y, outcome, message)
