"""The window on a small or much enlarged screen."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from PySide6.QtCore import QSize
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.engine.snapshot import ReadingRequest, SessionState
from boat_daq.gui import style
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import NARROW


@pytest.mark.parametrize(("size", "theme"), [((960, 540), style.LIGHT), ((853, 533), style.DARK)])
def test_enlarged_screen_shows_what_matters(make, qtbot, size, theme):
    """At 200 % on 1920 x 1080, or 150 % on 1280 x 800: VENT, the question, its field and the pressure's target."""
    session = RecordedSession(connected(), filled_ring(60.0))
    session.change(state=SessionState.RUNNING, waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    window.set_theme(theme)
    window.resize(*size)
    QTest.qWait(50)
    window.refresh()
    window.draw()
    bar = window.live.reading
    shown = window.header.vent, bar.question, bar.field, bar.skip, window.live.figures["kpa"]
    QTest.qWait(50)
    # the layout settles over several events, which take longer while others use the processor
    qtbot.waitUntil(lambda: all(each.visibleRegion().boundingRect().size() == each.size() for each in shown))
    for widget in shown:
        corner = widget.mapTo(window, widget.rect().bottomRight())
        assert widget.isVisible()
        assert window.rect().contains(corner), widget.accessibleName()
    assert window.live.figures["kpa"].note.text() == "→ +30.0"
    window.strip.messages.click()
    QTest.qWait(50)
    assert window.scrolls["Measure"].verticalScrollBar().maximum() == 0  # Stop and the question were off the screen
    window.strip.close_details()
    QTest.qWait(50)
    rows = window.live.plots.rows
    assert [plot.title for plot in rows] == ["Sensor 1", "Pressure"]
    assert sum(plot.item.getViewBox().height() for plot in rows) >= 140  # the data alone, under title and controls
    assert isinstance(window.grab().toImage(), QImage)


def test_moved_borders_are_restored(make):
    """A border that the operator moved is restored at the next start."""
    first = make(RecordedSession(connected(), filled_ring(10.0)))
    first.live.sides.moveSplitter(first.live.sides.width() - 360, 1)
    width = first.live.sides.sizes()[1]
    first.close()
    second = make(RecordedSession(connected(), filled_ring(10.0)))
    assert second.live.sides.sizes()[1] == width != style.PANE_WIDTH


def test_border_above_the_run_is_moved_and_kept(live):
    """The plan's picture grows where the border is dragged up, also after a stay in a low window, which hides it."""
    page = live.live
    live.resize(1280, 800)
    QTest.qWait(20)
    before = page.sequence.picture.height()
    page.run_border.moveSplitter(page.run_border.height() - 240, 1)
    QTest.qWait(20)
    tall = page.sequence.picture.height()
    assert tall > before + 80
    live.resize(853, 533)
    QTest.qWait(20)
    assert page.sequence.height() < 60
    live.resize(1280, 800)
    QTest.qWait(20)
    assert page.sequence.picture.height() == tall


def test_restored_window_fits_a_smaller_screen(live, monkeypatch):
    """Remembered at 100 %, opened at 150 %: VENT was beyond the edge of the screen."""
    live.model.preferences.set("geometry", "remembered")
    live.resize(1280, 800)
    monkeypatch.setattr(live, "screen", lambda: SimpleNamespace(availableSize=lambda: QSize(1280, 800)))
    live.fit_screen()
    assert not live.isMaximized()
    monkeypatch.setattr(live, "screen", lambda: SimpleNamespace(availableSize=lambda: QSize(853, 533)))
    live.fit_screen()
    assert live.isMaximized()


def test_models_pages_do_not_scroll_sideways(live):
    """Before, a page that required the width of both sides was never narrow enough to stack them."""
    for width in (NARROW, 960, 1280):
        live.resize(width, 533)
        for name in ("Optics", "Shadow", "Speed and accuracy"):
            live.model.optics.choose = lambda *_: None
            live.go(name)
            QApplication.processEvents()
            QApplication.processEvents()
            assert live.scrolls[name].horizontalScrollBar().maximum() == 0, name
            assert live.pages[name].width() >= live.pages[name].layout().minimumSize().width(), name
