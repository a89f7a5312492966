"""The table of figures: name over unit and limit, for each sensor the value over its interval; more as tooltip."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QModelIndex, QPersistentModelIndex, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QResizeEvent
from PySide6.QtWidgets import QHeaderView, QStyledItemDelegate, QStyleOptionViewItem, QWidget

from analysis.numbers import in_unit
from boat_daq.gui import style
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.results.figure_tables import Cell
from protocol.base.units import STORED_UNITS, ShownUnits, as_text, in_shown_units

SIDE = style.PANE_WIDTH_WIDE + 10 * style.STEP
"""Width of the table beside the plots of a page."""
FEW_COLUMNS = 3  # names and two sensors
STACKED = 3 * style.STACKED_HEIGHT // 2  # height of the table on a page that stacks its parts, at most
Index = QModelIndex | QPersistentModelIndex


class TwoLines(QStyledItemDelegate):
    """Paints the second line of a text small and muted below the first."""

    colour = QColor(style.LIGHT.muted)

    def initStyleOption(self, option: QStyleOptionViewItem, index: Index) -> None:
        """Leave the first line to Qt, in the upper part of the cells of a row that has two."""
        super().initStyleOption(option, index)
        option.text = str(index.data() or "").partition("\n")[0]
        if "\n" in str(index.sibling(index.row(), 0).data()):
            side = option.displayAlignment & Qt.AlignmentFlag.AlignHorizontal_Mask
            option.displayAlignment = side | Qt.AlignmentFlag.AlignTop

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        super().paint(painter, option, index)
        _, _, below = str(index.data() or "").partition("\n")
        if below:
            painter.save()
            painter.setFont(style.small_font())
            painter.setPen(self.colour)
            side = Qt.AlignmentFlag(index.data(Qt.ItemDataRole.TextAlignmentRole)) & Qt.AlignmentFlag.AlignRight
            inside = option.rect.adjusted(2 * style.STEP, 0, -2 * style.STEP, -style.STEP // 2)
            text = painter.fontMetrics().elidedText(below, Qt.TextElideMode.ElideRight, inside.width())
            painter.drawText(inside, side | Qt.AlignmentFlag.AlignBottom, text)
            painter.restore()

    def sizeHint(self, option: QStyleOptionViewItem, index: Index) -> QSize:
        hint = super().sizeHint(option, index)
        _, _, below = str(index.data() or "").partition("\n")
        if not below:
            return hint
        width = style.text_width(style.small_font(), below) + 5 * style.STEP
        return QSize(max(hint.width(), width), hint.height() + style.small_font().pixelSize() + style.STEP)


def shown_row(row: Sequence[Cell], units: ShownUnits) -> Sequence[Cell]:
    """Return a row of figures in the chosen units: the unit begins the second line of its name, or is in the cells."""
    row = tuple((in_shown_units(text, units), in_shown_units(tip, units)) for text, tip in row)
    label, _, below = row[0][0].partition("\n")
    unit, comma, limit = below.partition(", ")
    shown = units.shown(unit)
    if shown.symbol == unit:
        return row
    name = f"{label}\n{as_text(shown.symbol)}{comma}{in_unit(limit, shown)}"
    return ((name, row[0][1]), *((in_unit(text, shown), tip) for text, tip in row[1:]))


class FigureTable(DataTable):
    def __init__(self, name: str = "Figures with units, intervals and limits; definitions as tooltips") -> None:
        super().__init__(name)
        self.units = STORED_UNITS
        self._rows: tuple[Sequence[Sequence[Cell]], Sequence[str]] = ((), ())
        self._stacked = False
        self.lines = TwoLines(self)
        self.setItemDelegate(self.lines)

    def paint_theme(self, theme: Theme) -> None:
        self.lines.colour = QColor(theme.muted)
        if theme.units != self.units:
            self.units = theme.units
            if self._rows[0]:
                self.show_rows(*self._rows)

    def show_rows(self, rows: Sequence[Sequence[Cell]], sensors: Sequence[str]) -> None:
        self._rows = rows, sensors
        self.set_headings(["Figure", *sensors], stretched=0, right=range(1, 1 + len(sensors)))
        self.fill([shown_row(row, self.units) for row in rows])
        self.setVisible(bool(rows))  # no heading over nothing
        self.resizeRowsToContents()
        self.stack(self._stacked)
        self._share()

    def whole_height(self) -> int:
        rows = self.horizontalHeader().height() + self.verticalHeader().length()
        return rows + 2 * self.frameWidth() + 2 * style.STEP

    def stack(self, stacked: bool) -> None:
        """Show the key figures whole on a page that scrolls; a longer table scrolls itself, so that its head stays."""
        self._stacked = stacked
        self.setAlternatingRowColors(stacked)  # its values are far from their names
        self.setMinimumHeight(min(self.whole_height(), STACKED) if stacked and self.rowCount() else 0)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give the names the remaining width."""
        super().resizeEvent(event)
        self._share()

    def _share(self) -> None:
        """Cut names in a table that is a little too narrow; let a narrower one, or one of many sensors, scroll."""
        wide = self.viewport().width() >= style.FIGURES_LEAST and self.columnCount() <= FEW_COLUMNS
        mode = QHeaderView.ResizeMode.Stretch if wide else QHeaderView.ResizeMode.ResizeToContents
        if self.columnCount():
            self.horizontalHeader().setSectionResizeMode(0, mode)


class KeyFigures(QWidget):
    """The six figures that are read first, and all of them on request; the choice is kept by `name`."""

    def __init__(self, name: str, preferences: Preferences) -> None:
        super().__init__()
        self.table = FigureTable()
        self._key, self._preferences = f"all figures {name}", preferences
        self._rows: tuple[Sequence[Sequence[Cell]], Sequence[Sequence[Cell]], Sequence[str]] = ((), (), ())
        self.all = controls.button("", self._toggle, "quiet", tip="Every figure, or the six key figures")
        self.all.setCheckable(True)
        self.all.setChecked(bool(preferences.get(self._key, False)))
        self._name()
        self.setLayout(controls.column((self.table, 1000), controls.row(None, self.all), None, margins=(0, 0, 0, 0)))

    def _name(self) -> None:
        self.all.setText("Fewer figures" if self.all.isChecked() else "All figures")
        self.all.setAccessibleName(self.all.text())

    def _toggle(self) -> None:
        self._name()
        self._preferences.set(self._key, self.all.isChecked())
        self.show_figures(*self._rows)

    def show_figures(
        self, key: Sequence[Sequence[Cell]], every: Sequence[Sequence[Cell]], sensors: Sequence[str]
    ) -> None:
        self._rows = key, every, sensors
        self.table.show_rows(every if self.all.isChecked() or not key else key, sensors)
        self.table.setMaximumHeight(self.table.whole_height())
        self.all.setVisible(bool(key) and len(every) > len(key))
