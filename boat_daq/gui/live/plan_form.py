"""The plan in a form, checked as it is typed, and the manual pressure."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QCheckBox, QLineEdit, QScrollArea

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.sequence import ENTRIES, SequenceModel, limits_text

FIELD_WIDTH = 64


class PlanForm(QScrollArea):
    """The plan of a `SequenceModel`."""

    def __init__(self, sequence: SequenceModel, services: Services) -> None:
        super().__init__()
        self.sequence, self.services = sequence, services
        self._revision = -1
        self.setWidgetResizable(True)
        self.setAccessibleName("Plan, and manual pressure")
        self.choice = widgets.choice("Plan", [(name, name) for name in sequence.plans], sequence.choose)
        self.fields = {entry.key: self._field(entry.key, entry.label, entry.help) for entry in ENTRIES}
        self.refused = widgets.label("", wrap=True, name="Why the entry is invalid")
        self.estimate = widgets.label("", "muted", wrap=True)
        self.limits = widgets.label("", "muted", wrap=True)
        self.ask_readings = QCheckBox("Wait for each reading")
        self.ask_readings.setChecked(sequence.wait_for_reading)
        self.ask_readings.toggled.connect(sequence.require_readings)
        self.target = widgets.field("Target pressure in kPa", "0", self._set_pressure, width=FIELD_WIDTH)
        self.ramp = widgets.field("Ramp in kPa per second", "5", width=FIELD_WIDTH)
        self.set_button = widgets.button("Set pressure", self._set_pressure, tip="Within limits, without a run")
        plan, _ = widgets.card(
            widgets.row(widgets.label("Plan", "subtitle"), None, self.choice),
            widgets.form((entry.label, self.fields[entry.key], entry.unit) for entry in ENTRIES),
            self.refused,
            self.ask_readings,
            self.estimate,
            widgets.row(widgets.button("Open …", self.open), widgets.button("Save …", self.save), None),
        )
        manual, _ = widgets.card(
            widgets.label("Manual pressure", "subtitle"),
            widgets.form((("Target", self.target, "kPa"), ("Ramp", self.ramp, "kPa/s"))),
            self.limits,
            widgets.row(None, self.set_button),
        )
        layout = widgets.column(plan, manual, None, spacing=style.GAP)
        self.setWidget(widgets.holder(layout))
        layout.setContentsMargins(0, style.GAP, style.STEP, 0)

    def _field(self, key: str, name: str, tip: str) -> QLineEdit:
        field = widgets.field(name, self.sequence.value(key), width=FIELD_WIDTH, tip=tip)
        field.editingFinished.connect(lambda: self._edit(key, field))
        return field

    def _edit(self, key: str, field: QLineEdit) -> None:
        self.sequence.edit(key, field.text())
        self._show_refused()

    def _show_refused(self) -> None:
        """Mark the fields with invalid entries, and show why the last one is."""
        refused = self.sequence.refused
        for key, field in self.fields.items():
            widgets.set_state(field, "true" if key in refused else "", "wrong")
        widgets.set_text(self.refused, list(refused.values())[-1] if refused else "")
        widgets.set_state(self.refused, "fault" if refused else "")
        self.refused.setVisible(bool(refused))

    def open(self) -> None:
        """Open a plan from a file."""
        ask_open(self, self.services, "Open a plan", "toml", self._opened)

    def _opened(self, path: Path) -> None:
        self.sequence.open(path)
        name = self.sequence.plan.name
        if self.choice.findData(name) < 0:
            self.choice.addItem(name, name)

    def save(self) -> None:
        """Save the plan to a file."""
        ask_save(self, self.services, self.sequence.plan.name, "toml", self.sequence.save)

    def _set_pressure(self) -> None:
        self.services.notices.attempt(lambda: self.sequence.set_pressure(self.target.text(), self.ramp.text()))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the plan where it has changed; lock it during a run."""
        model = self.sequence
        idle = snapshot.progress is None or "arm" in model.allowed(snapshot) or not snapshot.can_command
        for field in (*self.fields.values(), self.choice, self.ask_readings):
            field.setEnabled(idle)
        self.set_button.setEnabled("arm" in model.allowed(snapshot))
        widgets.set_text(self.limits, limits_text(snapshot.limits) or "Connect to a board to set a pressure.")
        if model.revision == self._revision:
            return
        self._revision = model.revision
        self.ask_readings.setChecked(model.wait_for_reading)
        self.choice.setCurrentIndex(self.choice.findData(model.plan.name))
        for key, field in self.fields.items():
            if key not in model.refused:
                widgets.set_text(field, model.value(key))
        self.fields["step_kpa"].setEnabled(model.plan.kind == "staircase")
        widgets.set_text(self.estimate, model.estimate)
        self._show_refused()
