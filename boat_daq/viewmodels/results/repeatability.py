"""The repeatability page: a run of many cycles, also while it still goes.

Rules: while a continuous plan runs its recording is read again now and then, by a helper process, from the file itself;
nothing is computed twice in two ways. Cycles are drawn in groups of one colour, so that a hundred of them cost no more
than a dozen.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from time import monotonic

import numpy as np

from analysis.arrays import FloatArray
from analysis.fidelity import Fidelity, fidelity
from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.viewmodels.common.formatting import count, duration
from boat_daq.viewmodels.common.jobs import Job, JobRunner, JobState
from boat_daq.viewmodels.results.analysis_view import CycleSeries, RunResult
from boat_daq.viewmodels.results.calibration_jobs import analyse_run

EVERY_S = 20.0  # at the soonest, so that the helper takes a small share of the machine
WRITTEN_S = 0.5  # after the end of a run its last samples are in the file
GROUPS = 12
WARM_UP_FROM = 6  # cycles, before "warm-up" means anything
HOW = (
    "Choose the plan 'repeatability' and start it: this page fills while it runs. Or open a recording on the Runs page."
)
NO_RUN = "Here come the loops of every cycle, the drift of their ends, and hysteresis, sensitivity and SNR. " + HOW
NO_CYCLE = "A cycle goes from the highest pressure to the lowest and back."


class RepeatabilityModel:
    """State of the page.

    Parameters
    ----------
    jobs : where the work is done.
    clock : seconds, monotonic.
    """

    def __init__(self, jobs: JobRunner, clock: Callable[[], float] = monotonic) -> None:
        self.jobs, self._clock = jobs, clock
        self.level = fidelity().level
        self.result: RunResult | None = None
        self.failure = ""  # why the last run could not be read
        self.words = ""
        self.revision = 0
        self._asked_at = -np.inf
        self._asked_cycles = 0
        self._followed: Path | None = None
        self._ended_at = np.inf

    def set_fidelity(self, level: Fidelity) -> None:
        """Analyse as finely as this from now on."""
        self.level = level.level

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Read the running recording again where enough is new, and once more when the run has ended."""
        progress = snapshot.progress
        if snapshot.state is not SessionState.RUNNING or snapshot.recording is None or progress is None:
            if snapshot.state is not SessionState.FINISHING:
                self._read_the_whole()
            return
        self._ended_at = np.inf
        enough = progress.complete_cycles >= self._asked_cycles + 1 or progress.complete_cycles < self._asked_cycles
        continuous = getattr(snapshot.plan, "kind", "") == "continuous" and progress.complete_cycles >= 2
        free = self._clock() - self._asked_at >= EVERY_S and self.jobs.get("repeatability") is None
        if continuous and enough and free:
            self._asked_at, self._asked_cycles = self._clock(), progress.complete_cycles
            self._followed = snapshot.recording
            self.analyse(snapshot.recording, label="Repeatability so far")

    def _read_the_whole(self) -> None:
        """Read the run that has ended, once the recorder has written its last samples."""
        if self._followed is None:
            return
        self._ended_at = min(self._ended_at, self._clock())
        if self._clock() - self._ended_at >= WRITTEN_S and self.jobs.get("repeatability") is None:
            path, self._followed = self._followed, None
            self.analyse(path)

    def analyse(self, path: Path, *, label: str = "") -> None:
        """Analyse a recording in the background."""
        job = Job(label or f"Repeatability of {path.name}", analyse_run, str(path), level=self.level)
        self.jobs.start("repeatability", job, self._analysed)

    def _analysed(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.show(job.result)
        elif job.failure is not None:
            self.result, self.failure = None, job.failure.text
            self.revision += 1

    def show(self, result: RunResult) -> None:
        """Show a result that is there already."""
        self.result, self.failure = result, ""
        self.words = "   ".join(
            [result.unit or "no unit", count(result.cycles, "complete cycle"), duration(result.duration_s)]
            + ([f"{result.partial} partial, left out"] if result.partial else [])
        )
        self.revision += 1

    def missing(self) -> tuple[str, str]:
        """Return title and words of what is missing for the page; both empty where there is a cycle to show."""
        if self.failure:
            return "This run cannot be shown", self.failure
        if self.result is None:
            return "No run of many cycles yet", NO_RUN
        if not self.result.cycles:
            begun = f" It broke off after {count(self.result.partial, 'partial one')}." if self.result.partial else ""
            return f"{Path(self.result.path).name} has no complete cycle", f"{NO_CYCLE}{begun} {HOW}"
        return "", ""

    def groups(self) -> list[range]:
        """Return the cycles in at most `GROUPS` groups of consecutive ones."""
        n = self.result.cycles if self.result is not None else 0
        edges = np.unique(np.linspace(0, n, min(GROUPS, n) + 1).round().astype(int))
        return [range(int(a), int(b)) for a, b in pairwise(edges)]

    def extremes(self, sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return cycle numbers and the signal's change at the highest and the lowest level, mV from the first cycle."""
        assert self.result is not None
        loops = self.result.loops
        numbers = np.asarray(loops.numbers, dtype=float)
        top = np.nanmean(loops.signal_mv[sensor][:, :, -1], axis=0)
        bottom = np.nanmean(loops.signal_mv[sensor][:, :, 0], axis=0)
        return numbers, top - top[0], bottom - bottom[0]

    def numbers(self) -> FloatArray:
        """Return the numbers of the complete cycles."""
        assert self.result is not None
        return np.asarray(self.result.loops.numbers, dtype=float)

    def cycles(self, sensor: int) -> CycleSeries:
        """Return a sensor's figures cycle by cycle."""
        assert self.result is not None
        return self.result.sensors[sensor].cycles

    def warm_up(self) -> str:
        """Return the warm-up cycles in words; empty where there are none, or too few cycles to tell."""
        if self.result is None:
            return ""
        longest = max((s.cycles.warm_up for s in self.result.sensors), default=0)
        if not longest or self.result.cycles < WARM_UP_FROM:
            return ""
        return f"warm-up: cycle{'s' if longest > 1 else ''} 1" + (f" to {longest}" if longest > 1 else "")
