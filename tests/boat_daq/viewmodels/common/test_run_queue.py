"""A queue in the window: pauses, waits for the operator and other units, and what ends it."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import pytest

from boat_daq.engine.plan import Plan
from boat_daq.engine.run_queue import QueuedRun
from boat_daq.engine.snapshot import LinkState, RunEnding, SessionSnapshot, SessionState
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.run_queue import RunQueue
from protocol.base.errors import RequestError
from protocol.recording import RunEnd

PLAN = Plan("short", "staircase", 1, step_kpa=45.0)


class Bench:
    """A run model without a board: what the queue begins, and the session as the test sets it."""

    def __init__(self) -> None:
        self.snapshot = SessionSnapshot(SessionState.IDLE, LinkState.UP, unit="SA1")
        self.begun: list[str] = []
        self.notices = Notices()
        session: Any = SimpleNamespace(
            snapshot=lambda: self.snapshot, stop_recording=lambda: self.begun.append("closed")
        )
        self.now_s = 0.0
        self.queue = RunQueue(session, self.begin, self.notices, lambda: self.now_s)

    def begin(self, plan: Plan) -> None:
        self.begun.append(plan.name)
        self.show(state=SessionState.RUNNING, run_ended=None)

    def show(self, **changes: Any) -> None:
        self.snapshot = dataclasses.replace(self.snapshot, **changes)

    def end(self, how: RunEnd = RunEnd.FINISHED) -> None:
        self.show(state=SessionState.IDLE, run_ended=RunEnding(how))

    def follow(self) -> None:
        self.queue.follow(self.snapshot)

    @property
    def notice(self) -> str:
        found = self.notices.current()
        return found.cause if found else ""


def runs(*queued: QueuedRun) -> tuple[tuple[QueuedRun, Plan], ...]:
    return tuple((run, dataclasses.replace(PLAN, name=run.plan)) for run in queued)


def test_runs_follow_after_pause_and_confirmation() -> None:
    """Nothing begins before its pause is over and the operator has confirmed; the queue says when it is complete."""
    bench = Bench()
    bench.queue.start(runs(QueuedRun("a"), QueuedRun("b", pause_s=60.0, wait="Mount SA2", name="{plan}_{number}")))
    bench.follow()
    assert bench.begun == ["a"]
    bench.follow()
    bench.end()
    bench.follow()
    assert bench.begun == ["a", "closed"]
    assert bench.queue.template == "{plan}_{number}"
    bench.now_s = 59.0
    bench.follow()
    assert bench.notice == ""
    bench.now_s = 61.0
    for _ in range(3):
        bench.follow()
    assert bench.notice == "queue, run 2: Mount SA2"
    assert bench.begun == ["a", "closed"]
    bench.notices.current().action()
    bench.follow()
    bench.end()
    bench.follow()
    assert bench.begun == ["a", "closed", "b", "closed"]
    assert not bench.queue.active


def test_another_unit_is_connected_first() -> None:
    bench = Bench()
    bench.queue.start(runs(QueuedRun("a", unit="SA2")))
    bench.follow()
    bench.queue._confirm()
    bench.follow()
    assert bench.begun == []
    assert bench.notice == "queue, run 1: the next run is of unit SA2"
    bench.show(unit="SA2")
    bench.follow()
    assert bench.begun == ["a"]


@pytest.mark.parametrize("how", [RunEnd.STOPPED, RunEnd.ABORTED, RunEnd.FAULT])
def test_a_run_that_does_not_finish_ends_the_queue(how: RunEnd) -> None:
    bench = Bench()
    bench.queue.start(runs(QueuedRun("a"), QueuedRun("b")))
    bench.follow()
    bench.end(how)
    bench.follow()
    bench.follow()
    assert bench.begun == ["a", "closed"]
    assert bench.notice.startswith("the queue has ended: run 1 was")


def test_a_lost_board_and_a_run_in_progress_hold_the_queue() -> None:
    """It begins with a connected board and no run, and waits for a board that was lost."""
    bench = Bench()
    bench.show(state=SessionState.RUNNING)
    with pytest.raises(RequestError, match="begins with"):
        bench.queue.start(runs(QueuedRun("a")))
    bench.show(state=SessionState.IDLE)
    bench.queue.start(runs(QueuedRun("a")))
    bench.show(link=LinkState.LOST)
    bench.follow()
    assert bench.begun == []
    bench.queue.stop()
    bench.show(link=LinkState.UP)
    bench.follow()
    assert bench.begun == []
