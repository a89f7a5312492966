"""Scroll area of a page, and a stack that takes the size of its visible widget."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QFrame, QScrollArea, QVBoxLayout, QWidget


class PageScroll(QScrollArea):
    """Gives its page the size of the window, but not less than the minimum of the page; scrolls only below it.

    Qt's own `widgetResizable` uses the preferred height of wrapped labels, and scrolls sooner.
    """

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("scroll")
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)

    def setWidget(self, page: QWidget) -> None:
        """Set the page."""
        super().setWidget(page)
        page.installEventFilter(self)
        self._fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Fit again when the minimum of the page has changed."""
        if watched is self.widget() and event.type() is QEvent.Type.LayoutRequest:
            self._fit()
        return super().eventFilter(watched, event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the page."""
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        page = self.widget()
        layout = page.layout() if page is not None else None
        if page is None or layout is None:
            return
        layout.activate()  # takes changes of nested layouts into account
        size, least = self.maximumViewportSize(), page.minimumSizeHint()
        width = max(size.width(), least.width())
        if _least_height(page, width) > size.height():  # less the scroll bar
            width = max(size.width() - self.verticalScrollBar().sizeHint().width(), least.width())
        page.resize(width, max(size.height(), _least_height(page, width)))


def _least_height(page: QWidget, width: int) -> int:
    """Return the minimum height of a page at a width, with its wrapped labels."""
    layout, least = page.layout(), page.minimumSizeHint().height()
    wraps = layout is not None and layout.hasHeightForWidth()
    return max(least, layout.minimumHeightForWidth(width)) if layout is not None and wraps else least


class Leaves(QWidget):
    """A stack of widgets with the size of the visible one, not of the largest.

    Qt's own stack takes the height of wrapped labels of hidden widgets into account.
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
        """Show the widget of that number, in the order they were added."""
        self.setCurrentWidget(self._leaves[index])
