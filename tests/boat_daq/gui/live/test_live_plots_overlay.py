"""The last cycles overlaid."""

from __future__ import annotations

from boat_daq.engine.plan import StepMark
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring


def test_last_cycles_are_overlaid(make):
    """O shows the cycles of the run from their beginnings, and O again the plots."""
    session = RecordedSession(connected(), filled_ring(120.0))
    session.marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in (1, 2)
    )
    marks, session.marks = session.marks, ()
    window = make(session)
    window.live.toggle_overlay()
    window.refresh()
    assert window.live.overlay.isVisible()
    assert window.live.overlay.empty_text.isVisible()  # and no axes, before a cycle has begun
    session.marks = marks
    window.refresh()
    assert not window.live.overlay.empty_text.isVisible()
    assert window.live.overlay.readout.text() == "2 of the last 5 cycles"
    assert window.live.overlay.curves[0][-1].x.size > 100
    window.live.toggle_overlay()
    window.refresh()
    assert window.live.plots.isVisible()
