"""Panels that request texts. Not modal, so that VENT can always be pressed; Esc closes them."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QLineEdit, QPlainTextEdit, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls

DISCARD = "Not stored: close again to discard"


class FormDialog(QDialog):
    """A panel that is closed at the second request where something is typed that is not stored."""

    _warned_of: tuple[str, ...] = ()

    def reject(self) -> None:
        """Close the panel, or say in its title that this loses what is typed."""
        typed = [field.text() for field in self.findChildren(QLineEdit) if field.isModified()]
        typed += [t.toPlainText() for t in self.findChildren(QPlainTextEdit) if t.document().isModified()]
        if typed and tuple(typed) != self._warned_of:
            self._warned_of = tuple(typed)
            self.setWindowTitle(DISCARD)
        else:
            super().reject()


class TextDialog(FormDialog):
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
        cancel = controls.button("Cancel", self.accept)
        words = controls.label(explanation, "muted", wrap=True)
        self.setLayout(controls.column(words, self.field, controls.row(None, cancel, self.button), spacing=style.GAP))
        self.field.selectAll()
        self.show()
        self.field.setFocus()

    def _take(self) -> None:
        if self._then(self.field.text().strip()):
            self.accept()
