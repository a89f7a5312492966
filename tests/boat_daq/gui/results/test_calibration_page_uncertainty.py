"""The Uncertainty tab of the calibration page: U, traceability, limits and components of both sensors."""

from __future__ import annotations

import dataclasses

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QStyleOptionViewItem

from tests.boat_daq.gui.results.run_results import run_result

ROWS = (
    (("Expanded uncertainty", "of one reading"), ("\u00b181 \u00b5m", "k = 2"), ("\u00b173 \u00b5m", "k = 2")),
    (("Traceable", "not traceable: no uncertainty is given for parallax"), ("no", "for parallax"), ("no", "")),
    (("Parallax", "not in the file"), ("not assessed", "not in the file"), ("not assessed", "")),
    (
        ("Combined error\n\u2264 24.2 % FSO", "published"),
        ("\u25d0 pass\nconditional", ""),
        ("\u25d0 pass\nconditional", ""),
    ),
    (("Scale of grid or photograph", "not in the file"), ("not assessed", ""), ("not assessed", "")),
)


def test_tab_shows_what_was_not_assessed_with_its_reason(live):
    """A row a component, a column a sensor; the reason is the tooltip; a run without a result clears it."""
    model = live.model
    model.unit.preparation.call = lambda *_: None  # the live conversion is not looked at here
    live.go("Calibration")
    page = live.pages["Calibration"]
    voids = "the curve turns at 2.5 mm", ""
    model.calibration.show(dataclasses.replace(run_result(), uncertainty=ROWS, u_reason=voids))
    live.refresh()
    QApplication.processEvents()
    table = page.budget
    assert page.traced.text() == f"Sensor 1: {voids[0]}."
    assert [page.tabs.tabText(i) for i in range(page.tabs.count())][1] == "Uncertainty"
    assert table.rowCount() == len(ROWS)
    assert table.item(2, 1).text() == "not assessed"
    assert "not in the file" in table.item(2, 1).toolTip()
    assert table.item(1, 0).toolTip().startswith("not traceable")


def test_no_name_is_cut_beside_two_conditional_statements(live):
    """At 1280 x 800, with a scroll bar; a name alone in its row is in the middle of it, not at the header."""
    live.resize(1280, 800)
    live.go("Calibration")
    page = live.pages["Calibration"]
    page.tabs.setCurrentIndex(1)
    live.model.calibration.show(dataclasses.replace(run_result(), uncertainty=6 * ROWS))
    live.refresh()
    QApplication.processEvents()
    table = page.budget
    assert table.verticalScrollBar().isVisible()
    assert table.sizeHintForColumn(0) <= table.columnWidth(0)
    aligned = []
    for row in (0, 3):
        option = QStyleOptionViewItem()
        table.lines.initStyleOption(option, table.model().index(row, 1))
        aligned.append(option.displayAlignment & Qt.AlignmentFlag.AlignVertical_Mask)
    assert aligned == [Qt.AlignmentFlag.AlignVCenter, Qt.AlignmentFlag.AlignTop]
