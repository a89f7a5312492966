"""A panel that fails: in its own place, while the others go on."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QApplication, QLabel

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import SessionState
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import RAMPING
from tests.conftest import mostly_at_night


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
    assert page.guard._covers == {}


def test_failing_messages_and_values_are_covered_and_the_others_go_on(live, monkeypatch):
    """The strip and the values were the last parts whose error stopped all that is shown after them."""

    def fail(*_):
        raise ValueError("no such severity")

    page = live.live
    monkeypatch.setattr(live.strip, "refresh", fail)
    monkeypatch.setattr(page, "_show_values", fail)
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    assert [len(covers(panel)) for panel in (live.strip, page.head)] == [1, 1]
    assert page.sequence.state.text().endswith("Running")
    monkeypatch.undo()
    live.refresh()
    assert (live.guard._covers, page.guard._covers) == ({}, {})


@pytest.mark.parametrize("sensors", mostly_at_night(4, 1, 3))
def test_board_with_one_to_four_sensors_is_shown(make, qtbot, sensors):
    """With one sensor the overlay failed; sensors 3 and 4 had neither value nor plot."""
    session = RecordedSession(connected(), filled_ring(120.0, sensors=sensors))
    session.marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in (1, 2)
    )
    session.change(state=SessionState.RUNNING, progress=RAMPING)
    window = make(session)
    window.resize(1280, 800)
    window.refresh()
    QApplication.processEvents()
    window.draw()
    page, numbers = window.live, range(1, 5)
    shown = [page.figures[f"s{n}"] for n in numbers if page.figures[f"s{n}"].isVisible()]
    assert [figure.value.text() != "\u2013" for figure in shown] == [True] * sensors
    assert max(value.geometry().right() for value in page.figures.values() if value.isVisible()) <= page.head.width()
    titles = [*(f"Sensor {n}" for n in numbers[:sensors]), "Pressure"]
    qtbot.waitUntil(lambda: window.draw() or [plot.title for plot in page.plots.rows] == titles)
    assert [page.plots.curves[f"s{n}_mv"].x.size > 100 for n in numbers[:sensors]] == [True] * sensors
    layout = page.layouts.current.complete(page.model.quantities())
    for number in range(2, sensors + 1):
        layout = layout.placed(f"s{number}_mv", "s1_mv")
    page.plots.layout_wanted.emit(layout)
    window.draw()
    assert [plot.unit for plot in page.plots.rows] == ["mV", "kPa"]
    assert [page.plots.curves[f"s{n}_mv"] in page.plots.first.layers for n in numbers[:sensors]] == [True] * sensors
    page.toggle_overlay()
    window.refresh()
    window.refresh()
    drawn = [curves[-1].x.size > 100 for curves in page.overlay.curves]
    assert drawn[:sensors] == [True] * sensors
    assert (page.guard._covers, window.guard._covers, window.model.notices.history) == ({}, {}, [])
