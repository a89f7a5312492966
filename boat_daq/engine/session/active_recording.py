"""The recording of a session: it begins, or resumes that of a broken run, while the board sends; and it ends.

Rules: nothing that fails here leaves a half-begun recording in the session; closing is done once, by the first caller.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from boat_daq.engine.control.controller import Controller
from boat_daq.engine.control.preflight import Check
from boat_daq.engine.log import RECORDING, note
from boat_daq.engine.recording.file import check_space
from boat_daq.engine.recording.metadata_entry import read_metadata, remembered, state_metadata, statements
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.session.guarded_controller import GuardedController
from boat_daq.engine.session.journal import Journal
from boat_daq.engine.session.link_supervisor import LinkSupervisor
from boat_daq.engine.session.unit_under_test import UnitUnderTest
from boat_daq.engine.settings import Settings
from boat_daq.engine.snapshot import CameraReading, MessageKind, RunEnding, SessionState
from protocol.base.errors import RequestError, StorageError
from protocol.recording import Metadata, RunEnd


class ActiveRecording:
    """Begins and ends the recording of one session. `since_us`: board time sampled before the present one."""

    def __init__(
        self,
        control: GuardedController,
        journal: Journal,
        link: LinkSupervisor,
        settings: Callable[[], Settings],
        unit: UnitUnderTest,
    ) -> None:
        self.since_us = 0
        self._stated: tuple[Path, Metadata | None] = Path(), None  # of the recording in progress, where it has changed
        self._filmed: object = None  # the recorder that knows of the camera, and what it knows
        self._about_camera: dict[str, Any] = {}
        self._control, self._journal, self._link = control, journal, link
        self._settings, self._unit = settings, unit

    def begin(self, path: Path, metadata: Mapping[str, Any] | None, broken: BrokenRun | None) -> None:
        """Record from now on, or resume the recording of a broken run."""
        polarity = self._unit.library.load(self._unit.name).polarity if self._unit.name else -1
        with self._control.acting() as control:
            simulated = self._link.simulated(control.hello)
        stated = dataclasses.asdict(remembered(self._unit.library.of(simulated=simulated), self._unit.name))
        with self._control.acting() as control:
            reader = self._link.reader
            if reader is None or not (control.up or control.hold_samples):
                raise RequestError("there is nothing to record yet", "connect a board first")
            if self._journal.recorder is not None:
                raise RequestError(f"{self._journal.recorder.path} is being recorded", "stop that recording first")
            if control.sequencer.state in (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING):
                raise RequestError("a recording begins before its run", "stop the run first")
            meta = {"polarity": polarity, "metadata": stated, **self._describe(control), **(metadata or {})}
        if broken is not None:
            broken.check_same(meta, can_command=control.board.can_command)
        recorder = Recorder(path, meta, health=self._link.health_now, on_error=self._storage_failed, resumes=broken)
        with self._control.acting() as control:
            raced = self._journal.recorder is not None or self._link.reader is not reader
            if not raced:
                reader.add_recorder(recorder)
                self._journal.begin(recorder, broken)
                control.sequencer.marks[:] = broken.marks if broken else ()
                self.since_us = control.sampled_us
        note("info", f"{RECORDING}{path}")
        if raced:
            recorder.close(RunEnd.STOPPED)
            raise RequestError("the session changed while the recording began", "try again")

    def metadata(self, path: Path) -> Metadata:
        """Return the metadata of a recording; of the one in progress with what is not yet on the disk."""
        of, stated = self._stated
        recorder = self._journal.recorder
        active = recorder is not None and recorder.path == path == of
        return stated if active and stated is not None else read_metadata(path)

    def state(self, path: Path, metadata: Metadata) -> None:
        """State metadata of a recording, in progress or closed; the newest count."""
        before = self.metadata(path)
        with self._control.acting():
            recorder = self._journal.recorder
            recording = recorder is not None and recorder.path == path
            if recording:
                for kind, text in statements(before, metadata).items():
                    self._journal.event("user", kind, text)
                self._stated = path, metadata
        if not recording:
            state_metadata(path, metadata)

    def keep_camera(self, reading: CameraReading, about: Mapping[str, Any]) -> None:
        """Keep the reading of a camera's frame, where a recording runs; `about` is as in `Session.keep_camera`."""
        with self._control.lock:
            recorder = self._journal.recorder
            if recorder is None:
                return
            if recorder is not self._filmed or about != self._about_camera:
                self._filmed, self._about_camera = recorder, dict(about)
                recorder.update_meta(camera=self._about_camera)
            recorder.camera(reading)

    def end(self, end: RunEnd) -> Path | None:
        """Close the recording as it is, without a command to the board; return its path, None where there was none."""
        with self._control.acting():
            recorder = self._journal.close()
            ending, reader = self._journal.ended or RunEnding(end), self._link.reader
        if recorder is None:
            return None
        if reader is not None:
            reader.remove_sink(recorder)
        path = recorder.close(ending.end, ending.cause)
        note("info", f"recording ended, {ending.text}: {path}")
        if recorder.warning:
            with self._control.acting():
                self._journal.tell(MessageKind.STORAGE, "warning", recorder.warning)
        return path

    def check_space(self) -> Check:
        """Return whether what the plan will record fits on the disk. A good check where nothing is recorded."""
        with self._control.acting() as control:
            recorder, plan, rate_hz = self._journal.recorder, control.sequencer.plan, control.stream.rate_hz
            n_sensors = self._link.port.link.n_sensors if self._link.port else None
        if recorder is not None and plan is not None:
            try:
                check_space(recorder.path.parent, rate_hz=rate_hz, duration_s=plan.duration_s, n_sensors=n_sensors or 2)
            except StorageError as error:
                return Check("space", error.cause, error.remedy)
        return Check("space")

    def _describe(self, control: Controller) -> dict[str, Any]:
        """Return what a recording's `session` keeps of board, link and plan."""
        port = self._link.port
        assert port is not None
        hello, limits, plan = control.hello, control.interlock.limits, control.sequencer.plan
        return {
            "operator": self._settings().operator,
            "unit": self._unit.name,
            "note": "",
            "port": self._link.url,
            "settings": dataclasses.asdict(self._settings()),
            "simulated": self._link.simulated(hello),
            "board_id": hello.board_id if hello else "",
            "profile": port.profile,
            "n_sensors": port.link.n_sensors,
            "sample_kind": port.link.sample_kind,
            "channels": [list(channel) for channel in port.link.channels],
            "vref_mv": hello.vref_mv if hello else 0,
            "adc_bits": hello.adc_bits if hello else 0,
            "rate_hz": control.stream.rate_hz,
            "limits_pa": limits.pascals if limits else None,
            "plan": dataclasses.asdict(plan) if plan else None,
        }

    def _storage_failed(self, error: StorageError) -> None:
        """Abort the run, on the recorder's thread: no run without its record."""
        with self._control.acting() as control:
            self._journal.tell(MessageKind.STORAGE, "error", error.cause, error.remedy, error.command)
            control.abort(error.cause)
