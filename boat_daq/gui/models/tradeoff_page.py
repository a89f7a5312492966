"""The trade-off page: an overview of the methods, the chart and the settings of one, its failure maps."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QSignalBlocker, Qt
from PySide6.QtWidgets import QListWidget, QProgressBar, QVBoxLayout, QWidget

from analysis.fidelity import LEVELS
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import duration_text
from boat_daq.gui import style
from boat_daq.gui.models.tradeoff_chart import NOT_MEASURED, TradeoffCard
from boat_daq.gui.models.tradeoff_jobs import measure_methods
from boat_daq.gui.models.tradeoff_maps import AtlasCard
from boat_daq.gui.models.tradeoff_overview import DefaultsTable, OverviewCard
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.layouts import ReflowingPage, Shares
from boat_daq.gui.widgets.wrapped_table import WrappedTable
from boat_daq.viewmodels.common.preferences import Precision
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.models.failure_maps import AtlasModel
from boat_daq.viewmodels.models.tradeoff import (
    CHOICE,
    METHOD_NAMES,
    OVERVIEW,
    ROWS,
    MethodChart,
    TradeoffModel,
    error_text,
)

PRECISIONS = {
    "draft": "Draft: fast, rough",
    "normal": "Normal (sufficient)",
    "reference": "Reference: slow, exact",
}
_HEADINGS = ("No.", "Setting", "Time", "Error", "Use")
_USES = f"\u25cb default   \u25a1 {CHOICE}   D used at Draft   R used at Reference"
MEASURE = "Measure this computer"
MEASURE_TIP = "Some minutes in a helper process; the terminal measures more settings of each method"


class MethodList(QListWidget):
    """The methods; the selected one is shown."""

    def __init__(self, tradeoff: TradeoffModel) -> None:
        super().__init__()
        self.tradeoff = tradeoff
        self.setAccessibleName("Methods; the selected one is shown")
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.addItems(list(ROWS))
        self.show_entries()
        self.currentRowChanged.connect(lambda row: self.tradeoff.show(list(ROWS)[row]))

    def show_entries(self) -> None:
        """Show the current titles and verdicts."""
        with QSignalBlocker(self):
            for row, (name, title) in enumerate(ROWS.items()):
                self.item(row).setText(f"{title}\n{self.tradeoff.entry(name)}")
            self.setCurrentRow(list(ROWS).index(self.tradeoff.shown))


class SettingsTable(WrappedTable):
    """Every setting of a method, cheapest first."""

    def __init__(self) -> None:
        super().__init__("Settings of the method, cheapest first", _HEADINGS, stretched=(1,), right=(0, 2, 3))
        self.explain({_HEADINGS.index("Use"): _USES})

    def show_chart(self, chart: MethodChart | None) -> None:
        """Show another method's settings."""
        points = chart.points if chart is not None else ()
        unit = chart.unit if chart is not None else ""
        rows = [(str(p.number), p.setting, duration_text(p.seconds), error_text(p.error), p.symbols) for p in points]
        tips = [
            f"{p.setting}: {duration_text(p.seconds)}, {p.repeats} repeats within {duration_text(p.spread_s)}; "
            f"error {error_text(p.error)} {unit}, within {error_text(p.error_spread)}"
            for p in points
        ]
        self.fill(rows, tips)


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
        self.overview, self.defaults = OverviewCard(model), DefaultsTable(model)
        self.atlas = AtlasCard(atlas, services.notices.attempt)
        self.explanation = controls.label("", "muted", wrap=True, name="The rule and its choice")
        self.measured = controls.label("", "small", wrap=True)
        controls.page_layout(self).addLayout(controls.row(self._side(), (self._right(), 1)))

    def _side(self) -> QWidget:
        levels = [(PRECISIONS[n], n) for n in LEVELS]
        tip = "Precision of optics, shadow, uncertainty and live plots"
        self.level = controls.choice("Precision of the program", levels, self.precision.choose, tip=tip)
        toggle = partial(self.services.notices.attempt, self.model.toggle)
        self.start = controls.button(MEASURE, toggle, "primary", tip=MEASURE_TIP)
        self.progress = QProgressBar()
        self.progress.setAccessibleName("Progress of the measurement")
        self.status = controls.label("", "small", wrap=True)
        methods = controls.label("Methods", "subtitle"), (self.methods, 1)
        measurement = (self.start, self.progress, self.status, self.measured)
        frame, _ = controls.card(*methods, *measurement, style.GAP, controls.label("Precision", "subtitle"), self.level)
        frame.setFixedWidth(style.PANE_WIDTH_NARROW + 4 * style.STEP)
        return frame

    def _right(self) -> QVBoxLayout:
        self.table_card, _ = controls.card((self.table, 1), self.explanation)
        keep = self.services.preferences
        self.upper = Shares("settings", keep, (self.chart, 9), (self.table_card, 8), beside=True)
        self.one = Shares("trade-off", keep, (self.upper, 3), (self.atlas, 2))
        defaults, _ = controls.card((self.defaults, 1))
        self.all = Shares("overview", keep, (self.overview, 5), (defaults, 6))
        self.rows, self.tall = (self.upper,), (self.chart, self.table_card, self.overview, defaults)
        self.reflow()
        right = controls.column((self.one, 1), (self.all, 1), spacing=style.GAP)
        right.addStretch(0)  # takes the rest where only the small card of the maps is shown
        return right

    def reflow(self) -> None:
        """Give chart and table their height where they are stacked."""
        super().reflow()
        self.upper.setMinimumHeight(2 * style.STACKED_HEIGHT + style.GAP if self.narrow else 0)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the progress of the measurement; the rest where it has changed."""
        self.level.setCurrentIndex(self.level.findData(self.precision.level))
        job = self.model.job
        controls.set_text(self.start, "Cancel" if job is not None else MEASURE)
        self.progress.setVisible(job is not None)
        if job is not None:
            self.progress.setRange(0, 0 if job.fraction is None else 1000)
            self.progress.setValue(job.permille)
        controls.set_text(self.status, self.model.status())
        self.status.setVisible(bool(self.status.text()))
        self.atlas.refresh()
        revision = (self.model.revision, self.maps.revision)
        if revision == self._revision:
            return
        self._revision = revision
        self.methods.show_entries()
        self.measured.setText(self.model.measured)
        self.all.setVisible(self.model.shown == OVERVIEW)
        self.one.setVisible(self.model.shown != OVERVIEW)
        if self.model.shown == OVERVIEW:
            self.overview.show_defaults()
            self.defaults.show_defaults()
        else:
            self._show_method(self.model.chart)

    def _show_method(self, chart: MethodChart | None) -> None:
        self.chart.heading.setText(ROWS[self.model.shown])
        self.chart.show_chart(chart)
        self.table.show_chart(chart)
        self.atlas.show_method(self.model.shown)
        self.upper.setVisible(self.model.shown in METHOD_NAMES)
        self.explanation.setText(chart.explanation if chart else NOT_MEASURED)
