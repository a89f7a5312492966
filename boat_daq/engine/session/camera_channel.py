"""A camera beside a session: the elongation of every frame into its recording, and of every plateau as its reading.

The reading of a plateau is the mean over the frames of its settled part, less that of the last second before the run.
It is entered when the plateau has ended, or while the plateau waits for it; what the operator has entered stays. A
plateau with too few frames that show the marks gets no reading and a warning.

Rules: frames are assigned by the host's clock, on which samples arrive too; nothing here runs on the reading thread but
one append.
"""

from __future__ import annotations

import math
import statistics
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from boat_daq.engine.camera.capture import Camera, CameraState, TrackedFrame
from boat_daq.engine.camera.source import CameraSource, Picture, VideoStore
from boat_daq.engine.plan import StepMark
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import CameraReading
from protocol.base.errors import BoatDaqError, RequestError

_SOURCE = "camera"
_FEWEST_FRAMES = 5
REST_S = 1.0
_LASTING_S = 1.0  # a fault shorter than this gives no message
FRAMES_KEPT = 20_000  # eleven minutes
FAULT_TEXTS = {  # code -> cause, remedy
    "lost": ("a mark is not in the picture, or is covered", "show both marks to the camera"),
    "covered": ("a mark is covered in part", "clear the view"),
    "ambiguous": ("a mark is in the picture more than once", "remove the other one"),
    "blurred": ("the marks are blurred", "focus the camera"),
    "saturated": ("the white of the marks is saturated", "reduce light or exposure"),
    "low_contrast": ("the marks are too dark", "add light"),
    "frozen": ("the camera repeats one picture", "check the camera"),
    "moved": ("the camera was moved, or the marks are exchanged", "put it back, or open the camera again"),
    "distorted": ("the tip's mark has changed its size", "check that it is flat and moves in its plane"),
    "too_small": ("the marks are too small in the picture", "move the camera closer, or print larger marks"),
    "jumped": ("the tip moves faster than an actuator can", "check its mark"),
}


class CameraChannel:
    """Tracks with one camera for one session."""

    def __init__(
        self,
        session: Session,
        source: CameraSource,
        track: Callable[[Picture, float], TrackedFrame],
        about: Callable[[], Mapping[str, Any]],
        *,
        video: Path | None = None,
    ) -> None:
        if not source.live:
            raise RequestError(f"{source.name} is a file", "analyse the recording with it, or name a camera")
        self._session, self._about = session, about
        self._frames: deque[tuple[int, float, float, str]] = deque(maxlen=FRAMES_KEPT)  # host_ns, mm, u_mm, fault
        self._arrivals: deque[tuple[int, int]] = deque(maxlen=FRAMES_KEPT)  # host_ns, board us
        self._done: set[int] = set()
        self._earlier = max((step.number for step in session.steps()), default=0)  # last step that it did not see
        self._rest_mm: float | None = None
        self._bad_since_ns: int | None = None
        self._warned: set[str] = set()
        self._video = VideoStore(video) if video is not None else None
        self._camera = Camera(source, track, self._take)
        self._remove_sink = session.live.add_sink(self._samples)
        self._camera.start()

    @property
    def state(self) -> CameraState:
        """What the camera sees now."""
        return self._camera.state

    @property
    def about(self) -> Mapping[str, Any]:
        """CameraSource, marks and scale."""
        return self._about()

    def finish(self, timeout_s: float = 2.0) -> None:
        """Wait until the plateaus that have ended have their readings."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline and self._camera.state.error is None:
            seen = (step for step in self._session.steps() if step.number > self._earlier)
            steps = [step for step in seen if step.settled_us is not None and step.branch != "end"]
            if not math.isfinite(self._rest_mm or 0.0) or all(
                step.number in self._done or step.ended_us is None for step in steps
            ):
                return
            time.sleep(0.02)

    @property
    def rest_mm(self) -> float:
        """Elongation of the last second before the run, from which readings count; 0 where it was not seen."""
        return self._rest_mm if self._rest_mm is not None and math.isfinite(self._rest_mm) else 0.0

    def close(self) -> None:
        """End the camera; the session stays."""
        self._remove_sink()
        self._camera.close()
        if self._video is not None:
            self._video.close()

    def _samples(self, samples: np.ndarray[Any, Any]) -> None:
        """Keep when the newest sample of a block arrived, on the reading thread."""
        host_ns, time_us = int(samples["host_ns"][-1]), int(samples["time_us"][-1])
        if self._arrivals and time_us < self._arrivals[-1][1]:  # the board's clock restarted
            self._arrivals.clear()
        self._arrivals.append((host_ns, time_us))

    def _take(self, reading: CameraReading, picture: Picture) -> None:
        """Take a frame, on the camera's thread."""
        self._session.keep_camera(reading, self._about(), self.rest_mm)
        x, u = (math.nan if v is None else v for v in (reading.elongation_mm, reading.u_mm))
        self._frames.append((reading.host_ns, x, u, reading.fault))
        if self._video is not None:
            self._video.write(picture)
        self._watch(reading)
        self._follow_plateaus()

    def _watch(self, reading: CameraReading) -> None:
        """Warn once of each fault that lasts."""
        if not reading.fault:
            self._bad_since_ns = None
            self._warned.clear()
            return
        self._bad_since_ns = self._bad_since_ns or reading.host_ns
        lasting = reading.host_ns - self._bad_since_ns >= _LASTING_S * 1e9
        if lasting and reading.fault in FAULT_TEXTS and reading.fault not in self._warned:
            self._warned.add(reading.fault)
            cause, remedy = FAULT_TEXTS[reading.fault]
            self._session.warn_of_camera(f"the camera gives no elongation: {cause}", remedy)

    def _follow_plateaus(self) -> None:
        """Enter the reading of each plateau that has ended, or waits for it."""
        run = self._session.steps()
        if not run:
            self._rest_mm, self._done, self._earlier = None, set(), 0
        self._earlier = max(self._earlier, self._session.resumed_after())
        steps = [step for step in run if step.number > self._earlier]
        if not steps or not self._arrivals:
            return
        if self._rest_mm is None:
            self._rest_mm = self._rest_before(steps[0])
        if not math.isfinite(self._rest_mm):
            return
        waiting = self._session.snapshot().waiting_for_reading
        for step in steps[-3:]:
            if step.number in self._done or step.branch == "end" or step.settled_us is None:
                continue
            if step.ended_us is not None and self._arrivals[-1][1] >= step.ended_us:
                self._done.add(step.number)
                self._enter_reading(step, step.settled_us, step.ended_us, complain=True)
            elif waiting is not None and waiting.step_id == step.number:
                entered = self._enter_reading(step, step.settled_us, self._arrivals[-1][1], complain=False)
                self._done |= {step.number} if entered else set()

    def _host_ns(self, time_us: int) -> float:
        """Return when a sample of a board time arrived."""
        arrivals = np.array(self._arrivals)
        return float(np.interp(time_us, arrivals[:, 1], arrivals[:, 0]))

    def _between(self, first_us: int, last_us: int) -> list[tuple[int, float, float, str]]:
        first_ns, last_ns = self._host_ns(first_us), self._host_ns(last_us)
        return [frame for frame in self._frames if first_ns <= frame[0] <= last_ns]

    def _rest_before(self, first: StepMark) -> float:
        """Return the mean elongation of the last second before the first step; 0 where none was seen.

        NaN where the camera was opened during the run: then no reading can be related to those before.
        """
        if first.branch != "start" and self._earlier:
            self._session.warn_of_camera(
                "the camera was opened during the run and did not see the rest position: it gives no readings",
                "enter the readings yourself, or open the camera before a run starts",
            )
            return math.nan
        end_ns = self._host_ns(first.started_us)
        seen = [x for at_ns, x, _, _ in self._frames if end_ns - REST_S * 1e9 <= at_ns <= end_ns and math.isfinite(x)]
        if self._earlier and seen:
            self._session.warn_of_camera(
                "the run was resumed: the camera's readings count from the rest position before its resumption",
                "compare the readings of one pressure before and after it",
            )
        if not seen:
            self._session.warn_of_camera(
                "the camera saw no elongation before the run, so readings count from where it began to see",
                "open the camera a second before the run starts",
            )
        return statistics.fmean(seen) if seen else 0.0

    def _enter_reading(self, step: StepMark, first_us: int, last_us: int, *, complain: bool) -> bool:
        """Enter the mean of a plateau's frames; return whether there is a reading now."""
        if any(r.step_id == step.number and r.source != _SOURCE for r in self._session.readings()):
            return True  # the operator's own
        frames = self._between(first_us, last_us)
        good = [(x, u) for _, x, u, _ in frames if math.isfinite(x)]
        if len(good) < _FEWEST_FRAMES:
            if complain:
                faults = Counter(fault for *_, fault in frames if fault)
                why = FAULT_TEXTS.get(faults.most_common(1)[0][0], ("",))[0] if faults else ""
                cause = f"no reading of the camera at {step.target_kpa:+g} kPa: {len(good)} of {len(frames)} frames"
                self._session.warn_of_camera(cause + (f", {why}" if why else ""), "enter the reading yourself")
            return False
        x_mm = statistics.fmean(x for x, _ in good)
        spread = statistics.stdev(x for x, _ in good) / math.sqrt(len(good))
        u_mm = math.hypot(spread, statistics.median(u for _, u in good))
        try:
            self._session.add_reading(
                step.number,
                round(x_mm - self.rest_mm, 5),
                _SOURCE,
                resolution_mm=u_mm * math.sqrt(12.0),
                reader=_SOURCE,
                note=f"{len(good)} of {len(frames)} frames",
            )
        except BoatDaqError as error:
            self._session.warn_of_camera(f"a reading of the camera is refused: {error.cause}", error.remedy)
            return False
        return True
