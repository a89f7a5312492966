"""A panel that requests one text. Not modal, so that VENT can always be pressed; Esc closes it."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls


class TextDialog(QDialog):
    """Requests a text; `then` takes it and returns whether it was accepted, else the panel stays open."""

    def __init__(
        self, parent: QWidget, title: str, explanation: str, text: str, action: str, then: Callable[[str], bool]
    ) -> None:
        super().__init__(parent.window())
        self._then = then
        self.setWindowTitle(title)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setMinimumWidth(style.FORM_WIDTH)
        self.field = controls.field(title, text, self._take)
        self.button = controls.button(action, self._take, "primary")
        cancel = controls.button("Cancel", self.close)
        words = controls.label(explanation, "muted", wrap=True)
        self.setLayout(controls.column(words, self.field, controls.row(None, cancel, self.button), spacing=style.GAP))
        self.field.selectAll()
        self.show()
        self.field.setFocus()

    def _take(self) -> None:
        if self._then(self.field.text().strip()):
            self.close()
