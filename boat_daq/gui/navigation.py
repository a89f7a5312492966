"""The names of the pages at the left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QButtonGroup, QPushButton, QVBoxLayout, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common.services import Page


class Navigation(QWidget):
    """A button for each page.

    Parameters
    ----------
    pages : in order; their shortcuts are Ctrl+1 and so on.
    go : shows a page.
    show_keys : shows the shortcut sheet.
    """

    def __init__(self, pages: Sequence[Page], go: Callable[[Page], None], show_keys: Callable[[], None]) -> None:
        super().__init__()
        self.setObjectName("navigation")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.setFixedWidth(style.NAVIGATION_WIDTH)
        self.setAccessibleName("Pages")
        self._group = QButtonGroup(self)
        self.buttons: dict[Page, QPushButton] = {}
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, style.GAP, 0, style.GAP)
        layout.setSpacing(0)
        for i, name in enumerate(pages, 1):
            button = widgets.button(name, partial(go, name), "nav", tip=f"Ctrl+{i}")
            button.setCheckable(True)
            self._group.addButton(button)
            self.buttons[name] = button
            layout.addWidget(button)
        layout.addStretch(1)
        layout.addWidget(widgets.button("?  Keys", show_keys, "nav", name="Show the keys"))

    def mark(self, name: Page, why: str) -> None:
        """Mark a page that needs the operator, and why; an empty `why` removes the mark."""
        button = self.buttons[name]
        text = f"{name}  \u25c0" if why else name
        if button.text() != text:
            button.setText(text)
            button.setAccessibleName(f"{name}: {why}" if why else name)

    def show_page(self, name: Page) -> None:
        """Mark the page that is shown."""
        self.buttons[name].setChecked(True)
