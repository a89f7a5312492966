"""The certificate of a run: requests what is missing, shows the pages, writes PDF and XML. Not modal."""

from __future__ import annotations

from PySide6.QtCore import Qt, QTimerEvent
from PySide6.QtGui import QPixmap, QResizeEvent
from PySide6.QtWidgets import QFrame, QLabel, QLineEdit, QScrollArea, QVBoxLayout, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.gui.widgets.text_dialog import FormDialog
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.results.certificates import CertificateModel

_REFRESH_MS = 250
_MISSING = "Empty fields print as \u201cnot stated\u201d."
COMPLETE = "All fields are filled."
MAKING = "The pages are being made \u2026"
PAGE_SCALE = 0.85  # of the screen's height that the panel takes at most


class CertificatePanel(FormDialog):
    def __init__(self, parent: QWidget, model: CertificateModel, services: Services) -> None:
        super().__init__(parent.window())
        self.model, self.services = model, services
        self._shown = -1
        self.setWindowTitle(f"Certificate of {model.path.name}")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        missing, laboratory = model.missing(), model.missing_laboratory()
        self.metadata = {key: controls.field(label, on_enter=self._show) for key, label in missing}
        self.laboratory = {key: controls.field(label, on_enter=self._show) for key, label in laboratory}
        labels = {**dict(laboratory), **dict(missing)}
        fields: dict[str, QLineEdit] = {**self.laboratory, **self.metadata}
        self.words = controls.label(_MISSING if fields else COMPLETE, "muted", wrap=True)
        self.outcome = controls.label("", wrap=True, name="State of the certificate")
        self.stack = QVBoxLayout()
        self.area = QScrollArea()
        self.area.setWidgetResizable(True)
        self.area.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.area.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOn)  # its width is that of the pages
        self.area.setAccessibleName("Pages of the certificate")
        self.pages = controls.inside(self.stack)
        self.area.setWidget(self.pages)
        self.update_button = controls.button("Show pages", self._show, tip="Store what is entered and show the pages")
        self.write = controls.button("Save PDF and XML \u2026", self._write, "primary")
        buttons = controls.row(controls.button("Close", self.close), None, self.update_button, self.write)
        form = controls.form([(labels[key], field, "") for key, field in fields.items()])
        form.setColumnStretch(0, 0)
        form.setColumnStretch(1, 1)
        side = QScrollArea()
        side.setWidgetResizable(True)
        side.setFrameShape(QFrame.Shape.NoFrame)
        screen = self.screen().availableSize()
        wide = screen.width() >= style.CERTIFICATE_WIDTH
        side.setFixedWidth(style.PANE_WIDTH_WIDE if wide else style.PANE_WIDTH)
        entries = controls.inside(controls.column(self.outcome, self.words, form, None, spacing=style.GAP))
        entries.setContentsMargins(0, 0, style.GAP, 0)  # beside its scroll bar
        side.setWidget(entries)
        shown = controls.row(side, (self.area, 1))
        self.setLayout(controls.column((shown, 1), buttons, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4))
        self.resize(min(style.CERTIFICATE_WIDTH, screen.width()), int(PAGE_SCALE * screen.height()))
        next(iter(fields.values()), self.update_button).setFocus()
        services.notices.attempt(model.show)
        self._follow()
        self.startTimer(_REFRESH_MS)

    def timerEvent(self, event: QTimerEvent) -> None:
        self._follow()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit the pages to the width."""
        super().resizeEvent(event)
        self._shown = -1
        self._follow()

    def _follow(self) -> None:
        if self._shown == self.model.revision:
            return
        self._shown, model = self.model.revision, self.model
        self.outcome.setText(MAKING if model.working else model.failure or f"No. {model.number}")
        controls.allow(self.write, "" if model.pages and not model.working else "No pages yet.")
        while (item := self.stack.takeAt(0)) is not None:
            if (page := item.widget()) is not None:
                page.deleteLater()
        for number, image in enumerate(model.pages, 1):
            page = QLabel()
            pixmap = QPixmap()
            pixmap.loadFromData(image)
            ratio, width = self.devicePixelRatioF(), min(style.PAGE_WIDTH, self.area.viewport().width())
            pixmap = pixmap.scaledToWidth(round(ratio * width), Qt.TransformationMode.SmoothTransformation)
            pixmap.setDevicePixelRatio(ratio)
            page.setPixmap(pixmap)
            page.setFixedSize(pixmap.deviceIndependentSize().toSize())  # else pages share the height of the window
            page.setAccessibleName(f"Page {number} of {len(model.pages)}")
            self.stack.addWidget(page, 0, Qt.AlignmentFlag.AlignHCenter)
            page.show()  # now: a page shown later by Qt lies over the others for a while
        self.pages.setMinimumHeight(self.stack.minimumSize().height())

    def _show(self) -> None:
        texts = [{key: field.text() for key, field in part.items()} for part in (self.metadata, self.laboratory)]
        if self.services.notices.attempt(lambda: self.model.state(*texts)):
            for field in (*self.metadata.values(), *self.laboratory.values()):
                field.setModified(False)
            self.setWindowTitle(f"Certificate of {self.model.path.name}")
        self._follow()

    def _write(self) -> None:
        ask_save(self, self.services, f"{self.model.path.stem} certificate", "pdf", self.model.write, done="")
