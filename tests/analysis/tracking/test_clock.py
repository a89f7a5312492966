"""The delay of a camera, against the delay that was put in; no pictures."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.tracking.clock import Delay, find_delay, find_place
from protocol.base.errors import DataError
from tests.analysis.tracking.filmed_run import FilmedRun, filmed_run

NOISE_MM = 0.002


@pytest.fixture(scope="module")
def run() -> FilmedRun:
    """Return a staircase of seven holds; its pictures are not drawn."""
    return filmed_run((30, 20, 10, 0, 10, 20, 30), dwell_s=1.5)


def frames(
    run: FilmedRun, delay_s: float, *, drift: float = 0.0, rate_hz: float = 30.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and elongations of frames that are late."""
    true_s = np.arange(0.2, run.recording.time_s[-1] - 0.5, 1 / 30)
    noise = NOISE_MM * np.random.default_rng(1).standard_normal(true_s.size)
    return true_s + delay_s, run.elongation_mm(true_s) + noise


def found(run: FilmedRun, t: np.ndarray, x: np.ndarray) -> Delay:
    delay = find_delay(t, x, run.recording.time_s, run.recording.signal_mv)
    assert delay is not None
    return delay


@pytest.mark.parametrize("delay_s", [-0.05, 0.0, 0.123])
def test_delay_is_found_within_half_a_frame(run: FilmedRun, delay_s: float) -> None:
    """From six ramps of 10 kPa, with an honest uncertainty."""
    delay = found(run, *frames(run, delay_s))
    assert delay.delay_s == pytest.approx(delay_s, abs=0.0167)
    assert abs(delay.delay_s - delay_s) < 4 * delay.u_s + 0.001
    assert delay.u_s < 0.008


def test_a_still_unit_shows_no_delay(run: FilmedRun) -> None:
    """There is nothing to find it by."""
    t, x = frames(run, 0.0)
    assert find_delay(t, np.zeros_like(x), run.recording.time_s, run.recording.signal_mv) is None
    assert find_delay(t[:5], x[:5], run.recording.time_s, run.recording.signal_mv) is None


def test_a_video_is_laid_over_its_run(run: FilmedRun) -> None:
    """Its own time begins anywhere."""
    t, x = frames(run, 0.0)
    begin_s = find_place(t - 3.7 + 100.0, x, run.recording.time_s, run.recording.pressure_kpa)
    assert begin_s == pytest.approx(3.7 - 100.0, abs=0.15)


def test_a_video_of_another_run_is_refused(run: FilmedRun) -> None:
    """Noise, and a unit that does not move."""
    t, x = frames(run, 0.0)
    noise = np.random.default_rng(2).standard_normal(x.size)
    for other in (noise, np.zeros_like(x)):
        with pytest.raises(DataError, match="does not show the run"):
            find_place(t, other, run.recording.time_s, run.recording.pressure_kpa)


def test_the_first_ramp_alone_gives_the_delay() -> None:
    """Better than half a frame from one long ramp and the holds about it, from the video's first second on."""
    run = filmed_run((50, 40), dwell_s=3.0, seed=1)
    recording = run.recording
    first = recording.time_s < 9.3
    frame_s = np.arange(0.0, 9.3, 1 / 30)
    x = run.elongation_mm(frame_s) + 0.0008 * np.random.default_rng(1).standard_normal(frame_s.size)
    delay = find_delay(frame_s + 0.04, x, recording.time_s[first], recording.signal_mv[first])
    assert delay is not None
    assert len(delay.windows) == 1
    assert delay.delay_s == pytest.approx(0.04, abs=0.0167)
    assert delay.u_s < 0.012
