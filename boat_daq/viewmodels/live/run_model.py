"""The run on the bench: the buttons of its sequence, its recording, its readings and markers."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path

from boat_daq.engine.file_names import path_in
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.services import Page, Services
from boat_daq.viewmodels.live.connection import ConnectionModel
from boat_daq.viewmodels.live.live_model import LiveModel, Marker
from boat_daq.viewmodels.live.readings import ReadingsModel
from boat_daq.viewmodels.live.run_offers import CalibrationOffer, ResumeRun
from boat_daq.viewmodels.live.sequence import SequenceModel

UNDER_WAY = (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING)


class RunModel:
    """State of the run and what the operator can do with it.

    Parameters
    ----------
    session : commands the board and records.
    connection : names the unit on the bench, reads the simulated grid.
    live, sequence, readings : of the same session.
    resumption, calibration : what is offered after a run.
    services : of the window.
    """

    def __init__(
        self,
        session: Session,
        connection: ConnectionModel,
        live: LiveModel,
        sequence: SequenceModel,
        readings: ReadingsModel,
        resumption: ResumeRun,
        calibration: CalibrationOffer,
        services: Services,
    ) -> None:
        self.session, self.connection, self.live = session, connection, live
        self.sequence, self.readings = sequence, readings
        self.resumption, self.calibration = resumption, calibration
        self._services = services

    @property
    def snapshot(self) -> SessionSnapshot:
        """Return the session as it is now."""
        return self.session.snapshot()

    def connected(self) -> bool:
        """Return whether samples arrive."""
        return self.snapshot.link is LinkState.UP

    def press(self, button: str) -> None:
        """Press a button of the sequence; start begins a recording first, so that no run is lost.

        Each run has its own recording: one that holds a run already is closed before the plan is armed again.
        """
        self._services.notices.attempt(lambda: self._press(button))

    def _press(self, button: str) -> None:
        recording = self.snapshot.recording
        if button == "start" and recording is None:
            self.record()
        if button == "arm" and recording is not None and self.session.steps():
            self.session.stop_recording()
        self.sequence.press(button)
        if button == "start":
            self._services.show(Page.LIVE)  # which asks for the readings

    def record(self) -> Path:
        """Start a recording named after unit and time; return its path.

        Raises
        ------
        BoatDaqError : the folder cannot be written, or nothing is connected.
        """
        folder, unit = self._services.recordings, self.connection.unit
        folder.mkdir(parents=True, exist_ok=True)
        stamp = datetime.now(UTC).astimezone().strftime("%Y-%m-%d_%H%M%S")
        path = path_in(folder, f"{unit}_{stamp}.boat")
        self.session.start_recording(path, {"unit": unit, "operator": ""})
        return path

    def toggle_recording(self) -> None:
        """Start a recording, or close the current one."""
        notices, snapshot = self._services.notices, self.snapshot
        if snapshot.recording is None:
            notices.attempt(self.record, done="Recording")
        elif snapshot.state in UNDER_WAY:
            notices.add(Severity.WARNING, "a run is in progress", "Stop it before closing the recording.")
        else:
            notices.attempt(self.session.stop_recording, done="Recording closed")

    def mark(self, note: str) -> None:
        """Add a marker with a note at the newest sample."""
        now_s = self.live.now_s()
        if self._services.notices.attempt(lambda: self.session.mark(note)) and not math.isnan(now_s):
            self.live.markers.append(Marker(now_s, note))

    def can_read_simulated(self) -> bool:
        """Return whether there is a simulated grid to read."""
        return self.connection.simulated_mm() is not None

    def read_simulated(self, step_id: int) -> None:
        """Enter what the simulated unit's grid shows, to the nearest half millimetre."""
        x = self.connection.simulated_mm()
        if x is not None:
            self._services.notices.attempt(lambda: self.readings.put(step_id, x, "simulated"))

    def skip_reading(self) -> None:
        """Continue the plateau that waits without a reading."""
        self._services.notices.attempt(self.session.skip_reading)

    def reading_points(self) -> tuple[list[float], list[float]]:
        """Return the ring's time (s) and the elongation (mm) of each plateau that was read and is in the ring."""
        read = {key: r.elongation_mm for key, r in self.readings.latest().items() if r.elongation_mm is not None}
        points = [
            (time_s, read[step.number])
            for step in self.session.steps()
            if step.number in read and (time_s := self.live.time_of(step.settled_us or step.started_us)) is not None
        ]
        return [time_s for time_s, _ in points], [mm for _, mm in points]
