"""An empty state: what will be here, and the one action that brings it."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QVBoxLayout, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls as widgets


class EmptyState(QWidget):
    """A title, a sentence, a button."""

    def __init__(self, title: str, words: str, action: str, on_click: Callable[[], object]) -> None:
        super().__init__()
        frame, inside = widgets.card()
        frame.setFixedWidth(style.FORM_WIDTH)
        inside.setContentsMargins(*(6 * style.STEP,) * 4)
        inside.setSpacing(style.CARD_PADDING)
        self.title = widgets.label(title, "title", wrap=True)
        self.words = widgets.label(words, "muted", wrap=True)
        self.button = widgets.button(action, on_click, "primary")
        self.button.setVisible(bool(action))
        inside.addWidget(self.title)
        inside.addWidget(self.words)
        inside.addLayout(widgets.row(self.button, None))
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(frame, 0, Qt.AlignmentFlag.AlignCenter)

    def say(self, title: str, words: str, action: str) -> None:
        """Say something else; without an action there is no button."""
        widgets.set_text(self.title, title)
        widgets.set_text(self.words, words)
        self.button.setVisible(bool(action))
        if action:
            widgets.set_text(self.button, action)
            self.button.setAccessibleName(action)
