"""A table whose texts are wrapped where a column is narrower than they: nothing is cut."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QRect, Qt
from PySide6.QtWidgets import QHeaderView

from boat_daq.gui import style
from boat_daq.gui.widgets.data_table import Cell, DataTable

CELL_MARGIN = 2 * style.GAP  # of both sides
_HIGHEST = 1000


class WrappedTable(DataTable):
    """Rows as high as the texts of their wrapped columns.

    Parameters
    ----------
    stretched : the columns that share the remaining width, and are wrapped.
    """

    def __init__(self, name: str, headings: Sequence[str], *, stretched: Sequence[int], right: Sequence[int]) -> None:
        super().__init__(name, headings, stretched=stretched[0], right=right)
        self._stretched = stretched
        for column in stretched:
            self.horizontalHeader().setSectionResizeMode(column, QHeaderView.ResizeMode.Stretch)
        self.setWordWrap(True)
        self.horizontalHeader().sectionResized.connect(
            self._fit, Qt.ConnectionType.QueuedConnection
        )  # to the last widths

    def fill(self, rows: Sequence[Sequence[Cell]], tips: Sequence[str] = ()) -> None:
        """Show other rows; parameters as of `DataTable`."""
        super().fill(rows, tips)
        self._fit()

    def _fit(self, *_: int) -> None:
        """Set the heights; Qt's own would wrap the other columns too, which are as wide as their texts."""
        for row in range(self.rowCount()):
            self.setRowHeight(row, max(self._height(row, column) for column in self._stretched) + style.GAP)

    def _height(self, row: int, column: int) -> int:
        item, around = self.item(row, column), QRect(0, 0, self.columnWidth(column) - CELL_MARGIN, _HIGHEST)
        text = item.text() if item is not None else ""
        return self.fontMetrics().boundingRect(around, Qt.TextFlag.TextWordWrap, text or " ").height()
