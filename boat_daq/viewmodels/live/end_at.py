"""The uncertainty at which a run ends: its entry in the form of the plan, and the report after a run.

A calibration ends at U in mm, a repeatability run at % FSO; each value is kept between starts, and off until entered.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from analysis.stopping.requirement import EXAMPLES, UNIT_OF_REQUIREMENT, check_asked
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.formatting import duration, plain_number
from boat_daq.viewmodels.common.notices import Notices, sentence
from boat_daq.viewmodels.common.services import Change, Services
from boat_daq.workflows.end_at_uncertainty import ASSESSING, EnoughCycles, assess_end
from boat_daq.workflows.jobs import Job, JobState
from protocol.base.errors import RequestError

if TYPE_CHECKING:
    from boat_daq.viewmodels.live.sequence import SequenceModel

KEY = "end_at"  # of the preferences
WRITTEN_S = 0.5  # after the end of a run its last samples are in the file
NOT_KNOWN = {
    "mm": "U {:g} mm asked, known after one cycle",
    "% FSO": "\u00b1{:g} % FSO asked, known after a few cycles",
}
WITH_PLAN = (SessionState.ARMED, SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING)


def uncertainty_text(enough: EnoughCycles, snapshot: SessionSnapshot) -> str:
    """Return the uncertainty now, the one asked for and the time left to it; "" without a run that has one."""
    asked, known = enough.asked_of(snapshot.plan), enough.known
    if asked is None or snapshot.state not in WITH_PLAN:
        return ""
    if enough.unknown:
        return enough.unknown
    if known is None or snapshot.progress is None:
        return NOT_KNOWN[asked[1]].format(asked[0])
    if known.void:
        return known.text
    if known.reached:
        return known.end
    if known.best:
        return f"{known.now}, {known.best}"
    progress, more = snapshot.progress, known.more_cycles or 0
    begun = progress.complete_cycles - known.cycles
    planned = max(progress.cycles - progress.complete_cycles, 1)
    left_s = progress.time_left_s * max(more - begun, 0) / planned
    return ", ".join(filter(None, (known.now, known.at_least, f"ends in about {duration(left_s)}")))


class EndAt:
    """The entry of the plan's form."""

    def __init__(self, enough: EnoughCycles, sequence: SequenceModel, services: Services) -> None:
        self._enough, self._sequence = enough, sequence
        self._preferences, self._undo = services.preferences, services.undo
        self.revision = 0
        kept = self._preferences.get(KEY, {})
        for unit in UNIT_OF_REQUIREMENT.values():
            value = kept.get(unit)
            if isinstance(value, int | float) and 0.0 < value < math.inf:
                enough.ask(float(value), unit)

    @property
    def unit(self) -> str:
        """Return the unit for the chosen plan; empty where its kind runs all cycles."""
        return UNIT_OF_REQUIREMENT.get(self._sequence.plan.kind, "")

    @property
    def text(self) -> str:
        """Return the value of that unit; empty where it is off."""
        asked = self._enough.asked_of(self._sequence.plan)
        return "" if asked is None else f"{asked[0]:g}"

    def enter(self, text: str) -> None:
        """Set the value of the chosen plan's unit from text; an empty one runs all cycles."""
        unit, typed = self.unit, text.strip()
        asked, before = self._number(typed, unit) if typed else None, self._enough.asked.get(unit)
        if asked != before:
            text, ask = "U at which runs end", self._ask
            self._undo.push(Change(text, lambda: ask(asked, unit), lambda: ask(before, unit)))

    @staticmethod
    def _number(typed: str, unit: str) -> float:
        try:
            asked = plain_number(typed.removesuffix(unit))
        except ValueError:
            remedy = f"Enter a number in {unit}, such as {EXAMPLES[unit]}, or leave it empty to run all cycles."
            raise RequestError(f"{typed!r} is not a number", remedy) from None
        check_asked(asked, unit)
        return asked

    def _ask(self, asked: float | None, unit: str) -> None:
        self._enough.ask(asked, unit)
        self._preferences.set(KEY, dict(self._enough.asked))
        self.revision += 1


class EndReport:
    """Reports what a run had reached at its end; `text` is kept until the next plan is armed."""

    def __init__(self, enough: EnoughCycles, notices: Notices, clock: Callable[[], float] = monotonic) -> None:
        self._enough, self._notices, self._clock = enough, notices, clock
        self._run: tuple[Path, Plan] | None = None  # under way, with a complete cycle
        self._ended: tuple[Path, Plan] | None = None
        self._due_s = 0.0
        self._job: Job | None = None
        self._name = ""  # of the recording that is assessed
        self.text = ""

    def close(self) -> None:
        if self._job is not None:
            self._job.cancel()
            self._job = None

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Assess a run once it has ended and its samples are written."""
        if snapshot.state in WITH_PLAN:
            self._run, self.text = self._under_way(snapshot), ""
        elif self._run is not None:
            self._end(self._run, snapshot)
            self._run = None
        if self._ended is not None and self._clock() >= self._due_s:
            self._assess(*self._ended, shown=snapshot.state not in WITH_PLAN)
            self._ended = None
        if self._job is not None and self._job.poll() is not JobState.RUNNING:
            self._take(self._job, shown=snapshot.state not in WITH_PLAN)
            self._job = None

    def _under_way(self, snapshot: SessionSnapshot) -> tuple[Path, Plan] | None:
        """Return recording and plan of a run with a complete cycle; None without one, or where no U is asked for."""
        plan, recording, progress = snapshot.plan, snapshot.recording, snapshot.progress
        if plan is None or recording is None or progress is None or self._enough.asked_of(plan) is None:
            return None
        return (recording, plan) if progress.complete_cycles else None

    def _end(self, run: tuple[Path, Plan], snapshot: SessionSnapshot) -> None:
        """Take the assessment that ended the run, else let all its cycles be assessed."""
        ended = snapshot.run_ended
        if ended is None or ended.aborted:  # it can be resumed
            return
        if self._enough.ended_by is None:
            self._ended, self._due_s = run, self._clock() + WRITTEN_S
        elif (found := self._enough.at_end(*run)) is not None:
            self.text = sentence(found.text)

    def _assess(self, recording: Path, plan: Plan, *, shown: bool) -> None:
        """Start to assess the run that has ended; `shown` is whether no other one is armed."""
        asked = self._enough.asked_of(plan)
        if asked is None:
            return
        self.close()
        self._job, self._name = Job(ASSESSING, assess_end, recording, *asked, plan.cycles), recording.name
        self.text = "Assessing the uncertainty of all cycles \u2026" if shown else ""

    def _take(self, job: Job, *, shown: bool) -> None:
        """Report an assessment, with the recording's name beside the next run."""
        if job.state is JobState.DONE:
            cause = job.result.text
        else:
            failure = job.failure.cause if job.failure is not None else str(job.state.value)
            cause = f"the uncertainty is not known at the end of the run: {failure}"
        self.text = sentence(cause) if shown else ""
        self._notices.inform(cause if shown else f"{self._name}: {cause}")
