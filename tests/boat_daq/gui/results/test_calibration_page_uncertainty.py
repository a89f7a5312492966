"""The Uncertainty tab of the calibration page: U, traceability, limits and components of both sensors."""

from __future__ import annotations

import dataclasses

from PySide6.QtWidgets import QApplication

from tests.boat_daq.gui.results.run_results import run_result

ROWS = (
    (("Expanded uncertainty", "of one reading"), ("\u00b181 \u00b5m", "k = 2"), ("\u00b173 \u00b5m", "k = 2")),
    (("Traceable", "not traceable: not assessed: parallax"), ("no", "not assessed: parallax"), ("no", "")),
    (("Parallax", "not in the file"), ("not assessed", "not in the file"), ("not assessed", "")),
)


def test_tab_shows_what_was_not_assessed_with_its_reason(live):
    """A row a component, a column a sensor; the reason is the tooltip; a run without a result clears it."""
    model = live.model
    model.unit.preparation.call = lambda *_: None  # the live conversion is not looked at here
    live.go("Calibrate")
    page = live.pages["Calibrate"]
    model.calibration.show(dataclasses.replace(run_result(), uncertainty=ROWS))
    live.refresh()
    QApplication.processEvents()
    table = page.budget
    assert [page.tabs.tabText(i) for i in range(page.tabs.count())][1] == "Uncertainty"
    assert table.rowCount() == 3
    assert table.item(2, 1).text() == "not assessed"
    assert "not in the file" in table.item(2, 1).toolTip()
    assert table.item(1, 0).toolTip().startswith("not traceable")
