"""The form of type B contributions, from the Calibrate page."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from analysis.calibration.type_b import traceability
from boat_daq.gui.results.contributions_form import ContributionsForm
from boat_daq.viewmodels.results import calibration
from tests.boat_daq.gui.results.run_results import run_result
from tests.boat_daq.gui.windows import run_shortcut


def test_contribution_is_stated_refused_at_its_field_and_undone(live, monkeypatch):
    """From the page's button: a wrong k is refused beside it, a right one stored, the run analysed again; Ctrl+Z."""
    model, again = live.model.calibration, []
    live.go("Calibration")
    page = live.pages["Calibration"]
    page.tabs.setCurrentIndex(1)
    assert not page.contributions.isEnabled()
    model.show(dataclasses.replace(run_result(), traceability=traceability(())))
    live.refresh()
    assert page.traced.text().startswith("\u25b2 An elongation is not traceable: not assessed: scale")
    model.last_path = Path("run.boat")
    monkeypatch.setattr(calibration, "Job", lambda *args, **options: None)
    monkeypatch.setattr(model.jobs, "start", lambda *args: again.append(1))
    page.contributions.click()
    form = next(panel for panel in live.findChildren(ContributionsForm) if panel.isVisible())
    assert [form.list.item(i, 1).text() for i in range(5)] == ["not assessed"] * 5
    assert not form.refusals["value"].isVisible()  # nothing was entered yet
    form.list.setFocus()
    QTest.keyClick(form.list, Qt.Key.Key_Tab)  # it used to go from cell to cell, without an end
    assert form.focusWidget() is form.stated
    form.store.click()
    assert form.refusals["value"].text() == "Give a number of at least 0."
    QTest.keyClicks(form.texts["value"], "0.2")
    form.texts["k"].setText("0")
    assert form.refusals["k"].isVisible()
    assert not form.refusals["value"].isVisible()
    form.texts["k"].setText("2")
    assert form.outcome.text() == "u = 0.1 % of x, normal"
    QTest.keyClick(form.texts["value"], Qt.Key.Key_Return)
    assert (form.list.item(0, 1).text(), again) == ("u = 0.1 % of x, normal", [1])
    assert "the scale of grid or photograph has no certificate" in form.traced.text()
    live.refresh()
    assert page.traced.text().endswith("pressure gauge, temperature.")  # the budget beside it is still the one before
    assert "no certificate" not in page.traced.text()
    run_shortcut(live, "Ctrl+Z")
    form.show_stated()
    assert (form.list.item(0, 1).text(), again) == ("not assessed", [1, 1])
    form.list.selectRow(5)
    assert form.texts["name"].isVisible()
    form.choices["unit"].setCurrentIndex(form.choices["unit"].findData("kpa"))
    form.choices["unit"].activated.emit(form.choices["unit"].currentIndex())
    assert form.texts["sensitivity"].isVisible()
    form.resize(form.width(), 533)  # a small screen at 150 %: the chosen row stays in sight
    QApplication.processEvents()
    assert form.list.viewport().rect().contains(form.list.visualItemRect(form.list.item(5, 0)))
    form.close()
