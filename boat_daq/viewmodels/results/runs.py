"""The recordings of a folder, the units with their calibrations, and what can be done with them.

Rules: the list is read on a helper thread; exports and reports are made by a helper process.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from analysis.calibration.record import CalibrationRecord
from analysis.fidelity import Fidelity, fidelity
from boat_daq.engine.recording.recovery import Recovery, find_interrupted, recover
from boat_daq.engine.recording.rename import add_note, rename
from boat_daq.engine.recording.resumption import BrokenRun, prepare_resumption, read_broken_run
from boat_daq.engine.recording.summary import is_simulated
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.formatting import count, number, plain_number
from boat_daq.viewmodels.common.notices import NOT_SAVING, Notice, Notices, Severity
from boat_daq.viewmodels.common.services import Change, UndoHistory
from boat_daq.viewmodels.results.metadata import MetadataModel
from boat_daq.viewmodels.results.run_entry import MOST_COMPARED, RUN_HEADINGS, RunEntry, read_run, sort_key
from boat_daq.viewmodels.results.run_result import CurveBands, RunResult, compare_runs
from boat_daq.viewmodels.results.unit_over_time import UnitOverTimeModel
from boat_daq.workflows.calibration_in_force import record_of
from boat_daq.workflows.jobs import Job, JobRunner
from boat_daq.workflows.run_files import add_marker, export_run, report_runs
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.base.units import NOTHING, STORED_UNITS, Shown, as_text
from protocol.recording import SUFFIX

SCAN_INTERVAL_S = 3.0
IN_USE = (LinkState.OPENING, LinkState.UP, LinkState.SILENT, LinkState.LOST)
LOADING = "Loading \u2026", "The folder of the recordings is being read."
NOTHING_YET = "No recording yet", "Runs are listed here with unit, date, length and cycles. Start one on Measure."
SIMULATED_MARK = "  SIMULATED"  # behind the name of a unit


UnitLine = tuple[bool, tuple[str, ...]]
"""Whether a unit is simulated, and its line."""
Listing = tuple[list[RunEntry], list[UnitLine]]
"""The recordings and the lines of the units."""


class RunsModel:
    def __init__(
        self,
        folder: Path,
        units: UnitLibrary,
        jobs: JobRunner,
        notices: Notices,
        undo: UndoHistory,
        renamed: Callable[[Path, Path], None] = lambda old, new: None,
    ) -> None:
        self.folder, self.units, self.jobs, self._notices = folder, units, jobs, notices
        self._undo, self._renamed = undo, renamed
        self.runs: list[RunEntry] = []
        self.units_read: list[UnitLine] = []
        self.comparison: tuple[RunResult, ...] = ()
        self._offers: dict[Path, Notice] = {}  # to recover a recording
        self.wanted: Path | None = None  # is chosen once it is listed
        self.revision = 0
        self.listed = False  # whether the folder has been read
        self.shown_units = STORED_UNITS  # of its reports
        self.fidelity: Fidelity = fidelity()  # of the next reports
        self.simulated = False  # whether the board in use is, or was last
        self._unsaved: Path | None = None  # is recorded, but not saved now
        self._kinds: tuple[bool, ...] = (False, True)  # of the units that are shown
        self._scanned_at = -SCAN_INTERVAL_S
        self._known: dict[tuple[Path, int, int], RunEntry] = {}
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="runs")
        self._future: Future[Listing] | None = None

    def select(self, path: Path) -> None:
        """Have a recording chosen as soon as it is listed."""
        self.wanted = path
        self.scan()

    def scan(self) -> None:
        """Read the folder again on the helper thread."""
        if self._future is None:
            self._future = self._pool.submit(self._read)

    def scan_at_intervals(self) -> None:
        if monotonic() - self._scanned_at >= SCAN_INTERVAL_S:
            self._scanned_at = monotonic()
            self.scan()

    def _read(self) -> Listing:
        found: dict[tuple[Path, int, int], RunEntry] = {}
        for path, stat in self._files():
            key = (path, stat.st_size, stat.st_mtime_ns)
            run = self._known.get(key)
            fresh = run is None or run.summary is None or run.summary.status in ("recording", "interrupted")
            found[key] = read_run(path) if fresh or run is None else run
        self._known = found
        names = {run.summary.uuid: run.path.name for run in found.values() if run.summary is not None}
        return sorted(found.values(), key=sort_key, reverse=True), self._read_units(names)

    def _files(self) -> list[tuple[Path, os.stat_result]]:
        """Return the recordings of the folder with size and time, without those deleted since they were listed."""
        found = []
        for path in self.folder.glob(f"*{SUFFIX}"):
            with suppress(FileNotFoundError):
                found.append((path, path.stat()))
        return found

    def poll(self) -> None:
        if self._future is not None and self._future.done():
            future, self._future = self._future, None
            found = future.result()
            if not self.listed or found != (self.runs, self.units_read):
                self.listed = True
                self.runs, self.units_read = found
                self.revision += 1

    def nothing(self) -> tuple[str, str]:
        """Return title and text in place of an empty list."""
        return NOTHING_YET if self.listed else LOADING

    def newest(self, simulated: bool | None = None) -> Path | None:
        """Return the recording that was written last, a simulated or a real one where asked; None without one."""
        files = sorted(self._files(), key=lambda file: file[1].st_mtime_ns, reverse=True)
        return next((path for path, _ in files if simulated is None or is_simulated(path) is simulated), None)

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Show the units of the board in use, simulated or real ones; both without a board. Show what is not saved."""
        kinds = (snapshot.simulated,) if snapshot.link in IN_USE else (False, True)
        unsaved = snapshot.recording if snapshot.saves_nothing else None
        if (kinds, snapshot.simulated, unsaved) != (self._kinds, self.simulated, self._unsaved):
            self._kinds, self.simulated, self._unsaved = kinds, snapshot.simulated, unsaved
            self.revision += 1

    def cells(self, run: RunEntry) -> tuple[str, ...]:
        """Return the line of a recording; its state as in the header where nothing of it is saved now."""
        state = RUN_HEADINGS.index("State") if run.path == self._unsaved else -1
        return tuple(NOT_SAVING if k == state else cell for k, cell in enumerate(run.cells))

    @property
    def unit_lines(self) -> list[tuple[str, ...]]:
        return [line for simulated, line in self.units_read if simulated in self._kinds]

    def interrupted(self) -> list[Path]:
        """Return the recordings that killed sessions left open."""
        return find_interrupted(self.folder) if self.folder.is_dir() else []

    def offer_recovery(self) -> None:
        """Offer to recover each recording that a killed session left open."""
        for path in self.interrupted():
            cause = f"{path.name} was not closed: the program ended unexpectedly"
            remedy = "Nothing recorded is lost. Recover closes the file."
            offer = ("Recover", partial(self.recover, path))
            self._offers[path] = self._notices.add(Severity.WARNING, cause, remedy, action=offer)

    def recover(self, path: Path) -> None:
        """Close a recording that a killed session left open, or save what a damaged one holds, in the background."""
        self._notices.dismiss(self._offers.pop(path, None))
        self.start(f"recover {path}", Job(f"Recovering {path.name}", recover, path), self._recovered)

    def _recovered(self, recovery: Recovery) -> None:
        lost = [*recovery.missing.lines(), *recovery.damaged][:1]
        text = f"{recovery.path.name} is recovered" + (f", without what cannot be read: {lost[0]}" if lost else "")
        self._notices.inform(text)
        self.select(recovery.path)

    def rename(self, path: Path, name: str) -> None:
        """Rename a closed recording with its companions, undoably."""
        target = path.with_name(f"{name.strip().removesuffix(SUFFIX)}{SUFFIX}")
        if target != path:
            move = self._move
            text = f"{path.name} renamed {target.name}"
            self._undo.push(Change(text, lambda: move(path, target.name), lambda: move(target, path.name)))

    def _move(self, path: Path, name: str) -> None:
        target = rename(path, name)
        self._renamed(path, target)
        self.select(target)

    def note(self, run: RunEntry, text: str) -> None:
        """Add a note to a closed recording, undoably: undo adds the one before again."""
        before = run.note
        if text != before:
            add = self._add_note
            what = f"note on {run.path.name}"
            self._undo.push(Change(what, lambda: add(run.path, text), lambda: add(run.path, before)))

    def mark(self, run: RunEntry, text: str) -> None:
        """Add a marker to a closed recording: its time from the first sample, s, then what happened."""
        time, _, note = text.strip().partition(" ")
        try:
            time_s = plain_number(time)
        except ValueError as error:
            raise RequestError(f"{time!r} is not a time", "Begin with the seconds: 12.5 valve opened.") from error
        add_marker(run.path, time_s, note)
        self.select(run.path)

    def metadata(self, run: RunEntry) -> MetadataModel:
        if run.summary is None or not run.closed:
            raise RequestError(f"{run.path.name} is not closed", "Close or recover the recording first.")
        units, changed = self.units.of(simulated=run.summary.simulated), partial(self.select, run.path)
        return MetadataModel.of_recording(run.path, units, run.summary.unit or "", self._undo, changed)

    def _add_note(self, path: Path, text: str) -> None:
        add_note(path, text)
        self.select(path)

    def resume(self, path: Path, then: Callable[[BrokenRun], None]) -> None:
        """Prepare the resumption of a run in the background; `then` is called with it."""
        read_broken_run(path)
        self._notices.dismiss(self._offers.pop(path, None))
        self.start("resume", Job(f"Checking {path.name}", prepare_resumption, path), then)

    def export(self, paths: list[Path], target: Path) -> None:
        """Write the samples of one recording, in the form of the suffix of `target`, in the background."""
        if len(paths) != 1:
            raise RequestError("one recording is exported at a time", "Choose one line.")
        job = Job(f"Exporting {paths[0].name}", export_run, paths[0], target)
        job.target = target

        def done(void: str) -> None:
            self._notices.inform_saved(target)
            if void:
                self._notices.inform(f"{target.name} has no elongation: {void}")

        self.start(f"export {target}", job, done)

    def compare(self, paths: list[Path]) -> None:
        """Analyse two to four recordings in the background, to compare their curves."""
        if not 2 <= len(paths) <= MOST_COMPARED:
            raise RequestError(f"{count(len(paths), 'recording')} chosen to compare", "Choose two to four lines.")
        self.start("compare", Job("Comparing", compare_runs, paths), self.take_comparison)

    def take_comparison(self, compared: tuple[RunResult, ...]) -> None:
        """Show the runs that have a curve, and name the others."""
        bare = [Path(run.path).name for run in compared if not run.calibrated]
        enough = len(compared) - len(bare) >= 2
        self.show_comparison(compared if enough else ())
        lack = f"{' and '.join(bare)} {'has' if len(bare) == 1 else 'have'} no calibration curve"
        if bare and enough:
            self._notices.inform(f"left out: {lack}")
        elif bare:
            self._notices.add(Severity.WARNING, f"nothing to compare: {lack}", "Choose two runs with readings.")

    def show_comparison(self, comparison: tuple[RunResult, ...] = ()) -> None:
        self.comparison = comparison

    @property
    def comparison_unit(self) -> str:
        """Unit of the signals that are compared."""
        return self.comparison[0].signal_unit if self.comparison else "mV"

    def comparison_lines(self) -> tuple[list[list[tuple[FloatArray, FloatArray]]], str]:
        """Return for each sensor every run's curve less the first run's, over its range, and a legend."""
        runs = [run for run in self.comparison if run.calibrated]
        if len(runs) < 2:
            return [], ""
        lines = []
        for i in range(max(len(run.sensors) for run in runs)):
            fits = [run.sensors[i].fit if i < len(run.sensors) else None for run in runs]
            first = next((fit for fit in fits if fit is not None), None)
            lines.append([_less(fit, first) for fit in fits])
        return lines, "   ".join(f"{n}: {Path(run.path).stem}" for n, run in enumerate(runs, 1))

    def report(self, paths: list[Path], target: Path, *, curve: str = "") -> None:
        """Write the report of one or several recordings, HTML or PDF, in the background."""
        if not paths:
            raise RequestError("no recording is chosen", "Choose one line or several.")
        job = Job(
            "Making the report", report_runs, paths, target, curve=curve, level=self.fidelity.level,
            units=self.shown_units,
        )  # fmt: skip
        job.target = target
        self.start(f"report {target}", job, lambda _: self._notices.inform_saved(target))

    def start(self, name: str, job: Job, done: Callable[[Any], object]) -> None:
        """Run a job; report a failure, or call a function with its result."""
        take = self._notices.ended(done)

        def ended(job: Job) -> None:
            take(job)
            self.scan()

        self.jobs.start(name, job, ended)

    def _read_units(self, names: Mapping[str | None, str]) -> list[UnitLine]:
        """Return the units' calibrations: unit, date, sensitivities, recording; `names` of recordings by UUID."""
        lines: list[UnitLine] = []
        per_mm = self.shown_units.shown("mV/mm")
        places = per_mm.decimals(1)
        for units in (self.units.of(simulated=simulated) for simulated in (False, True)):
            for name in units.names():
                try:
                    unit = units.load(name)
                except RequestError as error:
                    lines.append((units.simulated, (name, NOTHING, "\u25a0 cannot be read", error.cause)))
                    continue
                shown = f"{name}{SIMULATED_MARK}" if units.simulated else name
                for record in (record_of(unit, entry) for entry in reversed(unit.history)):
                    figures = " / ".join(_in(per_mm, figure, places) for figure in _sensitivities(record))
                    if record.signal_unit != "mV":
                        known = [one for one in _sensitivities(record) if one is not None]
                        figures = f"{' / '.join(f'{one:.3g}' for one in known)} {as_text(record.signal_unit)}/mm"
                    name_now = names.get(record.recording_id, record.recording)
                    lines.append((units.simulated, (shown, record.calibrated_utc[:10], figures, name_now)))
        return lines

    def over_time(self, row: int) -> UnitOverTimeModel:
        """Return the model of the window of a unit, by its line in the list."""
        lines = [line for line in self.units_read if line[0] in self._kinds]
        if not 0 <= row < len(lines):
            raise RequestError("no unit is chosen", "Choose a line of the units.")
        simulated, cells = lines[row]
        units = self.units.of(simulated=simulated)
        return UnitOverTimeModel(units, cells[0].removesuffix(SIMULATED_MARK), self.jobs, self._notices)

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)


def _in(shown: Shown, stored: float | None, places: int) -> str:
    """Return a value as it is shown; a dash where it was not stored."""
    return NOTHING if stored is None else number(shown.value(stored), places)


def _sensitivities(record: CalibrationRecord) -> list[float | None]:
    """Return each sensor's sensitivity, mV/mm; None where it was not stored."""
    return [sensor.figures.get("sensitivity_mv_per_mm") for sensor in record.sensors]


def _less(curve: CurveBands | None, first: CurveBands | None) -> tuple[FloatArray, FloatArray]:
    """Return a curve less the first one where both are: x (mm) and the difference (mV); empty without a curve."""
    if curve is None or first is None:
        return np.zeros(0), np.zeros(0)
    shared = (curve.grid >= first.grid[0]) & (curve.grid <= first.grid[-1])
    x = curve.grid[shared]
    return x, curve.curve[shared] - np.interp(x, first.grid, first.curve)
