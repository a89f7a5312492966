"""The editor of a plan of segments in the window: rows, preview, undo, what is refused, the lock of a run."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton

from boat_daq.engine.snapshot import SessionState
from tests.boat_daq.gui.windows import RAMPING, run_command


@pytest.fixture
def panel(live):
    run_command(live, "Edit a plan of segments …")
    panel = live.live.plan_editor
    assert "Convert to segments" in panel.summary.text()
    panel.new.click()
    return panel


def press(panel, name: str) -> None:
    """Press a button of the panel by its name."""
    button = next(b for b in panel.findChildren(QPushButton) if b.accessibleName() == name and b.isVisible())
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def enter(field, text: str) -> None:
    """Type a value and leave the field."""
    field.setText(text)
    field.editingFinished.emit()


def test_plan_is_edited_over_its_preview(live, panel):
    """A ramp and a sine in a loop, with readings: what the form shows is the plan of the run, and the preview is it."""
    press(panel, "Add ramp")
    enter(panel.cells[1]["target"], "30")
    panel.cells[1]["reading"].click()
    press(panel, "Add sine")
    assert not panel.cells[2]["rate_per_s"].isEnabled()
    for entry, text in zip(panel.loop_entries, ("2", "3", "2"), strict=True):
        entry.setText(text)
    press(panel, "Add loop")
    plan = live.model.sequence.plan
    assert [segment.kind for segment in plan.unrolled] == ["step", "ramp", "sine", "ramp", "sine"]
    assert panel.curve.x[-1] == pytest.approx(plan.duration_s)
    assert panel.curve.y.max() == pytest.approx(40.0, abs=0.2)
    assert panel.readings.x.size == 2
    assert {-40.0, 50.0} <= set(panel.limits.y[~(panel.limits.y != panel.limits.y)])
    live.live.show_plan()
    live.refresh()
    assert live.live.plan.choice.currentText() == "own plan"
    assert not live.live.plan.fields["step_kpa"].isVisible()


def test_edit_is_undone_in_the_panel(panel):
    """Ctrl+Z in the panel reverses the last edit; the button does the same."""
    press(panel, "Add ramp")
    enter(panel.cells[1]["target"], "30")
    panel._undo()
    assert panel.cells[1]["target"].text() == "0"
    press(panel, "Undo")
    assert len(panel.cells) == 1
    press(panel, "Redo")
    assert len(panel.cells) == 2


def test_refused_entry_is_taken_back_with_the_reason(panel):
    """Beyond the plan's limits: the reason is shown, the field has the old value again."""
    enter(panel.cells[0]["target"], "99")
    assert "beyond the plan's own limits" in panel.refused.text()
    assert panel.refused.isVisible()
    assert panel.cells[0]["target"].text() == "0"
    enter(panel.cells[0]["target"], "9")
    assert not panel.refused.isVisible()


def test_plan_is_locked_during_a_run(live, panel):
    """Its rows cannot be changed while a run has it."""
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    assert not panel.segments.isEnabled()
    assert panel.summary.text() == "A run uses this plan."
