"""The page Recordings: the recordings with thumbnails, their actions, and the units with their calibrations."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import (
    QEvent,
    QItemSelectionModel,
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QPointF,
    QRect,
    QSize,
    Qt,
    QTimer,
)
from PySide6.QtGui import QAction, QFontMetrics, QPainter, QPen, QPolygonF, QResizeEvent, QTransform
from PySide6.QtWidgets import (
    QFrame,
    QHeaderView,
    QMenu,
    QPushButton,
    QScrollArea,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, PointLabels, ThemeColour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.closed_readings import ClosedReadings
from boat_daq.gui.results.metadata_form import MetadataForm
from boat_daq.gui.results.unit_window import UnitWindow
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save, open_folder
from boat_daq.gui.widgets.layouts import EmptyState, Leaves, Shares
from boat_daq.gui.widgets.text_dialog import TextDialog
from boat_daq.viewmodels.common.files import TABLE_KINDS
from boat_daq.viewmodels.common.services import Page, Place, Services, Tab
from boat_daq.viewmodels.live.axis import number_labels
from boat_daq.viewmodels.results.run_entry import RUN_HEADINGS, RunEntry, obstacle, selection_text
from boat_daq.viewmodels.results.runs import RunsModel
from protocol.base.units import as_text

Index = QModelIndex | QPersistentModelIndex
EXPORTS = {"CSV": "csv", "Parquet": "parquet", "HDF5": "h5", "MATLAB": "mat"}  # in the menu, and the suffix
LEAST_LINES = 3  # of the list; a lower window scrolls the page
LEAST_SPAN_MV = 0.1  # of a comparison, so that noise looks small
RUN_LINES: tuple[tuple[ThemeColour, Qt.PenStyle], ...] = (  # of the runs of a comparison, as many as are compared
    (lambda t: t.sensors[0], Qt.PenStyle.SolidLine),
    (lambda t: t.sensors[1], Qt.PenStyle.DashLine),
    (lambda t: t.pressure, Qt.PenStyle.DashDotLine),
    (lambda t: t.elongation, Qt.PenStyle.DotLine),
)
RUN_ROLE = Qt.ItemDataRole.UserRole
OPTIONAL = ("Readings", "Length", "Cycles")  # columns hidden in this order where the name of the file is cut
USUAL_NAME = "20260101-000000_SA1.boat"  # what the program names a recording
NO_UNITS = "Accepted calibrations are listed here by unit."
DIFFERENCE = "The curve of each run less the curve of the first one, over elongation."
OVER_TIME_TIP = "Its calibrations overlaid and over time, and when it is due again"
UNIT_HEADINGS = ("Unit", "Accepted", "Sensitivity, mV/mm", "Recording")


class Thumbnail(QStyledItemDelegate):
    theme: Theme = style.LIGHT

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
        super().paint(painter, option, index)
        run = index.data(RUN_ROLE)
        if not isinstance(run, RunEntry) or not run.outline:
            return
        area: QRect = option.rect.adjusted(style.GAP, style.STEP + 2, -style.GAP, -style.STEP - 2)
        painter.save()
        painter.setPen(QPen(style.colour(self.theme.pressure), 1))
        painter.setBrush(style.colour(self.theme.pressure, style.BAND_OPACITY))

        upper = [QPointF(x, high) for x, _, high in run.outline]
        lower = [QPointF(x, low) for x, low, _ in reversed(run.outline)]
        transform = QTransform(area.width(), 0, 0, -area.height(), area.left(), area.bottom())
        painter.drawPolygon(transform.map(QPolygonF(upper + lower)))
        painter.restore()

    def sizeHint(self, option: QStyleOptionViewItem, index: Index) -> QSize:
        return QSize(*style.THUMBNAIL)


class RunsPage(QWidget):
    def __init__(
        self, model: RunsModel, calibrate: Callable[[Path], None], resume: Callable[[Path], None], services: Services
    ) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._calibrate, self._resume = calibrate, resume
        self._revision = -1
        self._compared: object = None
        self._reveals = False  # whether the page is scrolled to the comparison once it has its height
        self._untouched = True  # until then the newest recording is chosen
        self.list = DataTable("Recordings", RUN_HEADINGS, right=(3, 4, 5))  # a long file name is cut, not scrolled
        self.list.verticalHeader().setDefaultSectionSize(style.THUMBNAIL[1])
        self.list.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Fixed)
        self.thumbnail = Thumbnail(self.list)
        self.list.setItemDelegateForColumn(0, self.thumbnail)
        self.list.viewport().installEventFilter(self)
        self.first = self.list
        self.list.itemSelectionChanged.connect(self._enable)
        self.list.itemDoubleClicked.connect(lambda _: self._run(calibrate, Tab.CALIBRATION))
        self.units = DataTable("Units and their calibrations", UNIT_HEADINGS)
        self.compare_card = PlotCard("Difference from run 1", DIFFERENCE)
        self.differences: list[list[Curve]] = []  # by sensor, as many as any comparison so far had
        self.numbers: list[PointLabels] = []
        self._arrange_comparison(2)
        back = controls.button("Back to the units", self.model.show_comparison)
        self.compare_card.bar.insertWidget(self.compare_card.bar.count() - 1, back)
        self.empty = EmptyState("", "", "Go to Measure", partial(services.show, Page.MEASURE))
        self.stack = Leaves(self.empty, self._filled())
        controls.page_layout(self).addWidget(self.stack)

    def _arrange_comparison(self, sensors: int) -> None:
        """Show the plots of so many sensors, side by side."""
        card = self.compare_card
        for number in range(len(card.plots) + 1, sensors + 1):
            plot = card.add(f"Sensor {number}", "mV", x_title="Elongation", x_unit="mm", beside=True)
            self.differences.append(
                [plot.curve(f"Run {i}", colour, pen_style=line) for i, (colour, line) in enumerate(RUN_LINES, 1)]
            )
            self.numbers.append(plot.labels((0.5, 0.5), ground=True))
        card.link_x()
        card.show_only(card.plots[:sensors], beside=True)
        card.paint_theme(card.theme)

    def _filled(self) -> QWidget:
        self.actions_ = self._make_menu()
        self.buttons = self._run_buttons()
        self.list.addActions(self.menu.actions())
        frame, side = self._recordings_card(), self._units_card()
        self.cards = (side, self.compare_card)
        self.below = Leaves(side, self.compare_card)  # the latter in place of the units
        self.list.setMinimumHeight(style.STRIP_HEIGHT + LEAST_LINES * style.THUMBNAIL[1])
        return Shares("runs", self.services.preferences, (frame, 3), (self.below, 2))

    def _make_menu(self) -> dict[str, QAction]:
        """Return what else can be done with the chosen recordings, in the menu of the list and of the button More."""
        run = self._run
        self.menu = QMenu("More", self)
        self.menu.setToolTipsVisible(True)
        entries: tuple[tuple[str, str, Callable[[], object]] | None, ...] = (
            ("readings", "Correct its readings …", partial(run, self._edit)),
            ("compare", "Compare", self._compare),
            None,
            ("resume", "Resume this run", partial(run, self._resume)),
            ("recover", "Recover", self._recover),
            None,
            ("rename", "Rename …", self._rename),
            ("note", "Note …", self._note),
            ("marker", "Marker …", self._marker),
            ("metadata", "Metadata …", self._metadata),
        )
        actions: dict[str, QAction] = {}
        for entry in entries:
            if entry is None:
                self.menu.addSeparator()
            else:
                key, text, act = entry
                actions[key] = self.menu.addAction(text, act)
        return actions

    def _run_buttons(self) -> dict[str, QPushButton]:
        open_ = partial(self._run, self._calibrate, Tab.CALIBRATION)
        buttons = {
            "open": controls.button("Open", open_, "primary", tip="Analyse it, on the page Results"),
            "report": controls.button("Report …", partial(self._ask_save, "pdf html", self.model.report, " report")),
            "export": controls.button("Export", lambda: None),
        }
        export = QMenu(buttons["export"])
        for kind, suffix in EXPORTS.items():
            export.addAction(f"{kind} …", partial(self._ask_save, suffix, self.model.export))
        controls.add_menu(buttons["export"], export)
        self.more = controls.button("More", lambda: None, tip="Also with a right click on the list")
        controls.add_menu(self.more, self.menu)
        return buttons

    def _recordings_card(self) -> QFrame:
        head = controls.row(controls.label("Recordings", "subtitle"), None, *self.buttons.values(), self.more)
        self.search = controls.field("Search the recordings", placeholder="Search: unit, date, note, file")
        self.search.textChanged.connect(self._list)
        place = partial(open_folder, self.model.folder, self.services)
        self.folder = controls.button("Open folder", place, tip=f"Recordings are in {self.model.folder}")
        where = controls.label(str(self.model.folder), "small", name="Folder of the recordings", elide=True)
        self.details = controls.label("", "small", name="Details of the chosen recordings", wrap=True)
        lines = 2 * QFontMetrics(style.small_font()).lineSpacing()
        self.details.setMinimumHeight(lines)  # a splitter gives a card no height for what wraps in it
        ask = partial(ask_open, self, self.services, "Import a table", TABLE_KINDS, self.services.open)
        self.import_ = controls.button("Import table …", ask, tip="Convert a table of another program to a recording")
        find = controls.row((self.search, 1), (where, 1), self.folder, self.import_)
        self.clear = controls.button("Clear the search", self.search.clear)
        frame, _ = controls.card(head, find, (self.list, 1), controls.row((self.details, 1), self.clear))
        return frame

    def _units_card(self) -> QFrame:
        self.no_units = controls.label(NO_UNITS, "muted", elide=True)
        self.over_time = self.buttons["unit"] = controls.button("Over time …", self._show_unit, tip=OVER_TIME_TIP)
        self.units.itemSelectionChanged.connect(self._enable)
        self.units.itemDoubleClicked.connect(lambda _: self._show_unit())
        units_head = controls.row(controls.label("Units", "subtitle"), (self.no_units, 1), self.over_time)
        side, _ = controls.card(units_head, (self.units, 1))
        return side

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Halve the pictures on a narrow page."""
        self._fit_below()
        self.list.setColumnWidth(0, style.THUMBNAIL[0] // (2 if self.width() < style.STACKED_BELOW else 1))
        super().resizeEvent(event)
        if self._reveals:
            self._reveals = False
            QTimer.singleShot(0, self, self._reveal)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Choose the columns again when the width of the list changes, which is after the page's."""
        if event.type() is QEvent.Type.Resize:
            self._share_columns()
        return super().eventFilter(watched, event)

    def _share_columns(self) -> None:
        """Hide columns until the name of the file fits: their content is also under the list, for the chosen line."""
        header, last = self.list.horizontalHeader(), len(RUN_HEADINGS) - 1
        for heading in OPTIONAL:
            self.list.setColumnHidden(RUN_HEADINGS.index(heading), False)  # a hidden column has no width
        needed = {k: max(self.list.sizeHintForColumn(k), header.sectionSizeHint(k)) for k in range(1, last)}
        file_width = style.text_width(self.list.font(), USUAL_NAME) + 2 * style.STEP  # in whichever font there is
        available = self.list.viewport().width() - self.list.columnWidth(0) - file_width
        for column in map(RUN_HEADINGS.index, OPTIONAL):
            hidden = sum(needed.values()) > available
            self.list.setColumnHidden(column, hidden)
            if hidden:
                del needed[column]

    def offers(self, key: str) -> bool:
        """Return whether an action can be done now."""
        if key in self.actions_:
            return self.actions_[key].isEnabled() and self.actions_[key].isVisible()
        return self.buttons[key].isEnabled()

    def why_not(self, key: str) -> str:
        """Return why an action cannot be done now; empty where it can, or is not needed."""
        if key in self.actions_:
            return self.actions_[key].statusTip()
        return self.buttons[key].accessibleDescription()

    def press(self, key: str, entry: int = 0) -> None:
        """Do an action; where it has a menu, take one of its entries."""
        if key in self.actions_:
            self.actions_[key].trigger()
            return
        button, menu = self.buttons[key], self.buttons[key].menu()
        (menu.actions()[entry].trigger if menu is not None else button.click)()

    def selected(self) -> list[RunEntry]:
        """Return the chosen lines as they are shown; the list of the model may be newer."""
        rows = sorted({index.row() for index in self.list.selectedIndexes()})
        return [self.list.model().index(row, 0).data(RUN_ROLE) for row in rows]

    def _paths(self) -> list[Path]:
        return [run.path for run in self.selected()]

    def _run(self, action: Callable[[Path], object], page: Place | None = None) -> None:
        for path in self._paths()[:1]:
            if self.services.notices.attempt(partial(action, path)) and page is not None:
                self.services.show(page)

    def _edit(self, path: Path) -> None:
        units = self.model.shown_units
        panel = ClosedReadings(self.window(), path, self._calibrate, self.services, units)
        panel.finished.connect(self.model.scan)
        panel.show()

    def _ask_save(self, kinds: str, save: Callable[[list[Path], Path], None], what: str = "") -> None:
        paths = self._paths()
        stem = (paths[0].stem if paths else "run") + what
        ask_save(self, self.services, stem, kinds, partial(save, paths), done="")

    def _rename(self) -> None:
        run = self.selected()[0]
        rename = partial(self.model.rename, run.path)
        words = f"New name of {run.path.name}; the files that belong to it are renamed, too. Undo: Ctrl+Z."
        attempt = self.services.notices.attempt
        TextDialog(self, "Rename", words, run.path.stem, "Rename", lambda text: attempt(partial(rename, text)))

    def _note(self) -> None:
        run = self.selected()[0]
        words = f"Note on {run.path.name}. The previous note stays in the file."
        attempt = self.services.notices.attempt
        add = partial(self.model.note, run)
        TextDialog(self, "Note", words, run.note, "Save", lambda text: attempt(partial(add, text)))

    def _marker(self) -> None:
        run = self.selected()[0]
        words = f"Marker in {run.path.name}: seconds from its start, then what happened. Example: 12.5 valve opened"
        attempt = self.services.notices.attempt
        TextDialog(self, "Marker", words, "", "Add", lambda text: attempt(partial(self.model.mark, run, text)))

    def _metadata(self) -> None:
        """Show the form of the recording's metadata beside the window."""
        run, attempt = self.selected()[0], self.services.notices.attempt
        attempt(lambda: MetadataForm(self, self.model.metadata(run), self.services).show())

    def _compare(self) -> None:
        self.services.notices.attempt(lambda: self.model.compare(self._paths()))

    def _recover(self) -> None:
        for path in self._paths():
            self.services.notices.attempt(partial(self.model.recover, path))

    def _enable(self) -> None:
        chosen = self.selected()
        for key in ("open", "report", "export"):
            controls.allow(self.buttons[key], obstacle(key, chosen))
        for key in ("readings", "compare", "rename", "note", "marker", "metadata"):
            why = obstacle(key, chosen)
            self.actions_[key].setEnabled(not why)
            self.actions_[key].setStatusTip(why)
            self.actions_[key].setToolTip(controls.as_words(why))
        one = len(chosen) == 1
        self.actions_["resume"].setVisible(one and chosen[0].resumable)
        self.actions_["recover"].setVisible(any(run.recoverable for run in chosen))
        nothing = bool(self.search.text()) and not self.list.rowCount()
        self.clear.setVisible(nothing)
        self.details.setText("No recording matches the search." if nothing else selection_text(chosen))
        controls.allow(self.over_time, "" if self.units.selectedIndexes() else "Choose a line of the units.")

    def paint_theme(self, theme: Theme) -> None:
        self.thumbnail.theme = theme
        per_mm = as_text(theme.units.shown("mV/mm").symbol)
        self.units.setHorizontalHeaderLabels([heading.replace("mV/mm", per_mm) for heading in UNIT_HEADINGS])

    def refresh(self, snapshot: SessionSnapshot) -> None:
        runs = self.model
        runs.scan_at_intervals()
        if runs.comparison is not self._compared:
            self._compared = runs.comparison
            self._show_comparison()
        if runs.revision == self._revision:
            return
        self._revision = runs.revision
        units = runs.unit_lines
        self.empty.say(*runs.nothing(), "Go to Measure" if runs.listed else "")
        self.stack.setCurrentIndex(1 if runs.runs or units else 0)
        self._list()
        self._share_columns()
        self.units.fill(units, [cells[-1] for cells in units])
        if units and not self.units.selectedIndexes():
            self.units.selectRow(0)
        self.units.setVisible(bool(units))
        self.no_units.setText("" if units else NO_UNITS)
        self._fit_below()
        self._enable()

    def _fit_below(self) -> None:
        """Leave the list the height that the units do not need and no comparison takes."""
        units, (card, compared) = self.units, self.cards
        head = needed = self.over_time.sizeHint().height() + 2 * style.CARD_PADDING
        if self.model.unit_lines:
            needed += units.horizontalHeader().height() + units.verticalHeader().length() + 2 * style.STEP
        narrow = self.width() < style.STACKED_BELOW
        two_lines = head + units.horizontalHeader().height() + 2 * style.CONTROL_HEIGHT  # more of them scroll
        card.setMinimumHeight(min(needed, two_lines) if narrow else 0)
        compared.setMinimumHeight(style.STACKED_HEIGHT if narrow else 0)
        self.below.setMaximumHeight(needed if self.below.currentIndex() == 0 else style.UNLIMITED)

    def _list(self) -> None:
        """List the recordings that match the search; those that were chosen stay chosen."""
        found = [run for run in self.model.runs if run.matches(self.search.text())]
        chosen = set(self._paths())
        self.list.fill([self.model.cells(run) for run in found], [run.tip for run in found])
        for row, run in enumerate(found):
            self.list.model().setData(self.list.model().index(row, 0), run, RUN_ROLE)
        wanted = [run for run in found if run.path == self.model.wanted]
        if wanted:
            chosen, self.model.wanted, self._untouched = set(), None, False
        newest = wanted or (found[:1] if self._untouched else [])
        self._untouched = self._untouched and not newest
        rows = [row for row, run in enumerate(found) if run.path in chosen or run in newest]
        self._choose(rows)
        if newest and rows:
            self.list.scrollTo(self.list.model().index(rows[0], 0))
        self._enable()

    def _choose(self, rows: list[int]) -> None:
        """Choose these lines and no others; `selectRow` would leave the last one only."""
        flags = QItemSelectionModel.SelectionFlag.Select | QItemSelectionModel.SelectionFlag.Rows
        self.list.clearSelection()
        for row in rows:
            self.list.selectionModel().select(self.list.model().index(row, 0), flags)
        if rows and not self.list.currentIndex().isValid():  # else an arrow key starts above the chosen line
            here = self.list.model().index(rows[0], 0)
            self.list.selectionModel().setCurrentIndex(here, QItemSelectionModel.SelectionFlag.NoUpdate)

    def _reveal(self) -> None:
        """Scroll a small page down to the comparison."""
        viewport = self.parentWidget()
        area = viewport.parentWidget() if viewport is not None else None
        if isinstance(area, QScrollArea):
            area.ensureWidgetVisible(self.compare_card, 0, style.GAP)

    def _show_unit(self) -> None:
        row = self.units.currentRow()
        self.services.notices.attempt(
            lambda: UnitWindow(self.window(), self.model.over_time(row), self.services, self.compare_card).show()
        )

    def _show_comparison(self) -> None:
        lines, legend = self.model.comparison_lines()
        self._reveals = bool(lines)
        self.below.setCurrentIndex(1 if lines else 0)
        self._fit_below()
        self.compare_card.clear()
        self.compare_card.show_signals_in(self.model.comparison_unit)
        if lines:
            self._arrange_comparison(len(lines))
        self.compare_card.readout.setText(legend)
        for labels, curves in zip(self.numbers, lines, strict=False):
            labels.set(number_labels(curves))
        for row, curves in zip(self.differences, lines, strict=False):
            for curve, (x, y) in zip(row, curves, strict=False):
                curve.set(x, y)
        for plot in self.compare_card.plots:
            plot.fit(smallest=LEAST_SPAN_MV if self.model.comparison_unit == "mV" else 0.0)
