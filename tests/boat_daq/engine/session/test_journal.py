"""The journal's warnings."""

from __future__ import annotations

from boat_daq.engine.session.journal import Journal
from boat_daq.engine.snapshot import MessageKind


class LateRecorder:
    """In place of a recorder: its lag."""

    def __init__(self) -> None:
        self.lag_ms, self.failure = 90.0, ""


def test_samples_that_wait_for_the_disk_are_warned_of_once():
    """Above 0.5 s one warning; another after they were in time again, not while they stay between the two bounds."""
    journal, recorder = Journal(), LateRecorder()
    journal.recorder = recorder  # type: ignore[assignment]
    warned = []
    for lag_ms in (90, 499, 501, 2700, 400, 600, 90, 510):
        recorder.lag_ms = lag_ms
        journal.watch_disk()
        warned.append(len(journal.messages))
    assert warned == [0, 0, 1, 1, 1, 1, 1, 2]
    assert [(m.kind, m.level) for m in journal.messages] == [(MessageKind.STORAGE, "warning")] * 2
    assert "the last 0.5 s are not saved yet" in journal.messages[0].cause
    recorder.lag_ms = 90
    journal.watch_disk()
    recorder.lag_ms, recorder.failure = 600, "the disk is full"  # which the recorder reports itself
    journal.watch_disk()
    assert len(journal.messages) == 2
