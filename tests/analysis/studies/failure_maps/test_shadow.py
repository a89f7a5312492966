"""Where the mechanics breaks down: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "message"),
    [
        ("fem-incompressible", 2e-6, 0.4, WORKS, ""),
        ("fem-incompressible", 1e-7, 0.0, REFUSES, "Poisson's ratio"),
        ("fem-incompressible", 0.2, 0.4, WORKS, ""),
        ("fem-incompressible", 0.2, 0.6, REFUSES, "folded"),
        pytest.param("fem-coarse", 8.0, 4.0, WORKS, "", marks=pytest.mark.nightly),
        ("fem-coarse", 4.0, 4.0, WARNS, "the mesh is coarse"),
        ("reduced-edge", -20.0, -3.4, WORKS, ""),
        ("reduced-edge", -20.0, -3.6, WARNS, "the full model answered"),
        pytest.param("reduced-edge", 54.9, 0.0, WORKS, "", marks=pytest.mark.nightly),
        ("reduced-edge", 55.1, 0.0, WARNS, "the full model answered"),
        ("reduced-edge", -45.0, 0.0, REFUSES, "critical pressure"),
    ],
)
def test_borders_of_the_mechanics(name: str, x: float, y: float, outcome: CellOutcome, message: str) -> None:
    """Lame, a finer mesh and the full model on one side; a warning or a refusal on the other."""
    check_point(name, x, y, outcome, message)
