"""A queue of runs in the window: each starts when the one before has finished, after its pause and wait.

A run that is stopped, vented or aborted ends the queue. A run of another unit waits until the board is connected
as that unit.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import monotonic

from boat_daq.engine.plan import Plan
from boat_daq.engine.run_queue import QueuedRun, load_queue
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.formatting import count, duration
from boat_daq.viewmodels.common.notices import Notice, Notices, Severity
from protocol.base.errors import RequestError
from protocol.recording import RunEnd

_OVER = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)


class RunQueue:
    """The queue of a window; `follow` is called with each refresh."""

    def __init__(
        self, session: Session, begin: Callable[[Plan], None], notices: Notices, clock: Callable[[], float] = monotonic
    ) -> None:
        self._session, self._begin_run, self._notices, self._clock = session, begin, notices, clock
        self._runs: list[tuple[QueuedRun, Plan]] = []
        self._next = 0
        self._under_way = False  # a run of the queue
        self._due_s = 0.0  # of the next run, after its pause
        self._asked: Notice | None = None
        self._confirmed = False

    @property
    def active(self) -> bool:
        """Whether runs are left or under way."""
        return bool(self._runs)

    @property
    def template(self) -> str:
        """Template of the name of the next recording; empty without one."""
        return self._runs[self._next][0].name if self._next < len(self._runs) else ""

    def load(self, path: Path) -> tuple[tuple[QueuedRun, Plan], ...]:
        """Return the runs of a file with their plans."""
        return tuple((run, run.loaded(path.parent)) for run in load_queue(path))

    @staticmethod
    def preview(runs: tuple[tuple[QueuedRun, Plan], ...]) -> str:
        """Return the runs as lines: plan, unit, duration, pause and wait."""
        lines = []
        for number, (run, plan) in enumerate(runs, 1):
            parts = [f"{number}. {plan.name}", run.unit, f"about {duration(plan.duration_s)}"]
            parts += [f"after {duration(run.pause_s)}"] if run.pause_s else []
            parts += [f"waits: {run.wait}"] if run.wait else []
            lines.append(", ".join(part for part in parts if part))
        return "\n".join(lines)

    def start(self, runs: tuple[tuple[QueuedRun, Plan], ...]) -> None:
        """Begin a queue."""
        seen = self._session.snapshot()
        if self.active:
            raise RequestError("a queue is in progress", "Stop it first.")
        if seen.link is not LinkState.UP or seen.state not in _OVER:
            raise RequestError("a queue begins with a connected board and no run", "Connect a board, or stop the run.")
        self._runs, self._next = list(runs), 0
        self._await()

    def stop(self) -> None:
        """Discard the runs that are left; one under way continues."""
        left = len(self._runs) - self._next - self._under_way
        self._end(f"the queue was stopped, {count(left, 'run')} left")

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Begin the next run when it is due."""
        if not self.active:
            return
        if self._under_way:
            if snapshot.state in _OVER and snapshot.run_ended is not None:
                self._finished(snapshot)
        elif self._clock() >= self._due_s and snapshot.link is LinkState.UP and snapshot.state in _OVER:
            self._begin(snapshot)

    def _begin(self, snapshot: SessionSnapshot) -> None:
        """Begin the next run, or have the operator confirm what it waits for."""
        queued, plan = self._runs[self._next]
        other = queued.unit and queued.unit != snapshot.unit
        if other or (queued.wait and not self._confirmed):
            if self._asked is None:
                cause = queued.wait or f"the next run is of unit {queued.unit}"
                remedy = f"Connect the board as unit {queued.unit}, then continue." if other else "Then continue."
                self._asked = self._notices.add(
                    Severity.WARNING,
                    f"queue, run {self._next + 1}: {cause}",
                    remedy,
                    action=("Continue", self._confirm),
                )
            return
        try:
            self._begin_run(plan)
        except Exception:
            self._runs = []
            raise
        self._under_way = True

    def _confirm(self) -> None:
        self._confirmed, self._asked = True, None

    def _finished(self, snapshot: SessionSnapshot) -> None:
        assert snapshot.run_ended is not None
        self._under_way = False
        self._next += 1
        self._session.stop_recording()
        if snapshot.run_ended.end is not RunEnd.FINISHED:
            cause = f"the queue has ended: run {self._next} was {snapshot.run_ended.text}"
            self._end(cause, Severity.WARNING)
        elif self._next == len(self._runs):
            self._end(f"the queue has ended: {count(self._next, 'run')} complete")
        else:
            self._await()

    def _await(self) -> None:
        """Let the pause before the next run begin."""
        self._confirmed, self._asked = False, None
        self._due_s = self._clock() + self._runs[self._next][0].pause_s

    def _end(self, text: str, severity: Severity = Severity.INFORMATION) -> None:
        self._runs, self._under_way = [], False
        self._notices.dismiss(self._asked)
        self._notices.add(severity, text)
