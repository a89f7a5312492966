"""The table of figures: name with unit, a value for each sensor; definition and interval as tooltip."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QHeaderView

from boat_daq.gui import style
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.viewmodels.results.analysis_jobs import Cell

SIDE = style.PANE_WIDTH_WIDE - 4 * style.STEP
"""Width of the table beside the plots of a page."""


class FigureTable(DataTable):
    """Figures of all sensors."""

    def __init__(self, name: str = "Figures with their units; definitions and intervals as tooltips") -> None:
        super().__init__(name)

    def show_rows(self, rows: Sequence[Sequence[Cell]], sensors: Sequence[str]) -> None:
        """Show other figures, with a column for each sensor."""
        self.set_headings(["Figure", *sensors], stretched=0, right=range(1, 1 + len(sensors)))
        self.fill(rows)
        self._share()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give the names the remaining width."""
        super().resizeEvent(event)
        self._share()

    def _share(self) -> None:
        """Cut names in a table that is a little too narrow; let a narrower one scroll."""
        wide = self.viewport().width() >= style.FIGURES_LEAST
        mode = QHeaderView.ResizeMode.Stretch if wide else QHeaderView.ResizeMode.ResizeToContents
        if self.columnCount():
            self.horizontalHeader().setSectionResizeMode(0, mode)
