"""Pages whose sides are side by side if wide enough, else stacked."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QSize
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QWidget

from boat_daq.gui import style


class ReflowingPage(QWidget):
    """A page that reflows by its width.

    Attributes
    ----------
    rows : layouts that become columns on a narrow page.
    tall : widgets with a minimum height on a narrow page, which scrolls.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rows: Sequence[QBoxLayout] = ()
        self.tall: Sequence[QWidget] = ()
        self.narrow = False
        self._beside = 0  # least width of the sides side by side

    def minimumSizeHint(self) -> QSize:
        """Return the minimum width of the stacked sides: they are stacked as soon as the width is less."""
        least = super().minimumSizeHint()
        return least if self.narrow else QSize(min(least.width(), style.STACKED_BELOW // 2), least.height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the sides side by side, or stack them."""
        super().resizeEvent(event)
        layout = self.layout()
        if not self.narrow and layout is not None:
            self._beside = layout.minimumSize().width()
        narrow = self.width() < max(style.STACKED_BELOW, self._beside)
        if narrow != self.narrow:
            self.narrow = narrow
            self.reflow()

    def reflow(self) -> None:
        """Follow `narrow`."""
        way = QBoxLayout.Direction.TopToBottom if self.narrow else QBoxLayout.Direction.LeftToRight
        for row in self.rows:
            row.setDirection(way)
        for widget in self.tall:
            widget.setMinimumHeight(style.STACKED_HEIGHT if self.narrow else 0)
