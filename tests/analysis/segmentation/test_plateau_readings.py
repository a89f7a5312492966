"""Readings of elongation put to plateaus: the run that broke off on the way."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from analysis import (
    BoatDaqError,
    Options,
    analyse,
    find_cycles,
    find_plateaus,
)
from analysis.data.recording import READING_COLUMNS, Recording
from analysis.segmentation.plateau_readings import elongations_of
from analysis.segmentation.plateaus import Plateau
from protocol.base.errors import DataError
from tests.analysis.boat_builder import Plant, Staircase

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


LOOP = 0.25
QUICK = Options(mcmc=False, x_resolution_mm=0.0)


def elongation_file(stairs: Staircase, folder: Path) -> Path:
    """The exact elongations of a staircase as a file."""
    path = folder / "elongation.csv"
    stairs.elongations().to_csv(path, index=False)
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
    with pytest.raises(DataError, match=r"row 2 is at 20 kPa where the run held 40\.0 kPa"):
        elongations_of(BROKEN, plateaus, write(tmp_path / "readings.csv", [50.0, 20.0]))


def test_a_plan_of_negative_pressures_leaves_its_vented_ends_unread(tmp_path: Path) -> None:
    """Holds from -5 to -45 kPa, two cycles, vented before and after: the file's 33 rows go to the 33 holds."""
    down = np.arange(-5.0, -46.0, -5.0)
    read = np.concatenate([down, down[-2::-1], down[1:], down[-2::-1]])
    held = np.repeat(np.concatenate([[0.0], read, [0.0]]), 300)
    recording = Plant().run(held, np.gradient(held) > 0, np.zeros(held.size))
    plateaus = find_plateaus(recording, find_cycles(recording))
    table = tmp_path / "readings.csv"
    pd.DataFrame({"pressure_kpa": read, "elongation_mm": read / 20.0}).to_csv(table, index=False)
    found = elongations_of(recording, plateaus, table)
    assert found is not None
    assert np.isnan(found.elongation_mm[[0, -1]]).all()
    np.testing.assert_allclose(found.elongation_mm[1:-1], read / 20.0)


@pytest.mark.parametrize(("entered", "counts"), [([1.5, None], np.nan), ([1.5, None, 2.5], 2.5), ([1.5, 2.0], 2.0)])
def test_a_withdrawn_reading_counts_no_more(entered: list[float | None], counts: float) -> None:
    """The last entry for a step counts: a correction, and also an empty one, which withdraws; its neighbour stays."""
    readings = pd.DataFrame(
        [(i, "", 2, mm, 0.5, "typed", "", "") for i, mm in enumerate(entered)]
        + [(9, "", 1, 3.0, 0.5, "typed", "", "")],
        columns=list(READING_COLUMNS),
    )
    recording = Recording.from_arrays([0.0, 1.0], [0.0, 0.0], [1.0, 1.0], readings=readings)
    found = elongations_of(recording, tuple(plateau(n, *held) for n, held in enumerate(HELD, 1)))
    assert found is not None
    np.testing.assert_array_equal(found.elongation_mm, [np.nan, 3.0, counts, np.nan, np.nan])


def test_a_run_whose_readings_were_all_withdrawn_was_not_read() -> None:
    """One reading, withdrawn: the run counts as one without readings."""
    readings = pd.DataFrame(
        [(i, "", 1, mm, 0.5, "typed", "", "") for i, mm in enumerate([3.0, None])], columns=list(READING_COLUMNS)
    )
    recording = Recording.from_arrays([0.0, 1.0], [0.0, 0.0], [1.0, 1.0], readings=readings)
    assert elongations_of(recording, tuple(plateau(n, *held) for n, held in enumerate(HELD, 1))) is None


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda f: f.iloc[:-3], "88 rows where the run has"),
        (lambda f: f.assign(pressure_kpa=f["pressure_kpa"].to_numpy()[::-1] + 7), "row 1 is at"),
        (lambda f: f.rename(columns={"elongation_mm": "x"}), "no column 'elongation_mm'"),
    ],
)
def test_an_elongation_file_that_does_not_fit_is_refused(tmp_path: Path, change, cause: str) -> None:  # type: ignore[no-untyped-def]
    """The reason names the count, the first row, or the column."""
    stairs = Staircase()
    path = tmp_path / "wrong.csv"
    change(stairs.elongations()).to_csv(path, index=False)
    with pytest.raises(BoatDaqError, match=cause):
        analyse(stairs.recording(), path, options=QUICK)


def test_elongations_by_cycle_and_branch_match_those_by_order(tmp_path: Path) -> None:
    """The same readings, shuffled, with cycle and branch columns, one given twice, give the same calibration."""
    stairs = Staircase(Plant(loop_mm=LOOP))
    frame = stairs.elongations()
    frame["cycle"] = [k for _, _, k in stairs.levels()]
    frame["branch"] = ["loading" if up else "unloading" for _, up, _ in stairs.levels()]
    path = tmp_path / "named.csv"
    twice = frame.loc[[5, 5]]
    twice["elongation_mm"] += [0.1, -0.1]
    pd.concat([frame.drop(5), twice]).sample(frac=1.0, random_state=0).to_csv(path, index=False)
    named = analyse(stairs.recording(), path, options=QUICK)
    ordered = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK)
    a, b = named.sensors[0].calibration, ordered.sensors[0].calibration
    assert a is not None
    assert b is not None
    np.testing.assert_allclose(a.coefficients, b.coefficients, rtol=1e-9)


def test_readings_of_a_cycle_that_broke_off_are_left_out_as_it_is(tmp_path: Path) -> None:
    """A run that ends in its third cycle, read to its end: the calibration is that of the two complete ones."""
    stairs = Staircase(Plant(loop_mm=LOOP), cycles=3)
    run, path, levels = stairs.recording(), tmp_path / "named.csv", stairs.levels()
    held = len(levels) - 12
    frame = stairs.elongations()[:held].assign(cycle=[k for _, _, k in levels][:held])
    frame["branch"] = ["loading" if up else "unloading" for _, up, _ in levels][:held]
    end = stairs.trace()[3][held - 1][1]
    broken = Recording.from_arrays(run.time_s[:end], run.pressure_kpa[:end], run.signal_mv[:end])
    found = []
    for rows in (frame, frame[frame["cycle"] < 3]):
        rows.to_csv(path, index=False)
        analysis = analyse(broken, path, options=QUICK)
        assert analysis.sensors[0].calibration is not None
        found.append(analysis.sensors[0].calibration.coefficients)
    np.testing.assert_array_equal(*found)
    frame.assign(pressure_kpa=frame["pressure_kpa"].where(frame.index < held - 1, 25.0)).to_csv(path, index=False)
    with pytest.raises(BoatDaqError, match="has none"):
        analyse(broken, path, options=QUICK)
