"""The repeatability page: a run of many cycles, also while it is in progress.

Rules: during a continuous plan a helper process analyses the file again at intervals. Cycles are drawn in groups of one
colour: a hundred take no longer than a dozen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic

import numpy as np

from analysis.fidelity import Fidelity, fidelity
from analysis.figures.figure import sensor_text
from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.formatting import count, quantity
from boat_daq.viewmodels.results.calibration_texts import verdict_text
from boat_daq.viewmodels.results.figure_tables import DRIFT_KEY, HYSTERESIS_KEY, SENSITIVITY_KEY, SNR_KEY
from boat_daq.viewmodels.results.run_result import RunResult, analyse_run
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from protocol.base.arrays import FloatArray, IntArray

LEAST_INTERVAL_S = 20.0  # so that the helper takes a small share of the processor
_WRITTEN_S = 0.5  # after the end of a run its last samples are in the file
GROUPS = 12
WARM_UP_FROM = 6  # cycles, so that warm-up can be distinguished
HOW = "Start the plan \u201crepeatability\u201d, or open a recording of it."
NO_RUN = f"{HOW} Its loops, drift and figures by cycle appear here."
FIRST_RESULTS = "The first results come after two cycles"
_NO_CYCLE = "A cycle goes from the highest pressure to the lowest and back."


@dataclass(frozen=True, slots=True)
class CycleFigure:
    """A figure that is drawn over the cycles: name, axis, unit, key of the run's figure; its points, its line."""

    name: str
    axis: str
    unit: str
    key: str
    points: str = "cycles"
    line: str = "the figure of the run"


CYCLE_FIGURES = (
    CycleFigure(
        "Drift", "From the mean", "% FSO", DRIFT_KEY, "signal at the highest (filled) and the lowest level", "drift"
    ),
    CycleFigure(
        "Hysteresis",
        "Hysteresis",
        "% FSO",
        HYSTERESIS_KEY,
        "single cycles",
        "the mean loop, to which the limit applies,",
    ),
    CycleFigure("Sensitivity", "Sensitivity", "mV/mm", SENSITIVITY_KEY),
    CycleFigure("SNR", "SNR", "dB", SNR_KEY),
)


class RepeatabilityModel:
    def __init__(self, jobs: JobRunner, clock: Callable[[], float] = monotonic) -> None:
        self.jobs, self._clock = jobs, clock
        self.fidelity: Fidelity = fidelity()  # of the next analyses
        self.result: RunResult | None = None
        self.failure = ""  # why the last run could not be read
        self.headline = ""
        self.revision = 0
        self._started_s = -np.inf
        self._started_cycles = 0
        self._followed: Path | None = None
        self._ended_at = np.inf
        self._cycle, self._loading = 0, False  # in progress

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Analyse the open recording again after each new cycle, and once more after the run."""
        progress = snapshot.progress
        continuous = getattr(snapshot.plan, "kind", "") == "continuous"
        self._show_cycle(progress.cycle if snapshot.state is SessionState.RUNNING and progress and continuous else 0)
        if snapshot.state is not SessionState.RUNNING or snapshot.recording is None or progress is None:
            if snapshot.state is not SessionState.FINISHING:
                self._read_ended()
            return
        self._ended_at = np.inf
        enough = progress.complete_cycles != self._started_cycles
        free = self._clock() - self._started_s >= LEAST_INTERVAL_S and self.jobs.get("repeatability") is None
        if continuous and progress.complete_cycles >= 2 and enough and free:
            self._started_s, self._started_cycles = self._clock(), progress.complete_cycles
            self._followed = snapshot.recording
            self.analyse(snapshot.recording, label="Repeatability so far")

    @property
    def in_progress(self) -> bool:
        return self._cycle > 0

    def _show_cycle(self, cycle: int) -> None:
        """Take the cycle that is in progress, 0 for none, and whether a run is being analysed."""
        loading = any(self.jobs.get(name) is not None for name in ("repeatability", "analysis"))
        if self.result is None and (cycle, loading) != (self._cycle, self._loading):
            self.revision += 1
        self._cycle, self._loading = cycle, loading

    def _read_ended(self) -> None:
        """Analyse the run that has ended, once its last samples are written."""
        if self._followed is None:
            return
        self._ended_at = min(self._ended_at, self._clock())
        if self._clock() - self._ended_at >= _WRITTEN_S and self.jobs.get("repeatability") is None:
            path, self._followed = self._followed, None
            self.analyse(path)

    def analyse(self, path: Path, *, label: str = "") -> None:
        level, label = self.fidelity.level, label or f"Repeatability of {path.name}"
        job = Job(label, analyse_run, str(path), level=level)
        self.jobs.start("repeatability", job, self._analysed)

    def _analysed(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.show(job.result)
        elif job.failure is not None:
            self.result, self.failure = None, job.failure.text
            self.revision += 1

    def show(self, result: RunResult) -> None:
        self.result, self.failure = result, ""
        self.headline = "   ".join(
            [result.unit_text, count(result.cycles, "complete cycle")]
            + ([f"{result.partial} partial, left out"] if result.partial else [])
        )
        self.revision += 1

    def verdict(self) -> tuple[str, str]:
        found = self.result.verdict if self.result is not None else None
        known = found is not None and found.limits_state != "none"
        return verdict_text(found.limits_state, found.limits_text) if found is not None and known else ("", "")

    def follow_rename(self, old: Path, new: Path) -> None:
        """Keep the run that is shown under its new name."""
        if self.result is not None and Path(self.result.path) == old:
            self.result = replace(self.result, path=str(new))

    @property
    def loading(self) -> bool:
        """Whether the first run to be shown is being analysed."""
        return self.result is None and not self.failure and self._loading

    def missing(self) -> tuple[str, str]:
        """Return title and text of what is missing; both empty where there is a cycle to show."""
        if self.failure:
            return "This run cannot be shown", self.failure
        if self.loading:
            return "Loading \u2026", "The run is being analysed."
        if self.result is None and self._cycle:
            return FIRST_RESULTS, f"Cycle {self._cycle} is in progress."
        if self.result is None:
            return "No repeatability run yet", NO_RUN
        if not self.result.cycles:
            partial = self.result.partial
            found = f" This run has {count(partial, 'partial cycle')}." if partial else ""
            return f"{Path(self.result.path).name} has no complete cycle", f"{_NO_CYCLE}{found} {HOW}"
        return "", ""

    def groups(self) -> list[IntArray]:
        """Return the cycles in `GROUPS` groups of consecutive ones, the last of them empty where there are fewer."""
        return np.array_split(np.arange(self.result.cycles if self.result is not None else 0), GROUPS)

    def numbers(self) -> FloatArray:
        return np.asarray(self.result.loops.numbers if self.result is not None else (), dtype=float)

    def limit(self, shown: CycleFigure) -> tuple[float, str]:
        """Return the published limit of a figure with its text; NaN where there is none."""
        found = [s.cycles.whole.get(shown.key) for s in self.result.sensors] if self.result is not None else []
        limit = next((f for f in found if f is not None and math.isfinite(f.limit)), None)
        return (math.nan, "") if limit is None else (limit.limit, f"limit {limit.symbol} {limit.limit:g} {shown.unit}")

    def no_figure(self, shown: CycleFigure) -> str:
        """Return why a figure is not drawn; "" where some cycle has it."""
        if self.result is not None and self.result.cycles < 2 and shown.key == DRIFT_KEY:
            return "One cycle has no drift. Run two or more."
        return ""

    def note(self, shown: CycleFigure, *, line: bool, band: bool) -> str:
        """Return what is drawn of a figure, with or without its line and band; why cycles lie above that of the run."""
        if self.result is None:
            return ""
        lifts = [(sensor_text(s.record.name), s.cycles.lift_percent_fso) for s in self.result.sensors]
        above = [f"{name} by {lift:.2f} {shown.unit}" for name, lift in lifts if math.isfinite(lift)]
        noise = f", made wider by noise, {', '.join(above)}" if above and shown.key == HYSTERESIS_KEY else ""
        drawn = [f"Points: {shown.points}{noise}."]
        if line:
            drawn.append(f"Line and band: {shown.line} with its 95 % interval." if band else f"Line: {shown.line}.")
        return " ".join(drawn)

    def known(self) -> str:
        """Return how well drift and repeatability are known, of the worse sensor; "" without an interval."""
        if self.result is None:
            return ""
        drift, spread = self.result.drift_half, self.result.spread_half
        parts = []
        if math.isfinite(drift):
            parts.append(f"drift \u00b1{quantity(drift, '% FSO')} per 100 cycles")
        if math.isfinite(spread):
            parts.append(f"repeatability \u00b1{quantity(spread, '% FSO')}")
        return f"95 % uncertainty: {', '.join(parts)}" if parts else ""

    def warm_up(self) -> str:
        """Return the warm-up cycles as text; empty where there are none, or too few cycles."""
        if self.result is None:
            return ""
        longest = max((s.cycles.warm_up for s in self.result.sensors), default=0)
        if not longest or self.result.cycles < WARM_UP_FROM:
            return ""
        return f"warm-up: cycle{'s' if longest > 1 else ''} 1" + (f" to {longest}" if longest > 1 else "")
