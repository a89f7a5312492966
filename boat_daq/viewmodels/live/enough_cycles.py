"""Ends a run as soon as its cycles leave no larger uncertainty than the one asked for.

Of a plan with plateaus that is U of an elongation in mm, of one without it is the half width of the intervals of drift
and repeatability in % FSO. Until then a plan with plateaus holds those that lower U most, and passes the others.

The run is analysed after each complete cycle, in a process of its own, so that the analysis delays neither samples nor
the window; meanwhile the run continues.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.errors import AnalysisError
from analysis.sequential.asked import check_asked
from boat_daq.engine.plan import Plan
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.errors import BoatDaqError, OperatorError
from boat_daq.viewmodels.common.formatting import count, duration
from boat_daq.viewmodels.common.jobs import Job, JobState

if TYPE_CHECKING:
    from analysis.sequential.stopping import StopAssessment


@dataclass(frozen=True, slots=True)
class EndUncertainty:
    """The uncertainty at the end of a run.

    Parameters
    ----------
    asked, unit : what was asked for, mm of U (k = 2) or % FSO.
    value : the largest of what was to become as small; None where it is not known.
    cycles : that it is of; None where the recording could not be analysed.
    reached : whether the run could end at it.
    text : this in words, or why it is not known.
    """

    asked: float
    unit: str
    value: float | None
    cycles: int | None
    reached: bool
    text: str


class EnoughCycles:
    """What a run knows, and the U at which it ends.

    Parameters
    ----------
    session : with the run, which is being recorded.
    enter : enters the readings of the plateaus reached; None where they are entered otherwise.
    report : called with each assessment in words.
    """

    def __init__(
        self,
        session: Session,
        enter: Callable[[], object] = lambda: None,
        report: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._session, self._enter, self._report = session, enter, report
        self._cycles = 0
        self._job: Job | None = None
        self.asked: float | None = None
        self.known: StopAssessment | None = None
        self.unknown = ""
        self.ended_by: StopAssessment | None = None  # of all complete cycles

    def ask(self, asked: float | None) -> None:
        """Set the uncertainty at which runs end, mm of U (k = 2) or % FSO; None runs all cycles.

        Raises
        ------
        RequestError : it is no number above 0.
        """
        if asked is not None:
            check_asked(asked, "mm or % FSO")
        self.asked, self.known, self.ended_by, self.unknown = asked, None, None, ""

    def close(self) -> None:
        """End the process of an assessment."""
        if self._job is not None:
            self._job.cancel()

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Assess the run after each further complete cycle; end it where U is small enough."""
        progress = snapshot.progress
        if snapshot.state is not SessionState.RUNNING or progress is None or self.asked is None:
            self.close()
            self._job, self._cycles, self.unknown = None, 0, ""
            self.known = self.known if snapshot.state is SessionState.FINISHING else None
            return
        if self._job is not None and self._job.poll() is not JobState.RUNNING:
            self._take(self._job, progress.complete_cycles)
            self._job = None
        if self._job is None and progress.complete_cycles > self._cycles and snapshot.recording is not None:
            self._cycles = progress.complete_cycles
            self._begin(snapshot, self.asked)

    def _begin(self, snapshot: SessionSnapshot, asked: float) -> None:
        """Start to assess the run."""
        from analysis.sequential.stopping import assess_run

        self.ended_by = None
        assert snapshot.recording is not None
        assert snapshot.plan is not None
        try:
            self._enter()
        except OperatorError as error:
            self._not_known(error.cause)
            return
        plan, name = snapshot.plan, "Assessing the uncertainty"
        self._job = Job(name, assess_run, snapshot.recording, asked, plan.cycles, repeats=plan.kind == "continuous")

    def _take(self, job: Job, complete_cycles: int) -> None:
        """Report an assessment, and end the run where it is enough."""
        if job.state is not JobState.DONE:
            cause = job.failure.cause if job.failure is not None else str(job.state.value)
            self._not_known(cause)
            return
        self.known, self.unknown = job.result, ""
        self._report(job.result.text)
        if job.result.reached:
            self._session.finish_early(job.result.text)
            self.ended_by = job.result if complete_cycles == self._cycles else None
        else:
            self._session.hold_at(job.result.hold)

    def _not_known(self, cause: str) -> None:
        """Report why the latest cycle has no assessment, and show it until a later one has."""
        self.unknown = f"U is not known after {count(self._cycles, 'cycle')}: {cause}"
        self._report(self.unknown)

    def at_end(self, recording: Path, plan: Plan) -> EndUncertainty | None:
        """Assess all complete cycles of a run that has ended; return None where no uncertainty was asked for.

        Parameters
        ----------
        recording : of the run, with its readings.
        plan : of the run.
        """
        if self.asked is None:
            return None
        from analysis.sequential.stopping import assess_run

        repeats, asked = plan.kind == "continuous", self.asked
        unit = "% FSO" if repeats else "mm"
        try:
            found = self.ended_by or assess_run(recording, asked, plan.cycles, repeats=repeats)
        except (AnalysisError, BoatDaqError) as error:
            text = f"the uncertainty is not known at the end of the run, {asked:g} {unit} asked: {error.cause}"
            return EndUncertainty(asked, unit, None, None, reached=False, text=text)
        value = max((criterion.now for criterion in found.criteria), default=None)
        text = f"{asked:g} {unit} asked: not reached, {found.end}" if found.void else found.end
        return EndUncertainty(asked, unit, value, found.cycles, found.reached, text)

    def text(self, snapshot: SessionSnapshot) -> str:
        """Return the uncertainty now, the one asked for and the time left to it; "" where none is asked for."""
        if self.asked is None or snapshot.progress is None:
            return ""
        if self.unknown:
            return self.unknown
        if self.known is None:
            return f"{self.asked:g} {self.unit(snapshot)} asked, known after a cycle"
        if self.known.void:
            return self.known.text
        if self.known.best:
            return f"{self.known.now}, {self.known.best}"
        progress, more = snapshot.progress, self.known.more_cycles or 0
        begun = progress.complete_cycles - self.known.cycles
        planned = max(progress.cycles - progress.complete_cycles, 1)
        left_s = progress.time_left_s * max(more - begun, 0) / planned
        return ", ".join(filter(None, (self.known.now, self.known.at_least, f"{duration(left_s)} left")))

    @staticmethod
    def unit(snapshot: SessionSnapshot) -> str:
        """Return the unit of what is asked for."""
        return "% FSO" if snapshot.plan is not None and snapshot.plan.kind == "continuous" else "mm of U"
