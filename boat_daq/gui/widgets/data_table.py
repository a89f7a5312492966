"""A table that is read, not edited."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableView, QTableWidget, QTableWidgetItem

from boat_daq.gui import style
from boat_daq.gui.widgets.controls import as_words

Cell = str | tuple[str, str]
"""A text, or a text with its tooltip."""
_LEFT = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter
_RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


class DataTable(QTableWidget):
    """Rows of texts; each column is as wide as its texts, one takes the rest.

    Parameters
    ----------
    name : accessible name.
    stretched : the column that takes the remaining width.
    """

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
        """Replace the columns; parameters as of the class."""
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
        """Set the tooltips of headings, by column."""
        for column, tip in tips.items():
            self._set_header(column, tip, Qt.ItemDataRole.ToolTipRole)

    def _set_header(self, column: int, value: object, role: Qt.ItemDataRole) -> None:
        self.model().setHeaderData(column, Qt.Orientation.Horizontal, value, role)

    def fill(self, rows: Sequence[Sequence[Cell]], tips: Sequence[str] = ()) -> None:
        """Show other rows."""
        self.setRowCount(len(rows))
        for i, cells in enumerate(rows):
            for k, cell in enumerate(cells):
                text, tip = (cell, tips[i] if tips else "") if isinstance(cell, str) else cell
                item = QTableWidgetItem(text)
                item.setToolTip(as_words(tip))
                item.setTextAlignment(_RIGHT if k in self._right else _LEFT)
                self.setItem(i, k, item)


def dress(table: QTableView, name: str) -> None:
    """Give `table` its name for a screen reader and the look of every table: rows without grid and numbers."""
    table.setAccessibleName(name)
    table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    table.setShowGrid(False)
    table.verticalHeader().hide()
    table.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - style.STEP)
    table.horizontalHeader().setHighlightSections(False)
    table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
