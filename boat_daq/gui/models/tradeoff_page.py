"""The trade-off page: which methods to measure, time against error of the one looked at, and what the rule chose."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QListWidget,
    QListWidgetItem,
    QProgressBar,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from analysis.fidelity import LEVELS
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.models.atlas_card import NO_LIMIT, AtlasCard
from boat_daq.gui.models.tradeoff_chart import TradeoffCard
from boat_daq.gui.models.tradeoff_jobs import measure_methods
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.gui.widgets.reflow import ReflowingPage
from boat_daq.viewmodels.common.formatting import duration_text
from boat_daq.viewmodels.common.precision import Precision
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.models.atlas import AtlasModel
from boat_daq.viewmodels.models.tradeoff import ENTRIES, METHODS, TradeoffModel
from boat_daq.viewmodels.models.tradeoff_report import MethodChart, error_text

FIDELITY_WORDS = {
    "draft": "Draft: fast, rough",
    "normal": "Normal: as fine as matters",
    "reference": "Reference: slow, exact",
}
NOT_MEASURED = "Nothing is measured yet: Measure, or Open."
MARKS = "\u25cb the default   \u25a1 chosen by the rule   D taken at Draft   R taken at Reference"
NOTHING_YET = (
    "What does the next digit cost? Measure, and every setting of this method stands here with its time on this "
    "machine and its error against an independent reference."
)


class MethodList(QListWidget):
    """The methods: a tick takes one into the measurement, a selected one is looked at."""

    def __init__(self, tradeoff: TradeoffModel) -> None:
        super().__init__()
        self.tradeoff = tradeoff
        self.setAccessibleName("Methods; ticked ones are measured, the selected one is shown")
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        for name in ENTRIES:
            item = QListWidgetItem()
            item.setData(Qt.ItemDataRole.UserRole, name)
            self.addItem(item)
        self.show_entries()
        self.itemChanged.connect(self._ticked)
        self.currentRowChanged.connect(lambda row: self.tradeoff.show(list(ENTRIES)[row]))

    def show_entries(self) -> None:
        """Show ticks, titles and verdicts as they are now."""
        self.blockSignals(True)
        for row, (name, title) in enumerate(ENTRIES.items()):
            item = self.item(row)
            item.setText(f"{title}\n{self.tradeoff.entry(name)}")
            if name in METHODS:
                ticked = name in self.tradeoff.chosen
                item.setCheckState(Qt.CheckState.Checked if ticked else Qt.CheckState.Unchecked)
        self.setCurrentRow(list(ENTRIES).index(self.tradeoff.shown))
        self.blockSignals(False)

    def _ticked(self, item: QListWidgetItem) -> None:
        name = str(item.data(Qt.ItemDataRole.UserRole))
        self.tradeoff.choose(name, item.checkState() is Qt.CheckState.Checked)


class SettingsTable(QTableWidget):
    """Every setting of a method, cheapest first."""

    COLUMNS = ("No.", "Setting", "Time", "Error", "Mark")

    def __init__(self) -> None:
        super().__init__(0, len(self.COLUMNS))
        self.setAccessibleName("Settings of the method, cheapest first: time, error, marks")
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setShowGrid(False)
        self.setWordWrap(False)
        self.verticalHeader().hide()
        self.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - 2 * style.STEP)
        self.setHorizontalHeaderLabels(list(self.COLUMNS))
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionResizeMode(1, QHeaderView.ResizeMode.Stretch)
        mark = self.horizontalHeaderItem(len(self.COLUMNS) - 1)
        if mark is not None:
            mark.setToolTip(MARKS)

    def show_chart(self, chart: MethodChart | None) -> None:
        """Show another method's settings."""
        points = chart.points if chart is not None else ()
        self.setRowCount(len(points))
        for row, p in enumerate(points):
            hover = (
                f"{p.setting}: {duration_text(p.seconds)}, {p.repeats} repeats within {duration_text(p.spread_s)}; "
                f"error {error_text(p.error)} {chart.unit if chart else ''}, within {error_text(p.error_spread)}"
            )
            cells = (str(p.number), p.setting, duration_text(p.seconds), error_text(p.error), p.symbols)
            for column, text in enumerate(cells):
                cell = QTableWidgetItem(text)
                cell.setToolTip(hover)
                side = Qt.AlignmentFlag.AlignRight if column in (0, 2, 3) else Qt.AlignmentFlag.AlignLeft
                cell.setTextAlignment(side | Qt.AlignmentFlag.AlignVCenter)
                self.setItem(row, column, cell)


class TradeoffPage(ReflowingPage):
    """The trade-off page."""

    def __init__(self, model: TradeoffModel, atlas: AtlasModel, precision: Precision, services: Services) -> None:
        super().__init__()
        self.model, self.maps, self.precision, self.services = model, atlas, precision, services
        self._revision = (-1, -1)
        self.model.measurer = measure_methods
        self.methods = MethodList(model)
        self.first = self.methods
        self.chart, self.table = TradeoffCard(), SettingsTable()
        self.atlas = AtlasCard(atlas, services.notices.attempt)
        self.words = widgets.label(NOTHING_YET, "muted", wrap=True, name="What the rule chose, and why")
        self.measured = widgets.label("", "small", wrap=True)
        across = QHBoxLayout()
        across.setSpacing(style.GAP)
        across.addWidget(self._side())
        across.addLayout(self._right(), 1)
        widgets.page_layout(self).addLayout(across)

    def _side(self) -> QWidget:
        frame, inside = widgets.card()
        frame.setFixedWidth(style.PANE_WIDTH_NARROW + 4 * style.STEP)
        self.kind = widgets.choice(
            "How thoroughly to measure", [("Quick, about half a minute", True), ("Full, about 3 minutes", False)]
        )
        self.kind.setCurrentIndex(self.kind.findData(self.model.quick))
        self.kind.activated.connect(lambda _: self.model.set_quick(bool(self.kind.currentData())))
        self.level = widgets.choice("How fine the program computes", [(FIDELITY_WORDS[n], n) for n in LEVELS])
        self.level.setToolTip(
            "Fidelity: optics, shadow, uncertainty and live plots are computed as finely as this (Models menu too)"
        )
        self.level.activated.connect(lambda _: self.precision.choose(self.level.currentData()))
        attempt = self.services.notices.attempt
        self.start = widgets.button("Measure", partial(attempt, self.model.toggle), "primary")
        self.progress = QProgressBar()
        self.progress.setAccessibleName("Progress of the measurement")
        self.status = widgets.label("", "small", wrap=True)
        self.open = widgets.button("Open \u2026", self._ask_open, name="Open a measured trade-off")
        self.save = widgets.button("Save \u2026", self._ask_save, name="Save the trade-off as JSON or CSV")
        inside.addWidget(widgets.label("Methods", "subtitle"))
        inside.addWidget(self.methods, 1)
        inside.addWidget(self.kind)
        inside.addWidget(self.start)
        inside.addWidget(self.progress)
        inside.addWidget(self.status)
        inside.addLayout(widgets.row(self.open, self.save))
        inside.addSpacing(style.GAP)
        inside.addWidget(widgets.label("Precision", "subtitle"))
        inside.addWidget(self.level)
        return frame

    def _right(self) -> QVBoxLayout:
        frame, inside = widgets.card()
        self.table_card = frame
        inside.addWidget(self.table, 1)
        inside.addWidget(self.words)
        inside.addWidget(self.measured)
        upper = QHBoxLayout()
        upper.setSpacing(style.GAP)
        upper.addWidget(self.chart, 1)
        upper.addWidget(frame)
        self.upper = widgets.holder(upper)
        self.rows, self.tall = (upper,), (self.chart, frame)
        self.reflow()
        right = QVBoxLayout()
        right.setSpacing(style.GAP)
        right.addWidget(self.upper, 3)
        right.addWidget(self.atlas, 2)
        right.addStretch()  # takes what is left where only the map's small card is shown
        return right

    def reflow(self) -> None:
        """Give the table its own width only where it stands beside the chart."""
        super().reflow()
        low, high = (0, NO_LIMIT) if self.narrow else (style.PANE_WIDTH_WIDE, style.PANE_WIDTH_WIDE)
        self.table_card.setMinimumWidth(low)
        self.table_card.setMaximumWidth(high)
        self.upper.setMinimumHeight(2 * style.STACKED_HEIGHT + style.GAP if self.narrow else 0)

    def _ask_open(self) -> None:
        ask_open(self, self.services, "Open a measured trade-off", "json", self.model.load)

    def _ask_save(self) -> None:
        ask_save(self, self.services, "tradeoff", "json csv", self.model.save)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the measurement under way; the rest where it has changed."""
        self.level.setCurrentIndex(self.level.findData(self.precision.level))
        job = self.model.job
        widgets.set_text(self.start, "Stop" if job is not None else "Measure")
        self.progress.setVisible(job is not None)
        if job is not None:
            self.progress.setRange(0, 0 if job.fraction is None else 1000)
            self.progress.setValue(job.permille)
        widgets.set_text(self.status, self.model.status())
        self.status.setVisible(bool(self.status.text()))
        self.atlas.refresh()
        revision = (self.model.revision, self.maps.revision)
        if revision == self._revision:
            return
        self._revision = revision
        chart = self.model.chart
        self.methods.show_entries()
        widgets.allow(self.save, "" if self.model.content is not None else NOT_MEASURED)
        self.chart.heading.setText(ENTRIES[self.model.shown])
        self.chart.readout.setText("" if chart else self.model.entry(self.model.shown))
        self.chart.show_chart(chart)
        self.table.show_chart(chart)
        self.atlas.show_method(self.model.shown)
        self.upper.setVisible(self.model.shown in METHODS)
        self.words.setText(chart.explanation if chart else NOTHING_YET)
        self.measured.setText(f"Measured: {chart.measured}" if chart else "")
