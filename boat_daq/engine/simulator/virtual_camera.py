"""The virtual camera: the virtual board's true elongation as a video file or as an MJPEG stream on this computer.

Frames are taken at fixed board times and drawn on a thread of their own, so that a slow picture never delays the board.
A file gets every frame, however fast the board runs; a stream gets the newest one, like a webcam's. What a camera
does wrong is listed in `CAMERA_FAULTS`, by name and time.
"""

from __future__ import annotations

import dataclasses
import math
import queue
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from boat_daq.engine.camera.source import FRAMES_PER_S, VideoStore
from boat_daq.engine.simulator.picture import FAULTLESS, CameraScene, Disturbance, Picture, Renderer
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, DeviceError, one_of
from protocol.base.optional import optional
from protocol.simulator.plant import TICK_S

BOUNDARY = "boat-daq-frame"
JPEG_QUALITY = 95

CAMERA_FAULTS: dict[str, tuple[str, Disturbance | None]] = {
    "blurred": ("The picture is out of focus.", Disturbance(blur_px=6.0)),
    "covered": ("A hand covers the tip's mark.", Disturbance(covered=1.0)),
    "half_covered": ("A hand covers half of the tip's mark.", Disturbance(covered=0.5)),
    "base_covered": ("A hand covers the base's mark.", Disturbance(base_covered=1.0)),
    "swapped": ("The two marks are exchanged.", Disturbance(swapped=True)),
    "second_tip": ("Another tip's mark lies in the picture.", Disturbance(second_tip=True)),
    "saturated": ("The light is too strong: white is clipped.", Disturbance(gain=1.7)),
    "dark": ("The light is off.", Disturbance(gain=0.04)),
    "moved": ("The camera is pushed aside.", Disturbance(shift_px=(70.0, 40.0))),
    "shaken": ("The camera shakes by a few pixels, which cancels.", Disturbance(shift_px=(4.0, 3.0))),
    "noisy": ("The gain of the sensor is high: noise.", Disturbance(noise_grey=15.0)),
    "frozen": ("The camera repeats its last picture.", None),
    "dropped": ("Frames are missing; in a file the last one is repeated.", None),
}


@dataclass(frozen=True, slots=True)
class CameraFault:
    """A fault of the camera, from `start_s` of board time for `seconds`."""

    name: str
    start_s: float
    seconds: float


def parse_camera_fault(text: str) -> CameraFault:
    """Return the fault in NAME@SECONDS[:DURATION]; without a duration it stays."""
    head, _, lasting = text.strip().partition(":")
    name, _, start = head.partition("@")
    if name not in CAMERA_FAULTS:
        remedy = one_of(name, CAMERA_FAULTS)
        raise ChoiceError(f"there is no fault of the camera {name!r}", remedy)
    try:
        numbers = float(start or "0"), float(lasting or "inf")
    except ValueError:
        numbers = (math.nan, math.nan)
    if not (numbers[0] >= 0 and numbers[1] > 0):
        raise ChoiceError(f"{text!r} has no usable times", "use NAME@SECONDS[:DURATION]")
    return CameraFault(name, *numbers)


def scene_of(values: Mapping[str, str]) -> CameraScene:
    """Return the scene with values of its fields. RequestError: no such field, or not a number of its kind."""
    kinds = {field.name: type(getattr(CameraScene(), field.name)) for field in dataclasses.fields(CameraScene)}
    parsed: dict[str, Any] = {}
    for name, text in values.items():
        try:
            number = float(text)
            parsed[name] = kinds[name](number)
        except KeyError:
            raise ChoiceError(f"the virtual camera has no {name!r}", f"use one of {', '.join(kinds)}") from None
        except (ValueError, OverflowError):
            raise ChoiceError(f"{text!r} is not a value of {name}", "give a number") from None
    scene = CameraScene(**parsed)
    if not (64 <= scene.width <= 4096 and 48 <= scene.height <= 4096 and 1 <= scene.px_per_mm <= 200):
        raise ChoiceError("a virtual camera of that size is not possible", "use 64 to 4096 pixels, 1 to 200 px/mm")
    if not (0.5 <= scene.mark_mm <= 100 and abs(scene.tilt_deg) < 60 and scene.noise_grey >= 0 and scene.blur_px > 0):
        raise ChoiceError("the marks, the tilt, the noise or the blur are not possible", "use values near the default")
    return scene


class Sink(Protocol):
    """Where the frames go; where none is `wanted`, none is drawn."""

    @property
    def wanted(self) -> bool:
        """Whether anybody takes a frame now."""

    def frame(self, picture: Picture | None, time_s: float) -> None:
        """Take a frame; None where it is missing."""

    def close(self) -> None:
        """Finish."""


class VideoFile:
    """Writes the frames to a file."""

    wanted = True

    def __init__(self, path: Path) -> None:
        self._store = VideoStore(path, FRAMES_PER_S)
        self._last: Picture | None = None

    def frame(self, picture: Picture | None, time_s: float) -> None:
        """Write a frame; a missing one is the one before, as recorders of a fixed rate do."""
        self._last = self._last if picture is None else picture
        if self._last is not None:
            self._store.write(self._last)

    def close(self) -> None:
        self._store.close()


class MjpegStream:
    """Serves the newest frame to each viewer, on this computer only; `url` is where."""

    def __init__(self, port: int) -> None:
        self._changed = threading.Condition()
        self._newest: tuple[int, float, bytes] = (0, 0.0, b"")
        self._closed = False
        self._viewers = 0
        if find_spec("cv2") is None:
            optional("cv2")  # raises what to install, before anything is served
        try:
            self._server = ThreadingHTTPServer(("127.0.0.1", port), self._handler())
        except (OSError, OverflowError) as error:
            remedy = "use another port, or 0 for any free one"
            raise DeviceError(f"cannot listen on 127.0.0.1:{port}: {error}", remedy) from None
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/"
        threading.Thread(target=self._server.serve_forever, name="mjpeg", daemon=True).start()

    @property
    def wanted(self) -> bool:
        """Whether anybody looks."""
        return self._viewers > 0

    def frame(self, picture: Picture | None, time_s: float) -> None:
        if picture is None:
            return
        cv = optional("cv2")
        jpeg = cv.imencode(".jpg", picture, [cv.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
        with self._changed:
            self._newest = (self._newest[0] + 1, time_s, jpeg)
            self._changed.notify_all()

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def next_after(self, number: int) -> tuple[int, float, bytes] | None:
        """Return the next frame after one, with its number; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._newest[0] > number)
            return None if self._closed else self._newest

    def begin(self) -> int:
        """Count a viewer; return the number of the newest frame, which may be old."""
        with self._changed:
            self._viewers += 1
            return self._newest[0]

    def end(self) -> None:
        with self._changed:
            self._viewers -= 1

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        stream = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={BOUNDARY}")
                self.end_headers()
                number = stream.begin()
                try:
                    self._send(number)
                finally:
                    stream.end()

            def _send(self, number: int) -> None:
                while (newest := stream.next_after(number)) is not None:
                    number, time_s, jpeg = newest
                    head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n"
                    try:
                        self.wfile.write(f"{head}X-Timestamp: {time_s:.6f}\r\n\r\n".encode() + jpeg + b"\r\n")
                    except OSError:
                        return  # the viewer has left

            def log_message(self, *_: object) -> None:
                """Print nothing."""

        return Handler


class VirtualCamera:
    """Draws the frames that are due on its own thread.

    `newest_only`: leave out frames that are late, as a camera does; else every frame is drawn.
    """

    def __init__(self, scene: CameraScene, sink: Sink, faults: Sequence[CameraFault], *, newest_only: bool) -> None:
        self._scene, self._sink, self._faults = scene, sink, tuple(faults)
        self._renderer = Renderer(scene) if sink.wanted else None  # else with the first viewer: it takes OpenCV
        self._exposure_s, self._newest_only = scene.exposure_s, newest_only
        self._number = 0
        self._last: Picture | None = None
        self._ticks = np.zeros(0)  # elongation of each tick from `_first` on, mm
        self._first = 0
        self._coming: queue.SimpleQueue[tuple[int, FloatArray] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="virtual camera", daemon=True)
        self._thread.start()

    def take(self, first_tick: int, elongation_mm: FloatArray) -> None:
        """Take the true elongation at the board's ticks, as it was advanced."""
        if elongation_mm.size:
            self._coming.put((first_tick, elongation_mm))

    def close(self) -> None:
        """Draw what is due, and finish."""
        self._coming.put(None)
        self._thread.join()
        self._sink.close()

    def _run(self) -> None:
        ended = False
        while not ended:
            parts = [self._coming.get()]
            while not self._coming.empty():  # else a slow picture would put off all later ones
                parts.append(self._coming.get())
            ended = parts[-1] is None
            known = [part for part in parts if part is not None]
            if known and not self._ticks.size:
                self._first = known[0][0]
            self._ticks = np.concatenate([self._ticks, *(elongation for _, elongation in known)])
            end_s = (self._first + self._ticks.size - 1) * TICK_S
            while (due := self._number / FRAMES_PER_S) + self._exposure_s / 2 <= end_s:
                late = self._newest_only and end_s - due > 2.0 / FRAMES_PER_S
                if self._sink.wanted and not late:
                    self._sink.frame(self._picture(self._number, due), time.monotonic())
                self._number += 1
            spent = max(0, int((self._number - 2) / FRAMES_PER_S / TICK_S) - self._first - 2)
            self._ticks, self._first = self._ticks[spent:], self._first + spent

    def _picture(self, number: int, time_s: float) -> Picture | None:
        """Return the frame of a time; None where it is missing."""
        active = {f.name for f in self._faults if f.start_s <= time_s < f.start_s + f.seconds}
        if "dropped" in active:
            return None
        if "frozen" not in active or self._last is None:
            exposed = np.linspace(-0.5, 0.5, 5) * self._exposure_s + time_s
            ticks = (self._first + np.arange(self._ticks.size)) * TICK_S
            elongation = np.interp(exposed, ticks, self._ticks)
            self._renderer = self._renderer or Renderer(self._scene)
            self._last = self._renderer.frame(number, elongation, time_s, _together(active, time_s))
        return self._last


def _together(active: set[str], time_s: float) -> Disturbance:
    """Return what is wrong with a frame when several faults are active."""
    wrong = FAULTLESS
    for name in sorted(active):
        one = CAMERA_FAULTS[name][1]
        if one is None:
            continue
        values = {f.name: getattr(one, f.name) for f in dataclasses.fields(one)}
        if name == "shaken":
            values["shift_px"] = (4.0 * math.sin(19.0 * time_s), 3.0 * math.sin(31.0 * time_s))
        changed = {key: value for key, value in values.items() if value != getattr(FAULTLESS, key)}
        wrong = dataclasses.replace(wrong, **changed)
    return wrong
