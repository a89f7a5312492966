"""The calibration page: curves with bands and residuals, loops, figures, posterior, comparison, acceptance."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QGridLayout, QLayout, QScrollArea, QWidget

from analysis.calibration.compare import Agreement
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, Plot, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.certificate_panel import CertificatePanel
from boat_daq.gui.results.closed_readings import ClosedReadings
from boat_daq.gui.results.figure_table import SIDE, FigureTable, KeyFigures
from boat_daq.gui.results.repeat_page import limit_lines
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.gui.widgets.layouts import Divided, EmptyState, Leaves, Shares
from boat_daq.viewmodels.common.services import Page, Panel, Services, Tab
from boat_daq.viewmodels.results.calibration import ACCEPT, ANYWAY, CURVE_CHOICES, CalibrationModel
from boat_daq.viewmodels.results.calibration_texts import NextStep, missing, warnings
from boat_daq.viewmodels.results.run_result import CurveBands, RunResult, SensorResult
from protocol.base.arrays import FloatArray

_BESIDE = 2  # curves in a row
_MOST_LOOPS = 10  # that are drawn over each other: of more, one sensor would cover the other
_ROUND_POINTS = 1.1  # height of the residuals: their largest is a whole circle
VERDICT_EXAMPLE = "\u25b2 U = 0.13 mm (k = 2) from -2.5 to 4.0 mm; 1 reading to check"
BANDS = "Uncertainty bands"
BANDS_TIP = "Bands that include the grid of the readings, by sampling (emcee); takes a while, in the background"
BANDS_SHOWN = "Bands: 68 % and 95 % of the curve; the widest, once sampled (emcee), 95 % of a new reading"
EXPORT_TIP = "For other programs: JSON, C header, MATLAB or Octave function, or table"
ACCEPT_TIP = "Store it with the unit and use it live"
IN_FORCE_TIP = "This calibration is in force"
ANYWAY_TIP = "Store it with the unit, marked as out of tolerance, and use it live"
_SYSTEM_TIP = "Loading minus unloading over pressure: each sensor on its actuator (the system); below, the actuator"
_ANALYSE_LAST = "Analyse the last run"
_NO_CYCLE = "A loop needs one complete cycle."
_LINES = (Qt.PenStyle.SolidLine, Qt.PenStyle.DashLine, Qt.PenStyle.DashDotLine, Qt.PenStyle.DotLine)  # by sensor
_LINE_TEXTS = ("\u2014", "- -", "-\u00b7-", "\u00b7\u00b7\u00b7")  # the same as text
_BRANCHES = (("Loading", "Residual, loading", True), ("Unloading", "Residual, unloading", False))
CERTIFICATE_TIP = "Certificate as PDF and XML: enter what is missing, look at the pages, save"
CHOICE_TIP = "Curve of all sensors; cross-validation takes the simplest that predicts best"
CURVE_TIPS = {
    1: "Whether the curve follows the readings within their scatter",
    2: "Expanded uncertainty (k = 2) of an elongation in the middle of the range",
    3: "Cross-validation: rms error of predicting each position from the others",
}
COMPARED = ("", "now", "previous", "E\u2099")


class CurveCard(PlotCard):
    """One sensor: points by branch, curve with bands, the unit's previous curve, residuals."""

    def __init__(self, number: int) -> None:
        super().__init__(f"Sensor {number}", BANDS_SHOWN)
        self.heading.least = style.PANE_WIDTH
        colour = sensor_colour(number)
        self.top = self.add("Signal", "mV", stretch=3)
        self.bottom = self.add("Residual", "mV", x_title="Elongation", x_unit="mm", stretch=1)
        self.link_x()
        self.wide = self.top.band("Band of a new reading, 95 %", colour, alpha=style.BAND_ALPHA_WIDE)
        self.bands = [self.top.band(f"Band of the curve, {p} %", colour) for p in (95, 68)]
        dashed = Qt.PenStyle.DashLine
        self.previous = self.top.curve("Previous calibration", lambda t: t.target, pen_style=dashed)
        self.curve = self.top.curve("Calibration", colour)
        self.difference = self.bottom.curve(
            "Previous calibration less this one", lambda t: t.target, pen_style=Qt.PenStyle.DashLine
        )
        self.residual_bands = [self.bottom.band(f"Band of the curve about itself, {p} %", colour) for p in (95, 68)]
        self.bottom.line(lambda t: t.muted, style_=Qt.PenStyle.SolidLine)
        self.branches = [
            (self.top.points(name, colour, filled=filled), self.bottom.points(residual, colour, filled=filled, size=6))
            for name, residual, filled in _BRANCHES
        ]

    def show_sensor(self, sensor: SensorResult, shown: CurveBands, previous: Agreement | None) -> None:
        """Draw a sensor's points, its curve with its bands, and the unit's previous one."""
        for branch, (points, residuals) in zip((sensor.loading, ~sensor.loading), self.branches, strict=True):
            points.set(sensor.x[branch], sensor.y[branch])
            residuals.set(sensor.x[branch], shown.residuals[branch])
        self.curve.set(shown.grid, shown.curve)
        bands = zip(self.bands, self.residual_bands, (shown.band_95, shown.band_68), strict=True)
        for above, below, (low, high) in bands:
            above.fill(shown.grid, low, high)
            below.fill(shown.grid, low - shown.curve, high - shown.curve)
        self.wide.show(shown.new_reading_95 is not None)
        if shown.new_reading_95 is not None:
            self.wide.fill(shown.grid, *shown.new_reading_95)
        for curve in (self.previous, self.difference):
            curve.show(previous is not None)
        if previous is not None:
            self.previous.set(previous.grid, previous.before_mv)
            self.difference.set(previous.grid, -previous.difference_mv)
        source = "fit" if shown.new_reading_95 is None else "emcee"
        legend = f"bands 68 %, 95 % ({source})" if previous is None else "\u2504 previous"
        self.readout.setText(f"\u25cf loading \u25cb unloading  {legend}")
        self.top.fit()
        largest = _ROUND_POINTS * float(abs(shown.residuals).max(initial=0.0))
        self.bottom.fit(also_y=(-largest, largest))  # ticks on either side of zero


class LoopCard(PlotCard):
    """Loading minus unloading over pressure in all cycles: sensors in one plot, the actuator below, with the limit.

    A loop of some per cent over its full range would be a line.
    """

    def __init__(self) -> None:
        super().__init__("Hysteresis, system", _SYSTEM_TIP)
        self.sensors = self.add("Sensors", "% FSO", x_title="Pressure", x_unit="kPa", stretch=3)
        self.actuator = self.add("Actuator", "% span", x_title="Pressure", x_unit="kPa", stretch=2)
        self.link_x()
        for plot in self.plots:
            plot.line(lambda t: t.muted, style_=Qt.PenStyle.SolidLine)
        self.curves: list[Curve] = []
        self.elongation = self.actuator.curve("Actuator", lambda t: t.elongation, gaps=True)
        self.limits: list[tuple[Plot, Any]] = []

    def show_loops(self, result: RunResult) -> None:
        """Draw all cycles of each sensor, and of the elongation where it was read."""
        for plot, line in self.limits:
            plot.remove_line(line)
        self.limits = []
        self.clear()
        self.show_empty("" if result.cycles else _NO_CYCLE)
        if not result.cycles:
            return
        for n in range(len(self.curves) + 1, len(result.sensors) + 1):
            self.curves.append(self.sensors.curve(f"Sensor {n}", sensor_colour(n), gaps=True))
        cycles = result.loops.spread(_MOST_LOOPS)
        for i, (curve, sensor) in enumerate(zip(self.curves, result.sensors, strict=False)):
            curve.set(*result.loops.opened(i, sensor.cycles.full_scale_mv, cycles))
        x, y = result.loops.actuator_opened(cycles)
        self.elongation.set(x, y)
        self.show_only(self.plots if x.size else [self.sensors])
        self.limits = limit_lines(self.sensors, result.sensors[0].cycles.whole) if result.sensors else []
        n, of = len(cycles), len(result.loops.numbers)
        self.readout.setText(f"loading minus unloading{f', {n} of {of} cycles' if n < of else ''}")
        self.paint_theme(self.theme)
        for plot in self.plots:
            plot.fit()


class UncertaintyCard(PlotCard):
    """Expanded uncertainty of an elongation over the calibrated range, a line for each sensor."""

    def __init__(self) -> None:
        super().__init__("Uncertainty of an elongation", "U = 2 u of one reading by each sensor, over its range")
        self.plot = self.add("U, k = 2", "mm", x_title="Elongation", x_unit="mm")
        self.lines: list[Curve] = []

    def show_uncertainty(self, of_sensors: Sequence[FloatArray]) -> None:
        """Draw U of each sensor that gives an elongation."""
        if not any(u.size for u in of_sensors):
            self.clear()
            self.show_empty("No curve gives an elongation.")
            return
        for n in range(len(self.lines) + 1, len(of_sensors) + 1):
            look = _LINES[(n - 1) % len(_LINES)]
            self.lines.append(self.plot.curve(f"Sensor {n}", sensor_colour(n), gaps=True, pen_style=look))
            self.lines[-1].paint(self.theme)
        self.plot.clear()
        for line, u in zip(self.lines, of_sensors, strict=False):
            line.set(u[:, 0], u[:, 1])
        drawn = (i for i, u in enumerate(of_sensors) if u.size)
        self.readout.setText("  ".join(f"{_LINE_TEXTS[i % len(_LINES)]} sensor {i + 1}" for i in drawn))
        self.plot.fit()


class TextArea(QScrollArea):
    """Texts under the figures: as high as they are, up to a limit that leaves the figures their height."""

    def __init__(self, texts: QLayout) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setAccessibleName("Warnings of this run")
        self.texts = controls.inside(texts)
        self.setWidget(self.texts)

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self.fit()

    def fit(self) -> None:
        needed = self.texts.heightForWidth(self.viewport().width())
        most = style.REMARKS_MOST + max(self.window().height() - style.REMARKS_GROW, 0)
        self.setFixedHeight(min(max(needed, 0), most))


class CalibrationPage(QWidget):
    def __init__(self, model: CalibrationModel, services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._revision, self._step = -1, NextStep.NONE
        self._looked: tuple[object, ...] = ()  # when it was last looked for a last run
        self.curves: list[CurveCard] = []
        self.curve_grid = QGridLayout()
        self.curve_grid.setSpacing(style.GAP)
        self._add_cards(_BESIDE)
        self.loops = LoopCard()
        self.uncertainty = UncertaintyCard()
        self.figures = KeyFigures("results", services.preferences)
        self.table = self.figures.table
        self.empty = EmptyState("", "", _ANALYSE_LAST, self._begin)
        self.stack = Leaves(self.empty, self._filled())
        controls.page_layout(self).addWidget(self.stack)

    @property
    def plots(self) -> tuple[PlotCard, ...]:
        return (*self.curves, self.loops, self.uncertainty)

    def _add_cards(self, sensors: int) -> None:
        """Add the cards that are missing, two in a row."""
        for i in range(len(self.curves), sensors):
            card = CurveCard(i + 1)
            self.curve_grid.addWidget(card, i // _BESIDE, i % _BESIDE)
            self.curves.append(card)
            if i >= _BESIDE:
                card.paint_theme(self.curves[0].theme)

    def _show_sensors(self, sensors: int) -> None:
        self._add_cards(sensors)
        for i, card in enumerate(self.curves):
            card.setVisible(i < sensors)

    def _filled(self) -> QWidget:
        self.missing = EmptyState("", "", "Enter readings \u2026", self._next_step)
        self.upper = Leaves(controls.holder(self.curve_grid), self.missing)
        controls.grow(self.upper)
        left = Shares("curves", self.services.preferences, (self.upper, 5), (self.loops, 4))
        figures = self._side()
        sides = Divided("calibration", self.services.preferences, left, figures, SIDE, stacks=True)
        sides.restacked.connect(self.table.stack)
        sides.restacked.connect(lambda stacked: sides.insertWidget(int(not stacked), figures))  # above the curves
        return controls.holder(controls.column(self._head(), (sides, 1), spacing=style.GAP))

    def _head(self) -> QWidget:
        self.verdict = controls.label("", "title", wrap=True, name="Verdict")
        self.detail = controls.label("", wrap=True, name="Limits, and where the calibration is used")
        self.headline = controls.label("", "muted", elide=True)
        self.more = controls.menu_button("More \u25be", "Analyse again, open another run, sample the uncertainty bands")
        self.again = self.more.menu().addAction("Analyse again", self._again)
        self.more.menu().addAction("Open \u2026", self._open)
        self.sample = self.more.menu().addAction(BANDS, partial(self.services.notices.attempt, self.model.sample))
        self.sample.setToolTip(BANDS_TIP)
        self.more.menu().setToolTipsVisible(True)
        self.report = controls.button("Report \u2026", partial(self.services.show, Panel.REPORT))
        self.certificate = controls.button("Certificate …", self.show_certificate, tip=CERTIFICATE_TIP)
        self.accept = controls.button(ACCEPT, self._accept, "primary", tip=ACCEPT_TIP)
        self.buttons = controls.row(self.more, self.report, self.certificate, self.accept)
        self.head = controls.row(
            (controls.column(self.verdict, self.detail, self.headline, spacing=0), 1), self.buttons
        )
        return controls.card(self.head, self._check(), self._warnings())[0]

    def _open(self) -> None:
        ask_open(self, self.services, "Open a recording or a table", "boat csv", self.services.open)

    def _check(self) -> QWidget:
        """Return the line with the readings to be checked and the three ways to settle them."""
        self.to_check = controls.label("", wrap=True, name="Readings to be checked")
        self.correct = controls.button("Correct \u2026", self._edit_readings, tip="Type what the grid shows")
        leave = partial(self.services.notices.attempt, self.model.leave_out_readings)
        self.leave_out = controls.button("Leave out", leave, tip="Withdraw it from the curve (undo: Ctrl+Z)")
        hint = "Reason, such as: read again"
        self.reason = controls.field("Reason to keep the reading", on_enter=self._confirm, placeholder=hint)
        self.reason.setFixedWidth(style.PANE_WIDTH_NARROW)
        self.confirm = controls.button("Confirm", self._confirm, tip="Keep it; the reason is stored with the reading")
        ways = controls.row(self.correct, self.leave_out, self.reason, self.confirm, None)
        self.check_line = controls.inside(controls.column(self.to_check, ways))
        self.check_line.hide()
        return self.check_line

    def _confirm(self) -> None:
        if self.services.notices.attempt(lambda: self.model.confirm_readings(self.reason.text())):
            self.reason.clear()

    def _warnings(self) -> QWidget:
        """Return the lines under the verdict: what is out of tolerance, and the button to the readings."""
        self.warnings = controls.label("", wrap=True, name="Warnings of this calibration")
        self.readings = controls.button("Readings \u2026", self._edit_readings, tip="Correct the readings of this run")
        line = controls.row((self.warnings, 1), self.readings)
        line.setAlignment(self.readings, Qt.AlignmentFlag.AlignTop)
        self.warnings_line = controls.inside(line)
        self.warnings_line.hide()
        return self.warnings_line

    def _accept(self) -> None:
        self.model.request_acceptance(anyway=bool(self.model.out_of_tolerance()))  # as the button reads

    def show_certificate(self) -> None:
        self.services.notices.attempt(
            lambda: CertificatePanel(self.window(), self.model.certificate(), self.services).show()
        )

    def ask_export(self) -> None:
        result = self.model.result
        stem = f"{result.unit} calibration" if result is not None else "calibration"
        ask_save(self, self.services, stem, "json h m csv", self.model.export, done="")

    def _edit_readings(self) -> None:
        path = self.model.last_path
        assert path is not None
        self.services.notices.attempt(
            lambda: ClosedReadings(
                self.window(), path, self.model.analyse, self.services, self.loops.theme.units
            ).show()
        )

    def _next_step(self) -> None:
        if self._step is NextStep.ENTER_READINGS:
            self._edit_readings()
        elif self._step is NextStep.CHOOSE_READINGS:
            ask_open(self, self.services, "Choose the file of readings", "csv", self.model.take_readings)
        elif self._step is NextStep.SHOW_REPEATABILITY:
            self.services.show(Tab.REPEATABILITY)
        else:
            self.services.show(Panel.PLAN)

    def _side(self) -> QWidget:
        self.coefficients = DataTable(
            "Coefficients of this calibration and the previous one", COMPARED, right=(1, 2, 3)
        )
        self.comparison = controls.label("", "small", wrap=True)
        self.comparison.setAlignment(Qt.AlignmentFlag.AlignTop)
        compared = controls.column(style.GAP, self.comparison, (self.coefficients, 1), spacing=style.GAP)
        self.budget = FigureTable("Uncertainty of an elongation, and the published limits; sources as tooltips")
        self.traced = controls.label("", "small", wrap=True, name="Traceability, and where U is given")
        parts = (self.uncertainty, 2), self.traced, (self.budget, 3)
        uncertainty = controls.inside(controls.column(*parts, spacing=style.GAP))
        others = (self._curve_tab(), "Curve"), (controls.inside(compared), "Previous")
        pages = (self.figures, "Figures"), (uncertainty, "Uncertainty"), *others
        self.tabs = controls.tabs("Figures, and the comparison with the previous calibration", *pages)
        self.posterior = controls.label("", "small", wrap=True)
        self.run_warnings = controls.label("", "small", wrap=True)
        self.texts = TextArea(controls.column(self.posterior, self.run_warnings))
        return controls.card((self.tabs, 1), self.texts)[0]

    def _curve_tab(self) -> QWidget:
        self.choice = controls.choice("Curve of the calibration", CURVE_CHOICES, self._choose_curve, tip=CHOICE_TIP)
        self.candidates = DataTable("Curves compared", self.model.curve_headings(), stretched=0, right=(2, 3))
        self.candidates.explain(CURVE_TIPS)
        self.export = controls.button("Export calibration \u2026", self.ask_export, tip=EXPORT_TIP)
        line = controls.row(controls.label("Curve"), self.choice, None, self.export)
        return controls.inside(controls.column(style.GAP, line, (self.candidates, 1), spacing=style.GAP))

    def _choose_curve(self, name: str) -> None:
        self.services.notices.attempt(lambda: self.model.choose_curve(name))

    def _again(self) -> None:
        path = self.model.last_path
        if path is not None:
            self.services.notices.attempt(lambda: self.model.analyse(path))

    def resizeEvent(self, event: QResizeEvent) -> None:
        self._fit_head()
        self.texts.fit()
        super().resizeEvent(event)

    def _fit_head(self) -> None:
        """Put the buttons under the verdict where they would cut that of two sensors; a result moves no button."""
        texts = self.verdict.fontMetrics().horizontalAdvance(VERDICT_EXAMPLE)
        margins = 2 * (style.PAGE_MARGIN + style.CARD_PADDING) + self.head.spacing()
        beside = texts + self.buttons.sizeHint().width() + margins <= self.width()
        self.head.setDirection(QBoxLayout.Direction.LeftToRight if beside else QBoxLayout.Direction.TopToBottom)

    def _begin(self) -> None:
        if self.model.failure is not None:
            self.services.show(Page.RECORDINGS)
        elif self.model.no_last_run():
            self.services.show(Page.MEASURE)
        else:
            self.services.notices.attempt(self.model.analyse_current)

    def _say_why_empty(self) -> None:
        if self.model.failure is not None:
            self.empty.say(self.model.verdict()[1], self.model.headline(), "Go to Recordings")
            return
        why = self.model.no_last_run()
        text = why or "Its curves, loops and figures appear here."
        self.empty.say("No run has been analysed yet", text, "Go to Measure" if why else _ANALYSE_LAST)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        looked = self.model.revision, snapshot.state, snapshot.link, snapshot.simulated, snapshot.recording
        if self.model.result is None and not self.model.working and looked != self._looked:
            self._looked = looked  # the last run is looked for in a folder of any number of recordings
            self._say_why_empty()
        if self.model.revision == self._revision:
            return
        self._revision = self.model.revision
        result = self.model.result
        self.again.setEnabled(not self.model.working and self.model.last_path is not None)
        self.stack.setCurrentIndex(0 if result is None and not self.model.working else 1)
        state, verdict = self.model.verdict()
        self.verdict.setText(verdict)
        controls.set_state(self.verdict, state)
        self.detail.setText(self.model.detail())
        controls.set_state(self.detail, self.model.limits_state())
        self.detail.setVisible(bool(self.detail.text()))
        self.headline.setText(self.model.headline())
        self._show_acceptance()
        self.choice.setCurrentIndex(self.choice.findData(self.model.curve_shown))
        controls.allow(self.choice, "" if result is not None else "No run is analysed yet.")
        self.sample.setEnabled(self.model.samples())
        self.report.setEnabled(result is not None)
        self.export.setEnabled(self.model.exports())
        self.certificate.setEnabled(result is not None and result.calibrated)
        if result is None:
            self._clear()
            return
        self._show_sensors(len(result.sensors))
        for shown in self.plots:
            shown.show_empty("")
        for i, (card, sensor) in enumerate(zip(self.curves, result.sensors, strict=False)):
            card.show_signals_in(result.signal_unit)
            curve = self.model.curve(i)
            if curve is not None:
                card.show_sensor(sensor, curve, self.model.agreement(i))
            else:
                card.clear()
                card.show_empty(f"No curve: {sensor.void}.")
        lacking = missing(result)
        self.upper.setCurrentIndex(0 if lacking is None else 1)
        if lacking is not None:
            self._step = lacking.step
            self.missing.say(lacking.title, lacking.text, lacking.step.value)
        self.loops.show_loops(result)
        labels = [sensor.label for sensor in result.sensors]
        self.uncertainty.show_uncertainty(result.u_elongation)
        self.figures.show_figures(result.key_figures, result.figures, labels)
        self.budget.show_rows(result.uncertainty, labels)
        self.traced.setText(self.model.uncertainty_text())
        curves = self.model.curve_rows()
        self.candidates.setHorizontalHeaderLabels(self.model.curve_headings())
        self.candidates.fill([cells for cells, _ in curves], [tip for _, tip in curves])
        self._show_texts(result)

    def _show_acceptance(self) -> None:
        """Show the warnings of the curves; out of tolerance, acceptance is possible but not the primary action."""
        missed, lines, obstacle = self.model.out_of_tolerance(), self.model.acceptance_warnings(), self.model.obstacle()
        checks = self.model.check_lines()
        self.check_line.setVisible(bool(checks) and not self.model.working)
        self.to_check.setText("\n".join(checks))
        every = " all" if len(self.model.to_check()) > 1 else ""
        self.leave_out.setText(f"Leave out{every}")
        self.confirm.setText(f"Confirm{every}")
        self.warnings_line.setVisible(bool(lines))
        self.warnings.setText("\n".join(lines))
        self.readings.setVisible(self.model.last_path is not None and self.model.last_path.suffix == ".boat")
        self.accept.setText(ANYWAY if missed else ACCEPT)
        self.accept.setAccessibleName(self.accept.text())
        done = self.model.accepted is not None
        self.accept.setToolTip(IN_FORCE_TIP if done else str(obstacle or (ANYWAY_TIP if missed else ACCEPT_TIP)))
        controls.set_state(self.accept, "" if missed or done else "primary", "role")
        self.accept.setEnabled(obstacle is None and not done)

    def _clear(self) -> None:
        """Remove the curves and figures of the run before."""
        for card in self.plots:
            card.clear()
            card.show_empty("Loading \u2026")
        self.figures.show_figures((), (), ())
        self.budget.show_rows((), ())
        for label in (self.posterior, self.run_warnings, self.comparison, self.traced):
            label.clear()
        for rows in (self.coefficients, self.candidates):
            rows.setRowCount(0)
        self.upper.setCurrentIndex(0)
        self.texts.fit()

    def _show_texts(self, result: RunResult) -> None:
        verdicts = {True: "converged", False: "NOT CONVERGED"}
        posterior = [
            f"{s.label}: {verdicts[p.sampler['converged']]}, {p.sampler['n_eff']:.0f} independent samples, bands "
            f"\u00b1{p.sampler['band_error_percent_fso']:.2g} % FSO by sampling"
            for s, p in zip(result.sensors, self.model.posterior, strict=False)
        ]
        lines = ["Uncertainty bands (emcee)", *posterior] if posterior else []
        self.posterior.setText("\n".join(lines))
        self.posterior.setVisible(bool(lines))
        self.comparison.setText(self.model.comparison())
        rows = self.model.coefficient_rows()
        self.coefficients.setVisible(bool(rows))
        self.coefficients.fill([cells for cells, _ in rows], [tip for _, tip in rows])
        self.run_warnings.setText("\n".join(f"\u25b2 {warning}" for warning in warnings(result)))
        self.run_warnings.setVisible(bool(result.warnings))
        self.texts.fit()
