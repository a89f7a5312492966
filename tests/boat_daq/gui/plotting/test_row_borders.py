"""The borders between plots, dragged by the mouse in the real window, and kept between starts."""

from __future__ import annotations

from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from boat_daq.gui import style

LEFT = Qt.MouseButton.LeftButton


def heights(card) -> list[float]:
    """The heights of the plots of a card, from the top."""
    QApplication.processEvents()
    return [plot.item.sceneBoundingRect().height() for plot in card.rows]


def drag(card, pixels: int) -> None:
    """Drag the border between the two highest plots."""
    viewport = card.view.viewport()
    here = QPoint(card.view.width() // 2, round(card.rows[0].item.sceneBoundingRect().bottom()) + 1)
    QTest.mouseMove(viewport, here)
    assert viewport.cursor().shape() is Qt.CursorShape.SplitVCursor
    QTest.mousePress(viewport, LEFT, pos=here)
    QTest.mouseMove(viewport, here + QPoint(0, pixels))
    QTest.mouseRelease(viewport, LEFT, pos=here + QPoint(0, pixels))


def test_dragged_heights_are_kept(live):
    """The first plot grows by what the second one loses, the picture does not move; a double click undoes it."""
    live.resize(1280, 800)
    live.draw()
    card = live.live.plots
    before = heights(card)
    following = live.live.model.following
    drag(card, 40)
    first, second, third = heights(card)[:3]
    assert abs(first - before[0] - 40) < 6
    assert abs(before[1] - second - 40) < 6
    assert abs(third - before[2]) < 6
    assert live.live.model.following is following  # nothing was panned
    kept = live.live.layouts.current
    drag(card, 1000)  # no plot becomes lower than a row can be
    assert heights(card)[1] >= style.ROW_LEAST - 4
    live.live.layouts.use(kept)
    card.arrange()
    assert abs(heights(card)[0] - first) < 2
    border = QPoint(card.view.width() // 2, round(card.rows[0].item.sceneBoundingRect().bottom()) + 1)
    QTest.mouseDClick(card.view.viewport(), LEFT, pos=border)
    assert abs(heights(card)[0] - before[0]) < 2


def test_unusable_stored_heights_are_ignored(live):
    """A broken file of preferences leaves the usual heights."""
    card = live.live.plots
    live.draw()
    before = heights(card)
    card.borders.take({"0": "high", "x": 3, "1": -5})
    assert heights(card) == before
