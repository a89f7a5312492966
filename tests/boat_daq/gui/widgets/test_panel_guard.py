"""A panel that fails: in its own place, while the others go on."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QLabel

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import SessionState
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import RAMPING


def covers(panel):
    """Return the texts that cover a panel."""
    return [label.text() for label in panel.findChildren(QLabel) if label.text().find("cannot be shown") >= 0]


def test_failing_panel_shows_it_in_its_place_and_the_others_go_on(live, capfd, monkeypatch):
    """The overlay raised fourteen times to stderr alone; shadow and run stopped at -10 kPa without a word."""

    def fail():
        raise IndexError("list index out of range")

    page = live.live
    page.toggle_overlay()
    monkeypatch.setattr(page.overlay, "draw", fail)
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    for _ in range(3):
        live.refresh()
        live.draw()
    (text,) = covers(page.overlay)
    assert text.startswith("The overlay cannot be shown: IndexError: list index out of range")
    assert page.sequence.state.text().endswith("Running")
    assert [n.cause for n in live.model.notices.history] == ["list index out of range"]
    assert "Traceback" not in capfd.readouterr().err
    monkeypatch.undo()
    live.refresh()
    live.refresh()
    page.overlay.findChildren(QLabel)
    assert page.overlay not in page.guard._covers


@pytest.mark.parametrize("sensors", [1, 2, 3, 4])
def test_board_with_one_to_four_sensors_is_shown(make, sensors):
    """With one sensor the overlay failed; plots, overlay and the line of the run show each number of sensors."""
    session = RecordedSession(connected(), filled_ring(120.0, sensors=sensors))
    session.marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in (1, 2)
    )
    session.change(state=SessionState.RUNNING, progress=RAMPING)
    window = make(session)
    window.refresh()
    window.draw()
    assert window.live.figures["s2"].isVisible() is (sensors > 1)
    assert (window.live.plots.second in window.live.plots.rows) is (sensors > 1)
    window.live.toggle_overlay()
    window.refresh()
    window.refresh()
    drawn = [curves[-1].x.size > 100 for curves in window.live.overlay.curves]
    assert drawn == [number <= sensors for number in range(1, 5)]
    assert (window.live.guard._covers, window.guard._covers, window.model.notices.history) == ({}, {}, [])
