"""The import of a table, in a panel beside the window: its first rows, and which column is what. Not modal."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from PySide6.QtWidgets import QComboBox, QDialog, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.gui.widgets.layouts import PageScroll
from boat_daq.viewmodels.common.files import TABLE_KINDS
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.results.csv_import import ROLES, SEPARATORS, UNIT_TEXTS, CsvImport, Source
from protocol.base.units import NOTHING

NOT_IMPORTED = "not in this file"
SECOND_TIP = "Join another file of the same run, such as that of the pressure logger"
CAPTURE_TIP = "Read captured serial text through the text profile of its board"


class ImportPanel(QDialog):
    def __init__(self, parent: QWidget, model: CsvImport, services: Services) -> None:
        super().__init__(parent)
        self.over, self.model, self.services = parent, model, services
        self._revision = -1
        self.resize(style.WINDOW_MINIMUM[0], style.WINDOW_MINIMUM[1] + style.STRIP_HEIGHT)
        self.summary = controls.label("", "muted", wrap=True, name="How the file is written")
        self.preview = DataTable("First rows of the file", ())
        self.preview.setMinimumHeight(4 * style.CONTROL_HEIGHT)
        self.columns = {role: controls.choice(f"Column: {name}", ()) for role, name in ROLES.items()}
        self.units = {role: controls.choice(f"Unit: {name}", ()) for role, name in ROLES.items()}
        for role, unit in self.units.items():
            policy = unit.sizePolicy()
            policy.setRetainSizeWhenHidden(True)  # only a column that is chosen has one
            unit.setSizePolicy(policy)
            self.columns[role].activated.connect(partial(self._choose, role))
            self.units[role].activated.connect(partial(self._choose, role))
        self.separator = controls.choice("Separator", SEPARATORS, model.separate)
        self.rate = controls.field("Sampling rate in Hz", width=2 * style.CONTROL_HEIGHT, placeholder="Hz")
        self.rate.textEdited.connect(self._type_rate)
        self.name = controls.field("Name of the recording")
        self.warnings = controls.label("", "small", wrap=True, name="What was guessed")
        self.obstacle = controls.label("", "muted", wrap=True, name="What is missing")
        self.button = controls.button("Import", self._import, "primary")
        self.second = controls.button("Second file \u2026", self._ask_second, "quiet", tip=SECOND_TIP)
        self.profile = controls.button("Text profile \u2026", self._ask_profile, "quiet", tip=CAPTURE_TIP)
        close = controls.button("Cancel", self.close, name="Cancel the import")
        parts = (self.summary, (self.preview, 1), self._form(), self.warnings)
        area = PageScroll()  # on a small screen; the buttons stay below it
        area.setWidget(controls.holder(controls.column(*parts, spacing=style.GAP)))
        buttons = controls.row((self.obstacle, 1), self.second, self.profile, close, self.button)
        self.setLayout(controls.column((area, 1), buttons, spacing=style.GAP))

    def _form(self) -> QWidget:
        """Return quantities and their columns in two columns, then what holds for the whole file."""
        grid, rows = controls.grid(), (len(ROLES) + 1) // 2
        for i, (role, name) in enumerate(ROLES.items()):
            for k, widget in enumerate((controls.label(name), self.columns[role], self.units[role])):
                grid.addWidget(widget, i % rows, k + (4 if i >= rows else 0))
        grid.setColumnMinimumWidth(3, style.PAGE_MARGIN)
        for stretched in (1, 5):
            grid.setColumnStretch(stretched, 1)
        whole = controls.row(
            controls.label("Separator"), self.separator, controls.label("Rate"), self.rate, style.PAGE_MARGIN,
            controls.label("Recording"), (self.name, 1),
        )  # fmt: skip
        return controls.card(grid, style.STEP, whole)[0]

    def open_file(self, path: Path) -> None:
        """Read a file and show it."""
        self.model.open(path)
        self.name.setText(self.model.name)
        self.setWindowTitle(f"Import {path.name}")
        over, size = self.over.size(), self.size().boundedTo(self.over.size())  # on a small screen
        size.setWidth(size.width() if over.width() - size.width() >= style.PAGE_MARGIN * 2 else over.width())
        self.resize(size)
        self.show()
        self.raise_()

    def _choose(self, role: str, _: int = 0) -> None:
        column, unit = self.columns[role].currentData(), self.units[role].currentData()
        self.model.choose(role, Source(int(column or 0), str(unit or "")))
        self.refresh()

    def _type_rate(self, text: str) -> None:
        self.model.rate = text
        self._show_obstacle()

    def _import(self) -> None:
        self.services.notices.attempt(lambda: self.model.start(self.name.text()))

    def _ask_second(self) -> None:
        ask_open(self, self.services, "Second file of the run", TABLE_KINDS, self.model.join)

    def _ask_profile(self) -> None:
        ask_open(self, self.services, "Text profile of the board", "toml", self.model.read_through)

    def refresh(self) -> None:
        """Show the file where something has changed; close once it is imported."""
        model = self.model
        if not self.isVisible() or model.revision == self._revision:
            return
        self._revision = model.revision
        if model.finished:
            self.close()
            return
        controls.set_text(self.summary, model.summary())
        controls.set_state(self.summary, "fault" if model.failure is not None else "")
        self.separator.setCurrentIndex(self.separator.findData(model.separator))
        controls.set_text(self.rate, model.rate)
        self.warnings.setText("\n".join(f"\u25b2 {text}" for text in model.warnings()))
        self.warnings.setVisible(bool(model.warnings()))
        self._show_file()
        self._show_sources()
        self._show_obstacle()

    def _show_file(self) -> None:
        columns = self.model.columns
        roles = (self.model.heading(i) or NOTHING for i in range(1, len(columns) + 1))
        self.preview.set_headings([f"{c.title}\n{role}" for c, role in zip(columns, roles, strict=True)])
        self.preview.fill(list(zip(*(column.first for column in columns), strict=False)))

    def _show_sources(self) -> None:
        entries = [(NOT_IMPORTED, 0), *((f"{i}  {c.title}", i) for i, c in enumerate(self.model.columns, 1))]
        for role, source in self.model.sources.items():
            _fill(self.columns[role], entries, source.column)
            units = self.model.units(role) if source.column else ()
            _fill(self.units[role], [(UNIT_TEXTS.get(unit, unit), unit) for unit in units], source.unit)

    def _show_obstacle(self) -> None:
        obstacle = "" if self.model.reading else self.model.obstacle()
        controls.set_text(self.obstacle, obstacle)
        self.rate.setEnabled(bool(self.model.sources) and not self.model.sources["time_s"].column)
        self.button.setEnabled(not obstacle and not self.model.reading)


def _fill(choice: QComboBox, entries: Sequence[tuple[str, object]], value: object) -> None:
    choice.clear()
    for text, entry in entries:
        choice.addItem(text, entry)
    choice.setCurrentIndex(choice.findData(value))
    choice.setVisible(bool(entries))
