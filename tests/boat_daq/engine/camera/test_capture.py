"""The camera's threads: the newest frame, losses counted, errors kept."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from boat_daq.engine.camera.capture import Camera, TrackedFrame
from boat_daq.engine.camera.source import CameraFrame
from protocol.base.errors import BoatDaqError, DeviceError

PICTURE = np.zeros((4, 4), np.uint8)


@dataclass
class Times:
    """A source of frames at given times; then it fails or waits for its end."""

    times_s: tuple[float, ...]
    error: BoatDaqError | None = None
    wait: Callable[[], object] = lambda: None
    name: str = "made up"
    live: bool = True
    frame_count: int = 0

    def frames(self) -> Iterator[CameraFrame]:
        for time_s in self.times_s:
            yield CameraFrame(time_s, partial(np.copy, PICTURE))
            self.wait()
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        """Nothing to close."""


def run(source: Times, track: Callable[[object, float], TrackedFrame]) -> tuple[Camera, list]:
    """Return a camera that has taken every frame, each after the one before was tracked."""
    taken: list = []
    done = threading.Semaphore(0)

    def take(reading: object, picture: object) -> None:
        taken.append(reading)
        done.release()

    source.wait = lambda: done.acquire(timeout=10.0)
    camera = Camera(source, track, take)
    camera.start()
    deadline = time.monotonic() + 10.0
    while len(taken) < len(source.times_s) and time.monotonic() < deadline:
        time.sleep(0.002)
    return camera, taken


def test_readings_carry_time_value_and_losses() -> None:
    """A frame without a value has its reason; two frames are missing before the last."""
    times = tuple(0.033 * n for n in (0, 1, 2, 3, 4, 5, 6, 7, 10))
    values = iter([TrackedFrame(None, None, "lost"), *(TrackedFrame(0.5, 0.01) for _ in range(8))])
    camera, taken = run(Times(times), lambda picture, time_s: next(values))
    camera.close()
    assert (taken[0].elongation_mm, taken[0].fault) == (None, "lost")
    assert taken[1].host_ns == 33_000_000
    assert [reading.dropped for reading in taken] == [0] * 8 + [2]
    assert (camera.state.frames, camera.state.valid, camera.state.dropped) == (9, 8, 2)


def test_an_error_of_the_source_is_kept() -> None:
    """The unplugged camera's cause and remedy."""
    failure = DeviceError("the camera gives no more pictures", "check its cable")
    camera, _ = run(Times((0.0, 0.1), failure), lambda picture, time_s: TrackedFrame(0.0, 0.01))
    deadline = time.monotonic() + 10.0
    while camera.state.error is None and time.monotonic() < deadline:
        time.sleep(0.002)
    assert camera.state.error is failure
    camera.close()


def test_an_error_of_the_tracker_ends_the_camera() -> None:
    """With its own cause."""

    def refuse(picture: object, time_s: float) -> TrackedFrame:
        raise DeviceError("the marks contradict the grid", "measure them")

    camera = Camera(Times((0.0,)), refuse, lambda reading, picture: None)
    camera.start()
    deadline = time.monotonic() + 10.0
    while camera.state.error is None and time.monotonic() < deadline:
        time.sleep(0.002)
    assert camera.state.error is not None
    assert camera.state.error.cause == "the marks contradict the grid"
