"""The menu of every table: copy and save."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QTableView, QWidget

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
    """The actions of the menu that a right click opens."""
    table.customContextMenuRequested.emit(QPoint(5, 5))
    menu = QApplication.activePopupWidget()
    menu.close()
    return {action.text(): action for action in menu.actions()}


def test_right_click_copies_and_saves_a_table(owner, tmp_path):
    """Truth: the texts that were given; the chosen rows are copied, all rows are saved, formulas as text."""
    table = DataTable("Steps", ("Step", "Value"))
    table.setParent(owner)
    table.fill([("1", "+2.5"), ("2", "=cmd"), ("3", "")])
    found = actions(table)
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
    """Each page's tables open a menu of their own or this one."""
    tables = whole.findChildren(QTableView)
    assert len(tables) >= 6
    assert {table.contextMenuPolicy() for table in tables} == {Qt.ContextMenuPolicy.CustomContextMenu}
