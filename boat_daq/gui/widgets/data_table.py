"""A table that is read, not edited."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QPoint, Qt
from PySide6.QtGui import QGuiApplication, QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QMenu, QTableView, QTableWidget, QTableWidgetItem

from boat_daq.formatting import THIN
from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.controls import as_words
from boat_daq.viewmodels.common import tables
from protocol.base.units import MINUS

Cell = str | tuple[str, str]
"""A text, or a text with its tooltip."""
_LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
_RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


class DataTable(QTableWidget):
    """Rows of texts; each column is as wide as its texts, `stretched` takes the rest."""

    def __init__(
        self, name: str, headings: Sequence[str] = (), *, stretched: int = -1, right: Sequence[int] = ()
    ) -> None:
        super().__init__()
        dress(self, name)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setTabKeyNavigation(False)  # Tab goes to the next control, the arrows through the rows
        self.setWordWrap(False)
        self.horizontalHeader().setDefaultAlignment(_LEFT)
        self.set_headings(headings, stretched=stretched, right=right)

    def set_headings(self, headings: Sequence[str], *, stretched: int = -1, right: Sequence[int] = ()) -> None:
        self.setColumnCount(len(headings))
        self.setHorizontalHeaderLabels(list(headings))
        self._right = frozenset(right)
        for column in right:
            self._set_header(column, _RIGHT, Qt.ItemDataRole.TextAlignmentRole)
        header = self.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        if headings:
            header.setSectionResizeMode(stretched % len(headings), QHeaderView.ResizeMode.Stretch)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Keep the chosen row in sight."""
        super().resizeEvent(event)
        for index in self.selectedIndexes()[:1]:
            self.scrollTo(index)

    def explain(self, tips: dict[int, str]) -> None:
        for column, tip in tips.items():
            self._set_header(column, tip, Qt.ItemDataRole.ToolTipRole)

    def _set_header(self, column: int, value: object, role: Qt.ItemDataRole) -> None:
        self.model().setHeaderData(column, Qt.Orientation.Horizontal, value, role)

    def fill(self, rows: Sequence[Sequence[Cell]], tips: Sequence[str] = ()) -> None:
        self.setRowCount(len(rows))
        for i, cells in enumerate(rows):
            for k, cell in enumerate(cells):
                text, tip = (cell, tips[i] if tips else "") if isinstance(cell, str) else cell
                item = QTableWidgetItem(text)
                item.setToolTip(as_words(tip))
                item.setTextAlignment(_RIGHT if k in self._right else _LEFT)
                self.setItem(i, k, item)


def dress(table: QTableView, name: str) -> None:
    """Give `table` its name, the look of every table, and its menu: the table's own actions, copy and save."""
    table.setAccessibleName(name)
    table.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
    table.customContextMenuRequested.connect(partial(_open_menu, table))
    table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    table.setShowGrid(False)
    table.verticalHeader().hide()
    table.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - style.STEP)
    table.horizontalHeader().setHighlightSections(False)
    table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)


def _open_menu(table: QTableView, at: QPoint) -> None:
    menu = QMenu(table)
    menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
    menu.setToolTipsVisible(True)
    if table.indexAt(at).isValid():
        menu.addActions(table.actions())
        menu.addSeparator()
    add_exports(menu, table)
    menu.popup(table.viewport().mapToGlobal(at))


def add_exports(menu: QMenu, table: QTableView) -> None:
    """Add the actions that copy the chosen rows or the whole table, and save it."""
    chosen = sorted({index.row() for index in table.selectionModel().selectedRows()})
    rows = list(range(table.model().rowCount()))
    copy = menu.addAction("Copy rows" if chosen else "Copy table", partial(_copy, table, chosen or rows))
    copy.setEnabled(bool(rows))
    owner = controls.owner(table, "save_table")
    if owner is not None:
        menu.addAction("Save CSV \u2026", partial(owner.save_table, table)).setEnabled(bool(rows))


def _cells(table: QTableView, rows: Sequence[int]) -> tuple[list[str], list[list[str]]]:
    """Return the headings and the texts of some rows, hidden columns left out."""
    model, shown = table.model(), [k for k in range(table.model().columnCount()) if not table.isColumnHidden(k)]
    names = [str(model.headerData(k, Qt.Orientation.Horizontal) or f"column {k + 1}") for k in shown]
    return names, [[str(model.index(i, k).data() or "") for k in shown] for i in rows]


def _copy(table: QTableView, rows: Sequence[int]) -> None:
    names, cells = _cells(table, rows)
    QGuiApplication.clipboard().setText("\n".join("\t".join(row) for row in [names, *cells]))


def save_table(table: QTableView, path: Path) -> None:
    """Save all rows of a table as CSV; what is a number as one."""
    names, cells = _cells(table, range(table.model().rowCount()))
    tables.save_csv(path, tables.by_column(names, [[_number_or_text(text) for text in row] for row in cells]))


def _number_or_text(text: str) -> float | str:
    """Return the number that a text shows, with a typographic minus and thin spaces; else the text."""
    try:
        return float(text.replace(MINUS, "-").replace(THIN, "").replace("\u00a0", ""))
    except ValueError:
        return text
