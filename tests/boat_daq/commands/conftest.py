"""Fixtures of the commands' tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.analysis.boat_builder import PAPER, Plant, Staircase, write_boat


@pytest.fixture(scope="session")
def stairs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a recording of one sensor over two cycles and its elongation file, alone in their folder."""
    folder = tmp_path_factory.mktemp("stairs")
    plan = Staircase(Plant(cubics=PAPER[:1], noise_mv=(1.49,), loop_mm=0.25), cycles=2)
    plan.elongations().to_csv(folder / "e.csv", index=False)
    return write_boat(folder / "run.boat", plan.recording()), folder / "e.csv"
