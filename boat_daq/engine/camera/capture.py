"""The camera's two threads: one takes the frames as they come, the other has the newest tracked and hands it on.

The engine knows no tracker: `track` turns a picture into a reading. A frame that comes while the one before is tracked
waits, and is replaced by a newer one: a busy computer loses frames, counted from the intervals, and never falls behind.
An error of the source ends both threads and is kept in `error`; nothing here delays the board's reading thread.
"""

from __future__ import annotations

import statistics
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.camera.source import CameraFrame, CameraSource, Picture
from boat_daq.engine.log import note_failure
from boat_daq.engine.snapshot import CameraReading
from protocol.base.errors import BoatDaqError, DeviceError, cause_and_remedy

INTERVALS_KEPT = 31
MISSING_FROM = 1.6  # intervals: longer ones lack a frame


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """Elongation in a picture and its standard uncertainty, mm, None where there is no value."""

    elongation_mm: float | None
    u_mm: float | None
    fault: str = ""  # why there is no value; empty where there is one
    marks_px: tuple[NDArray[np.float64], ...] = ()  # [4, 2] corners of each mark that was found


@dataclass(frozen=True, slots=True)
class CameraState:
    """What is known of a camera now."""

    frames: int = 0  # since it was opened, as the next two
    valid: int = 0
    dropped: int = 0
    rate_hz: float | None = None  # of the last second; None before
    reading: CameraReading | None = None  # the newest, as the next two; None before the first
    picture: Picture | None = None
    tracked: TrackedFrame | None = None
    error: BoatDaqError | None = None  # why it ended; None while it runs


class Camera:
    """Captures from one source until it is closed."""

    def __init__(
        self,
        source: CameraSource,
        track: Callable[[Picture, float], TrackedFrame],
        sink: Callable[[CameraReading, Picture], None],
    ) -> None:
        self.source = source
        self._track, self._sink = track, sink
        self._state = CameraState()
        self._intervals: deque[float] = deque(maxlen=INTERVALS_KEPT)
        self._changed = threading.Condition()
        self._waiting: CameraFrame | None = None
        self._ended = False
        self._error: BoatDaqError | None = None
        self._grabber = threading.Thread(target=self._grab, name=f"camera {source.name}", daemon=True)
        self._thread = threading.Thread(target=self._run, name=f"tracking {source.name}", daemon=True)

    def start(self) -> None:
        self._grabber.start()
        self._thread.start()

    @property
    def state(self) -> CameraState:
        """What is known now; one value that is never changed."""
        return self._state

    def close(self) -> None:
        """End both threads; waits for the one that tracks."""
        self.source.close()
        with self._changed:
            self._ended, self._waiting = True, None
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join()

    def _grab(self) -> None:
        """Take the frames as they come, until the source ends."""
        try:
            for frame in self.source.frames():
                with self._changed:
                    if self._ended:
                        break
                    self._waiting = frame
                    self._changed.notify_all()
        except Exception as failed:  # noqa: BLE001 - a thread must never end silently
            self._error = _as_error(failed)
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _run(self) -> None:
        """Track the newest frame, again and again."""
        before_s: float | None = None
        try:
            while (frame := self._newest()) is not None:
                self._take(frame, before_s)
                before_s = frame.time_s
        except Exception as failed:  # noqa: BLE001 - a thread must never end silently
            self._error = _as_error(failed)
            self.source.close()
        self._state = replace(self._state, rate_hz=None, error=self._error)

    def _newest(self) -> CameraFrame | None:
        """Return the frame that waits, or the next one; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._waiting is not None)
            frame, self._waiting = self._waiting, None
            return frame

    def _take(self, frame: CameraFrame, before_s: float | None) -> None:
        """Track a frame and hand its reading on."""
        dropped = self._missing(frame.time_s - before_s) if before_s is not None else 0
        picture = frame.decode()
        tracked = self._track(picture, frame.time_s)
        good = not tracked.fault
        reading = CameraReading(
            round(frame.time_s * 1e9), tracked.elongation_mm, tracked.u_mm, tracked.fault, dropped
        )  # fmt: skip
        s = self._state
        rate_hz = 1.0 / statistics.fmean(self._intervals) if len(self._intervals) >= 5 else None
        self._state = CameraState(
            s.frames + 1, s.valid + good, s.dropped + dropped, rate_hz, reading, picture, tracked, None
        )
        self._sink(reading, picture)

    def _missing(self, interval_s: float) -> int:
        """Return how many frames are missing in an interval, by those before it."""
        typical = statistics.median(self._intervals) if len(self._intervals) >= 5 else interval_s
        self._intervals.append(interval_s)
        return max(0, round(interval_s / typical) - 1) if interval_s > MISSING_FROM * typical > 0 else 0


def _as_error(failed: Exception) -> BoatDaqError:
    """Return an error of the family; another one is logged with its traceback."""
    if isinstance(failed, BoatDaqError):
        return failed
    if (known := cause_and_remedy(failed)) is None:
        note_failure("the camera's pictures are not tracked", failed)
        return DeviceError(f"the camera's pictures are not tracked: {failed!r}")
    return DeviceError(*known)
