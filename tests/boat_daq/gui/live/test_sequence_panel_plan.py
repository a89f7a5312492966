"""The plan in its form."""

from __future__ import annotations

from itertools import product

from PySide6.QtTest import QTest

from boat_daq.workflows.unit_control import NotIdentified
from protocol.base.units import ShownUnits
from tests.boat_daq.gui.windows import NARROW


def test_invalid_plan_is_marked_and_not_armed(live):
    """A step of 20 kPa was refused in red, and Arm ran the old step of 10 kPa."""
    plan, model = live.live.plan, live.model.sequence
    plan.fields["step_kpa"].setText("20")
    plan.fields["step_kpa"].editingFinished.emit()
    assert plan.refused.text() == "Step must divide the span of 90 kPa evenly."
    run_line, arm = live.live.sequence.progress, live.live.sequence.buttons["arm"]
    assert (run_line.text(), arm.isEnabled()) == ("the plan has an invalid entry", False)
    assert "marked" in arm.toolTip()
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


def test_what_is_entered_is_shown_at_once(live):
    """Truth: 91 plateaus in 5 cycles are 18 a cycle and the first. They stood beside "Cycles 1" until the next look."""
    page, plan = live.live, live.live.plan
    live.calm_timer.stop()
    page.pane.setCurrentWidget(plan)
    live.refresh()
    assert plan.estimate.text().startswith("91 plateaus")
    plan.fields["cycles"].setText("1")
    plan.fields["cycles"].editingFinished.emit()
    assert plan.estimate.text().startswith("19 plateaus")
    assert "19 plateaus" in page.sequence.progress.text()
    plan.choice.activated.emit(plan.choice.findData("step-test"))
    assert page.sequence.progress.text().startswith("step-test")


def test_cycles_and_readings_are_in_sight_and_the_rest_behind_edit(live):
    """Ten fields hid the two that are set; a plan of segments has no highest, lowest and step."""
    live.live.pane.setCurrentWidget(live.live.plan)
    plan = live.live.plan
    live.refresh()
    assert plan.fields["cycles"].isVisible()
    assert plan.ask_readings.isVisible()
    assert not plan.fields["step_kpa"].isVisible()
    plan.edit.click()
    assert plan.fields["step_kpa"].isVisible()
    live.model.sequence.choose("step-test")
    live.refresh()
    assert not any(plan.fields[key].isVisible() for key in ("high_kpa", "low_kpa", "step_kpa"))


def test_plan_target_and_limits_are_in_the_chosen_units(live):
    """Truth: 1 kPa = 10 mbar. What is shown is what was typed; leaving a field changes nothing."""
    live.live.pane.setCurrentWidget(live.live.plan)
    plan, model = live.live.plan, live.model
    plan.target.setText("20")
    plan.ramp.setText("5,5")
    model.unit_choice.choose(ShownUnits.of("mbar"))
    live.refresh()
    assert (plan.target.text(), plan.ramp.text()) == ("200", "55")  # 5 kPa/s became 5 mbar/s, or 5 bar/s
    assert (plan.fields["high_kpa"].text(), plan.rows["high_kpa"][2].text()) == ("500", "mbar")
    assert plan.limits.text() == "Limits \u2212400 to +500 mbar"
    assert plan.limits.toolTip() == "Limits of the plan"
    plan.fields["high_kpa"].editingFinished.emit()
    assert model.undo.done == []
    plan.fields["high_kpa"].setText("400")
    plan.fields["high_kpa"].editingFinished.emit()
    assert model.sequence.plan.high_kpa == 40.0
    commanded = []
    model.session.set_pressure = lambda *values: commanded.append(values)
    plan.target.setText("200")
    plan.ramp.setText("50 mbar/s")
    plan._set_pressure()
    assert commanded == [(20.0, 5.0)]
    plan.fields["high_kpa"].setText("600")
    plan.fields["high_kpa"].editingFinished.emit()
    assert plan.refused.text() == "Highest is above the plan's own limit of 500 mbar."


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
    """With its vertical scroll bar nothing is cut at the right; at 853 pixels the units were."""
    live.live.pane.setCurrentWidget(live.live.plan)
    live.live.plan.edit.click()
    for plan, size in product(("calibration", "repeatability"), ((1280, 720), (NARROW, 600))):
        live.resize(*size)
        live.model.sequence.choose(plan)
        live.refresh()
        QTest.qWait(50)
        assert live.live.plan.verticalScrollBar().maximum() > 0
        assert live.live.plan.horizontalScrollBar().maximum() == 0


def test_both_manual_fields_are_in_sight(live):
    """The command shows the pressure, with the focus, and the elongation below it."""
    live.resize(1280, 800)
    live.live.show_manual()
    QTest.qWait(50)
    plan = live.live.plan
    for widget in (plan.target, plan.elongation_button):
        assert widget.visibleRegion().boundingRect().height() >= widget.height() - 1


def test_refusal_to_control_the_elongation_offers_what_is_missing(live, monkeypatch):
    """The message named what to prepare, and nothing in the window did it."""
    form, notices = live.live.plan, live.model.notices
    form.elongation_button.click()
    assert notices.current().action_text == "Go to Results"

    def regulator():
        raise NotIdentified("the hysteresis of unit SA1 is not identified")

    monkeypatch.setattr(live.model.sequence, "_regulator", regulator)
    form.elongation_button.click()
    assert notices.current().action_text == "Prepare it"
    notices.current().action()
    assert "is gone" in notices.current().cause


def test_the_uncertainty_has_the_unit_of_its_plan(live):
    """0.08 mm became 0.08 % FSO with the plan; each unit keeps its own, off until it is entered."""
    live.live.pane.setCurrentWidget(live.live.plan)
    form, model = live.live.plan, live.model

    def shown(plan):
        model.sequence.choose(plan)
        live.refresh()
        named = form.asked.accessibleName().rpartition(", ")[2]
        return form.asked_label.text(), form.asked.text(), form.asked_unit.text(), named, form.asked.isEnabled()

    def enter(text):
        form.asked.setText(text)
        form.asked.editingFinished.emit()
        live.refresh()

    assert shown("calibration") == ("Stop at U \u2264", "", "mm", "mm", True)
    enter("0.08")
    assert shown("repeatability") == ("Stop at \u00b1 \u2264", "", "% FSO", "% FSO", True)
    enter("0.5")
    assert shown("calibration") == ("Stop at U \u2264", "0.08", "mm", "mm", True)
    assert shown("step-test")[1:3] == ("", "")
    assert not form.asked.isEnabled()
    assert shown("repeatability")[1] == "0.5"
    enter("wide")
    model.sequence.edit("cycles", "50")
    live.refresh()
    assert (form.asked.text(), form.asked.property("wrong")) == ("wide", "true")
    assert "% FSO" in model.notices.current().remedy
    assert shown("calibration")[1] == "0.08"
    assert form.asked.property("wrong") == ""
