"""The place of a page: it scrolls where the window is too small for it, and only then."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QScrollArea, QStackedWidget, QWidget


class Room(QScrollArea):
    """Gives its page the window's room, but not less than the page's least.

    Qt's own way (`widgetResizable`) asks a page with wrapped words for the height it would like, and scrolls sooner.
    """

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("room")
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)

    def setWidget(self, page: QWidget) -> None:
        """Take a page."""
        super().setWidget(page)
        page.installEventFilter(self)
        self._fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Look again where the page's least has changed."""
        if watched is self.widget() and event.type() is QEvent.Type.LayoutRequest:
            self._fit()
        return super().eventFilter(watched, event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give the page what there is."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        page = self.widget()
        layout = page.layout() if page is not None else None
        if page is None or layout is None:
            return
        layout.activate()  # what has changed deep inside is not counted before
        room, least = self.maximumViewportSize(), page.minimumSizeHint()
        width = max(room.width(), least.width())
        if _least_height(page, width) > room.height():  # the bar at the side takes its part
            width = max(room.width() - self.verticalScrollBar().sizeHint().width(), least.width())
        page.resize(width, max(room.height(), _least_height(page, width)))


def _least_height(page: QWidget, width: int) -> int:
    """Return the height that a page needs at a width, its wrapped words included."""
    layout, least = page.layout(), page.minimumSizeHint().height()
    wraps = layout is not None and layout.hasHeightForWidth()
    return max(least, layout.minimumHeightForWidth(width)) if layout is not None and wraps else least


class Leaves(QStackedWidget):
    """Several widgets in one place; it needs the room of the one that is shown, not of the largest."""

    def __init__(self) -> None:
        super().__init__()
        self.currentChanged.connect(lambda _: self.updateGeometry())

    def minimumSizeHint(self) -> QSize:
        """Return the least of the widget that is shown."""
        shown = self.currentWidget()
        return shown.minimumSizeHint() if shown is not None else super().minimumSizeHint()

    def sizeHint(self) -> QSize:
        """Return the size that the widget shown would like."""
        shown = self.currentWidget()
        return shown.sizeHint() if shown is not None else super().sizeHint()

    def hasHeightForWidth(self) -> bool:
        """Whether the widget that is shown wraps words."""
        shown = self.currentWidget()
        return shown is not None and shown.hasHeightForWidth()

    def heightForWidth(self, width: int) -> int:
        """Return the height that the widget shown would like at a width."""
        shown = self.currentWidget()
        return shown.heightForWidth(width) if shown is not None else super().heightForWidth(width)
