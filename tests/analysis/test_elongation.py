"""Readings of elongation put to plateaus: the run that broke off on the way."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from analysis.elongation import elongations_of
from analysis.errors import DataError
from analysis.plateaus import Plateau
from analysis.recording import Recording

HELD = ((0.0, None), (50.0, 1), (40.0, 2), (30.0, 3), (0.0, None))  # kPa and step: rest, three steps, vented
BROKEN = cast(
    Recording, SimpleNamespace(steps=pd.DataFrame({"id": [1, 2, 3], "status": ["reached"] * 2 + ["aborted"]}))
)


def plateau(number: int, pressure_kpa: float, step: int | None) -> Plateau:
    nothing = (0.0,)
    return Plateau(
        number, 0, "", 0, 0, 0, 0.0, 1.0, pressure_kpa, 0.0, nothing, nothing, nothing, (1,), 0, 0, step=step
    )


def write(path: Path, pressures_kpa: list[float]) -> Path:
    path.write_text("pressure_kpa,elongation_mm\n" + "".join(f"{p},{p / 10}\n" for p in pressures_kpa))
    return path


@pytest.mark.parametrize("read", [[50.0, 40.0], [50.0, 40.0, 30.0]])
def test_a_broken_run_takes_one_row_for_each_step(tmp_path: Path, read: list[float]) -> None:
    """One row for each step that was reached, or also for the one broken off: rest and vent have none."""
    plateaus = tuple(plateau(n, *held) for n, held in enumerate(HELD, 1))
    found = elongations_of(BROKEN, plateaus, write(tmp_path / "readings.csv", read))
    assert found is not None
    expected = [np.nan] + [p / 10 for p in read] + [np.nan] * (4 - len(read))
    np.testing.assert_array_equal(found.elongation_mm, expected)


def test_rows_at_other_pressures_are_refused(tmp_path: Path) -> None:
    """As many rows as steps, one of them at a pressure that was not held: refused, with the row."""
    plateaus = tuple(plateau(n, *held) for n, held in enumerate(HELD, 1))
    with pytest.raises(DataError, match=r"row 2 says 20 kPa where the run held 40\.0 kPa"):
        elongations_of(BROKEN, plateaus, write(tmp_path / "readings.csv", [50.0, 20.0]))
