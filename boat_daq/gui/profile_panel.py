"""The panel that describes a board with another firmware: what it prints, its fields, its commands. Not modal."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QCheckBox, QComboBox, QDialog, QGridLayout, QLabel, QLineEdit, QScrollArea, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.board_profile import COMMAND_LABELS, DEVICE, BoardProfile, escaped, meaning_choices

_UNITS = ("", "s", "ms", "us", "kPa", "Pa", "mbar", "bar", "psi", "counts", "mV", "V", "degC")
_EXPLANATION = "Choose the port of the board, or a file with what it printed. Nothing is sent to the port."
COMMANDS_HINT = (
    "Text the firmware understands, such as P{kpa:.1f}\\n; without limits, vent and pressure it is only recorded"
)
_HINTS = {"set_pressure": "P{kpa:.1f}\\n", "vent": "V\\n", "start": "R{rate_hz}\\n", "heartbeat": "H\\n"}
PREVIEW_HEIGHT = 6 * style.CONTROL_HEIGHT
LIMITS_TIP = "The pressure is never commanded beyond these limits; without both, none is commanded."


class ProfilePanel(QDialog):
    """Proposes a profile from what a board prints, and lets the operator correct it over a preview."""

    def __init__(
        self,
        parent: QWidget,
        model: BoardProfile,
        services: Services,
        ports: Callable[[], list[tuple[str, str]]],
        use: Callable[[str, str], None],
    ) -> None:
        super().__init__(parent)
        self.model, self.services, self._ports, self._use = model, services, ports, use
        self._shown: object = None
        self._filled = False  # hidden, it is shown as it was
        self.setWindowTitle("Describe a board")
        self.setModal(False)
        self.resize(style.FORM_WIDTH + style.PANE_WIDTH_WIDE, style.FORM_HEIGHT)
        self.raw = controls.label("", "small", name="What the board prints")
        self.raw.setObjectName("raw")
        self.raw.setFont(style.fixed_font())
        self.raw.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.heard, self.summary = controls.label("", "muted"), controls.label("", "subtitle", wrap=True)
        self.grid = QGridLayout()
        self.meanings: list[QComboBox] = []  # of the fields in their order, as the units and the scales
        self.units: list[QComboBox] = []
        self.scales: list[QLineEdit] = []
        self.rx8 = controls.field("RX8 format", on_enter=self._set_rx8)
        self.device = {key: self._device_field(key) for key in DEVICE}
        self.falling = QCheckBox("Voltage falls with light")
        self.falling.clicked.connect(lambda: self.model.set_falling(self.falling.isChecked()))
        self.table = DataTable("Preview of the samples")
        self.remark = controls.label("", "muted", wrap=True)
        self.commands = {key: self._command_field(key) for key in COMMAND_LABELS}
        self.dry = {key: controls.label("", "small", wrap=True) for key in COMMAND_LABELS}
        pages = ((self._fields_page(), "Fields"), (self._commands_page(), "Commands"))
        tabs = controls.tabs("Fields, commands", *pages)
        seen = controls.row((self._raw_area(), 1), (controls.holder(controls.column(self.remark, self.table)), 1))
        parts = (self._source(), seen, self.summary, (tabs, 1), self._ends())
        self.setLayout(controls.column(*parts, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4))

    def _source(self) -> QWidget:
        self.port = QComboBox()
        self.port.setEditable(True)
        self.port.setAccessibleName("Port of the board")
        self.port.setLineEdit(controls.field("Port of the board", placeholder="a port, or socket://HOST:PORT"))
        self.listen_button = controls.button("Listen", self._listen)
        file = controls.button("Open a file …", self._open)
        line = controls.row(controls.label("Port"), (self.port, 1), self.listen_button, file)
        return controls.holder(controls.column(controls.label(_EXPLANATION, "muted", wrap=True), line))

    def _raw_area(self) -> QScrollArea:
        area = QScrollArea()
        area.setWidgetResizable(True)
        area.setFixedHeight(PREVIEW_HEIGHT)
        area.setWidget(controls.inside(controls.column(self.heard, self.raw, None)))
        return area

    def _fields_page(self) -> QScrollArea:
        self.grid.setColumnStretch(1, 1)
        rx8 = controls.row(controls.label("RX8 format"), (self.rx8, 1))
        self.rx8_row = controls.holder(rx8)
        self.rx8_row.hide()
        values = [
            controls.form([(DEVICE[key][0], self.device[key], DEVICE[key][1]) for key in part])
            for part in (("rate_hz", "vref_mv", "adc_bits"), ("low_kpa", "high_kpa"))
        ]
        columns = [controls.column(values[0], None), controls.column(values[1], self.falling, None)]
        device = controls.row(columns[0], 2 * style.GAP, columns[1], None)
        self.table.setFixedHeight(PREVIEW_HEIGHT - style.TITLE_HEIGHT)
        return _scrolled(controls.column(self.rx8_row, self.grid, device, None, spacing=style.GAP))

    def _commands_page(self) -> QScrollArea:
        grid = QGridLayout()
        grid.setColumnStretch(2, 1)
        for i, (key, text) in enumerate(COMMAND_LABELS.items()):
            for k, cell in enumerate((controls.label(text), self.commands[key], self.dry[key])):
                grid.addWidget(cell, i, k)
        return _scrolled(controls.column(controls.label(COMMANDS_HINT, "muted", wrap=True), grid, None))

    def _ends(self) -> QWidget:
        self.name = controls.field("Name of the profile", self.model.name)
        self.name.textChanged.connect(self._set_name)
        self.save_button = controls.button("Save …", self._save)
        self.use_button = controls.button("Use it", self._take, "primary", tip="Put it into the connection panel")
        buttons = (controls.button("Close", self.close), None, self.save_button, self.use_button)
        return controls.holder(controls.row(controls.label("Name"), (self.name, 1), *buttons))

    def _device_field(self, key: str) -> Any:
        field = controls.field(DEVICE[key][0], width=3 * style.CONTROL_HEIGHT)
        field.editingFinished.connect(lambda: self._attempt(partial(self.model.set_device, key, field.text())))
        if key.endswith("_kpa"):
            field.setToolTip(LIMITS_TIP)
        return field

    def _command_field(self, key: str) -> Any:
        field = controls.field(f"Template: {COMMAND_LABELS[key]}", placeholder=_HINTS.get(key, ""))
        field.setFixedWidth(6 * style.CONTROL_HEIGHT)
        field.textEdited.connect(lambda text: self._attempt(partial(self.model.set_command, key, text)))
        return field

    def open_fresh(self, port: str = "") -> None:
        """List the ports and show the panel."""
        self.port.clear()
        for text, name in self._ports():
            self.port.addItem(text, name)
        self.port.setEditText(port)
        self.refresh()
        self.show()
        self.raise_()

    def closeEvent(self, event: Any) -> None:
        """Close the port."""
        self.model.stop()
        super().closeEvent(event)

    def hideEvent(self, event: Any) -> None:
        """Close the port; Esc hides the panel without closing it."""
        self.model.stop()
        super().hideEvent(event)

    def refresh(self) -> None:
        """Show what has come, and the profile as it stands; called a few times a second."""
        if not self.isVisible() and self._filled:
            return
        self._filled = True
        self.services.notices.attempt(self.model.follow)
        controls.set_text(self.listen_button, "Stop" if self.model.listening else "Listen")
        controls.set_text(self.raw, self.model.raw())
        controls.set_text(self.heard, self.model.heard())
        proposal = self.model.proposal
        controls.set_text(self.summary, proposal.summary if proposal is not None else self.model.problem)
        preview, dry = self.model.preview(), self.model.dry_run()
        mark = "" if preview.good else "\u25b2 "
        controls.set_text(self.remark, f"{mark}{preview.remark}")
        controls.set_state(self.remark, "" if preview.good else "warning")
        for button in (self.save_button, self.use_button):
            controls.allow(button, "" if preview.rows else preview.remark)
        self.table.set_headings(preview.headings, right=range(len(preview.headings)))
        self.table.fill(preview.rows)
        for key, text in dry.items():
            controls.set_text(self.dry[key], text)
        if proposal != self._shown or self._shown is None:
            self._shown = proposal
            self._fill()

    def _fill(self) -> None:
        """Fill the fields with the proposal, but for those in which the operator types."""
        proposal = self.model.proposal
        controls.clear(self.grid)
        self.meanings, self.units, self.scales = [], [], []
        fields = proposal.fields if proposal is not None else ()
        for k, text in enumerate(("Printed", "Example", "Meaning", "Unit", "Scale", "") if fields else ()):
            self.grid.addWidget(controls.label(text, "muted"), 0, k)
        for i, field in enumerate(fields):
            label = field.label or f"field {i + 1}"
            meaning = _editable(f"Meaning of {label}", meaning_choices(), field.name, partial(self._set, i, "name"))
            unit = _editable(f"Unit of {label}", [(u, u) for u in _UNITS], field.unit, partial(self._set, i, "unit"))
            scale = controls.field(f"Scale of {label}", f"{field.scale:g}", width=2 * style.CONTROL_HEIGHT)
            scale.editingFinished.connect(partial(self._scale, i, scale))
            guess = controls.label("\u25b2 guess" if field.guessed else "", "small")
            cells: tuple[QLabel | QWidget, ...] = (
                controls.label(label), controls.label(", ".join(field.examples), "muted", elide=True),
                meaning, unit, scale, guess,
            )  # fmt: skip
            for k, cell in enumerate(cells):
                self.grid.addWidget(cell, i + 1, k)
            self.meanings.append(meaning)
            self.units.append(unit)
            self.scales.append(scale)
        self.rx8_row.setVisible(bool(proposal and proposal.rx8))
        if proposal is None:
            return
        self.rx8.setText(proposal.rx8)
        self.falling.setChecked(proposal.polarity < 0)
        for key, box in self.device.items():
            if not box.hasFocus():
                box.setText(self.model.device_text(key))
        for key, box in self.commands.items():
            if not box.hasFocus():
                box.setText(escaped((proposal.commands or {}).get(key, "")))

    def _attempt(self, action: Callable[[], object]) -> None:
        self.services.notices.attempt(action)
        self.refresh()

    def _set(self, at: int, key: str, value: str) -> None:
        if self.model.proposal is not None and getattr(self.model.proposal.fields[at], key) != value:
            self._attempt(partial(self.model.set_field, at, **{key: value}))

    def _scale(self, at: int, field: Any) -> None:
        if self.model.proposal is not None and field.text() != f"{self.model.proposal.fields[at].scale:g}":
            self._attempt(partial(self.model.set_scale, at, field.text()))

    def _set_rx8(self) -> None:
        self._attempt(partial(self.model.set_rx8, self.rx8.text()))

    def _set_name(self, text: str) -> None:
        self.model.name = text.strip() or "Own board"

    def _listen(self) -> None:
        known = self.port.findText(self.port.currentText())
        port = str(self.port.itemData(known)) if known >= 0 else self.port.currentText()
        self._attempt(self.model.stop if self.model.listening else partial(self.model.listen, port))

    def _open(self) -> None:
        ask_open(self, self.services, "Open what a board printed", "txt csv log dat bin", self._opened)

    def _opened(self, path: Any) -> None:
        self.model.open(path)
        self.refresh()

    def _save(self) -> None:
        ask_save(self, self.services, self.model.name, "toml", self.model.save)

    def _take(self) -> None:
        port = self.port.currentText()
        self.model.stop()
        self._use(self.model.toml(), port)
        self.hide()


def _scrolled(layout: Any) -> QScrollArea:
    area = QScrollArea()
    area.setWidgetResizable(True)
    area.setWidget(controls.inside(layout))
    return area


def _editable(name: str, entries: list[tuple[str, str]], value: str, act: Callable[[str], None]) -> QComboBox:
    """Return a choice whose text may also be typed; `act` takes the value of an entry, or the text."""
    box = controls.choice(name, entries)
    box.setEditable(True)
    box.setInsertPolicy(QComboBox.InsertPolicy.NoInsert)

    def chosen() -> None:
        known = box.findText(box.currentText().strip())
        act(str(box.itemData(known)) if known >= 0 else box.currentText().strip())

    box.activated.connect(lambda *_: chosen())
    text = controls.field(name)
    box.setLineEdit(text)
    at = box.findData(value)
    box.setCurrentIndex(at)
    if at < 0:
        box.setEditText(value)
    text.editingFinished.connect(chosen)
    return box
