"""The borders between plots that are one below the other: dragged by the mouse; a double click shares alike again.

Each plot has a share of the height, kept by its place among the plots of its card, so that a plot that comes and goes
keeps its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QMouseEvent

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Plot

_REACH = style.STEP  # pixels on either side of a border
USUAL_SHARE = 1000  # share of a plot with the stretch 1
CORRECTIONS = 3


class RowBorders(QObject):
    """Event filter of a view with plots."""

    changed = Signal()  # by the operator

    def __init__(self, view: pg.GraphicsLayoutWidget, plots: list[Plot]) -> None:
        super().__init__(view)
        self._view, self._plots = view, plots
        self.usual: dict[int, int] = {}  # by the place of the plot
        self.shares: dict[int, int] = {}  # of those that the operator has changed
        self._dragged: tuple[int, int] | None = None  # places of the plots above and below the border
        view.viewport().installEventFilter(self)

    def take(self, shares: Mapping[str, object]) -> None:
        """Take the shares that were kept between starts."""
        kept = {int(at): share for at, share in shares.items() if at.isdigit()}
        self.shares = {at: share for at, share in kept.items() if isinstance(share, int) and share > 0}
        self.apply()

    def apply(self) -> None:
        """Share the height among the plots that are shown."""
        for row, at in enumerate(self._rows()):
            share = self.shares.get(at, self.usual.get(at, USUAL_SHARE))
            self._view.ci.layout.setRowStretchFactor(row, share)

    def _rows(self) -> list[int]:
        """Return the places of the plots that are shown, from the top; none where some are side by side."""
        shown = {at: self._view.ci.items[p.item] for at, p in enumerate(self._plots) if p.item in self._view.ci.items}
        if any(cell[1] for cells in shown.values() for cell in cells):
            return []
        return sorted(shown, key=lambda at: shown[at][0])

    def _border(self, y: float) -> tuple[int, int] | None:
        """Return the places of the plots above and below the border at a height of the view."""
        for above, below in pairwise(self._rows()):
            bottom = self._plots[above].item.sceneBoundingRect().bottom()
            top = self._plots[below].item.sceneBoundingRect().top()
            if bottom - _REACH <= y <= top + _REACH:
                return above, below
        return None

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Drag a border; the plots do not get the events that do."""
        if not isinstance(event, QMouseEvent):
            return False
        y, kind = event.position().y(), event.type()
        if kind is QEvent.Type.MouseMove and self._dragged is not None:
            self._drag(*self._dragged, y)
            return True
        border = self._border(y)
        if kind is QEvent.Type.MouseMove and not event.buttons():
            viewport = self._view.viewport()
            viewport.setCursor(Qt.CursorShape.SplitVCursor) if border else viewport.unsetCursor()
        if kind is QEvent.Type.MouseButtonPress and event.button() is Qt.MouseButton.LeftButton and border:
            self._dragged = border
            return True
        if kind is QEvent.Type.MouseButtonDblClick and border:
            self.shares = {}
            self.apply()
            self.changed.emit()
            return True
        if kind is QEvent.Type.MouseButtonRelease and self._dragged is not None:
            self._dragged = None
            self.changed.emit()
            return True
        return False

    def _drag(self, above: int, below: int, y: float) -> None:
        """Move a border to a height of the view; neither plot becomes lower than a row can be."""
        boxes = {at: self._plots[at].item.sceneBoundingRect() for at in self._rows()}
        top, bottom = boxes[above].top(), boxes[below].bottom()
        if bottom - top < 2 * style.ROW_LEAST:
            return
        y = min(max(y, top + style.ROW_LEAST), bottom - style.ROW_LEAST)
        heights = {at: box.height() for at, box in boxes.items()} | {above: y - top, below: bottom - y}
        total = sum(self.shares.get(at, self.usual.get(at, USUAL_SHARE)) for at in heights)
        share = {at: total * height / sum(heights.values()) for at, height in heights.items()}
        for _ in range(CORRECTIONS):  # a plot with an axis below is higher than its share
            self.shares |= {at: max(1, round(part)) for at, part in share.items()}
            self.apply()
            self._view.ci.layout.activate()
            share = {
                at: part * heights[at] / self._plots[at].item.sceneBoundingRect().height() for at, part in share.items()
            }
