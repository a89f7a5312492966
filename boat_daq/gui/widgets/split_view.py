"""Two sides of a page with a movable border, whose place is stored."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QSplitter, QWidget

from boat_daq.gui import style
from boat_daq.viewmodels.common.preferences import Preferences


class Divided(QSplitter):
    """A main part on the left, a side part on the right.

    Parameters
    ----------
    name : key of the stored width of the right side.
    preferences : keep the width.
    left, right : the two sides.
    width : of the right side until the operator moves the border.
    stacks : whether the sides are stacked on a narrow page, which then scrolls.
    """

    def __init__(
        self, name: str, preferences: Preferences, left: QWidget, right: QWidget, width: int, *, stacks: bool = False
    ) -> None:
        super().__init__(Qt.Orientation.Horizontal)
        self._key, self._preferences, self._width = f"side {name}", preferences, width
        self._stacks, self.stacked = stacks, False
        self._left, self._right = left, right
        self.setHandleWidth(style.GAP)
        self.setChildrenCollapsible(False)
        self.addWidget(left)
        self.addWidget(right)
        self.setStretchFactor(0, 1)
        self.setStretchFactor(1, 0)
        self.handle(1).setAccessibleName("Border between the two sides")
        self.splitterMoved.connect(lambda *_: self._store())

    def prefer(self, width: int) -> None:
        """Take another width for the right side, unless the operator has moved the border."""
        self._width = width
        self._share()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the width of the right side, or stack it under the left one."""
        super().resizeEvent(event)
        narrow = self._stacks and self.width() < style.STACKED_BELOW - 2 * style.PAGE_MARGIN
        if narrow != self.stacked:
            self._stack(narrow)
        self._share()

    def _stack(self, narrow: bool) -> None:
        self.stacked = narrow
        self.setOrientation(Qt.Orientation.Vertical if narrow else Qt.Orientation.Horizontal)
        self._left.setMinimumHeight(2 * style.STACKED_HEIGHT if narrow else 0)
        self._right.setMinimumHeight(style.STACKED_TABLE if narrow else 0)

    def _store(self) -> None:
        if not self.stacked:
            self._preferences.set(self._key, self.sizes()[1])

    def _share(self) -> None:
        if self.stacked:
            return
        available = self.width() - self.handleWidth()
        right = min(int(self._preferences.get(self._key, self._width)), available // 2)
        if available > 0 and self.sizes()[1] != right:
            self.setSizes([available - right, right])
