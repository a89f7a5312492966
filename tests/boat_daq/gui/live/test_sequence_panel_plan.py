"""The plan in its form."""

from __future__ import annotations

from PySide6.QtTest import QTest


def test_invalid_plan_is_marked_and_not_armed(live):
    """A step of 20 kPa was refused in red, and Arm ran the old step of 10 kPa."""
    plan, model = live.live.plan, live.model.sequence
    plan.fields["step_kpa"].setText("20")
    plan.fields["step_kpa"].editingFinished.emit()
    assert plan.refused.text() == "Step must divide the span of 90 kPa evenly."
    live.model.run.press("arm")
    assert live.model.session.calls == []
    assert "Step must divide" in live.model.notices.current().cause
    plan.fields["cycles"].setText("2")
    plan.fields["cycles"].editingFinished.emit()
    plan.refresh(live.model.snapshot)
    assert (model.plan.cycles, plan.fields["step_kpa"].text(), plan.fields["step_kpa"].property("wrong")) == (
        2, "20", "true",
    )  # fmt: skip
    plan.fields["high_kpa"].setText("40")
    plan.fields["high_kpa"].editingFinished.emit()
    assert (model.plan.high_kpa, model.plan.step_kpa, model.refused) == (40.0, 20.0, {})
    live.model.run.press("arm")
    assert "arm" in live.model.session.calls


def test_invalid_plan_names_its_field(live):
    """A step that does not divide the span is refused in the form, and the plan stays."""
    live.live.pane.setCurrentWidget(live.live.plan)
    field = live.live.plan.fields["step_kpa"]
    field.setText("7")
    field.editingFinished.emit()
    assert "divide the span" in live.live.plan.refused.text()
    assert live.model.sequence.plan.step_kpa == 10.0


def test_edit_of_the_plan_is_undone(live):
    """The number of cycles goes back with undo, in the model and in the form."""
    live.live.pane.setCurrentWidget(live.live.plan)
    field = live.live.plan.fields["cycles"]
    field.setText("2")
    field.editingFinished.emit()
    assert live.model.sequence.plan.cycles == 2
    live.model.undo.undo()
    live.refresh()
    assert live.model.sequence.plan.cycles == 5
    assert field.text() == "5"


def test_the_form_is_not_wider_than_its_tab(live):
    """With its vertical scroll bar at 1280 x 720 nothing is cut at the right."""
    live.resize(1280, 720)
    live.live.pane.setCurrentWidget(live.live.plan)
    QTest.qWait(50)
    assert live.live.plan.verticalScrollBar().maximum() > 0
    assert live.live.plan.horizontalScrollBar().maximum() == 0


def test_both_manual_fields_are_in_sight(live):
    """Ctrl+G shows the pressure, with the focus, and the elongation below it."""
    live.resize(1280, 800)
    live.live.show_manual()
    plan = live.live.plan
    for widget in (plan.target, plan.elongation_button):
        assert widget.visibleRegion().boundingRect().height() >= widget.height() - 1
