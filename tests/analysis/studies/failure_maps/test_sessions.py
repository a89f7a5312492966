"""Where a calibration session breaks down: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("wave_mv", "grid_mm", "outcome", "message"),
    [
        pytest.param(0.0, 0.02, WORKS, "", marks=pytest.mark.nightly),
        pytest.param(0.1, 0.02, WORKS, "", marks=pytest.mark.nightly),
        (1.0, 0.02, WARNS, "misses the position means"),
        pytest.param(3.0, 0.2, WARNS, "misses the position means", marks=pytest.mark.nightly),
        pytest.param(1.0, 0.5, WORKS, "", marks=pytest.mark.nightly),
        (10.0, 0.5, WARNS, "predicts better"),
    ],
)
def test_borders_of_a_cubic_through_no_cubic(
    wave_mv: float, grid_mm: float, outcome: CellOutcome, message: str
) -> None:
    """U holds the truth where the wave is too small to be found; where it is not, the curve is called doubtful."""
    check_point("fit-adequacy", wave_mv, grid_mm, outcome, message)


@pytest.mark.parametrize(
    ("loop_mv", "grid_mm"),
    [
        (10.0, 0.02),
        (0.0, 1.0),
        *(pytest.param(*at, marks=pytest.mark.nightly) for at in ((0.0, 0.02), (3.0, 0.5), (10.0, 0.0))),
    ],
)
def test_borders_of_a_loop(loop_mv: float, grid_mm: float) -> None:
    """The interval of the loop's width holds it on fine and on coarse grids, with a loop and without."""
    check_point("fit-loop", loop_mv, grid_mm, WORKS)
