"""The last cycles overlaid."""

from __future__ import annotations

import pytest

from boat_daq.engine.plan import StepMark
from boat_daq.viewmodels.live.live_model import OverlayModel


def test_cycles_begin_at_zero(ring):
    """Each cycle's trace begins at 0 and holds the samples of its own steps."""
    marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in range(1, 4)
    )
    model = OverlayModel(lambda: ring, lambda: marks, lambda time_us: time_us / 1e6)
    cycles = model.cycles()
    assert [number for number, _ in cycles] == [1, 2, 3]
    for _, columns in cycles:
        assert columns["time_s"][0] == pytest.approx(0.0, abs=0.3)  # a thinned point may lie just before
        assert columns["time_s"][-1] == pytest.approx(36.0, abs=0.3)
