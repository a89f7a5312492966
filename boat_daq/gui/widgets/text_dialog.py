"""A panel that requests one text. Not modal, so that VENT can always be pressed; Esc closes it."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QLineEdit, QPlainTextEdit, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls


class TextDialog(QDialog):
    """Requests a text.

    Parameters
    ----------
    text : present text, which is selected.
    then : function of the text that returns whether it was accepted; else the panel stays open.
    lines : height of a text of several lines; 1 for one that Enter accepts.
    """

    def __init__(
        self,
        parent: QWidget,
        title: str,
        explanation: str,
        text: str,
        action: str,
        then: Callable[[str], bool],
        lines: int = 1,
    ) -> None:
        super().__init__(parent.window())
        self._then = then
        self.setWindowTitle(title)
        self.setModal(False)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setMinimumWidth(style.FORM_WIDTH)
        self.field: QLineEdit | QPlainTextEdit = controls.field(title, text, self._take)
        if lines > 1:
            self.field = QPlainTextEdit(text)
            self.field.setAccessibleName(title)
            self.field.setTabChangesFocus(True)
            self.field.setMinimumHeight(lines * self.field.fontMetrics().lineSpacing())
        self.button = controls.button(action, self._take, "primary")
        cancel = controls.button("Cancel", self.close)
        words = controls.label(explanation, "muted", wrap=True)
        self.setLayout(controls.column(words, self.field, controls.row(None, cancel, self.button), spacing=style.GAP))
        self.field.selectAll()
        self.show()
        self.field.setFocus()

    def _take(self) -> None:
        text = self.field.text() if isinstance(self.field, QLineEdit) else self.field.toPlainText()
        if self._then(text.strip()):
            self.close()
