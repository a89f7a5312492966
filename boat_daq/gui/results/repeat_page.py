"""The repeatability page: one large plot of a figure of every cycle with that of the run, its band and its limit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, Plot, Points, ramp_colour, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.figure_table import SIDE, KeyFigures
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.layouts import Divided, EmptyState, Leaves
from boat_daq.viewmodels.common.services import Panel, Services
from boat_daq.viewmodels.results.figure_tables import DRIFT_KEY, HYSTERESIS_KEY, SENSITIVITY_KEY, SNR_KEY, RunFigure
from boat_daq.viewmodels.results.repeatability import CYCLE_FIGURES, GROUPS, CycleFigure, RepeatabilityModel
from boat_daq.viewmodels.results.run_result import CycleSeries, RunResult
from protocol.base.arrays import FloatArray

SYMBOLS = ("o", "s", "t1", "d")  # by sensor, up to four
_SENSORS = len(SYMBOLS)
FILLED = "\u25cf\u25a0\u25b2\u25c6"  # the same as text
_EMPTY: FloatArray = np.zeros(0)
NO_FIGURE = "No cycle has this figure; the tooltip in the table gives the reason."
CHOOSE = "Choose the plan"
BREAK_HEADINGS = ("", "before", "after", "p (t)", "p (F)")
BREAK_TIPS = {
    3: "Probability of means so far apart if nothing changed (t-test)",
    4: "Probability of standard deviations so different if nothing changed (F-test)",
}


class LoopsByCycle(PlotCard):
    """Loading minus unloading of each sensor over pressure, a plot each; early cycles dark, late ones bright."""

    def __init__(self) -> None:
        super().__init__("Loops by cycle")
        self.groups: list[list[Curve]] = []  # by sensor
        self.limits: list[tuple[Plot, Any]] = []
        self._arrange(1)

    def _arrange(self, sensors: int) -> None:
        for number in range(len(self.plots) + 1, sensors + 1):
            plot = self.add(f"Sensor {number}", "% FSO", x_title="Pressure", x_unit="kPa")
            plot.line(lambda t: t.muted, style_=Qt.PenStyle.SolidLine)
            colours = {f"Sensor {number}, group {i + 1}": ramp_colour(i, GROUPS) for i in range(GROUPS)}
            self.groups.append([plot.curve(name, of, gaps=True, thin=True) for name, of in colours.items()])
        self.link_x()
        self.show_only(self.plots[:sensors])
        self.paint_theme(self.theme)

    def show_groups(self, model: RepeatabilityModel) -> None:
        assert model.result is not None
        loops, sensors = model.result.loops, model.result.sensors
        self.clear()
        self._arrange(len(sensors))
        for plot, line in self.limits:
            plot.remove_line(line)
        self.limits = []
        for i, (plot, curves) in enumerate(zip(self.plots, self.groups, strict=False)):
            for curve, cycles in zip(curves, model.groups(), strict=True):
                known = i < len(sensors)
                curve.set(*(loops.opened(i, sensors[i].cycles.full_scale_mv, cycles) if known else (_EMPTY, _EMPTY)))
            self.limits += limit_lines(plot, sensors[i].cycles.whole) if i < len(sensors) else []
            plot.fit()
        self.readout.setText(f"loading minus unloading, cycles {loops.numbers[0]}\u2013{loops.numbers[-1]}, dark first")


def limit_lines(plot: Plot, whole: Mapping[str, RunFigure]) -> list[tuple[Plot, Any]]:
    """Draw the limit of the hysteresis on both sides of zero; none where there is no limit."""
    found = whole.get(HYSTERESIS_KEY, RunFigure()).limit
    ends = [end for end in (found, -found) if np.isfinite(end)]
    label = f"limit {found:g} % FSO"
    return [(plot, plot.line(lambda t: t.warn, at=at, label=label, style_=Qt.PenStyle.DotLine)) for at in ends]


class CycleFigureCard(PlotCard):
    """A figure of every cycle over its number, all sensors: points, the run's figure with its band, and the limit."""

    def __init__(self) -> None:
        super().__init__("Figure by cycle", show_title=False)
        self.plot = self.add("", "", x_title="Cycle")
        self.bands = [self.plot.band(f"Interval, sensor {n}, 95 %", sensor_colour(n)) for n in range(1, _SENSORS + 1)]
        self.lines = [self.plot.curve(f"Run, sensor {n}", sensor_colour(n)) for n in range(1, _SENSORS + 1)]
        self.sensors = self._points("Sensor {}")
        self.low_ends = self._points("Sensor {}, lowest", filled=False)
        self.marks: list[Any] = []
        self.note = controls.label("", "small", wrap=True, name="What the plot shows")
        self.inside.addWidget(self.note)

    def _points(self, name: str, *, filled: bool = True) -> list[Points]:
        """Return points for each sensor; its number is put into `name`."""
        return [
            self.plot.points(name.format(n), sensor_colour(n), filled=filled, symbol=symbol, size=6)
            for n, symbol in enumerate(SYMBOLS, 1)
        ]

    def show_figure(self, model: RepeatabilityModel, shown: CycleFigure) -> None:
        assert model.result is not None
        self.title = shown.name
        self.show_signals_in(model.result.signal_unit)
        self.plot.clear()
        for mark in self.marks:
            self.plot.remove_line(mark)
        self.marks = []
        sensors, numbers = model.result.sensors, model.numbers()
        unit = sensors[0].cycles.sensitivity_unit if shown.key == SENSITIVITY_KEY else shown.unit
        self.plot.set_title(shown.axis, unit)
        for i, sensor in enumerate(sensors):
            self._show_sensor(i, sensor.cycles, numbers, shown.key)
        limit, text = model.limit(shown)
        if np.isfinite(limit):
            self._mark(self.plot.line(lambda t: t.warn, at=limit, style_=Qt.PenStyle.DotLine))
        for found in model.result.breaks:
            self._mark(self.plot.line(lambda t: t.warn, at=found.at_cycle, vertical=True, label="interrupted"))
        drawn = [n for n, points in enumerate(self.sensors) if points.y.size]
        self.show_empty(model.no_figure(shown) or ("" if drawn else NO_FIGURE))
        names = [f"{FILLED[n]} sensor {n + 1}" for n in drawn]
        self.readout.setText("  ".join([*names, f"\u2508 {text}"] if text and drawn else names))
        self.plot.fit(also_y=() if not np.isfinite(limit) else (limit,))
        line = any(layer.y.size > 1 for layer in self.lines)
        band = any(layer.y.size > 1 and self.plot.is_seen(layer.y - layer.low) for layer in self.bands)
        controls.set_text(self.note, model.note(shown, line=line, band=band) if drawn else "")

    def _mark(self, line: Any) -> None:
        self.marks.append(line)

    def _show_sensor(self, i: int, each: CycleSeries, numbers: FloatArray, key: str) -> None:
        if key == DRIFT_KEY:
            low, high = each.ends if each.ends.size else (_EMPTY, _EMPTY)
            self._set(self.low_ends[i], numbers, low)
            self._set(self.sensors[i], numbers, high)
            line, *band = each.drift_line(numbers)
        else:
            per_cycle = {SENSITIVITY_KEY: each.sensitivity, SNR_KEY: each.snr_db}
            self._set(self.sensors[i], numbers, per_cycle.get(key, each.hysteresis_percent_fso))
            found = each.whole.get(key, RunFigure())
            comparable = key != SENSITIVITY_KEY or each.sensitivity_unit == "mV/mm"
            values = (found.value, found.low, found.high) if comparable else (np.nan,) * 3
            line, *band = (np.full(numbers.size, value) for value in values)
        if np.isfinite(line).all():
            self.lines[i].set(numbers, line)
        if np.isfinite(band).all():
            self.bands[i].fill(numbers, *band)

    @staticmethod
    def _set(points: Points, numbers: FloatArray, values: FloatArray) -> None:
        known = np.isfinite(values)  # cycles that have the figure
        points.set(numbers[: values.size][known], values[known])


class RepeatPage(QWidget):
    def __init__(self, model: RepeatabilityModel, choose_plan: Callable[[], None], services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._revision = -1
        self.verdict = controls.label("", "title", wrap=True, name="Verdict")
        self.headline = controls.label("", "muted", elide=True)
        self.warm_up = controls.label("", "muted")
        self.known = controls.label("", "muted", name="Uncertainty of drift and repeatability", wrap=True)
        self.loops, self.card = LoopsByCycle(), CycleFigureCard()
        names = [(shown.name, shown) for shown in CYCLE_FIGURES]
        self.figure = controls.choice("Figure", [*names, ("Loops by cycle", None)], lambda _: self._draw())
        self.drawn = Leaves(self.card, self.loops)
        self.figures = KeyFigures("repeat", services.preferences)
        self.table = self.figures.table
        self.break_texts = controls.label("", "small", wrap=True)
        self.tests = DataTable("Both sides of each interruption compared", BREAK_HEADINGS)
        self.tests.explain(BREAK_TIPS)
        self.breaks = controls.inside(controls.column(style.GAP, self.break_texts, (self.tests, 1), spacing=style.GAP))
        self.missing = EmptyState(*model.missing(), CHOOSE, choose_plan)
        self.stack = Leaves(self.missing, self._filled())
        controls.page_layout(self).addWidget(self.stack)

    def _filled(self) -> QWidget:
        report = controls.button("Report \u2026", partial(self.services.show, Panel.REPORT))
        run = controls.row(self.headline, self.warm_up, None)
        texts = controls.column(self.verdict, run, spacing=0)
        line = controls.row((texts, 1), controls.label("Figure", "muted"), self.figure, report)
        head, _ = controls.card(line, self.known)
        self.tabs = controls.tabs("Figures, and the interruptions of the run", (self.figures, "Figures"))
        self.tabs.setTabBarAutoHide(True)
        side, _ = controls.card((self.tabs, 1))
        sides = Divided(
            "repeat",
            self.services.preferences,
            self.drawn,
            side,
            SIDE,
            stacks=True,
            stacked_height=style.STACKED_HEIGHT,
        )
        sides.restacked.connect(self.table.stack)
        return controls.holder(controls.column(head, (sides, 1), spacing=style.GAP))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        model = self.model
        if model.revision == self._revision:
            return
        self._revision = model.revision
        result = model.result
        title, text = model.missing()
        self.stack.setCurrentIndex(0 if title else 1)
        if title:
            self.missing.say(title, text, "" if model.loading else CHOOSE)
        state, verdict = model.verdict()
        self.verdict.setText(verdict)
        self.verdict.setVisible(bool(verdict))
        controls.set_state(self.verdict, state)
        self.headline.setText(model.headline)
        self.warm_up.setText(model.warm_up())
        self.known.setText(model.known())
        self.known.setVisible(bool(self.known.text()))
        if result is None or not result.cycles:
            return
        self._draw()
        self._show_breaks(result)
        self.figures.show_figures(result.key_figures, result.figures, [sensor.label for sensor in result.sensors])

    def _draw(self) -> None:
        result, shown = self.model.result, self.figure.currentData()
        if result is None or not result.cycles:
            return
        self.drawn.setCurrentWidget(self.loops if shown is None else self.card)
        if shown is None:
            self.loops.show_groups(self.model)
        else:
            self.card.show_figure(self.model, shown)

    def _show_breaks(self, result: RunResult) -> None:
        """Show the tests across each interruption in a tab of their own."""
        self.break_texts.setText("\n".join(found.sentence for found in result.breaks))
        self.tests.fill([row for found in result.breaks for row in found.rows])
        at = self.tabs.indexOf(self.breaks)
        if result.breaks and at < 0:
            self.tabs.addTab(self.breaks, "Interruptions")
        elif not result.breaks and at >= 0:
            self.tabs.removeTab(at)
            self.breaks.setParent(None)
