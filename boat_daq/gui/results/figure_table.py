"""The table of figures: name, unit, a value for each sensor; definition and interval on hover."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem

from boat_daq.gui import style
from boat_daq.viewmodels.results.analysis_view import FigureRow, FigureText


class FigureTable(QTableWidget):
    """Figures of all sensors."""

    def __init__(self) -> None:
        super().__init__(0, 0)
        self.setAccessibleName("Figures with their units; definitions and intervals on hover")
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setShowGrid(False)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.horizontalHeader().setHighlightSections(False)
        self.horizontalHeader().setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        self.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - style.STEP)

    def show_rows(self, rows: Sequence[FigureRow], sensors: Sequence[str]) -> None:
        """Show other figures."""
        self.setColumnCount(2 + len(sensors))
        self.setHorizontalHeaderLabels(["Figure", *sensors, ""])
        self.setRowCount(len(rows))
        for i, row in enumerate(rows):
            self.setItem(i, 0, self._item(FigureText(row.name, row.cells[0].hover), Qt.AlignmentFlag.AlignLeft))
            for k, cell in enumerate(row.cells, 1):
                self.setItem(i, k, self._item(cell, Qt.AlignmentFlag.AlignRight))
            self.setItem(
                i, 1 + len(row.cells), self._item(FigureText(row.unit, row.cells[0].hover), Qt.AlignmentFlag.AlignLeft)
            )
        for k in range(1, 1 + len(sensors)):
            heading = self.horizontalHeaderItem(k)
            if heading is not None:
                heading.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self._share()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give the names what room there is."""
        super().resizeEvent(event)
        self._share()

    def _share(self) -> None:
        """Cut names where a little is missing; where much is, the table scrolls."""
        roomy = self.viewport().width() >= style.FIGURES_LEAST
        mode = QHeaderView.ResizeMode.Stretch if roomy else QHeaderView.ResizeMode.ResizeToContents
        if self.columnCount():
            self.horizontalHeader().setSectionResizeMode(0, mode)

    @staticmethod
    def _item(cell: FigureText, side: Qt.AlignmentFlag) -> QTableWidgetItem:
        item = QTableWidgetItem(cell.text)
        item.setToolTip(cell.hover)
        item.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
        return item
