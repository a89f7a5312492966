"""Pages whose sides stand beside each other where there is room, and over each other where there is not."""

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
    tall : widgets that then keep a height of their own; the page scrolls.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rows: Sequence[QBoxLayout] = ()
        self.tall: Sequence[QWidget] = ()
        self.narrow = False
        self._beside = 0  # the width that the sides need beside each other

    def minimumSizeHint(self) -> QSize:
        """Ask for no more width than the sides need over each other: they go there as soon as there is less."""
        least = super().minimumSizeHint()
        return least if self.narrow else QSize(min(least.width(), style.STACKED_BELOW // 2), least.height())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Stand the sides beside or over each other."""
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
