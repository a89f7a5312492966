"""A run of a virtual unit with its pictures: truth, recording and camera record, without a process or a port."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pandas as pd

from analysis.data.camera_record import CameraRecord
from analysis.data.recording import STEP_COLUMNS, Recording
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import Options
from analysis.tracking.lens import Picture
from analysis.tracking.run import track, with_video
from analysis.tracking.tracker import MarkTracker, Optics
from boat_daq.engine.simulator.picture import FAULTLESS, CameraScene, Disturbance, Renderer
from protocol.simulator.specimens import find_specimen
from protocol.simulator.truth import NoiseFreeRun, noise_free_run

SMALL = CameraScene(width=320, height=240, px_per_mm=10.0)
NOISE_KPA = 0.03
REST_S = 1.5


@dataclass(frozen=True)
class FilmedRun:
    """What a board would have recorded, and the true elongation."""

    truth: NoiseFreeRun
    recording: Recording
    scene: CameraScene

    def elongation_mm(self, time_s: np.ndarray) -> np.ndarray:
        """Return the true elongation at times of the recording."""
        return np.interp(time_s, self.truth.time_s - self.truth.time_s[0] + REST_S, self.truth.elongation_mm)

    def pictures(
        self, *, begin_s: float = 0.0, rate_hz: float = 30.0, faults: Mapping[int, Disturbance | None] | None = None
    ) -> Iterator[tuple[Picture, float]]:
        """Give the frames from a time of the recording on, in the video's own time; None repeats the one before."""
        renderer, last = Renderer(self.scene), None
        end_s = float(self.recording.time_s[-1])
        for number in range(int((end_s - begin_s) * rate_hz)):
            at_s = begin_s + number / rate_hz
            wrong = (faults or {}).get(number, FAULTLESS)
            exposed = at_s + np.linspace(-0.5, 0.5, 5) * self.scene.exposure_s
            if wrong is not None or last is None:
                last = renderer.frame(number, self.elongation_mm(exposed), at_s, wrong or FAULTLESS)
            yield last, number / rate_hz

    def filmed(self, *, begin_s: float = 0.0, rate_hz: float = 30.0) -> Recording:
        """Return the recording with its video tracked and placed."""
        tracker = MarkTracker(Optics(self.scene.mark_mm))
        record = track(self.pictures(begin_s=begin_s, rate_hz=rate_hz), tracker)
        assert tracker.plane is not None
        return with_video(self.recording, record, {"source": "test", "u_scale": tracker.plane.u_scale})


def filmed_run(targets_kpa: Sequence[float], *, dwell_s: float, scene: CameraScene = SMALL, seed: int = 0) -> FilmedRun:
    """Return a staircase of SA1 at 10 kPa/s, at rest for `REST_S` before and vented after."""
    specimen, rng = find_specimen("SA1"), np.random.default_rng(seed)
    run = noise_free_run("SA1", targets_kpa, ramp_kpa_per_s=10.0, dwell_s=dwell_s)
    rest = round(REST_S * 100)
    time_s = np.arange(rest + run.time_s.size) / 100.0
    pressure = np.concatenate([np.zeros(rest), run.pressure_kpa]) + NOISE_KPA * rng.standard_normal(time_s.size)
    signal = np.concatenate([np.repeat(run.signal_mv[:1], rest, axis=0), run.signal_mv])
    signal = signal + rng.standard_normal(signal.shape) * [sensor.noise_mv for sensor in specimen.sensors]
    rows = []
    started = REST_S
    lowest = int(np.argmin(targets_kpa))
    for i, (target, arrived) in enumerate(zip(targets_kpa, run.arrivals_s + REST_S, strict=True)):
        branch = "start" if i == 0 else "unloading" if i <= lowest else "loading"
        ended = arrived + dwell_s
        rows.append(
            (i + 1, 0, i + 1, int(i > 0), branch, target, 10.0, started, arrived, arrived + 0.5, ended, "reached", "{}")
        )
        started = ended
    steps = pd.DataFrame(rows, columns=list(STEP_COLUMNS))
    meta = {"simulated": True, "rate_hz": 100.0}
    return FilmedRun(run, Recording.from_arrays(time_s, pressure, signal, steps=steps, meta=meta), scene)


LEVELS = (50, 30, 10, -10, -30)
U_MM = 0.004


def with_camera(run: FilmedRun, delay_s: float = 0.06, first_s: float = 0.0) -> Recording:
    """Return the run with a camera of known errors."""
    true_s = np.arange(first_s, float(run.recording.time_s[-1]), 1 / 30)
    x = run.elongation_mm(true_s) + 1.0 + 0.001 * np.random.default_rng(3).standard_normal(true_s.size)
    record = CameraRecord(true_s + delay_s, x, np.full(x.size, U_MM), np.full(x.size, ""), 0)
    meta = {**run.recording.meta, "camera": {"source": "0", "u_scale": 0.002}}
    return replace(run.recording, camera=record, meta=meta)


@cache
def camera_analysis() -> Analysis:
    """Return two cycles of five levels with a camera, analysed once."""
    down = (*LEVELS, *LEVELS[-2::-1])
    return analyse(with_camera(filmed_run((*down, *down[1:]), dwell_s=1.5)), options=Options(mcmc=False))
