"""The Settings page: the values of the program and of each unit with range, default and meaning; what changed when."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QComboBox, QLabel, QLineEdit, QListWidget, QListWidgetItem, QWidget

from boat_daq.engine.described import Described, StoredChange, described
from boat_daq.engine.settings import Settings, Unit
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import typographic
from boat_daq.gui import style
from boat_daq.gui.results.metadata_form import MetadataForm
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.gui.widgets.layouts import Leaves, ReflowingPage
from boat_daq.viewmodels.common.notices import sentence
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.unit_in_use import UnitInUse
from boat_daq.viewmodels.settings_model import (
    CALIBRATION_CHANGED,
    PROGRAM,
    SettingsModel,
    StoredValues,
    in_force,
    note,
    refusal,
)
from protocol.base.errors import RequestError
from protocol.base.units import MINUS

_EXPLANATION = "Stored when you leave a field; its tooltip explains it."
_LIMITS = "Plans outside these limits are refused."
NO_CHANGE = "None yet"
_EMPTY = "empty"
_TABLES = {"type_b": "Type B", "metadata": "Metadata"}
_NO_LIMIT = 16_777_215  # of Qt
ON_OFF = [("off", "off"), ("on", "on")]
SUBJECT_ROLE = Qt.ItemDataRole.UserRole


class ValueRow:
    """The row of one value: its label and field, range and default, and a button that sets the default."""

    def __init__(self, about: Described, store: Callable[[str], object], reset: Callable[[], object]) -> None:
        self.about, self._store = about, store
        self._text: str | None = None  # as stored
        self.label = controls.label(about.label)
        self.refused = controls.label("", "small", wrap=True, name=f"Why {about.label} is refused")
        controls.set_state(self.refused, "warning")
        self.refused.hide()
        self.reset = controls.button("Default", reset, "link", name=f"Default of {about.label}")
        policy = self.reset.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.reset.setSizePolicy(policy)
        self.field: QLineEdit | QComboBox
        if about.choices or isinstance(about.default, bool):
            entries = [(text, str(value)) for value, text in about.choices] or ON_OFF
            self.field = controls.choice(about.label, entries, lambda _: self._enter())
        else:
            self.field = controls.field(about.label, placeholder=in_force(about))
            self.field.editingFinished.connect(self._enter)
        self.field.setAccessibleDescription(about.meaning)
        for part in (self.label, self.field):
            part.setToolTip(controls.as_words(f"{about.meaning}.\n{note(about)}".strip()))

    def text(self) -> str:
        """Return what is entered, as it is stored: a number has a hyphen for its minus."""
        if isinstance(self.field, QComboBox):
            return str(self.field.currentData())
        text = self.field.text()
        return text if isinstance(self.about.default, str) else text.replace(MINUS, "-")

    def show_text(self, text: str, *, other: bool) -> None:
        """Show what is stored, where that or the subject (`other`) has changed; what is being typed stays."""
        if text == self._text and not other:
            return
        self._text = text
        if isinstance(self.field, QComboBox):
            self.field.setCurrentIndex(self.field.findData(text))
        else:
            self.field.setText(text if isinstance(self.about.default, str) else typographic(text))
        self._refuse("")
        self.reset.setVisible(self.about.value_of(text, "") != self.about.default)

    def _enter(self) -> None:
        text = self.text()
        self._refuse(refusal(self.about, text))
        if not self.refused.text() and text != self._text:
            self._store(text)

    def _refuse(self, why: str) -> None:
        self.refused.setText(why)
        self.refused.setVisible(bool(why))
        controls.set_state(self.field, "true" if why else "", "wrong")


class ValueForm(QWidget):
    """The rows of the program, or those of a unit."""

    def __init__(
        self, shown: Iterable[Described], store: Callable[[str, str], object], reset: Callable[[str], object]
    ) -> None:
        super().__init__()
        self.setObjectName("inside")
        self._subject = ""  # whose values are shown
        self.rows = {
            about.key: ValueRow(about, partial(store, about.key), partial(reset, about.key)) for about in shown
        }
        grid = controls.grid()
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setVerticalSpacing(0)
        grid.setColumnStretch(1, 1)
        for i, row in enumerate(self.rows.values()):
            for column, part in enumerate((row.label, row.field, controls.label(row.about.unit, "muted"), row.reset)):
                grid.addWidget(part, 3 * i, column)
            grid.addWidget(row.refused, 3 * i + 1, 1, 1, 3)
            grid.setRowMinimumHeight(3 * i + 2, style.GAP)
        self.setLayout(grid)

    def show_texts(self, texts: Mapping[str, str], subject: str) -> None:
        for key, text in texts.items():
            self.rows[key].show_text(text, other=subject != self._subject)
        self._subject = subject


class SettingsPage(ReflowingPage):
    """Lists the program and the units; shows the values of the chosen one."""

    def __init__(self, model: SettingsModel, unit: UnitInUse, services: Services) -> None:
        super().__init__()
        self.model, self._unit, self.services = model, unit, services
        self._shown: tuple[object, ...] = ()
        self.subject = PROGRAM
        self.forms = {
            of_unit: ValueForm(described(Unit if of_unit else Settings).values(), self._store, self._reset)
            for of_unit in (False, True)
        }
        self.leaves = Leaves(*self.forms.values())
        self.list = self.first = QListWidget()
        self.list.setAccessibleName("Program and units")
        self.list.currentItemChanged.connect(lambda item, _: self._choose(item))
        self.name = controls.field("Name of a new unit", on_enter=self._add, placeholder="New unit")
        self.add = controls.button("Add", self._add, name="Add a unit")
        self.title = controls.label("", "subtitle")
        self.broken = controls.label("", wrap=True, name="Why the file cannot be used")
        controls.set_state(self.broken, "fault")
        self.calibrations = controls.label("", "muted", wrap=True)
        self.explanation = controls.label("", "muted", wrap=True)
        self.metadata = controls.button("Metadata \u2026", self._metadata, tip="Written into its next recordings")
        self.path = controls.label("", "small", wrap=True)
        self.changes = DataTable("Changes", ("When (UTC)", "Value", "Change"), stretched=2)
        self.changes.setMinimumHeight(style.QUESTION_LEAST)
        self._lay_out()

    def _lay_out(self) -> None:
        files = controls.row(
            controls.button("Import \u2026", self._import, tip="Settings or a unit from a TOML file"),
            controls.button("Export \u2026", self._export, tip="What is shown, as a TOML file"),
            None,
        )
        self.side, _ = controls.card((self.list, 1), controls.row((self.name, 1), self.add), files)
        self.reset = controls.button("All defaults", self._reset, tip="Calibrations, metadata and contributions stay")
        foot = controls.row(self.metadata, None, self.reset)
        self.values, _ = controls.card(
            self.title, self.explanation, self.broken, self.leaves, self.calibrations, None, foot, self.path
        )
        history, _ = controls.card(controls.label("Changes", "subtitle"), (self.changes, 1))
        body = controls.row((self.side, 1), (self.values, 3), (history, 3), spacing=style.GAP)
        controls.page_layout(self).addLayout(body, 1)
        self.rows, self.tall = (body,), (history,)
        self.reflow()

    def reflow(self) -> None:
        """Keep the list narrow beside the values, and above them no higher than its lines."""
        super().reflow()
        lines = self.list.count() * self.list.sizeHintForRow(0) + 2 * self.list.frameWidth()
        low = min(max(lines, style.CONTROL_HEIGHT), 4 * style.CONTROL_HEIGHT)
        self.list.setMinimumHeight(low)
        self.list.setMaximumHeight(low if self.narrow else _NO_LIMIT)
        self.side.setMaximumWidth(_NO_LIMIT if self.narrow else style.QUESTION_LEAST)
        self.values.setMaximumWidth(_NO_LIMIT if self.narrow else style.FORM_WIDTH + style.PANE_WIDTH_WIDE)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Follow the stored files where something has changed."""
        subjects = self.model.subjects(self._unit.name(snapshot))
        followed = (subjects, self.subject, self.model.revision, self.model.stamp(self.subject))
        if followed == self._shown:
            return
        self._shown = followed
        if [(self.list.item(i).text()) for i in range(self.list.count())] != [text for text, _ in subjects]:
            self._list(subjects)
        self.show_subject()

    def _list(self, subjects: list[tuple[str, str]]) -> None:
        self.list.blockSignals(True)
        self.list.clear()
        for text, subject in subjects:
            item = QListWidgetItem(text)
            item.setData(SUBJECT_ROLE, subject)
            self.list.addItem(item)
        names = [subject for _, subject in subjects]
        self.subject = self.subject if self.subject in names else PROGRAM
        self.list.setCurrentRow(names.index(self.subject))
        self.list.blockSignals(False)
        self.reflow()

    def _choose(self, item: QListWidgetItem | None) -> None:
        if item is not None:
            self.subject = str(item.data(SUBJECT_ROLE))
            self.show_subject()

    def show_subject(self) -> None:
        """Show the values of the chosen subject; where its file is refused, why."""
        is_unit = self.subject != PROGRAM
        self.title.setText(f"Unit {self.subject}" if is_unit else "This program")
        self.explanation.setText(f"{_LIMITS} {_EXPLANATION}" if is_unit else _EXPLANATION)
        self.path.setText(str(self.model.file(self.subject)))
        for part in (self.metadata, self.calibrations):
            part.setVisible(is_unit)
        self.broken.hide()
        try:
            shown = self.model.shown(self.subject)
        except RequestError as error:
            shown = StoredValues({}, ())
            self.broken.setText(f"\u25a0 {error.cause}. {error.remedy}")
            self.broken.show()
        self.leaves.setCurrentWidget(self.forms[is_unit])
        self.calibrations.setText(shown.calibrations)
        self.leaves.setVisible(bool(shown.texts))
        self.forms[is_unit].show_texts(shown.texts, self.subject)
        for button in (self.metadata, self.reset):
            button.setEnabled(bool(shown.texts))
        rows = self.forms[is_unit].rows
        cells = [self._change_cells(change, rows) for change in shown.changes]
        tips = [f"{change.utc}: {' '.join(row[1:])}" for change, row in zip(shown.changes, cells, strict=True)]
        self.changes.fill(cells or [(NO_CHANGE, "", "")], tips or [""])

    @staticmethod
    def _change_cells(change: StoredChange, rows: Mapping[str, ValueRow]) -> tuple[str, str, str]:
        when = change.utc[5:16].replace("T", " ")
        if change.key == CALIBRATION_CHANGED:
            return when, CALIBRATION_CHANGED, change.after
        table, _, key = change.key.partition(".")
        label = rows[table].about.label if table in rows else f"{_TABLES.get(table, table)}: {key}".rstrip(": ")
        return when, label, typographic(f"{change.before or _EMPTY} \u2192 {change.after or _EMPTY}")

    def _store(self, key: str, text: str) -> None:
        self._attempt(lambda: self.model.enter(self.subject, {key: text}))

    def _reset(self, *keys: str) -> None:
        self._attempt(lambda: self.model.reset(self.subject, *keys))

    def _attempt(self, action: Callable[[], object]) -> None:
        self.services.notices.attempt(action)
        self.show_subject()

    def _add(self) -> None:
        name = self.name.text().strip()

        def add() -> None:
            self.model.add_unit(name)
            self.subject = name
            self.name.clear()

        if name:
            self._attempt(add)

    def _metadata(self) -> None:
        form = partial(self.model.metadata, self.subject)
        self.services.notices.attempt(lambda: MetadataForm(self, form(), self.services).show())

    def _import(self) -> None:
        def take(path: Path) -> None:
            self.subject = self.model.import_(path)

        ask_open(self, self.services, "Import settings or a unit", "toml", take)

    def _export(self) -> None:
        stem = self.subject or "boat-daq settings"
        ask_save(self, self.services, stem, "toml", partial(self.model.export, self.subject))


class SafeModeBar(QWidget):
    """A bar under the header while the stored settings are refused and the defaults are used."""

    def __init__(self, model: SettingsModel, show_page: Callable[[], object]) -> None:
        super().__init__()
        self.model = model
        self.mark = controls.label("\u25b2  Safe mode")
        controls.set_state(self.mark, "warning")
        self.text: QLabel = controls.label("", wrap=True, name="Why the stored settings are not used")
        parts = (self.mark, (self.text, 1), controls.button("Settings", show_page, name="Show the settings"))
        margins = (style.PAGE_MARGIN, style.STEP, style.PAGE_MARGIN, style.STEP)
        controls.surface(self, "strip", controls.row(*parts, margins=margins))
        controls.set_state(self, "warning", "level")
        self.refresh()

    def refresh(self) -> None:
        refused = self.model.refused
        self.setVisible(refused is not None)
        if refused is not None:
            remedy = sentence(refused.remedy) if refused.remedy else ""
            text = f"Default settings are in use: {refused.cause}. The file is kept. {remedy}"
            controls.set_text(self.text, text.strip())
