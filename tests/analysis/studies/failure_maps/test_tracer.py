"""Where the ray tracer ends: both sides of each border."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.parameters import Design
from analysis.studies.failure_maps.sweep import CellOutcome
from analysis.studies.failure_maps.tracer import second_tracer, segments
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "message"),
    [
        ("tracer-grazing", 1e-12, 0.0, WORKS, ""),  # both indices the same: the ray passes
        ("tracer-grazing", 1e-12, 1e-14, WORKS, ""),  # index a little higher: it is reflected
        ("tracer-grazing", 1e-6, 1e-12, WORKS, ""),
        ("tracer-grazing", 1e-6, 1e-14, WORKS, ""),
        ("tracer-grazing", 0.8, 0.5, WORKS, ""),
        ("tracer-bend", 1e-8, 50.0, WORKS, ""),
        ("tracer-bend", 1e-11, 50.0, WARNS, "1 of 1 rays: cut"),
        ("tracer-bend", 1e-10, 5000.0, WARNS, "1 of 1 rays: cut"),
        ("tracer-corner", 1e-6, 45.0, WORKS, ""),
        ("tracer-corner", 1e-10, 45.0, WARNS, "1 of 1 rays: corner"),
        ("tracer-corner", -1e-6, 45.0, WORKS, ""),
        ("tracer-cavity", 0.01, 0.001, WORKS, ""),
        ("tracer-cavity", 0.005, 0.001, REFUSES, "cavity width"),
        ("tracer-cavity", 0.01, 5e-4, REFUSES, "cavity depth"),
        ("tracer-cavity", 1.0, 1.999, WORKS, ""),
        ("tracer-cavity", 1.0, 2.0, REFUSES, "cuts through the guide"),
        ("tracer-cavity", 11.5, 0.5, REFUSES, "does not fit"),
    ],
)
def test_borders_of_the_tracer(name: str, x: float, y: float, outcome: CellOutcome, message: str) -> None:
    """Closed forms and a second tracer agree on one side; what is given up is tallied or refused on the other."""
    check_point(name, x, y, outcome, message)


def test_the_second_tracer_keeps_snells_law_and_the_receiver() -> None:
    """In a plain strip flat rays arrive, steep ones leave at the first wall, a straight ray meets nothing else."""
    angle = np.radians([0.0, 30.0, 48.0, 48.4, 59.0])
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends, hits = second_tracer(segments(Design(cavities=0)), np.tile([0.1, 0.0], (5, 1)), way, 1.5, 1000.0)
    assert ends.tolist() == [1, 1, 1, 0, 0]
    assert hits[[0, 3]].tolist() == [1, 1]
