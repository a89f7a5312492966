"""The form of a unit's type B contributions, in a panel beside the window. Not modal."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import Qt, QTimerEvent
from PySide6.QtWidgets import QComboBox, QDialog, QGridLayout, QLabel, QLineEdit, QWidget

from analysis.calibration.type_b import TypeBContribution
from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.results.contributions import (
    DISTRIBUTIONS,
    MEASURES,
    OF_PRESSURE_OR_TEMPERATURE,
    STATED,
    ContributionFields,
    ContributionsModel,
    Refusal,
    label,
    traceability_text,
)

_REFRESH_MS = 250
_EXPLANATION = "From a certificate or data sheet. Empty: not assessed; zero is a statement (undo: Ctrl+Z)."
ANOTHER = "Another \u2026"
_HINTS = {
    "dof": "empty: certain", "certificate": "number and date", "source": "", "k": "",
    "sensitivity": "0 where the elongation does not depend on it",
}  # fmt: skip


class ContributionsForm(QDialog):
    """States and withdraws contributions; budget and traceability follow."""

    def __init__(self, parent: QWidget, model: ContributionsModel, services: Services) -> None:
        super().__init__(parent)
        self.model, self.services = model, services
        self._shown: list[tuple[str, str, str]] = []
        self._tried = False
        self.setWindowTitle(f"Type B contributions of {model.unit}")
        self.setModal(False)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.resize(style.FORM_WIDTH, min(style.FORM_HEIGHT, self.screen().availableSize().height()))
        self.list = DataTable("Contributions of the unit", ("Contribution", "Statement"), stretched=1)
        self.list.itemSelectionChanged.connect(self._choose)
        self.traced = controls.label("", wrap=True, name="Whether an elongation is traceable")
        self.outcome = controls.label("", "muted", name="Standard uncertainty of this contribution")
        self.withdraw = controls.button("Not assessed", self._withdraw, tip="Remove the statement from the unit's file")
        self.store = controls.button("Store", self._state, "primary", tip="Store it in the unit's file")
        buttons = controls.row(controls.button("Close", self.close), None, self.withdraw, self.store)
        explanation = controls.label(_EXPLANATION, "muted", wrap=True)
        parts = (explanation, (self.list, 1), self.traced, self._form(), self.outcome, buttons)
        self.setLayout(controls.column(*parts, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4))
        self.show_stated()
        self.list.selectRow(0)
        self.startTimer(_REFRESH_MS)  # undo is a key of the window, not of this panel

    def _form(self) -> QGridLayout:
        fields = {key: controls.field(key, placeholder=hint) for key, hint in _HINTS.items()}
        self.name, self.value = controls.field("name", placeholder="e.g. lens distortion"), controls.field("value")
        self.stated = controls.choice("How it is stated", STATED, self._check)
        self.unit = controls.choice("Unit", MEASURES, self._check)
        self.distribution = controls.choice("Distribution", DISTRIBUTIONS, self._check)
        self.texts: dict[str, QLineEdit] = {"name": self.name, "value": self.value, **fields}
        self.choices: dict[str, QComboBox] = {
            "stated": self.stated, "unit": self.unit, "distribution": self.distribution
        }  # fmt: skip
        for field in self.texts.values():
            field.textChanged.connect(self._check)
            field.returnPressed.connect(self._state)
        self.per = controls.label("", "muted")
        lines: tuple[tuple[str, str, tuple[controls.Item, ...]], ...] = (
            ("name", "Name", (self.name,)),
            ("stated", "Stated as", (self.stated,)),
            ("value", "Value", ((self.value, 1), self.unit)),
            ("k", "Coverage factor k", (fields["k"],)),
            ("distribution", "Distribution", (self.distribution,)),
            ("sensitivity", "Sensitivity", (fields["sensitivity"], self.per)),
            ("dof", "Degrees of freedom", (fields["dof"],)),
            ("certificate", "Certificate", (fields["certificate"],)),
            ("source", "Note", (fields["source"],)),
        )
        grid = QGridLayout()
        grid.setVerticalSpacing(style.STEP)
        grid.setColumnStretch(1, 1)
        self.lines: dict[str, tuple[QWidget, QWidget]] = {}
        self.refusals: dict[str, QLabel] = {}
        for i, (key, text, line) in enumerate(lines):
            self.refusals[key] = controls.label("", "small", wrap=True, name=f"Why {text} is refused")
            self.lines[key] = controls.label(text), controls.holder(controls.row(*line))
            grid.addWidget(self.lines[key][0], 2 * i, 0)
            grid.addWidget(self.lines[key][1], 2 * i, 1)
            grid.addWidget(self.refusals[key], 2 * i + 1, 1)
            controls.set_state(self.refusals[key], "fault")
            if key in self.texts:
                self.texts[key].setAccessibleName(text)
        return grid

    def timerEvent(self, event: QTimerEvent) -> None:
        """Follow the unit's file; close where it is refused."""
        if not self.services.notices.attempt(self.show_stated):
            self.close()

    def show_stated(self) -> None:
        """Show the contributions as the unit's file has them now."""
        rows = self.model.rows()
        if rows == self._shown:
            return
        chosen, self._shown = self.chosen(), rows
        self.list.blockSignals(True)
        self.list.fill([row[1:] for row in rows] + [(ANOTHER, "")], [row[2] for row in rows] + [""])
        self.list.blockSignals(False)
        self.traced.setText(traceability_text(self.model.traceability()))
        names = [name for name, *_ in rows]
        self.list.selectRow(names.index(chosen) if chosen in names else len(names))

    def chosen(self) -> str:
        """Return the key of the contribution that is chosen; empty for another one."""
        row = self.list.currentRow()
        return self._shown[row][0] if 0 <= row < len(self._shown) else ""

    def typed(self) -> ContributionFields:
        """Return what the form holds."""
        texts = {key: field.text() for key, field in self.texts.items() if key != "name"}
        return ContributionFields(**texts, **{key: str(choice.currentData()) for key, choice in self.choices.items()})

    def _choose(self) -> None:
        """Show the fields of the chosen contribution."""
        name = self.chosen()
        fields = self.model.fields(name)
        self._tried = False
        for key, choice in self.choices.items():
            choice.setCurrentIndex(choice.findData(getattr(fields, key)))
        for key, field in self.texts.items():
            field.setText(label(name) if key == "name" else getattr(fields, key))
        for part in self.lines["name"]:
            part.setVisible(not name)
        controls.allow(self.withdraw, "" if name in self.model.tables() else "It is not stated.")
        self._check()

    def _found(self) -> TypeBContribution | Refusal:
        """Return the contribution that the form states, or why it states none."""
        name = self.chosen()
        return self.model.check(name or self.name.text(), self.typed(), new=not name)

    def _check(self, *_: object) -> None:
        """Show what the fields amount to, or at the field what to enter there, once something was entered."""
        fields = self.typed()
        wanted = {"k": fields.stated == "expanded", "sensitivity": fields.unit in OF_PRESSURE_OR_TEMPERATURE}
        for key, shown in wanted.items():
            for part in self.lines[key]:
                part.setVisible(shown)
        self.per.setText({"kpa": "mm/kPa", "k": "mm/K"}.get(fields.unit, ""))
        found = self._found()
        refused = found if isinstance(found, Refusal) and (self._tried or fields.value.strip()) else None
        for key, text in self.refusals.items():
            text.setText(refused.text if refused is not None and refused.field == key else "")
            text.setVisible(bool(text.text()))
        for key, field in self.texts.items():
            controls.set_state(field, "true" if refused is not None and refused.field == key else "", "wrong")
        self.outcome.setText("" if isinstance(found, Refusal) else found.statement)

    def _state(self) -> None:
        """Store the contribution; where it is refused, go to the field."""
        self._tried = True
        self._check()
        found = self._found()
        if isinstance(found, Refusal):
            {**self.texts, **self.choices}[found.field].setFocus()
        elif self.services.notices.attempt(partial(self.model.state, found.name, self.typed())):
            self.services.notices.attempt(self.show_stated)

    def _withdraw(self) -> None:
        self.services.notices.attempt(partial(self.model.withdraw, self.chosen()))
        self.services.notices.attempt(self.show_stated)
