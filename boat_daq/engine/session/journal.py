"""A session's messages, steps and readings: kept for display, and written into the recording where one runs.

Steps and readings are kept here as well as in the file, so that no page reads the disk for them. Steps are numbered
from 1 in every recording; a step's number is its id in the recording's table `step`.
"""

from __future__ import annotations

import time
from collections import deque

from boat_daq.engine.control.sequencer import ControlEvent, SegmentBreak, StepChanged
from boat_daq.engine.log import note
from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.recording.rows import reading_row
from boat_daq.engine.snapshot import LATE_MS, Message, MessageKind, Reading, RunEnding
from protocol.base.errors import RequestError

MESSAGES = 50
_OTHER_CLOCK = (MessageKind.BOARD_RESTARTED, MessageKind.BOARD_CLOCK)


class Journal:
    """Keeps and records; the session's lock guards it."""

    def __init__(self) -> None:
        self.recorder: Recorder | None = None
        self.broken: BrokenRun | None = None  # the run that this recording resumes
        self.messages: deque[Message] = deque(maxlen=MESSAGES)
        self.steps: dict[int, StepMark] = {}
        self.readings: list[Reading] = []
        self.closed = 0  # number of the last step of a recording that is closed
        self.earlier = 0  # number of the last step on another clock than that of the samples on the screen
        self.ended: RunEnding | None = None  # the recording's last run
        self._last = 0
        self._late = False

    @property
    def lag_ms(self) -> float:
        """Age of the oldest thing not yet on disk."""
        return self.recorder.lag_ms if self.recorder is not None else 0.0

    @property
    def at_risk_ms(self) -> float:
        """What a crash would cost at most."""
        return self.recorder.at_risk_ms if self.recorder is not None else 0.0

    def watch_disk(self) -> None:
        """Warn once when samples wait too long for the disk, and again when it happens after they were in time."""
        lag_ms = self.lag_ms
        failing = self.recorder is not None and self.recorder.failure  # reported by the recorder
        if lag_ms > LATE_MS and not self._late and not failing:
            cause = f"the disk is slow: the last {lag_ms / 1e3:.1f} s are not saved yet"
            self.tell(MessageKind.STORAGE, "warning", cause, "close programs that write to that disk, or use another")
        self._late = lag_ms > (LATE_MS / 2 if self._late else LATE_MS)

    def begin(self, recorder: Recorder, broken: BrokenRun | None = None) -> None:
        """Begin a recording, with the steps and readings of the run that it resumes."""
        self.recorder, self.ended, self.broken, self.closed = recorder, None, broken, 0
        self.steps = {mark.number: mark for mark in broken.marks} if broken else {}
        self.readings = list(broken.readings) if broken else []
        self.new_clock()

    def close(self) -> Recorder | None:
        """End the recording, whose readings are then corrected in its file; return its recorder."""
        recorder, self.recorder = self.recorder, None
        if recorder is not None:
            self.closed = max(self.steps, default=0)
        return recorder

    def new_clock(self) -> None:
        """Note that the samples to come are on another clock than the steps so far."""
        self.earlier = max(self.steps, default=0)

    def tell(self, kind: MessageKind, level: str, cause: str, remedy: str = "", command: str = "") -> None:
        """Add a message for the operator, and log it."""
        self._last += 1
        note(level, f"{kind}: {cause}" + (f" (try: {remedy})" if remedy else ""))
        self.messages.append(Message(self._last, kind, level, cause, remedy, time.monotonic_ns(), command))

    def take(self, effect: StepChanged | SegmentBreak | ControlEvent | RunEnding, *, time_us: int | None) -> None:
        """Keep an effect of the controller; `time_us` is the board time of its event."""
        match effect:
            case StepChanged(mark, new):
                self.steps[mark.number] = mark
                self.closed = 0 if new else self.closed
                if self.recorder is not None:
                    self.recorder.step(mark, new=new)
            case SegmentBreak(reason, paused):
                if self.recorder is not None:
                    self.recorder.new_segment(reason, paused=paused)
            case ControlEvent():
                if effect.kind in _OTHER_CLOCK:
                    self.new_clock()
                if effect.level:
                    self.tell(effect.kind, effect.level, effect.text, effect.remedy)
                else:
                    note("info", f"{effect.kind}: {effect.text}")
                self.event("sequencer", effect.kind, effect.text, value=effect.value, time_us=time_us)
            case RunEnding():
                self.ended = effect

    def event(
        self, source: str, kind: str, text: str, *, value: float | None = None, time_us: int | None = None
    ) -> None:
        """Record an event, where a recording runs."""
        if self.recorder is not None:
            self.recorder.event(source, kind, value=value, text=text, time_us=time_us)

    def add_reading(self, reading: Reading) -> None:
        """Keep a reading. RequestError: no such plateau, none of this recording, or no length that a unit can have."""
        if reading.step_id <= self.closed:
            remedy = "correct its readings on the page Recordings"
            raise RequestError("the recording of this run is closed", remedy)
        if reading.step_id not in self.steps:
            raise RequestError(f"there is no step {reading.step_id}", "give the number of a plateau of this recording")
        reading_row(reading)  # refuses what is no reading, also where nothing is recorded
        self.readings.append(reading)
        if self.recorder is not None:
            self.recorder.reading(reading)
