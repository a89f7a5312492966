"""The panel for the units in which the window shows values. Not modal; each choice is seen at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from PySide6.QtWidgets import QComboBox, QDialog, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common.preferences import UnitChoice
from boat_daq.viewmodels.common.services import Services
from protocol.base.units import CHOICES, STORED_UNITS, ShownUnits, as_text

_EXPLANATION = "For the whole window. Recordings, plan files and exports keep kPa, mV and mm."
_NAMES = {"pressure": "Pressure", "voltage": "Signal", "length": "Elongation", "temperature": "Temperature"}


class UnitsPanel(QDialog):
    def __init__(self, parent: QWidget, choice: UnitChoice, services: Services, changed: Callable[[], None]) -> None:
        super().__init__(parent)
        self.choice, self.attempt, self.changed = choice, services.notices.attempt, changed
        self.setWindowTitle("Units of the values")
        self.setMinimumWidth(style.FORM_WIDTH)
        self.grid = controls.grid()
        self.grid.setColumnStretch(2, 1)  # the fields are beside their names
        self.units: dict[str, QComboBox] = {}
        for row, (quantity, name) in enumerate(_NAMES.items()):
            entries = [
                (as_text(unit) if unit != "%" else "% of the length at rest", unit) for unit in CHOICES[quantity]
            ]
            self.units[quantity] = controls.choice(f"Unit of {name.lower()}", entries, partial(self._choose, quantity))
            self.grid.addWidget(controls.label(name), row, 0)
            self.grid.addWidget(self.units[quantity], row, 1)
        self.length = controls.field("Length at rest, mm", on_enter=self._set_length)
        self.length.editingFinished.connect(self._set_length)
        self.grid.addWidget(controls.label("Length at rest, mm"), len(_NAMES), 0)
        self.grid.addWidget(self.length, len(_NAMES), 1)
        for control in (*self.units.values(), self.length):
            control.setFixedWidth(style.PANE_WIDTH_NARROW)
        usual = controls.button("Stored units", partial(self._use, STORED_UNITS))
        words = controls.label(_EXPLANATION, "muted", wrap=True)
        close = controls.button("Close", self.close)
        self.setLayout(controls.column(words, self.grid, controls.row(usual, None, close), spacing=style.CARD_PADDING))
        self.refresh()

    def refresh(self) -> None:
        units = self.choice.units
        for quantity, box in self.units.items():
            box.setCurrentIndex(box.findData(getattr(units, quantity)))
        self.length.setText(f"{units.rest_length_mm:g}")
        controls.allow(self.length, "" if units.length == "%" else "Only where the elongation is shown in %.")

    def _use(self, units: ShownUnits) -> None:
        self.choice.choose(units)
        self.changed()
        self.refresh()

    def _choose(self, quantity: str, unit: str) -> None:
        if unit != getattr(self.choice.units, quantity):
            chosen = {quantity: unit}
            self._use(replace(self.choice.units, **chosen))  # type: ignore[arg-type]

    def _set_length(self) -> None:
        text = self.length.text()
        if text != f"{self.choice.units.rest_length_mm:g}":
            self.attempt(lambda: self.choice.set_length(text))
            self._use(self.choice.units)
