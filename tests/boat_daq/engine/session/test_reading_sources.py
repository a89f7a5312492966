"""Readings from a file or a virtual unit's truth: each to its plateau, or none at all."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from analysis.segmentation.plateau_readings import read_elongation_file
from boat_daq.engine.plan import Plan, StepMark, built_in_plans
from boat_daq.engine.session.reading_sources import (
    FileReading,
    check_against_plan,
    match_readings,
    readings_so_far,
    simulated_reading,
    truth_at_plateaus,
)
from protocol.base.errors import FileError, RequestError
from protocol.base.units import ShownUnits, in_shown_units
from protocol.recording.elongation_file import read_elongation_rows

PLAN = dataclasses.replace(built_in_plans()["calibration"], cycles=2)
STEPS = [StepMark(n, s.cycle, s.branch, s.target_kpa, 10.0, 0, status="reached") for n, s in enumerate(PLAN.steps, 1)]


def rows(pressures: list[float]) -> list[FileReading]:
    """Return readings that number their rows, so that it shows where each one went."""
    return [FileReading(i + 2, p, float(i)) for i, p in enumerate(pressures)]


def write(folder: Path, text: str) -> Path:
    path = folder / "x.csv"
    path.write_bytes(text.encode("utf-8"))
    return path


def test_by_order_each_row_meets_its_plateau() -> None:
    """As many rows as plateaus, at their pressures: the i-th reading belongs to the i-th step."""
    found = match_readings(rows([s.target_kpa for s in STEPS]), STEPS)
    assert found == {step.number: float(i) for i, step in enumerate(STEPS)}


def test_by_order_the_opening_plateau_may_be_left_out() -> None:
    """Without the first row, everything is one plateau later."""
    found = match_readings(rows([s.target_kpa for s in STEPS[1:]]), STEPS)
    assert found == {step.number: float(i) for i, step in enumerate(STEPS[1:])}


def test_shared_plateaus_listed_twice_are_one_hold() -> None:
    """Each branch written with both its ends: equal neighbours are averaged to one reading."""
    down = [50.0 - 10 * n for n in range(10)]
    found = match_readings(rows([*down, *down[::-1]] * 2), STEPS)
    assert len(found) == len(STEPS) == 37
    assert found[1] == 0.0
    assert found[10] == (9 + 10) / 2
    assert found[19] == (19 + 20) / 2


@pytest.mark.parametrize("by_branch", [False, True])
@pytest.mark.parametrize("opening", [True, False])
def test_rows_of_passed_plateaus_are_left_out(by_branch: bool, opening: bool) -> None:
    """A file of the whole plan, for a run that held the ends of its second cycle only, and is in that cycle's end."""
    run = [
        dataclasses.replace(s, detail={"passed": s.cycle == 2 and abs(s.target_kpa - 5.0) < 44.0}) for s in STEPS[:-1]
    ]
    given = [
        FileReading(i, s.target_kpa, float(s.number), *((s.cycle or 1, s.branch) if by_branch else ()))
        for i, s in enumerate(STEPS, 2)
        if opening or s.branch != "start"
    ]
    so_far = readings_so_far(given, PLAN, run)
    held = [step for step in run if not step.passed and (opening or step.branch != "start")]
    assert match_readings(so_far, run) == {step.number: float(step.number) for step in held}


def test_rows_of_a_growing_file_are_those_of_the_plateaus_held() -> None:
    """Written during the run, a row for each plateau that was held."""
    run = [dataclasses.replace(s, detail={"passed": s.number in (21, 22)}) for s in STEPS[:24]]
    held = [step for step in run if not step.passed]
    given = rows([step.target_kpa for step in held])
    assert match_readings(readings_so_far(given, PLAN, run), run) == {s.number: float(i) for i, s in enumerate(held)}


def test_by_cycle_and_branch_in_any_order() -> None:
    """With the two columns the order is free; a branch's first plateau may be named from either side."""
    given = [FileReading(i, s.target_kpa, float(s.number), s.cycle, s.branch) for i, s in enumerate(STEPS) if s.cycle]
    given.append(FileReading(99, 50.0, 1.0, 1, "unloading"))
    found = match_readings(given[::-1], STEPS)
    assert found == {step.number: float(step.number) for step in STEPS}
    again = match_readings([FileReading(2, 50.0, 7.0, 2, "unloading"), FileReading(3, -40.0, 8.0, 2, "loading")], STEPS)
    assert again == {19: 7.0, 28: 8.0}


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ([], "no readings"),
        (rows([50.0, 40.0]), "2 rows for 37 plateaus"),
        (rows([*[s.target_kpa for s in STEPS[:-1]], 0.0]), "line 38 has 0 kPa where the run has 50 kPa"),
        ([FileReading(5, 20.0, 1.0, 7, "loading")], "line 5: no plateau at 20 kPa, cycle 7"),
        ([FileReading(6, 25.0, 1.0, 1, "loading")], "line 6"),
    ],
)
def test_a_file_that_does_not_fit_names_the_line(given: list[FileReading], part: str) -> None:
    """The first row that does not fit is named, and nothing is matched by chance."""
    with pytest.raises(RequestError) as refusal:
        match_readings(given, STEPS)
    assert part in refusal.value.cause
    assert "kPa" not in in_shown_units(refusal.value.cause, ShownUnits.of("mbar"))


def test_a_file_is_checked_before_anything_moves() -> None:
    """Against the plan: a fitting one passes, another is refused, a plan without plateaus too."""
    check_against_plan(rows([s.target_kpa for s in PLAN.steps]), PLAN)
    with pytest.raises(RequestError, match="do not fit"):
        check_against_plan(rows([10.0]), PLAN)
    with pytest.raises(RequestError, match="no plateaus"):
        check_against_plan(rows([10.0]), Plan("c", "continuous", 1))


@pytest.mark.parametrize(
    "text",
    [
        "pressure_kpa,elongation_mm\n50,3.8\n-40,-2.7\n",
        "\ufeff# a comment\nPressure_kPa;elongation_mm\r\n50,0;3,8\r\n-40,0;-2,7\r\n\r\n",
        "elongation_mm\tnote\tpressure_kpa\n3.8\thello\t50\n-2.7\t\t-40\n",
    ],
)
def test_files_as_spreadsheets_write_them(tmp_path: Path, text: str) -> None:
    """Comma, semicolon with decimal comma, tab; a mark of order, comments, other columns."""
    found = read_elongation_rows(write(tmp_path, text))
    assert [(r.pressure_kpa, r.elongation_mm) for r in found] == [(50.0, 3.8), (-40.0, -2.7)]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_record_and_analyze_read_the_same_files_alike(tmp_path: Path, encoding: str) -> None:
    """One owner of the rules: what one accepts the other does, with the same rows; so for what is refused."""
    path = tmp_path / "readings.csv"
    path.write_bytes(
        "# Längen\npressure_kpa;elongation_mm;cycle;branch\n50;3,8;1;unloading\n-40;-2,7;1;loading\n".encode(encoding)
    )
    rows = [(r.pressure_kpa, r.elongation_mm, r.cycle, r.branch) for r in read_elongation_rows(path)]
    assert rows == [(50.0, 3.8, 1, "unloading"), (-40.0, -2.7, 1, "loading")]
    found = read_elongation_file(path)[["pressure_kpa", "elongation_mm", "cycle", "branch"]]
    assert [tuple(row) for row in found.itertuples(index=False)] == rows
    path.write_bytes("pressure_kpa,elongation_mm\n50,3.8\n40,\n".encode(encoding))
    for read, refused in ((read_elongation_rows, RequestError), (read_elongation_file, FileError)):
        with pytest.raises(refused, match="line 3"):
            read(path)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "is empty"),
        ("pressure_kpa,elongation_mm\n", "has no rows"),
        ("pressure,elongation\n1,2\n", "no column 'pressure_kpa'"),
        ("pressure_kpa,elongation_mm,cycle\n1,2,3\n", "only one of the columns"),
        ("pressure_kpa,elongation_mm\n50,3.8\n40,?\n", "line 3"),
        ("pressure_kpa,elongation_mm\n50\n", "line 2"),
        ("pressure_kpa,elongation_mm\n50,nan\n", "line 2: not a finite"),
        ("pressure_kpa,elongation_mm,cycle,branch\n50,3.8,1,sideways\n", "'sideways'"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(tmp_path: Path, text: str, part: str) -> None:
    """Empty, wrong header, no number, not finite, no such branch."""
    with pytest.raises(RequestError) as refusal:
        read_elongation_rows(write(tmp_path, text))
    assert part in refusal.value.cause


def test_a_simulated_reading_lies_on_the_grid_with_the_stated_error() -> None:
    """10,000 readings of one length: multiples of 0.1 mm, their error as the reader's and the rounding's together."""
    rng = np.random.default_rng(1)
    truth = rng.uniform(-2.7, 3.8, 10_000)
    read = np.array([simulated_reading(x, rng, resolution_mm=0.1, reader_sd_mm=0.03) for x in truth])
    assert np.allclose(read * 10, np.round(read * 10), atol=1e-9)
    assert np.std(read - truth) == pytest.approx(np.hypot(0.03, 0.1 / np.sqrt(12)), rel=0.05)


def test_truth_is_taken_over_the_settled_plateau(tmp_path: Path) -> None:
    """A ramp and a hold at 3 mm: the mean over settled .. ended is 3 mm, whatever the ramp did."""
    lines = ["# SIMULATED unit SA1 seed 0", "run,index,time_s,pressure_kpa,elongation_mm,s1_mv,s2_mv"]
    lines += [f"1,{i},{i / 100:.2f},0,{min(i / 100, 3.0):.4f},0,0" for i in range(1000)]
    path = write(tmp_path, "\n".join(lines) + "\n")
    mark = StepMark(4, 1, "loading", 50.0, 10.0, 0, 3_000_000, 4_000_000, 8_000_000, "reached")
    left_out = [
        dataclasses.replace(mark, number=5, status="aborted"),
        dataclasses.replace(mark, number=6, branch="end"),
        dataclasses.replace(mark, number=7, settled_us=90_000_000, ended_us=91_000_000),
    ]
    assert truth_at_plateaus(path, [mark, *left_out]) == {4: pytest.approx(3.0)}


def test_a_file_that_is_no_truth_is_refused(tmp_path: Path) -> None:
    """Another file is refused."""
    with pytest.raises(RequestError, match="not a truth file"):
        truth_at_plateaus(write(tmp_path, "a\nb\n"), STEPS)
