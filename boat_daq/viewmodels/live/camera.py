"""The camera of the window: opened and closed by the operator, shown with its marks and its value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from boat_daq.engine.camera.capture import CameraState
from boat_daq.engine.session.camera_channel import FAULT_TEXTS, CameraChannel
from boat_daq.engine.session.session import Session
from boat_daq.engine.simulator.picture import CameraScene
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import count, in_units, plain_number
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.workflows.camera_tracking import CameraChoice, open_channel
from protocol.base.errors import RequestError
from protocol.base.units import NOTHING, STORED_UNITS

_SOURCE, MARK = "camera_source", "camera_mark_mm"
LEARNING = "learning"


@dataclass(frozen=True, slots=True)
class CameraView:
    """What the panel shows; `warning` gives the reason and remedy where there is no value."""

    state: CameraState | None
    elongation: str = NOTHING
    u: str = ""
    line: str = ""
    warning: str = ""


class CameraModel:
    """The camera beside the session; `virtual` returns where that of the virtual board is, empty without one."""

    def __init__(self, session: Session, preferences: Preferences, virtual: Callable[[], str] = lambda: "") -> None:
        self._session, self._preferences, self.virtual = session, preferences, virtual
        self.channel: CameraChannel | None = None
        self.units = STORED_UNITS  # in which elongations are shown

    @property
    def source(self) -> str:
        return str(self._preferences.get(_SOURCE, "0"))

    @property
    def mark(self) -> str:
        """Side of the marks last used, mm."""
        return str(self._preferences.get(MARK, "10"))

    def open(self, source: str, mark: str) -> None:
        """Open a camera in place of the open one; `mark` is the side of the square, mm, 0 for the millimetre grid."""
        try:
            mark_mm = plain_number(mark)
        except ValueError:
            raise RequestError(f"{mark!r} is not a length", "Type the side of a mark's black square in mm.") from None
        unit = self._session.snapshot().unit
        choice = CameraChoice(source.strip(), mark_mm, unit=unit)
        self.close()
        self.channel = open_channel(self._session, choice)
        self._preferences.set(_SOURCE, source.strip())
        self._preferences.set(MARK, mark.strip())

    def open_virtual(self) -> None:
        """Open the camera of the virtual board; the camera used last is kept for the next time."""
        self.close()
        unit = self._session.snapshot().unit
        self.channel = open_channel(self._session, CameraChoice(self.virtual(), CameraScene().mark_mm, unit=unit))

    def save_marks(self, path: Path, mark: str) -> None:
        from analysis.tracking.sheet import write_sheet

        try:
            write_sheet(path, plain_number(mark))
        except ValueError:
            raise RequestError(f"{mark!r} is not a length", "Type the side of a mark's black square in mm.") from None

    def close(self) -> None:
        """Close the camera; the session stays."""
        channel, self.channel = self.channel, None
        if channel is not None:
            channel.close()

    def follow(self, snapshot: SessionSnapshot) -> None:
        if self.channel is not None and (error := self.channel.state.error) is not None:
            self.close()
            raise error

    def view(self) -> CameraView:
        if self.channel is None:
            return CameraView(None)
        state = self.channel.state
        reading = state.reading
        if reading is None:
            return CameraView(state, line="waiting for the first picture")
        rate = f"{state.rate_hz:.0f} frames/s" if state.rate_hz else "starting"
        line = f"{rate}, {count(state.frames, 'frame')}, {state.dropped} missing"
        if reading.elongation_mm is None or reading.u_mm is None:
            cause, remedy = FAULT_TEXTS.get(reading.fault, ("", ""))
            text = "learning the marks' plane" if reading.fault == LEARNING else f"{cause}: {remedy}" if cause else ""
            return CameraView(state, line=line, warning=text[:1].upper() + text[1:])
        x_mm = reading.elongation_mm - self.channel.rest_mm
        u = in_units(self.units, "mm", reading.u_mm, 3).removeprefix("+")
        return CameraView(state, in_units(self.units, "mm", x_mm, 3), f"u {u}", line)
