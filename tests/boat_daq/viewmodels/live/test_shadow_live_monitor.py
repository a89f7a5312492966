"""The monitor: whole cycles handed over once."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import Phase, Progress
from boat_daq.viewmodels.live.live_model import OverlayModel
from boat_daq.viewmodels.live.shadow_live import ShadowMonitor
from tests.boat_daq.gui.recorded_session import connected, filled_ring
from tests.boat_daq.viewmodels.helpers import Straight


@pytest.fixture(scope="module")
def ring():
    """Two hundred seconds of signals."""
    return filled_ring(200.0)


def test_each_whole_cycle_is_monitored_once(ring, model):
    """Ended cycles are handed over once; the cycle under way is not; a new recording begins anew."""
    marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1)) if i < 4 else None)
        for i in range(1, 5)
    )
    overlay = OverlayModel(lambda: ring, lambda: marks, lambda time_us: time_us / 1e6)
    monitor = ShadowMonitor(lambda: model, overlay)
    progress = Progress(9, 200, 4, 100, 3, (), "loading", Phase.RAMPING, 50.0, 1.0, 90.0, 900.0)
    snapshot = dataclasses.replace(connected(), progress=progress, recording="a.boat")
    for _ in range(3):
        monitor.follow(snapshot, Straight())
    end = time.monotonic() + 30
    while len(monitor.marks) < 3 and time.monotonic() < end:
        assert monitor.poll() == []
        time.sleep(0.02)
    cycles, deviation = monitor.series("deviation")
    assert cycles.tolist() == [1.0, 2.0, 3.0]
    assert np.ptp(deviation) < 0.05
    assert monitor.sight() == "too few cycles yet to detect a leak or softening"
    monitor._sight = {"loss": 1.31, "gain": np.inf}
    assert monitor.sight() == "would detect a leak from 1.3 %/min, too few cycles yet to detect softening"
    assert monitor.sight() in monitor.verdict()
    monitor.follow(dataclasses.replace(snapshot, recording="b.boat", progress=None), Straight())
    assert monitor.series("deviation")[0].size == 0
    monitor.close()


def test_cycle_that_the_ring_does_not_hold_is_left_out(ring, model):
    """After a resumption the message "A cycle needs ten samples" came for each cycle before the break."""
    marks = (StepMark(1, 1, "unloading", 0.0, 10.0, 0, ended_us=40_000),)
    overlay = OverlayModel(lambda: ring, lambda: marks, lambda time_us: time_us / 1e6)
    monitor = ShadowMonitor(lambda: model, overlay)
    progress = Progress(9, 200, 2, 100, 1, (), "loading", Phase.RAMPING, 50.0, 1.0, 90.0, 900.0)
    monitor.follow(dataclasses.replace(connected(), progress=progress, recording="a.boat"), Straight())
    assert not monitor._reducing.pending
    monitor.close()
