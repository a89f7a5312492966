"""The calibration page: curves with bands and residuals, loops, figures, posterior, comparison, acceptance."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QFrame,
    QHBoxLayout,
    QLayout,
    QScrollArea,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.closed_readings import ClosedReadings
from boat_daq.gui.results.figure_table import FigureTable
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.empty_page import EmptyState
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.gui.widgets.page_scroll import Leaves
from boat_daq.gui.widgets.split_view import Divided
from boat_daq.viewmodels.common.formatting import sensor_words
from boat_daq.viewmodels.common.services import Page, Panel, Services
from boat_daq.viewmodels.results.analysis_view import LoopSet, RunResult, SensorResult
from boat_daq.viewmodels.results.calibration import CalibrationModel, CurveShown
from boat_daq.viewmodels.results.closed_run import ClosedRun

SENSORS = 2
SOURCES = {"least squares": "fit", "posterior": "emcee"}  # what the curve and its bands are of
BANDS = "Compute uncertainty bands"
BANDS_TIP = (
    "Bands that also hold what the grid of the readings leaves open: samples the posterior of the coefficients with "
    "emcee, a Markov chain Monte Carlo; takes a while, in the background"
)
ACCEPT, ACCEPT_TIP = "Accept", "Store it with the unit and use it live"
ANYWAY, ANYWAY_TIP = "Accept anyway", "Store it with the unit, marked as poor, and use it live"
BESIDE = ("", "now", "last", "E\u2099")
SIDE = style.PANE_WIDTH_WIDE - 8 * style.STEP


class CurveCard(PlotCard):
    """One sensor: points by branch, curve with bands, the unit's last curve, residuals."""

    def __init__(self, number: int) -> None:
        super().__init__(f"Sensor {number}")
        ink = sensor_colour(number)
        self.top = self.add("Signal", "mV", stretch=3)
        self.bottom = self.add("Residual", "mV", x_title="Elongation", x_unit="mm", stretch=1)
        self.link_x()
        self.wide = self.top.band("Band of a new reading, 95 %", ink, alpha=style.BAND_ALPHA_WIDE)
        self.bands = [self.top.band(f"Band of the curve, {p} %", ink) for p in (95, 68)]
        self.before = self.top.curve("Last calibration", lambda t: t.target, dashed=True)
        self.curve = self.top.curve("Calibration", ink)
        self.loading = self.top.points("Loading", ink)
        self.unloading = self.top.points("Unloading", ink, filled=False)
        self.apart = self.bottom.curve("Last calibration less this one", lambda t: t.target, dashed=True)
        self.rest_bands = [self.bottom.band(f"Band of the curve about itself, {p} %", ink) for p in (95, 68)]
        self.bottom.line(lambda t: t.muted, style_=Qt.PenStyle.SolidLine)
        self.rest_loading = self.bottom.points("Residual, loading", ink, size=6)
        self.rest_unloading = self.bottom.points("Residual, unloading", ink, filled=False, size=6)

    def show_sensor(self, sensor: SensorResult, shown: CurveShown) -> None:
        """Draw a sensor's calibration, its bands and the unit's last one."""
        up, down = sensor.loading, ~sensor.loading
        self.loading.set(sensor.x[up], sensor.y[up])
        self.unloading.set(sensor.x[down], sensor.y[down])
        self.rest_loading.set(sensor.x[up], shown.residuals[up])
        self.rest_unloading.set(sensor.x[down], shown.residuals[down])
        self.curve.set(shown.grid, shown.curve)
        for above, below, (low, high) in zip(self.bands, self.rest_bands, (shown.band_95, shown.band_68), strict=True):
            above.fill(shown.grid, low, high)
            below.fill(shown.grid, low - shown.curve, high - shown.curve)
        self.wide.show(shown.new_reading_95 is not None)
        if shown.new_reading_95 is not None:
            self.wide.fill(shown.grid, *shown.new_reading_95)
        for before in (self.before, self.apart):
            before.show(shown.last is not None)
        if shown.last is not None:
            self.before.set(shown.last[0], shown.last[1])
            self.apart.set(shown.last[0], shown.last[2])
        bands = "" if shown.last is not None else "68, 95 %: "  # there is no room for both; the hover says them
        last = "  \u2504 last" if shown.last is not None else ""
        self.readout.setText(f"\u25cf loading  \u25cb unloading{last}   {bands}{SOURCES[shown.source]}")
        self.top.fit()
        self.bottom.fit()


class LoopCard(PlotCard):
    """The loops of all cycles: the system's (mV over kPa) for each sensor, and the actuator's own (mm over kPa)."""

    def __init__(self) -> None:
        super().__init__("Loops over pressure")
        self.signals = []
        for number in range(1, SENSORS + 1):
            plot = self.add(f"Signal {number}", "mV", x_title="Pressure" if number == SENSORS else "", x_unit="kPa")
            self.signals.append((plot, plot.curve(f"Sensor {number}", sensor_colour(number), gaps=True)))
        self.link_x()

    def show_loops(self, loops: LoopSet) -> None:
        """Draw the loops, where there is a whole one."""
        cycles = range(len(loops.numbers))
        if not cycles:
            self.clear()
            self.show_empty("A loop needs one complete cycle.")
            return
        for i, (plot, curve) in enumerate(self.signals[: len(loops.signal_mv)]):
            curve.set(*loops.broken(loops.pressure_kpa, loops.signal_mv[i], cycles))
            plot.fit()


class ActuatorCard(PlotCard):
    """The actuator's own loop: elongation over pressure."""

    def __init__(self) -> None:
        super().__init__("The actuator's own loop")
        self.plot = self.add("Elongation", "mm", x_title="Pressure", x_unit="kPa")
        self.curve = self.plot.curve("Elongation", lambda t: t.elongation, gaps=True)

    def show_loops(self, loops: LoopSet) -> None:
        """Draw the loops, where the elongation was read."""
        cycles = range(len(loops.numbers))
        if loops.elongation_mm is None or not cycles:
            self.clear()
            self.show_empty("Elongation over pressure comes with the readings of a complete cycle.")
            return
        self.curve.set(*loops.broken(loops.pressure_kpa, loops.elongation_mm, cycles))
        self.plot.fit()


def _inside(layout: QLayout) -> QWidget:
    """Return a widget that holds `layout` on the ground of its card."""
    widget = widgets.holder(layout)
    widget.setObjectName("inside")
    return widget


class Remarks(QScrollArea):
    """Words under the figures: as high as they are, but never so high that they push the figures away."""

    def __init__(self, words: QLayout) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setAccessibleName("Remarks on this run")
        self.words = _inside(words)
        self.setWidget(self.words)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Ask for the height that the words need at this width."""
        super().resizeEvent(event)
        self.fit()

    def fit(self) -> None:
        """Be as high as the words, or as the most that they may take."""
        needed = self.words.heightForWidth(self.viewport().width())
        self.setFixedHeight(min(max(needed, 0), style.REMARKS_MOST))


class CalibrationPage(QWidget):
    """The calibration page."""

    def __init__(
        self, model: CalibrationModel, show_repeatability: Callable[[RunResult], None], services: Services
    ) -> None:
        super().__init__()
        self.model, self.show_repeatability, self.services = model, show_repeatability, services
        self._revision = -1
        self.curves = [CurveCard(n) for n in range(1, SENSORS + 1)]
        self.loops, self.actuator = LoopCard(), ActuatorCard()
        self.table = FigureTable()
        self.stack = Leaves()
        self.stack.addWidget(
            EmptyState(
                "No run has been analysed yet",
                "Here come each sensor's points and curve with its bands, the hysteresis loops and the figures "
                "with their intervals. Run the calibration plan on the Live page, enter the readings, analyse it here.",
                "Analyse the last run",
                partial(services.notices.attempt, model.analyse_current),
            )
        )
        self.stack.addWidget(self._filled())
        widgets.page_layout(self).addWidget(self.stack)

    def _filled(self) -> QWidget:
        body = QWidget()
        layout = QVBoxLayout(body)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(style.GAP)
        layout.addWidget(self._head())
        self.missing = EmptyState("", "", "Enter readings …", self._next_step)
        self.upper, upper, lower = Leaves(), QHBoxLayout(), QHBoxLayout()
        widgets.grow(self.upper)
        upper.setSpacing(style.GAP)
        lower.setSpacing(style.GAP)
        for card in self.curves:
            upper.addWidget(card, 1)
        for leaf in (widgets.holder(upper), self.missing):
            self.upper.addWidget(leaf)
        lower.addWidget(self.loops, 1)
        lower.addWidget(self.actuator, 1)
        left = QVBoxLayout()
        left.setSpacing(style.GAP)
        left.addWidget(self.upper, 5)
        left.addLayout(lower, 4)
        sides = (widgets.holder(left), self._side())
        layout.addWidget(Divided("calibration", self.services.preferences, *sides, SIDE, stacks=True), 1)
        return body

    def _head(self) -> QWidget:
        frame, inside = widgets.card()
        self.verdict = widgets.label("", "subtitle", elide=True)
        self.headline = widgets.label("", "muted", elide=True)
        self.sample = widgets.button(BANDS, lambda: self.services.notices.attempt(self.model.sample), tip=BANDS_TIP)
        self.accept = widgets.button(ACCEPT, self._accept, "primary", tip=ACCEPT_TIP)
        self.report = widgets.button("Report …", partial(self.services.show, Panel.REPORT))
        self.again = widgets.button("Analyse again", self._again)
        buttons = widgets.row(
            self.again,
            widgets.button("Open …", self._open),
            self.sample,
            self.report,
            self.accept,
        )
        self.head = widgets.row()
        self.head.addLayout(widgets.column(self.verdict, self.headline, spacing=0), 1)
        self.head.addLayout(buttons)
        inside.addLayout(self.head)
        inside.addWidget(self._judgement())
        return frame

    def _judgement(self) -> QWidget:
        """Return the lines under the verdict: what is poor, against which limits, and the way to the readings."""
        self.poor = widgets.label("", wrap=True, name="What is poor about this calibration")
        self.look = widgets.button("Readings …", self._edit_readings, tip="Correct the readings of this run")
        line = QHBoxLayout()
        line.setSpacing(style.GAP)
        line.addWidget(self.poor, 1)
        line.addWidget(self.look, 0, Qt.AlignmentFlag.AlignTop)
        self.judgement = _inside(line)
        self.judgement.hide()
        return self.judgement

    def _accept(self) -> None:
        self.model.request_acceptance(anyway=bool(self.model.poor()))  # its button says so

    def _edit_readings(self) -> None:
        """Show the readings of the run in a panel beside the window."""

        def deed() -> None:
            assert self.model.last_path is not None
            run = ClosedRun(self.model.last_path)
            ClosedReadings(self.window(), run, self.model.analyse, self.services).show()

        self.services.notices.attempt(deed)

    def _next_step(self) -> None:
        """Do what brings what is missing."""
        lacking, result = self.model.missing(), self.model.result
        if lacking is None or result is None:
            return
        if lacking.key == "readings":
            self._edit_readings()
        elif lacking.key == "repeat":
            self.show_repeatability(result)
            self.services.show(Page.REPEAT)
        else:
            self.services.show(Panel.PLAN)

    def _side(self) -> QWidget:
        frame, inside = widgets.card()
        self.tabs = QTabWidget()
        self.tabs.setDocumentMode(True)
        self.tabs.tabBar().setDrawBase(False)
        self.tabs.setAccessibleName("Figures, and the last calibration beside this one")
        self.tabs.tabBar().setAccessibleName("Figures, and the last calibration beside this one")
        self.beside = widgets.read_table("This calibration beside the last one", BESIDE)
        self.comparison = widgets.label("", "small", wrap=True)
        before, words = QWidget(), widgets.column(self.comparison, self.beside, spacing=style.GAP)
        words.setContentsMargins(0, style.GAP, 0, 0)
        words.setStretchFactor(self.beside, 1)
        self.comparison.setAlignment(Qt.AlignmentFlag.AlignTop)
        before.setLayout(words)
        self.tabs.addTab(self.table, "Figures")
        self.tabs.addTab(before, "Against the last")
        inside.addWidget(self.tabs, 1)
        self.posterior = widgets.label("", "small", wrap=True)
        self.flags = widgets.label("", "small", wrap=True)
        self.remarks = Remarks(widgets.column(self.posterior, self.flags))
        inside.addWidget(self.remarks)
        return frame

    def _again(self) -> None:
        path = self.model.last_path
        if path is not None:
            self.services.notices.attempt(lambda: self.model.analyse(path))

    def _open(self) -> None:
        ask_open(self, self.services, "Open a recording", "boat csv", lambda path: self.model.analyse(Path(path)))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the buttons under the verdict where both have no room beside each other."""
        narrow = self.width() < style.STACKED_BELOW
        self.head.setDirection(QBoxLayout.Direction.TopToBottom if narrow else QBoxLayout.Direction.LeftToRight)
        super().resizeEvent(event)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the result where it has changed."""
        if self.model.revision == self._revision:
            return
        self._revision = self.model.revision
        result = self.model.result
        self.again.setEnabled(not self.model.working and self.model.last_path is not None)
        self.stack.setCurrentIndex(0 if result is None and not self.model.working and self.model.failure is None else 1)
        state, words = self.model.verdict()
        self.verdict.setText(words)
        widgets.set_state(self.verdict, state)
        self.headline.setText(self.model.headline())
        obstacle = self.model.obstacle()
        self._show_judgement(obstacle)
        self.sample.setEnabled(result is not None and result.calibrated)
        self.report.setEnabled(result is not None)
        if result is None:
            self._clear()
            return
        for shown in (*self.curves, self.loops, self.actuator):
            shown.show_empty("")
        for i, (card, sensor) in enumerate(zip(self.curves, result.sensors, strict=False)):
            if sensor.x.size:
                card.show_sensor(sensor, self.model.shown(i))
            else:
                card.clear()
                card.show_empty(f"No curve: {sensor.void}.")
        lacking = self.model.missing()
        self.upper.setCurrentIndex(0 if lacking is None else 1)
        if lacking is not None:
            self.missing.say(lacking.title, lacking.words, lacking.action)
        self.loops.show_loops(result.loops)
        self.actuator.show_loops(result.loops)
        self.table.show_rows(result.figures, [sensor_words(s.name) for s in result.sensors])
        self._show_words()

    def _show_judgement(self, obstacle: str) -> None:
        """Say what is poor; what is poor is not the page's one next step, but can be accepted all the same."""
        poor, against = self.model.poor(), self.model.against()
        self.judgement.setVisible(bool(against))
        self.poor.setText("\n".join(against))
        self.look.setVisible(self.model.last_path is not None and self.model.last_path.suffix == ".boat")
        self.accept.setText(ANYWAY if poor else ACCEPT)
        self.accept.setAccessibleName(self.accept.text())
        self.accept.setToolTip(obstacle or (ANYWAY_TIP if poor else ACCEPT_TIP))
        widgets.set_state(self.accept, "" if poor else "primary", "role")
        self.accept.setEnabled(not obstacle and self.model.accepted is None)

    def _clear(self) -> None:
        """Take an earlier run's curves and figures away: none of them is of the run in the head."""
        for card in (*self.curves, self.loops, self.actuator):
            card.clear()
            card.show_empty("Nothing to show yet." if self.model.working else "Nothing to show.")
        self.table.show_rows((), ())
        for words in (self.posterior, self.flags, self.comparison):
            words.clear()
        self.beside.setRowCount(0)
        self.upper.setCurrentIndex(0)
        self.remarks.fit()

    def _show_words(self) -> None:
        result = self.model.result
        assert result is not None
        posterior = [
            f"{sensor_words(s.name)}: {p.verdict}" for s, p in zip(result.sensors, self.model.posterior, strict=False)
        ]
        self.posterior.setText("\n".join(["Uncertainty bands (emcee)", *posterior] if posterior else []))
        self.posterior.setVisible(bool(posterior))
        self.comparison.setText(self.model.comparison())
        rows = self.model.coefficient_rows()
        self.beside.setVisible(bool(rows))
        widgets.fill_table(self.beside, [row.cells for row in rows], [row.hover for row in rows])
        self.flags.setText("\n".join(f"\u25b2 {flag}" for flag in self.model.remarks()))
        self.flags.setVisible(bool(result.warnings))
        self.remarks.fit()
