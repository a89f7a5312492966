"""Readings of elongation, matched to their plateaus.

A reading of the session carries its step, and so its plateau; a file's rows are matched by order or by their cycle and
branch columns, and checked by pressure. A file that does not fit is refused with the first place where it does not.
The reading that counts for a step is the last one entered. The grid that readings were taken from is that of their own
steps, unless it is stated; photographs state their error as that of a grid.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.data.recording import Recording
from analysis.segmentation.plateaus import Plateau
from analysis.statistics import mean, standard_error
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, FileError, RequestError
from protocol.recording.elongation_file import read_elongation_rows, reason_of

BY_IMAGE = ("photograph", "camera")  # sources of readings whose resolution is no grid
MOST_SLIPS = 0.1  # of the readings: a slip of the pen does not refine a grid
_CHANCE = 0.02  # that readings of a finer grid are all on the coarser one
_DECIMALS = 6  # more have computed values alone
_NEAR_KPA = 3.0  # a reading belongs to a plateau no farther than this, or than a third of the smallest step


@dataclass(frozen=True, slots=True)
class Elongations:
    """Elongation at each plateau: [plateaus] mm, NaN where none was read; the grid's resolution; where from.

    `resolution_mm` is that of `steps_mm`, their own steps, unless they are of images; `stated_mm` was set for the run.

    `confirmed`: the reason of each reading that was checked and confirmed, by its plateau, counted from 0;
    `of_recording`: they are stored in the recording.
    """

    elongation_mm: FloatArray
    resolution_mm: float
    source: str
    confirmed: Mapping[int, str] = field(default_factory=dict)
    of_recording: bool = False
    steps_mm: float = float("nan")
    stated_mm: float | None = None

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """[plateaus] True where an elongation was read."""
        return np.isfinite(self.elongation_mm)


Readings: TypeAlias = str | Path | pd.DataFrame | npt.ArrayLike


def elongations_of(
    recording: Recording, plateaus: tuple[Plateau, ...], readings: Readings | None = None
) -> Elongations | None:
    """Return the elongations given (CSV, frame with its columns, or [plateaus] in mm), or of the recording, or None."""
    if readings is None:
        return _from_session(recording, plateaus) or _from_column(recording, plateaus)
    if isinstance(readings, pd.DataFrame):
        frame, name = _checked_frame(readings), "the frame"
    elif isinstance(readings, str | Path):
        frame, name = read_elongation_file(readings), Path(readings).name
    else:
        return _from_values(np.asarray(readings, dtype=np.float64).ravel(), plateaus)
    steps = recording.steps
    reached = set(steps.loc[steps["status"] == "reached", "id"].tolist())
    return _from_file(frame, plateaus, reached, name)


def _checked_frame(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a frame as `read_elongation_file` returns it. DataError: a column is missing."""
    missing = {"pressure_kpa", "elongation_mm"} - set(frame.columns)
    if missing:
        raise DataError(f"the readings lack {', '.join(sorted(missing))}", "Give pressure_kpa and elongation_mm.")
    return frame.assign(confirmed=frame.get("confirmed", "")).reset_index(drop=True)


def _from_values(values: FloatArray, plateaus: tuple[Plateau, ...]) -> Elongations:
    """Return values in the order of the plateaus: of all, or of those in cycles. DataError: another number."""
    in_cycles = [plateau.number for plateau in plateaus if plateau.branch]
    full = np.full(len(plateaus), np.nan)
    if values.size == len(plateaus):
        full = values
    elif values.size == len(in_cycles):
        full[[at for at, plateau in enumerate(plateaus) if plateau.branch]] = values
    else:
        cause = f"{values.size} elongations for {len(plateaus)} plateaus, {len(in_cycles)} of them in cycles"
        raise DataError(cause, "Give one for each, NaN where none was read.")
    return Elongations(full, steps_of(full), "values", steps_mm=steps_of(full))


def read_elongation_file(path: str | Path) -> pd.DataFrame:
    """Read a CSV of elongations, as `protocol.recording.elongation_file` describes it.

    Returns `pressure_kpa`, `elongation_mm`, `confirmed`, and `cycle` and `branch` if the file has them; raises
    FileError with the line.
    """
    try:
        rows = read_elongation_rows(Path(path))
    except RequestError as error:
        raise FileError(error.cause, error.remedy) from error
    frame = pd.DataFrame({name: [getattr(row, name) for row in rows] for name in ("pressure_kpa", "elongation_mm")})
    frame["confirmed"] = [row.confirmed for row in rows]
    if rows[0].cycle is not None:
        frame["cycle"] = [row.cycle for row in rows]
        frame["branch"] = [row.branch for row in rows]
    return frame


def _from_column(recording: Recording, plateaus: tuple[Plateau, ...]) -> Elongations | None:
    """Return the means of a displacement column over the plateaus; its resolution and their scatter are one u.

    A reading's standard uncertainty is its resolution over sqrt(12), so the scatter is stated as a wider resolution.
    """
    name = recording.meta.get("elongation_channel")
    names = [channel.column for channel in recording.channels]
    if name not in names or recording.channel is None:
        return None
    column = recording.channel[:, names.index(str(name))]
    parts = [column[p.settled_first : p.last + 1] for p in plateaus]
    means = np.array(
        [mean(part[np.isfinite(part)]) if not p.void else np.nan for p, part in zip(plateaus, parts, strict=True)]
    )
    errors = np.array([standard_error(part[np.isfinite(part)]) for part in parts])
    known = np.isfinite(means) & np.isfinite(errors)
    if not known.any():
        return None
    steps = np.diff(np.unique(column[np.isfinite(column)]))
    resolution_mm = float(steps.min()) if steps.size and steps.size < column.size / 3 else 0.0
    scatter_mm = float(np.sqrt(np.mean(errors[known] ** 2)))
    return Elongations(means, float(np.hypot(resolution_mm, np.sqrt(12.0) * scatter_mm)), "displacement column")


def _from_session(recording: Recording, plateaus: tuple[Plateau, ...]) -> Elongations | None:
    if recording.readings.empty:
        return None
    current = recording.current_readings
    read = pd.to_numeric(current["elongation_mm"], errors="coerce").astype(float)
    if not np.isfinite(read).any():
        return None  # every reading was withdrawn
    elongation = dict(zip(current["step"].tolist(), read.tolist(), strict=True))
    taken: set[int] = set()
    values = np.full(len(plateaus), np.nan)
    notes = current["note"] if "note" in current else [""] * len(current)
    reasons = {step: reason_of(note) for step, note in zip(current["step"], notes, strict=True)}
    confirmed: dict[int, str] = {}
    for i, plateau in enumerate(plateaus):
        if plateau.step is not None and plateau.step in elongation and plateau.step not in taken:
            values[i] = elongation[plateau.step]
            taken.add(plateau.step)
            if reasons[plateau.step]:
                confirmed[i] = reasons[plateau.step]
    resolution = pd.to_numeric(current["resolution_mm"], errors="coerce").dropna()
    sources = ", ".join(sorted(set(map(str, current["source"]))))
    stated = float(resolution.median()) if len(resolution) else None
    steps = steps_of(values)
    by_image = current["source"].astype(str).isin(BY_IMAGE).mean() > 0.5
    used = stated if by_image and stated is not None else steps
    return Elongations(values, used, sources, confirmed, of_recording=True, steps_mm=steps, stated_mm=stated)


def _from_file(frame: pd.DataFrame, plateaus: tuple[Plateau, ...], reached: set[int], name: str) -> Elongations:
    if not plateaus:
        raise DataError("the run has no plateaus, so the elongations have no plateau", "Record a staircase.")
    near = _near(plateaus)
    if {"cycle", "branch"} <= set(frame.columns):
        values, confirmed = _by_branch(frame, plateaus, near, name)
    else:
        values, confirmed = _by_order(frame, plateaus, reached, near=near, name=name)
    steps = steps_of(values)
    return Elongations(values, steps, name, confirmed, steps_mm=steps)


def steps_of(readings: FloatArray) -> float:
    """Return the grid (1, 2 or 5 times a power of ten, mm) that readings were taken from; 0 for values on none.

    The coarsest that nine tenths of the readings lie on, unless so few distinct ones would by chance; NaN without any.
    """
    values = np.asarray(readings, dtype=np.float64)
    values = values[np.isfinite(values)]
    if not values.size:
        return float("nan")
    grids = [factor * 10.0**-places for places in range(_DECIMALS, -1, -1) for factor in (1.0, 2.0, 5.0)]
    found = 0.0
    for grid in grids:
        on = np.abs(values - grid * np.round(values / grid)) < 1e-9
        if (~on).sum() > MOST_SLIPS * values.size:
            continue
        if found == 0.0 or (grid / found) ** -np.unique(values[on]).size < _CHANCE:
            found = grid
    return found


def _near(plateaus: tuple[Plateau, ...]) -> float:
    levels = np.sort([p.pressure_kpa for p in plateaus if np.isfinite(p.pressure_kpa)])
    steps = np.diff(levels)
    steps = steps[steps > 2.0]
    return float(min(_NEAR_KPA, steps.min() / 3)) if steps.size else _NEAR_KPA


def _by_order(
    frame: pd.DataFrame, plateaus: tuple[Plateau, ...], reached: set[int], *, near: float, name: str
) -> tuple[FloatArray, dict[int, str]]:
    """Return rows in plateau order: of all, those in cycles, the sequencer's steps, or those at a pressure read.

    Equal neighbours in the file are one hold.
    """
    everything = list(range(len(plateaus)))
    in_cycles = [i for i in everything if plateaus[i].branch]
    without_start = [i for i in in_cycles if plateaus[i].branch != "start"]
    of_steps = [i for i in everything if plateaus[i].step is not None]
    of_reached = [i for i in of_steps if plateaus[i].step in reached]
    read_kpa = frame["pressure_kpa"].unique()
    at_read = [i for i in everything if np.abs(read_kpa - plateaus[i].pressure_kpa).min() <= near]
    misfit = ""
    for rows in (frame, _merged(frame)):
        for chosen in (everything, in_cycles, without_start, of_reached, of_steps, at_read):
            if len(rows) != len(chosen):
                continue
            reason = _first_misfit(rows, [plateaus[i] for i in chosen], near)
            if reason:
                misfit = misfit or reason
                continue
            values = np.full(len(plateaus), np.nan)
            values[chosen] = rows["elongation_mm"].to_numpy()
            return values, {i: reason for i, reason in zip(chosen, rows["confirmed"], strict=True) if reason}
    if not misfit:
        misfit = f"{len(frame)} rows where the run has {len(plateaus)} plateaus, {len(in_cycles)} of them in its cycles"
    raise DataError(f"{name} does not fit the plateaus: {misfit}", "One row a plateau, in the order of the run.")


def _merged(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows that follow each other at one pressure are one hold, their elongations averaged."""
    run = (frame["pressure_kpa"].diff().abs() > 1e-9).cumsum()
    each = frame.groupby(run, as_index=False)
    return each[["pressure_kpa", "elongation_mm"]].mean().assign(confirmed=each["confirmed"].first()["confirmed"])


def _first_misfit(rows: pd.DataFrame, plateaus: list[Plateau], near: float) -> str:
    pressures = rows["pressure_kpa"].to_numpy()
    for i, (pressure, plateau) in enumerate(zip(pressures, plateaus, strict=True)):
        if not abs(pressure - plateau.pressure_kpa) <= near:
            return f"row {i + 1} is at {pressure:g} kPa where the run held {plateau.pressure_kpa:.1f} kPa"
    return ""


def _by_branch(
    frame: pd.DataFrame, plateaus: tuple[Plateau, ...], near: float, name: str
) -> tuple[FloatArray, dict[int, str]]:
    found: dict[int, list[float]] = {}
    confirmed, last = {}, max(p.cycle for p in plateaus)
    columns = [frame[c].tolist() for c in ("cycle", "branch", "pressure_kpa", "elongation_mm", "confirmed")]
    for at, (cycle, branch, pressure, elongation, reason) in enumerate(zip(*columns, strict=True), 1):
        close = [i for i, p in enumerate(plateaus) if abs(p.pressure_kpa - pressure) <= near]
        own = [i for i in close if plateaus[i].cycle == cycle]
        hits = [i for i in own if plateaus[i].branch == branch] or [i for i in own if plateaus[i].branch == "start"]
        # the extreme that ends a branch also opens the next: a row may name it from either side
        hits = hits or [i for i in close if abs(plateaus[i].cycle - cycle) <= 1 and _is_extreme(i, plateaus)]
        if not hits and cycle > last and any(not plateaus[i].branch for i in close):
            continue  # of a cycle that was not completed, which counts nothing
        if not hits:
            cause = f"{name} does not fit the plateaus: row {at} (cycle {cycle:g}, {branch}, {pressure:g} kPa) has none"
            raise DataError(cause, "Check cycle, branch (unloading or loading) and pressure.")
        found.setdefault(hits[0], []).append(elongation)
        if reason:
            confirmed[hits[0]] = reason
    values = np.asarray([float(np.mean(found.get(i, [np.nan]))) for i in range(len(plateaus))])
    return values, confirmed


def _is_extreme(i: int, plateaus: tuple[Plateau, ...]) -> bool:
    ends = [p.pressure_kpa for p in plateaus]
    return abs(ends[i] - max(ends)) < 1.0 or abs(ends[i] - min(ends)) < 1.0
