"""How the parts of a page share its area: scrolled, stacked, side by side with a movable border, or none yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from PySide6.QtCore import QEvent, QObject, QSize, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QScrollArea, QSplitter, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common.preferences import Preferences

_NONE = (0, 0, 0, 0)


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
        super().setWidget(page)
        page.installEventFilter(self)
        self._fit()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Fit again when the minimum of the page has changed."""
        if watched is self.widget() and event.type() is QEvent.Type.LayoutRequest:
            self._fit()
        return super().eventFilter(watched, event)

    def resizeEvent(self, event: QResizeEvent) -> None:
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

    def __init__(self, *leaves: QWidget) -> None:
        super().__init__()
        self._leaves: list[QWidget] = []
        self._inside = controls.column(margins=_NONE)
        self.setLayout(self._inside)
        for leaf in leaves:
            self.addWidget(leaf)

    def addWidget(self, leaf: QWidget) -> None:
        """Add a widget; the first one is shown."""
        self._inside.addWidget(leaf)
        leaf.setVisible(not self._leaves)  # as a part of this one: alone it would be a window, which takes the keyboard
        self._leaves.append(leaf)

    def currentWidget(self) -> QWidget:
        return next(leaf for leaf in self._leaves if not leaf.isHidden())

    def currentIndex(self) -> int:
        return self._leaves.index(self.currentWidget())

    def setCurrentWidget(self, wanted: QWidget) -> None:
        if wanted.isHidden():
            self.currentWidget().hide()
            wanted.show()

    def setCurrentIndex(self, index: int) -> None:
        self.setCurrentWidget(self._leaves[index])


class ReflowingPage(QWidget):
    """A page that reflows by its width.

    Attributes
    ----------
    rows : layouts that become columns on a narrow page.
    tall : widgets with a minimum height on a narrow page, which scrolls.
    """

    def __init__(self) -> None:
        super().__init__()
        self.rows: Sequence[QBoxLayout | Shares] = ()
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
        way = QBoxLayout.Direction.TopToBottom if self.narrow else QBoxLayout.Direction.LeftToRight
        for row in self.rows:
            row.setDirection(way)
        for widget in self.tall:
            widget.setMinimumHeight(style.STACKED_HEIGHT if self.narrow else 0)


class Divided(QSplitter):
    """A main part, and a side part at its right or below it, with a movable border.

    Parameters
    ----------
    name : key of the stored size of the side part.
    size : width or height of the side part until the operator moves the border.
    below : whether the side part is below the main one.
    stacks : whether the parts are stacked on a narrow page, which then scrolls; the main one is so high then.
    """

    restacked = Signal(bool)  # whether the parts are stacked now

    def __init__(
        self,
        name: str,
        preferences: Preferences,
        main: QWidget,
        side: QWidget,
        size: int,
        *,
        below: bool = False,
        stacks: bool = False,
        stacked_height: int = 2 * style.STACKED_HEIGHT,
    ) -> None:
        super().__init__(Qt.Orientation.Vertical if below else Qt.Orientation.Horizontal)
        self._key, self._preferences, self._size = f"side {name}", preferences, size
        self._stacks, self.stacked, self._stacked_height = stacks, False, stacked_height
        self._main, self._side = main, side
        self.setHandleWidth(style.GAP)
        self.setChildrenCollapsible(False)
        self.addWidget(main)
        self.addWidget(side)
        self.setStretchFactor(0, 1)
        self.setStretchFactor(1, 0)
        self.handle(1).setAccessibleName("Movable border")
        self.splitterMoved.connect(lambda *_: self._store())

    def prefer(self, size: int) -> None:
        """Take another size for the side part, unless the operator has moved the border."""
        self._size = size
        self._share()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the size of the side part, or stack it under the main one."""
        super().resizeEvent(event)
        narrow = self._stacks and self.width() < style.STACKED_BELOW - 2 * style.PAGE_MARGIN
        if narrow != self.stacked:
            self.stacked = narrow
            self.setOrientation(Qt.Orientation.Vertical if narrow else Qt.Orientation.Horizontal)
            self._main.setMinimumHeight(self._stacked_height if narrow else 0)
            self.restacked.emit(narrow)
        self._share()

    def _store(self) -> None:
        if not self.stacked:
            self._preferences.set_later(self._key, self.sizes()[1])

    def _share(self) -> None:
        if self.stacked:
            return
        if self.orientation() is Qt.Orientation.Vertical:
            length, most = self.height(), self._side.maximumHeight()
        else:
            length, most = self.width(), self._side.maximumWidth()
        available = length - self.handleWidth()
        side = min(int(self._preferences.get(self._key, self._size)), available // 2, most)
        if available > 0 and self.sizes()[1] != side:
            self.setSizes([available - side, side])


class Shares(QSplitter):
    """Parts one below the other with movable borders; their shares of the length are kept between starts.

    Parameters
    ----------
    name : key of the stored shares.
    parts : each with its share until the operator moves a border.
    beside : whether they are side by side instead.
    """

    def __init__(
        self, name: str, preferences: Preferences, *parts: tuple[QWidget, float], beside: bool = False
    ) -> None:
        super().__init__(Qt.Orientation.Horizontal if beside else Qt.Orientation.Vertical)
        self._key, self._preferences, self._own = f"shares {name}", preferences, self.orientation()
        kept = preferences.get(self._key, [])
        known = len(kept) == len(parts) and all(isinstance(share, float) and share > 0 for share in kept)
        self._shares: list[float] = kept if known else [share for _, share in parts]
        self.setHandleWidth(style.GAP)
        self.setChildrenCollapsible(False)
        for i, (part, _) in enumerate(parts):
            self.addWidget(part)
            self.handle(i).setAccessibleName("Movable border")
        self.splitterMoved.connect(lambda *_: self._store())

    def setDirection(self, direction: QBoxLayout.Direction) -> None:
        """Put the parts below or beside each other, as `QBoxLayout` does."""
        below = direction is QBoxLayout.Direction.TopToBottom
        self.setOrientation(Qt.Orientation.Vertical if below else Qt.Orientation.Horizontal)
        self._share()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._share()

    def _store(self) -> None:
        if self.orientation() is self._own:  # not while they are stacked on a narrow page
            sizes = self.sizes()
            self._shares = [size / sum(sizes) for size in sizes]
            self._preferences.set_later(self._key, self._shares)

    def _share(self) -> None:
        length = self.height() if self.orientation() is Qt.Orientation.Vertical else self.width()
        self.setSizes([round(length * share / sum(self._shares)) for share in self._shares])


class EmptyState(QWidget):
    def __init__(self, title: str, words: str, action: str, on_click: Callable[[], object]) -> None:
        super().__init__()
        self.title = controls.label(title, "title", wrap=True)
        self.words = controls.label(words, "muted", wrap=True)
        self.button = controls.button(action, on_click, "primary")
        frame, inside = controls.card(self.title, self.words, controls.row(self.button, None))
        frame.setMaximumWidth(style.FORM_WIDTH)
        inside.setContentsMargins(*(6 * style.STEP,) * 4)
        inside.setSpacing(style.CARD_PADDING)
        self.setLayout(controls.column(None, controls.row(None, (frame, 1000), None), None, margins=_NONE))
        self.button.setVisible(bool(action))

    def say(self, title: str, words: str, action: str) -> None:
        """Say something else; without an action there is no button."""
        controls.set_text(self.title, title)
        controls.set_text(self.words, words)
        self.button.setVisible(bool(action))
        if action:
            controls.set_text(self.button, action)
            self.button.setAccessibleName(action)
