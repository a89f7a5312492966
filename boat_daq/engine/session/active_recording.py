"""The recordings of a session: one begins, or a broken one goes on, beside whatever the board sends; and ends.

Rules: nothing that fails here leaves a half-begun recording in the session; closing is done once, by whoever is first.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from boat_daq.engine.control.preflight import Check
from boat_daq.engine.log import note
from boat_daq.engine.recording.disk_space import check_space
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.session.core import Core
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.snapshot import MessageKind, RunEnding, SessionState
from boat_daq.errors import OperatorError, StorageError
from protocol.recording import RunEnd


class Recordings:
    """Begins and ends the recording of one session.

    Attributes
    ----------
    unit : name of the unit on the bench; empty where none was given.
    since_us : board time at which the recording under way began.
    """

    def __init__(self, core: Core, settings: Settings, units: UnitLibrary) -> None:
        self.unit = ""
        self.since_us = 0
        self._core, self._settings, self._units = core, settings, units

    def begin(
        self, path: Path, metadata: Mapping[str, Any] | None, broken: BrokenRun | None, *, port: str | None
    ) -> None:
        """Record into `path` from now on, or go on in the recording of a broken run; see `Session.start_recording`."""
        core = self._core
        ours = {
            "operator": self._settings.operator,
            "unit": self.unit,
            "note": "",
            "port": port,
            "polarity": self._units.load(self.unit).polarity if self.unit else -1,
            "settings": dataclasses.asdict(self._settings),
        }
        with core.lock:
            acquisition = core.acquisition
            if acquisition is None or not (core.control.up or core.control.hold_samples):
                raise OperatorError("there is nothing to record yet", "connect a board first")
            if core.journal.recorder is not None:
                raise OperatorError(f"{core.journal.recorder.path} is being recorded", "stop that recording first")
            if core.control.sequencer.state in (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING):
                raise OperatorError("a recording begins before its run", "stop the run first")
            meta = {**ours, **core.describe(), **(metadata or {})}
        if broken is not None:
            broken.check_same(meta, can_command=core.control.dialogue.can_command)
        recorder = Recorder(path, meta, health=core.health_now, on_error=core.storage_failed, goes_on=broken)
        with core.lock:
            raced = core.journal.recorder is not None or core.acquisition is not acquisition
            if not raced:
                acquisition.add_recorder(recorder)
                core.journal.begin(recorder, broken)
                core.control.sequencer.marks[:] = broken.marks if broken else ()
                self.since_us = core.control.dialogue.board_us
        note("info", f"recording {'goes on in' if broken else 'begins in'} {path}")
        if raced:
            recorder.close(RunEnd.STOPPED)
            raise OperatorError("the session changed while the recording began", "try again")

    def end(self, end: RunEnd) -> Path | None:
        """Close the recording as it is, without a word to the board; `end` where no run gives one."""
        core = self._core
        with core.lock:
            recorder, core.journal.recorder = core.journal.recorder, None
            ending, acquisition = core.journal.ended or RunEnding(end), core.acquisition
        if recorder is None:
            return None
        if acquisition is not None:
            acquisition.remove_sink(recorder)
        path = recorder.close(ending.end, ending.cause)
        note("info", f"recording ended, {ending.text}: {path}")
        if recorder.remark:
            core.tell(MessageKind.STORAGE, "warning", recorder.remark)
        return path

    def check_space(self) -> Check:
        """Whether what the plan will record fits on the disk; nothing to ask where nothing is recorded."""
        core = self._core
        with core.lock:
            recorder, plan, rate_hz = core.journal.recorder, core.control.sequencer.plan, core.control.rate_hz
            n_sensors = core.port.link.n_sensors if core.port else None
        if recorder is None or plan is None:
            return Check("space")
        try:
            check_space(recorder.path.parent, rate_hz=rate_hz, duration_s=plan.duration_s, n_sensors=n_sensors or 2)
        except StorageError as error:
            return Check("space", error.cause, error.remedy)
        return Check("space")
