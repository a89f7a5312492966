"""Videos with the virtual camera's faults, alone and in pairs: no wrong elongation, and each lost frame says why."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from analysis.tracking.run import track
from analysis.tracking.tracker import MarkTracker, Optics
from boat_daq.engine.simulator.virtual_camera import CAMERA_FAULTS, VirtualCamera, parse_camera_fault
from protocol.simulator.plant import TICK_S
from tests.analysis.tracking.filmed_run import SMALL
from tests.boat_daq.engine.simulator.test_virtual_camera import Kept

WRONG_MM, WRONG_U = 0.02, 4.0  # a value is wrong beyond both: this length, and so many of its standard uncertainties
REST_S, END_S, SPEED_MM_PER_S = 0.6, 1.6, 0.75
PAIRS = list(combinations(CAMERA_FAULTS, 2))


def values_of(*faults: str) -> tuple[int, int, float]:
    """Return how many frames of a ramp have an elongation, how many of them a wrong one, and the largest error, mm."""
    ticks = np.arange(round(END_S / TICK_S)) * TICK_S
    true_mm, kept = SPEED_MM_PER_S * np.maximum(ticks - REST_S, 0.0), Kept()
    camera = VirtualCamera(SMALL, kept, [parse_camera_fault(text) for text in faults], newest_only=False)
    camera.take(0, true_mm)
    camera.close()
    pictures = [(picture, n / 30) for n, picture in enumerate(kept.frames) if picture is not None]
    record = track(pictures, MarkTracker(Optics(SMALL.mark_mm)))
    seen = record.valid
    error = np.abs(record.elongation_mm[seen] - np.interp(record.time_s[seen], ticks, true_mm))
    wrong = (error > WRONG_MM) & (error > WRONG_U * record.u_mm[seen])
    assert all(record.fault[~seen])
    return int(seen.sum()), int(wrong.sum()), float(error.max(initial=0.0))


@pytest.mark.parametrize("pair", [("half_covered", "noisy")])
def test_two_faults_at_once_give_no_wrong_value(pair: tuple[str, str]) -> None:
    """Frames before and after them have values."""
    values, wrong, _ = values_of(f"{pair[0]}@0.8:0.3", f"{pair[1]}@0.9:0.3")
    assert values > 10
    assert wrong == 0


@pytest.mark.nightly
def test_a_hundred_faulty_videos_give_no_wrong_value() -> None:
    """Each fault alone, at two instants, and every pair: a frame has a right value, or a reason."""
    videos = [(f"{name}@{at_s}:0.3",) for name in CAMERA_FAULTS for at_s in (0.8, 1.2)]
    videos += [(f"{a}@0.8:0.3", f"{b}@0.9:0.3") for a, b in PAIRS]
    found = [values_of(*faults) for faults in videos]
    total, worst_mm = sum(values for values, _, _ in found), max(worst for _, _, worst in found)
    print(f"{len(videos)} videos, {total} values, largest error {worst_mm:.4f} mm")
    assert len(videos) >= 100
    assert total > 1000
    assert [faults for faults, (_, wrong, _) in zip(videos, found, strict=True) if wrong] == []
