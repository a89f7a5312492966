"""The recordings of a folder and the units on the shelf; what can be done with them.

Rules: a list is read on a helper thread, from heads and overviews, never from samples. A damaged file is listed with
its reason, never left out. Exports and reports are made by a helper process.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Literal

import numpy as np

from analysis.arrays import FloatArray
from boat_daq.engine.recording.recovery import find_interrupted, recover
from boat_daq.engine.recording.resumption import BrokenRun, prepare_resumption, read_broken_run
from boat_daq.engine.recording.summary import Summary, summarise
from boat_daq.engine.settings import UnitLibrary
from boat_daq.errors import BoatDaqError, OperatorError
from boat_daq.viewmodels.common.formatting import NOTHING, count, duration, number
from boat_daq.viewmodels.common.jobs import Job, JobRunner, JobState
from boat_daq.viewmodels.common.notices import Notices, Severity
from boat_daq.viewmodels.results.analysis_view import RunResult
from boat_daq.viewmodels.results.run_jobs import compare_runs, export_run, report_runs
from protocol.errors import ProtocolError
from protocol.recording import SUFFIX, RunEnd, open_recording

HEADINGS = ("", "Unit", "Recorded", "Length", "Cycles", "Readings", "State", "File")
POINTS = 160  # of a thumbnail
MOST_COMPARED = 4
LOOK_EVERY_S = 3.0
STATES = {
    "closed": "\u25cf complete", "recovered": "\u25cf recovered", "recording": "\u25b6 recording",
    "interrupted": "\u25b2 interrupted",
}  # fmt: skip
ONE, SOME = "Choose a recording in the list.", "Choose one or more recordings in the list."
NONE_CHOSEN = "Choose a recording to calibrate, replay or export it, or two to four to compare them."


@dataclass(frozen=True, slots=True)
class RunEntry:
    """One line of the list; `outline` is the pressure's (time, low, high) in the unit square."""

    path: Path
    summary: Summary | None
    problem: str
    outline: tuple[tuple[float, float, float], ...]

    @property
    def interrupted(self) -> bool:
        """Whether a killed session left it."""
        return self.summary is not None and self.summary.status == "interrupted"

    @property
    def closed(self) -> bool:
        """Whether it is complete as a file, so that something may be added to it."""
        return self.summary is not None and self.summary.status in ("closed", "recovered")

    @property
    def resumable(self) -> bool:
        """Whether its run did not come to its end and can go on in it."""
        s = self.summary
        ended = s is not None and s.status != "recording" and s.run_end is not RunEnd.FINISHED
        return ended and s is not None and s.steps > 0

    @property
    def hover(self) -> str:
        """Return what is said on hover."""
        s = self.summary
        if s is None:
            return self.problem
        breaks = "\n".join(
            f"broken after {count(b.complete_cycles, 'cycle')}: {b.cause}"
            + (f", for {duration(b.break_s)}" if b.break_s is not None else "")
            for b in s.breaks
        )
        told = (
            self.path.name,
            f"{duration(s.duration_s)} long, {count(s.readings, 'reading')}",
            breaks,
            s.note,
            f"operator {s.operator}" if s.operator else "",
            s.stop_reason,
            f"{s.lost_samples} samples lost",
        )
        return "\n".join(part for part in told if part)

    @property
    def cells(self) -> tuple[str, ...]:
        """Return the line as text, in the order of `HEADINGS`."""
        s = self.summary
        if s is None:
            return ("", NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, "\u25a0 cannot be read", self.path.name)
        simulated = "  SIMULATED" if s.simulated else ""
        cycles = str(s.cycles.complete) + (f" + {s.cycles.partial} partial" if s.cycles.partial else "")
        when = s.started_utc[:16].replace("T", "  ")
        state = _state(s.status, s.run_end) + (f", {count(len(s.breaks), 'break')}" if s.breaks else "")
        return (
            "",
            f"{s.unit or NOTHING}{simulated}",
            when,
            duration(s.duration_s),
            cycles,
            str(s.readings),
            state,
            self.path.name,
        )


def _state(status: str, end: RunEnd | None) -> str:
    """Return what became of a run: a file that is closed in order may hold a run that was not finished."""
    if status == "closed" and end in (RunEnd.ABORTED, RunEnd.FAULT):
        return "\u25b2 broken off"
    if status == "closed" and end is RunEnd.STOPPED:
        return "\u25a0 stopped"
    return STATES.get(status, status)


def read_run(path: Path) -> RunEntry:
    """Return one line of the list; never raises for what the file is."""
    try:
        return RunEntry(path, summarise(path), "", _outline(path))
    except (ProtocolError, BoatDaqError) as error:
        return RunEntry(path, None, error.cause, ())
    except (OSError, sqlite3.Error, KeyError, ValueError) as error:
        return RunEntry(path, None, f"cannot be read: {error}", ())


def _outline(path: Path) -> tuple[tuple[float, float, float], ...]:
    with closing(open_recording(path)) as db:
        rows = db.execute(
            "SELECT first_time_us, last_time_us, pressure_min_kpa, pressure_max_kpa FROM overview "
            "WHERE pressure_min_kpa IS NOT NULL ORDER BY id"
        ).fetchall()
    step = max(1, len(rows) // POINTS)
    groups = [rows[i : i + step] for i in range(0, len(rows), step)]
    if len(groups) < 2:
        return ()
    low, high = min(row[2] for row in rows), max(row[3] for row in rows)
    span = (high - low) or 1.0
    ends = len(groups) - 1
    return tuple(
        (i / ends, (min(r[2] for r in group) - low) / span, (max(r[3] for r in group) - low) / span)
        for i, group in enumerate(groups)
    )


def _began(run: RunEntry) -> tuple[str, str]:
    """Return what the list is sorted by: a line keeps its place while its file is written, under the mouse too."""
    return (run.summary.started_utc if run.summary is not None else "", run.path.name)


@dataclass(frozen=True, slots=True)
class RunActions:
    """What other pages do with a chosen recording, and the name of the unit on the bench."""

    calibrate: Callable[[Path], None]
    repeat: Callable[[Path], None]
    resume: Callable[[Path], None]
    replay: Callable[[Path, float], None]
    unit: Callable[[], str]


class RunsModel:
    """State of the page.

    Parameters
    ----------
    folder : of the recordings.
    units : the units and their calibrations.
    jobs : where exports and reports are made.
    notices : where it is reported how they end.
    """

    def __init__(self, folder: Path, units: UnitLibrary, jobs: JobRunner, notices: Notices) -> None:
        self.folder, self.units, self.jobs, self._notices = folder, units, jobs, notices
        self.runs: list[RunEntry] = []
        self.comparison: tuple[RunResult, ...] = ()
        self.nothing = (np.zeros(0), np.zeros(0))
        self.revision = 0
        self._looked_at = -LOOK_EVERY_S
        self._known: dict[tuple[Path, int, int], RunEntry] = {}
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="runs")
        self._future: Future[list[RunEntry]] | None = None

    def look(self) -> None:
        """Read the folder again on the helper thread."""
        if self._future is None:
            self._future = self._pool.submit(self._read)

    def look_now_and_then(self) -> None:
        """Read the folder again if the last time is a while ago."""
        if monotonic() - self._looked_at >= LOOK_EVERY_S:
            self._looked_at = monotonic()
            self.look()

    def _read(self) -> list[RunEntry]:
        found: dict[tuple[Path, int, int], RunEntry] = {}
        for path in self.folder.glob(f"*{SUFFIX}"):
            stat = path.stat()
            key = (path, stat.st_size, stat.st_mtime_ns)
            run = self._known.get(key)
            fresh = run is None or run.summary is None or run.summary.status in ("recording", "interrupted")
            found[key] = read_run(path) if fresh or run is None else run
        self._known = found
        return sorted(found.values(), key=_began, reverse=True)

    def poll(self) -> None:
        """Take the list where it has come."""
        if self._future is not None and self._future.done():
            future, self._future = self._future, None
            runs = future.result()
            if runs != self.runs:
                self.runs = runs
                self.revision += 1

    def newest(self) -> Path | None:
        """Return the recording that was written last; None where there is none."""
        found = self.folder.glob("*.boat") if self.folder.is_dir() else ()
        return max(found, key=lambda path: path.stat().st_mtime_ns, default=None)

    def interrupted(self) -> list[Path]:
        """Return what killed sessions left in the folder."""
        return find_interrupted(self.folder) if self.folder.is_dir() else []

    def recover(self, path: Path) -> None:
        """Close properly what a killed session left, in the background."""
        job = Job(f"Recovering {path.name}", recover, path)
        self.jobs.start("recover", job, lambda job: self.finished(job, f"{path.name} is recovered and complete"))

    def resume(self, path: Path, then: Callable[[BrokenRun], None]) -> None:
        """Make a broken run ready to go on, in the background; `then` is called with it.

        Raises
        ------
        OperatorError, StorageError, RecordingError : there is nothing to go on with, or not now.
        """
        read_broken_run(path)

        def ready(job: Job) -> None:
            if job.state is JobState.DONE:
                then(job.result)
            else:
                self._failed(job)

        job = Job(f"Looking at {path.name}", prepare_resumption, path)
        self.jobs.start("resume", job, ready)

    def export(self, paths: list[Path], target: Path) -> None:
        """Write the samples of one recording as CSV or Parquet, as the ending of `target` says, in the background.

        Raises
        ------
        OperatorError : not exactly one recording.
        """
        if len(paths) != 1:
            raise OperatorError("one recording is exported at a time", "Choose one line.")
        kind: Literal["csv", "parquet"] = "parquet" if target.suffix == ".parquet" else "csv"
        job = Job(
            f"Exporting {paths[0].name}",
            export_run,
            paths[0],
            target,
            kind,
        )
        self.jobs.start("export", job, lambda job: self.finished(job, f"Saved {target.name}"))

    def compare(self, paths: list[Path]) -> None:
        """Analyse two to four recordings in the background, to lay their curves over each other.

        Raises
        ------
        OperatorError : another number of them.
        """
        if not 2 <= len(paths) <= MOST_COMPARED:
            raise OperatorError(f"{count(len(paths), 'recording')} chosen to compare", "Choose two to four lines.")
        job = Job("Comparing", compare_runs, paths)
        self.jobs.start("compare", job, self._compared)

    def forget_comparison(self) -> None:
        """Compare nothing any more."""
        self.comparison = ()

    def _compared(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.comparison = job.result
        else:
            self._failed(job)

    def comparison_lines(self) -> tuple[list[list[tuple[FloatArray, FloatArray]]], str]:
        """Return for each sensor every run's curve less the first run's, over its range, and the words above them."""
        runs = [run for run in self.comparison if run.calibrated]
        if len(runs) < 2:
            return [], "fewer than two of these runs have a calibration" if self.comparison else ""
        lines = []
        for i, first in enumerate(runs[0].sensors):
            coefficients = (first.content or {})["fit"]["coefficients"]
            others = [run.sensors[i] for run in runs if i < len(run.sensors)]
            lines.append([(s.grid, s.curve - np.polynomial.polynomial.polyval(s.grid, coefficients)) for s in others])
        return lines, "   ".join(f"{n}: {Path(run.path).stem}" for n, run in enumerate(runs, 1))

    def report(self, paths: list[Path], target: Path) -> None:
        """Make the report of one or several recordings, HTML or PDF, in the background.

        Raises
        ------
        OperatorError : no recording was chosen.
        """
        if not paths:
            raise OperatorError("no recording was chosen", "Choose one line or several.")
        job = Job("Making the report", report_runs, paths, target)
        self.jobs.start("report", job, lambda job: self.finished(job, f"Saved {target.name}"))

    def finished(self, job: Job, done: str) -> None:
        """Report how a job has ended."""
        if job.state is JobState.DONE:
            self._notices.inform(done)
        else:
            self._failed(job)
        self.look()

    def _failed(self, job: Job) -> None:
        if job.failure is not None:
            self._notices.say(Severity.WARNING, job.failure.cause, job.failure.remedy, details=job.failure.details)

    def unit_lines(self) -> list[tuple[str, ...]]:
        """Return the units with each of their calibrations: unit, date, sensitivities, recording."""
        lines: list[tuple[str, ...]] = []
        for name in self.units.names():
            for entry in reversed(self.units.load(name).history):
                figures = [s.get("figures", {}).get("sensitivity_mv_per_mm") for s in entry.content.get("sensors", [])]
                simulated = "  SIMULATED" if entry.content.get("simulated") else ""
                lines.append(
                    (name + simulated, entry.utc[:10], " / ".join(number(f, 1) for f in figures), entry.recording)
                )
        return lines

    def sensitivities(self, unit: str) -> list[list[float]]:
        """Return for each sensor its sensitivity over the unit's calibrations, oldest first, mV/mm."""
        history = [entry for entry in self.units.load(unit).history if entry.accepted]
        rows = [
            [s.get("figures", {}).get("sensitivity_mv_per_mm") for s in e.content.get("sensors", [])] for e in history
        ]
        sensors = max((len(row) for row in rows), default=0)
        return [[float(row[i]) for row in rows if i < len(row) and row[i] is not None] for i in range(sensors)]

    def ages(self, unit: str) -> list[tuple[FloatArray, FloatArray]]:
        """Return for each sensor (number of the calibration, sensitivity)."""
        return [(np.arange(1.0, len(row) + 1), np.array(row)) for row in self.sensitivities(unit)]

    def close(self) -> None:
        """Let the thread end."""
        self._pool.shutdown(wait=False, cancel_futures=True)


def told(chosen: Sequence[RunEntry]) -> str:
    """Return what stands under the list: what to choose, or what is to be known of what is chosen."""
    if not chosen:
        return NONE_CHOSEN
    if len(chosen) > 1:
        return f"{count(len(chosen), 'recording')} are chosen: for a report, or to be compared."
    return " \u00b7 ".join(chosen[0].hover.splitlines())


def obstacle(deed: str, chosen: Sequence[RunEntry]) -> str:
    """Return why `deed` (a button's key) cannot be done with `chosen`."""
    if deed == "report":
        return _readable(chosen) if chosen else SOME
    if deed == "compare":
        return _comparable(chosen)
    if not chosen:
        return ONE
    if len(chosen) > 1:
        return f"{count(len(chosen), 'recording')} are chosen; choose only one."
    if deed == "readings" and chosen[0].summary is not None and not chosen[0].closed:
        return "Its readings can be corrected once the recording is closed or recovered."
    return _readable(chosen)


def _readable(chosen: Sequence[RunEntry]) -> str:
    return next((f"{run.path.name}: {run.problem}." for run in chosen if run.summary is None), "")


def _comparable(chosen: Sequence[RunEntry]) -> str:
    if not 2 <= len(chosen) <= MOST_COMPARED:
        now = f"{count(len(chosen), 'recording')} {'is' if len(chosen) == 1 else 'are'} chosen" if chosen else "none is"
        return f"Choose two to four recordings (Ctrl and click, or Shift and an arrow); {now}."
    return _readable(chosen)
