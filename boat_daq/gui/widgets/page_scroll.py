"""The place of a page: it scrolls where the window is too small for it, and only then."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QScrollArea, QVBoxLayout, QWidget


class PageScroll(QScrollArea):
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


class Leaves(QWidget):
    """Several widgets in one place; it needs the room of the one that is shown, not of the largest.

    Qt's own stack asks all of them for the height that wrapped words need, the hidden ones too.
    """

    def __init__(self) -> None:
        super().__init__()
        self._leaves: list[QWidget] = []
        self._inside = QVBoxLayout(self)
        self._inside.setContentsMargins(0, 0, 0, 0)

    def addWidget(self, leaf: QWidget) -> None:
        """Add a widget; the first one is shown."""
        leaf.setVisible(not self._leaves)
        self._leaves.append(leaf)
        self._inside.addWidget(leaf)

    def currentWidget(self) -> QWidget:
        """Return the widget that is shown."""
        return next(leaf for leaf in self._leaves if not leaf.isHidden())

    def currentIndex(self) -> int:
        """Return which widget is shown."""
        return self._leaves.index(self.currentWidget())

    def setCurrentWidget(self, wanted: QWidget) -> None:
        """Show one of the widgets."""
        if wanted.isHidden():
            self.currentWidget().hide()
            wanted.show()

    def setCurrentIndex(self, index: int) -> None:
        """Show the widget of that number, in the order of their adding."""
        self.setCurrentWidget(self._leaves[index])
