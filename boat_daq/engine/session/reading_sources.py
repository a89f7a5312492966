"""Readings of elongation from a file or from a virtual board's truth, assigned to their plateaus.

The format of a file is documented in `protocol.recording.elongation_file`. Rules:

- Every row is checked against its plateau's pressure. What does not fit is refused with the first row that does not,
  and nothing of the file is entered.
- Neighbouring cycles share the plateau between them (see `plan`). A file that lists it for both, as it does when each
  branch is written with both its ends, gives two equal neighbours: they are one hold, and their mean is its reading.
- A file by order may begin with the opening plateau or leave it out.
- A virtual unit's reading is its truth over the settled plateau, with a reader's error, rounded to the grid; the source
  of such a reading is "simulated".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from boat_daq.engine.plan import Plan, StepMark
from protocol.base.errors import RequestError
from protocol.base.units import Quantity, UnitText
from protocol.recording.elongation_file import ElongationRow as FileReading

if TYPE_CHECKING:
    from boat_daq.engine.session.session import Session

SIMULATED_SOURCE = "simulated"
SIMULATED_RESOLUTION_MM = 0.02  # a pixel, where a photograph shows 80 mm of the grid on 4,000
READER_SD_MM = 0.005  # of the one who finds the tip in it, before rounding
_NEAR_KPA = 3.0  # a row names its plateau by its target; no closer than this, or a third of the smallest step


def check_against_plan(readings: Sequence[FileReading], plan: Plan) -> None:
    """Refuse a file that will not fit an unbroken run of `plan`, before it begins."""
    if plan.kind != "staircase":
        raise RequestError(f"plan {plan.name} has no plateaus to read elongation at", "omit the file of readings")
    steps = [StepMark(n, s.cycle, s.branch, s.target_kpa, 0.0, 0) for n, s in enumerate(plan.steps, 1)]
    match_readings(readings, steps)


def match_readings(readings: Sequence[FileReading], steps: Sequence[StepMark]) -> dict[int, float]:
    """Return step_id -> elongation (mm) for plateaus in the order of the run."""
    plateaus = [step for step in steps if step.branch != "end" and not step.passed]
    if not readings or not plateaus:
        raise RequestError("there are no readings" if plateaus else "the run has no plateaus", "nothing was entered")
    levels = sorted({step.target_kpa for step in plateaus})
    near = min([_NEAR_KPA, *((b - a) / 3 for a, b in pairwise(levels))])
    if readings[0].cycle is not None:
        return _by_branch(readings, plateaus, near)
    return _by_order(readings, plateaus, near)


def _by_order(readings: Sequence[FileReading], plateaus: list[StepMark], near: float) -> dict[int, float]:
    misfit: str = f"{len(readings)} rows for {len(plateaus)} plateaus"
    for rows in (list(readings), _merged(readings)):
        for chosen in (plateaus, [step for step in plateaus if step.branch != "start"]):
            if len(rows) != len(chosen):
                continue
            pairs = list(zip(rows, chosen, strict=True))
            wrong = next((p for p in pairs if abs(p[0].pressure_kpa - p[1].target_kpa) > near), None)
            if wrong is None:
                return {step.number: row.elongation_mm for row, step in pairs}
            row, step = wrong
            found, wanted = (Quantity(kpa, "kPa") for kpa in (row.pressure_kpa, step.target_kpa))
            misfit = UnitText(f"line {row.line} has ", found, " where the run has ", wanted)
    remedy = "give one row for each plateau, in order; none was entered"
    raise RequestError(UnitText("the readings do not fit the plateaus: ", misfit), remedy)


def _merged(readings: Sequence[FileReading]) -> list[FileReading]:
    """Return one row for neighbours at one pressure, their mean: they are one hold."""
    groups = (list(group) for _, group in groupby(readings, key=lambda row: row.pressure_kpa))
    return [replace(g[0], elongation_mm=sum(row.elongation_mm for row in g) / len(g)) for g in groups]


def _by_branch(readings: Sequence[FileReading], plateaus: list[StepMark], near: float) -> dict[int, float]:
    found: dict[int, list[float]] = {}
    for row in readings:
        step = _plateau_of(row, plateaus, near)
        if step is None:
            at = Quantity(row.pressure_kpa, "kPa")
            cause = UnitText(f"line {row.line}: no plateau at ", at, f", cycle {row.cycle}, {row.branch}")
            raise RequestError(cause, "check cycle, branch (unloading or loading) and pressure; none was entered")
        found.setdefault(step.number, []).append(row.elongation_mm)
    return {number: sum(values) / len(values) for number, values in found.items()}


def _plateau_of(row: FileReading, plateaus: list[StepMark], near: float) -> StepMark | None:
    """Return the plateau of a row. Its own branch's, or the one at which that branch begins."""
    own = [i for i, step in enumerate(plateaus) if step.cycle == row.cycle and step.branch == row.branch]
    first = own[0] if own else next((i + 1 for i, s in enumerate(plateaus) if s.branch == row.branch == "start"), 0)
    candidates = [*own, first - 1] if first else own
    return next((plateaus[i] for i in candidates if abs(plateaus[i].target_kpa - row.pressure_kpa) <= near), None)


def enter_readings(session: Session, readings: Sequence[FileReading]) -> int:
    """Enter a file's readings for the plateaus reached; return how many."""
    matched = match_readings(readings, [step for step in session.steps() if step.status == "reached"])
    for step_id, elongation_mm in matched.items():
        _add_once(session, step_id, elongation_mm, "csv")
    return len(matched)


def readings_so_far(readings: Sequence[FileReading], plan: Plan, steps: Sequence[StepMark]) -> tuple[FileReading, ...]:
    """Return the rows of a file for the plateaus that a run has reached."""
    reached = [step for step in steps if step.status == "reached" and step.branch != "end"]
    planned = [StepMark(n, s.cycle, s.branch, s.target_kpa, 0.0, 0) for n, s in enumerate(plan.steps, 1)]
    if readings and readings[0].cycle is not None:
        held = [step for step in reached if not step.passed]
        later = [
            row for row in readings if _plateau_of(row, planned, _NEAR_KPA) and not _plateau_of(row, held, _NEAR_KPA)
        ]
        return tuple(row for row in readings if row not in later)  # with those of no plateau at all, which are refused
    try:
        matched = match_readings(readings, planned)
    except RequestError:
        return tuple(readings)
    known = [(step, matched.get(number)) for number, step in enumerate(planned, 1)]
    now = [(step, mm) for (_, mm), step in zip(known, reached, strict=False) if mm is not None and not step.passed]
    return tuple(FileReading(n, step.target_kpa, mm) for n, (step, mm) in enumerate(now, 1))


def _add_once(session: Session, step_id: int, elongation_mm: float, source: str, **details: Any) -> None:
    """Add a reading that the recording does not have yet."""
    if not any(r.step_id == step_id and r.elongation_mm == elongation_mm for r in session.readings()):
        session.add_reading(step_id, elongation_mm, source, **details)


def simulated_reading(truth_mm: float, rng: np.random.Generator, *, resolution_mm: float, reader_sd_mm: float) -> float:
    """Return a reading of a true elongation, mm: with an error, rounded to the grid.

    `resolution_mm`: distance of the lines of the grid.
    """
    return round((truth_mm + reader_sd_mm * rng.standard_normal()) / resolution_mm) * resolution_mm


def truth_at_plateaus(truth_csv: Path, steps: Sequence[StepMark]) -> dict[int, float]:
    """Return step_id -> mean true elongation (mm) over each settled plateau."""
    try:
        table = np.genfromtxt(truth_csv, delimiter=",", names=True, comments="#", usecols=(2, 4), skip_header=1)
        time_us, elongation_mm = table["time_s"] * 1e6, table["elongation_mm"]
    except (OSError, ValueError, IndexError) as error:
        raise RequestError(f"{truth_csv} is not a truth file of a virtual board: {error}") from error
    found = {}
    for step in steps:
        if step.status == "reached" and step.branch != "end" and step.settled_us is not None:
            inside = (time_us >= step.settled_us) & (time_us <= (step.ended_us or step.settled_us))
            if inside.any():
                found[step.number] = float(elongation_mm[inside].mean())
    return found


def enter_simulated_readings(
    session: Session,
    truth_csv: Path | None = None,
    *,
    seed: int = 0,
    resolution_mm: float = SIMULATED_RESOLUTION_MM,
    reader_sd_mm: float = READER_SD_MM,
) -> int:
    """Enter readings of a virtual unit, from its truth; return how many.

    `truth_csv`: what the board wrote; by default that of `Session.simulated`. `seed`: seed of the reader's error.
    """
    if truth_csv is None and session.virtual_board is not None:
        truth_csv = session.virtual_board.truth
    if not session.snapshot().simulated or truth_csv is None:
        raise RequestError("only a virtual board has true elongations", "type the readings of a real unit")
    rng = np.random.default_rng(seed)
    truth = truth_at_plateaus(truth_csv, session.steps())
    for step_id, truth_mm in truth.items():
        seen_mm = simulated_reading(truth_mm, rng, resolution_mm=resolution_mm, reader_sd_mm=reader_sd_mm)
        _add_once(session, step_id, seen_mm, SIMULATED_SOURCE, resolution_mm=resolution_mm, reader="virtual reader")
    return len(truth)
