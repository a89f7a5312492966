"""Ends a run as soon as its cycles leave no larger uncertainty than the one asked for.

Of a plan with plateaus that is U of an elongation in mm, of one without it is the half width of the intervals of drift
and repeatability in % FSO. Until then a plan with plateaus holds those that lower U most, and passes the others.

The run is analysed after each complete cycle, in a process of its own, so that the analysis delays neither samples nor
the window. The run holds the last level meanwhile, so that its end does not depend on the speed of board and computer;
a continuous one, whose next cycle such a hold may change, only from the cycle on after which it may end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.stopping.requirement import FEWEST_REPEATS, UNIT_OF_REQUIREMENT, check_asked
from boat_daq.engine.plan import Plan
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.formatting import count
from boat_daq.workflows.jobs import Job, JobState
from protocol.base.errors import BoatDaqError, RequestError

if TYPE_CHECKING:
    from analysis.stopping.criterion import StopAssessment

FIRST_HELD = {UNIT_OF_REQUIREMENT["staircase"]: 1, UNIT_OF_REQUIREMENT["continuous"]: FEWEST_REPEATS}  # cycle, by unit
ASSESSING = "Assessing the uncertainty"  # what the process of an assessment does


@dataclass(frozen=True, slots=True)
class EndUncertainty:
    """The uncertainty at the end of a run. `asked`, `unit`: limit that was asked for, mm of U (k = 2) or % FSO."""

    asked: float
    unit: str
    value: float | None  # largest uncertainty that the limit applies to; None where it is not known
    cycles: int | None  # number of cycles analysed; None where the recording could not be analysed
    reached: bool  # whether the run could end
    text: str  # the result as a sentence, or why it is not known

    @classmethod
    def of(cls, found: StopAssessment, asked: float, unit: str) -> EndUncertainty:
        value = max((criterion.now for criterion in found.criteria), default=None)
        text = f"{asked:g} {unit} asked: not reached, {found.end}" if found.void else found.end
        return cls(asked, unit, value, found.cycles, found.reached, text)


def assess_end(recording: Path, asked: float, unit: str, cycles: int) -> EndUncertainty:
    """Return the uncertainty of all complete cycles of a run that has ended; `unit` is mm of U or % FSO."""
    from analysis.stopping.criterion import assess_run

    try:
        found = assess_run(recording, asked, cycles, repeats=unit == UNIT_OF_REQUIREMENT["continuous"])
    except BoatDaqError as error:
        text = f"the uncertainty is not known at the end of the run, {asked:g} {unit} asked: {error.cause}"
        return EndUncertainty(asked, unit, None, None, reached=False, text=text)
    return EndUncertainty.of(found, asked, unit)


class EnoughCycles:
    """What a run knows, and the U at which it ends. `enter` enters the readings of the plateaus reached."""

    def __init__(
        self,
        session: Session,
        enter: Callable[[], object] = lambda: None,
        report: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._session, self._enter, self._report = session, enter, report
        self._cycles = 0
        self._job: Job | None = None
        self._unwritten: int | None = None  # what of a cycle that is to be assessed may not be in the file yet
        self._stopping = False  # whether the run holds at the end of its cycles
        self.asked: dict[str, float] = {}
        self.known: StopAssessment | None = None
        self.unknown = ""
        self.ended_by: StopAssessment | None = None  # of all complete cycles

    def ask(self, asked: float | None, unit: str) -> None:
        """Set the U (k = 2, mm) or the interval (% FSO) at which runs end; None runs all their cycles."""
        if asked is None:
            self.asked.pop(unit, None)
        else:
            check_asked(asked, unit)
            self.asked[unit] = asked
        self.known, self.ended_by, self.unknown = None, None, ""

    def asked_of(self, plan: Plan | None) -> tuple[float, str] | None:
        """Return the uncertainty asked for, else the plan's own, and its unit; None where a run has all its cycles."""
        if plan is None:
            return None
        unit = UNIT_OF_REQUIREMENT.get(plan.kind, "")
        asked = self.asked.get(unit, plan.end_percent_fso)
        return (asked, unit) if asked else None

    def close(self) -> None:
        """End the process of an assessment."""
        if self._job is not None:
            self._job.cancel()

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Assess the run after each further complete cycle; end it where U is small enough."""
        progress, asked = snapshot.progress, self.asked_of(snapshot.plan)
        if snapshot.state is not SessionState.RUNNING or progress is None or asked is None:
            self.close()
            if self._stopping and snapshot.state is SessionState.RUNNING:
                self._session.stop_at_cycles(on=False)
            self._job, self._cycles, self.unknown, self._stopping = None, 0, "", False
            self._unwritten = None
            self.known = self.known if snapshot.state is SessionState.FINISHING else None
            return
        if not progress.complete_cycles:
            self.ended_by = None  # that of the run before
        if not self._stopping:
            self._session.stop_at_cycles(on=True, first=FIRST_HELD[asked[1]])
            self._stopping = True
        if self._job is not None and self._job.poll() is not JobState.RUNNING:
            self._take(self._job, progress.complete_cycles)
            self._job = None
        if self._job is None and progress.complete_cycles > self._cycles and snapshot.recording is not None:
            self._cycles = progress.complete_cycles
            self._enter_readings()
        if self._unwritten is not None and self._session.written(self._unwritten):
            self._unwritten = None
            self._begin(snapshot, asked[0])

    def _enter_readings(self) -> None:
        """Enter the readings of the cycle; it is assessed once they and its samples are in the file."""
        try:
            self._enter()
        except RequestError as error:
            self._not_known(error.cause)
            return
        self._unwritten = self._session.taken()

    def _begin(self, snapshot: SessionSnapshot, asked: float) -> None:
        from analysis.stopping.criterion import assess_run

        self.ended_by = None
        assert snapshot.recording is not None
        assert snapshot.plan is not None
        plan = snapshot.plan
        self._job = Job(
            ASSESSING, assess_run, snapshot.recording, asked, plan.cycles, repeats=plan.kind == "continuous"
        )

    def _take(self, job: Job, complete_cycles: int) -> None:
        if job.state is not JobState.DONE:
            cause = job.failure.cause if job.failure is not None else str(job.state.value)
            self._not_known(cause)
            return
        self.known, self.unknown = job.result, ""
        self._report(job.result.text)
        if job.result.reached:
            self._session.finish_early(job.result.end)
            self.ended_by = job.result if complete_cycles == self._cycles else None
        else:
            self._session.hold_at(job.result.hold)
            self._session.next_cycle(self._cycles)

    def _not_known(self, cause: str) -> None:
        """Report why the latest cycle has no assessment, and show it until a later one has."""
        self.unknown = f"U is not known after {count(self._cycles, 'cycle')}: {cause}"
        self._report(self.unknown)
        self._session.next_cycle(self._cycles)

    def at_end(self, recording: Path, plan: Plan) -> EndUncertainty | None:
        """Assess all complete cycles of a run that has ended; return None where no uncertainty was asked for."""
        asked = self.asked_of(plan)
        if asked is None:
            return None
        if self.ended_by is not None:
            return EndUncertainty.of(self.ended_by, *asked)
        return assess_end(recording, *asked, plan.cycles)
