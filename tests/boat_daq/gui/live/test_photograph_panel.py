"""A reading from a photograph."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QGuiApplication, QImage, QMouseEvent, QPainter, QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import (
    ReadingRequest,
    SessionState,
)
from protocol.base.errors import RequestError
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import run_command


def test_photograph_is_read_with_clicks(make, tmp_path):
    """A pasted picture, two clicks 10 mm apart, one at rest and one now, on the picture itself."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    window.refresh()
    run_command(window, "Read from a photograph …")
    panel = window.live.photograph
    panel.refresh()
    assert panel.instruction.text().endswith("\nAt +30 kPa, unloading, cycle 1")  # before there is a picture, too
    picture = QPixmap(400, 200)
    picture.fill()
    QGuiApplication.clipboard().setPixmap(picture)
    panel.paste()
    for x in (40, 240, 300, 346):
        spot = panel.view.mapFromScene(float(x), 100.0)
        QTest.mouseClick(panel.view.viewport(), Qt.MouseButton.LeftButton, pos=spot)
    panel.take.click()
    assert session.kept[-1].source == "photograph"
    assert session.kept[-1].elongation_mm == pytest.approx(2.3, abs=0.06)


def test_grid_lines_stay_visible_and_the_picture_moves(live):
    """A hundred lines of 2 px in a picture three times as wide as its place: all are there; the right button drags."""
    live.live.open_photograph()
    panel = live.live.photograph
    assert panel.width() >= 0.89 * live.width()
    assert panel.height() + 2 * live.strip.height() < live.height()  # in the middle: the messages stay in sight
    picture = QImage(1600, 400, QImage.Format.Format_RGB32)
    picture.fill(Qt.GlobalColor.white)
    painter = QPainter(picture)
    for x in range(8, 1600, 16):
        painter.fillRect(x, 0, 2, 400, Qt.GlobalColor.black)
    painter.end()
    panel.resize(700, 400)
    QApplication.processEvents()
    QGuiApplication.clipboard().setPixmap(QPixmap.fromImage(picture))
    panel.paste()
    seen = panel.view.grab().toImage()
    row = np.array([seen.pixelColor(x, seen.height() // 2).lightness() for x in range(4, seen.width() - 4)])
    dark = row < 240
    assert np.count_nonzero(dark[1:] & ~dark[:-1]) == 100
    panel.view.scale(4, 4)
    bar, place = panel.view.horizontalScrollBar(), panel.view.viewport()
    before = bar.value()
    QTest.mousePress(place, Qt.MouseButton.RightButton, pos=QPoint(200, 100))
    move(place, QPoint(150, 100))
    QTest.mouseRelease(place, Qt.MouseButton.RightButton, pos=QPoint(150, 100))
    assert bar.value() == before + 50
    assert panel.state.clicks == ()


def move(widget, at: QPoint) -> None:
    """Move the mouse with the right button held, which QTest cannot."""
    event = QMouseEvent(
        QEvent.Type.MouseMove, QPointF(at), widget.mapToGlobal(QPointF(at)), Qt.MouseButton.NoButton,
        Qt.MouseButton.RightButton, Qt.KeyboardModifier.NoModifier,
    )  # fmt: skip
    QApplication.sendEvent(widget, event)


def test_photograph_read_early_is_taken_when_its_plateau_waits(make):
    """Before, it showed "Press Enter" without a waiting plateau, and stayed closed with one."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    panel = window.live.photograph
    window.live.open_photograph()
    picture = QPixmap(200, 100)
    picture.fill()
    panel.view.set_picture(picture)
    for x in (20.0, 120.0, 150.0, 173.0):
        panel.view.clicked.emit(x, 50.0)
    assert "No plateau needs a reading" in panel.instruction.text()
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 20.0, 20.0), state=SessionState.RUNNING)
    window.refresh()
    assert panel.instruction.text().startswith("Press Enter")
    assert panel.take.isEnabled()
    panel.close()


def test_photograph_gives_a_reading(make, tmp_path):
    """Load a picture, four clicks, and the tip's way is kept as a reading from a photograph."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    panel = window.live.photograph
    panel.show()
    picture = QPixmap(200, 100)
    picture.fill()
    picture.save(str(tmp_path / "grid.png"))
    panel.load(tmp_path / "grid.png")
    for x in (20.0, 120.0, 150.0, 173.0):
        panel.view.clicked.emit(x, 50.0)
    assert (panel.value.text(), panel.take.text()) == ("+2.30 mm", "Take the reading")
    session.marks = (StepMark(3, 1, "unloading", 30.0, 10.0, 0),)
    window.model.readings._nominal = lambda kpa: (10.0, 0.5)
    panel.refresh()
    assert panel.instruction.text().startswith("\u25b2 +2.30 mm? Model +10.0")
    assert panel.take.text() == "Take it anyway"
    panel.take.click()
    assert (session.kept[-1].elongation_mm, session.kept[-1].source) == (2.3, "photograph")
    assert session.kept[-1].resolution_mm < 1.0
    with pytest.raises(RequestError, match="is not a picture"):
        panel.load(tmp_path / "nothing.png")
