"""The menu of every table: copy and save."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QAction, QGuiApplication
from PySide6.QtWidgets import QApplication, QTableView, QWidget

from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.widgets.data_table import DataTable, save_table


@pytest.fixture
def owner(qtbot):
    """A window that saves tables."""
    made = QWidget()
    made.saved = []
    made.save_table = made.saved.append
    qtbot.addWidget(made)
    return made


def actions(table):
    """The actions of the only menu that a right click opens."""
    table.customContextMenuRequested.emit(QPoint(5, 5))
    menu = QApplication.activePopupWidget()
    menu.close()
    assert QApplication.activePopupWidget() is None
    return {action.text(): action for action in menu.actions()}


def test_right_click_copies_and_saves_a_table(owner, tmp_path):
    """Truth: the texts that were given; the chosen rows are copied, all rows are saved, formulas as text."""
    table = DataTable("Steps", ("Step", "Value"))
    table.setParent(owner)
    table.fill([("1", "+2.5"), ("2", "=cmd"), ("3", "")])
    table.addAction(QAction("Rename", table))  # what a table has besides is in the same menu
    found = actions(table)
    assert list(found) == ["Rename", "", "Copy table", "Save CSV \u2026"]
    found["Copy table"].trigger()
    assert QGuiApplication.clipboard().text() == "Step\tValue\n1\t+2.5\n2\t=cmd\n3\t"
    found["Save CSV \u2026"].trigger()
    assert owner.saved == [table]
    table.selectRow(1)
    actions(table)["Copy rows"].trigger()
    assert QGuiApplication.clipboard().text() == "Step\tValue\n2\t=cmd"
    save_table(table, tmp_path / "steps.csv")
    assert (tmp_path / "steps.csv").read_text().splitlines() == ["Step,Value", "1.0,2.5", "2.0,'=cmd", "3.0,"]


def test_every_table_of_the_window_has_the_menu(whole):
    """Two menus opened over each other on the recordings, and neither of its own copied or saved them."""
    tables = whole.findChildren(QTableView)
    assert len(tables) >= 6
    assert [table.accessibleName() for table in tables if "Save CSV \u2026" not in actions(table)] == []


def test_every_plot_is_copied_and_saved_by_the_window(whole):
    """The menu of the preview of a plan did nothing: it is made after its page."""
    whole.live.edit_segments()
    copied = []
    whole.copy_plot = copied.append
    cards = whole.findChildren(PlotCard)
    for card in cards:
        card.menu_button.menu().actions()[0].trigger()
    assert (copied, whole.live.plan_editor.card in cards) == (cards, True)
