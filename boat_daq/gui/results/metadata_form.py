"""The form of metadata of a recording or of a unit, in a panel beside the window. Not modal."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QLineEdit, QPlainTextEdit, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.text_dialog import FormDialog
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.results.metadata import FIELDS, MetadataModel, free_lines

_EXPLANATION = "Printed in reports, exports and certificates."
FREE_HINT = "name = value, one on each line"


class MetadataForm(FormDialog):
    def __init__(self, parent: QWidget, model: MetadataModel, services: Services) -> None:
        super().__init__(parent.window())
        self.model, self.services = model, services
        self.setWindowTitle(f"Metadata of {model.subject}")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setMinimumWidth(style.FORM_WIDTH)
        stated = model.stated()
        labels = dict(FIELDS)
        self.fields: dict[str, QLineEdit] = {
            key: controls.field(labels[key], text, self._save) for key, text in model.texts(stated).items()
        }
        self.free = QPlainTextEdit(free_lines(stated), tabChangesFocus=True, placeholderText=FREE_HINT)
        self.free.setProperty("role", "paste")
        self.free.setAccessibleName("Fields of your own")
        self.free.setAcceptDrops(False)
        rows = [(labels[key], field, "") for key, field in self.fields.items()]
        name = controls.label("Fields of your own")
        name.setFixedHeight(style.CONTROL_HEIGHT)  # level with its first line
        form = controls.form([*rows, (name, self.free, "")])
        form.setAlignment(name, Qt.AlignmentFlag.AlignTop)
        form.setColumnStretch(0, 0)  # the names are short; the texts take the rest
        form.setColumnStretch(1, 1)
        buttons = controls.row(
            controls.button("Close", self.close), None, controls.button("Store", self._save, "primary")
        )
        parts = (controls.label(_EXPLANATION, "muted", wrap=True), form, buttons)
        self.setLayout(controls.column(*parts, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4))

    def showEvent(self, event: QShowEvent) -> None:
        """Take the height that the texts need, which is known once they have their font."""
        super().showEvent(event)
        self.resize(self.width(), self.heightForWidth(self.width()))

    def typed(self) -> dict[str, str]:
        return {key: field.text() for key, field in self.fields.items()}

    def _save(self) -> None:
        if self.services.notices.attempt(lambda: self.model.state(self.typed(), self.free.toPlainText())):
            self.accept()
