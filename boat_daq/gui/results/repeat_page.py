"""The repeatability page: loops coloured by cycle; drift, hysteresis, sensitivity and SNR of every cycle."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from PySide6.QtWidgets import QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, Points, ramp_colour, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.figure_table import SIDE, FigureTable
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.layouts import Divided, EmptyState, Leaves, Shares
from boat_daq.viewmodels.common.services import Panel, Services
from boat_daq.viewmodels.results.repeatability import GROUPS, RepeatabilityModel
from boat_daq.viewmodels.results.run_result import RunResult

SYMBOLS = ("o", "s", "t1", "d")  # by sensor, up to four
FILLED, _OPEN = "\u25cf\u25a0\u25b2\u25c6", "\u25cb\u25a1\u25b3\u25c7"  # the same as text
NO_FIGURE = "No cycle has this figure; the tooltip in the table gives the reason."
BREAK_HEADINGS = ("", "before", "after", "p (t)", "p (F)")
BREAK_TIPS = {
    3: "Probability of means so far apart if nothing changed (t-test)",
    4: "Probability of standard deviations so different if nothing changed (F-test)",
}


class LoopsByCycle(PlotCard):
    """The loops of each sensor over pressure, one plot below the other; early cycles dark, late ones bright."""

    def __init__(self) -> None:
        super().__init__("Loops by cycle")
        self.groups: list[list[Curve]] = []  # by sensor
        self._arrange(1)

    def _arrange(self, sensors: int) -> None:
        """Show the plots of so many sensors."""
        for number in range(len(self.plots) + 1, sensors + 1):
            plot = self.add(f"Sensor {number}", "mV", x_title="Pressure", x_unit="kPa")
            names = [f"Sensor {number}, group {i + 1}" for i in range(GROUPS)]
            self.groups.append([plot.curve(name, ramp_colour(i, GROUPS), gaps=True) for i, name in enumerate(names)])
        self.link_x()
        self.show_only(self.plots[:sensors])
        self.paint_theme(self.theme)

    def show_groups(self, model: RepeatabilityModel) -> None:
        """Draw the groups of cycles of each sensor."""
        assert model.result is not None
        loops = model.result.loops
        self.clear()
        self._arrange(len(loops.signal_mv))
        for plot, curves, signal_mv in zip(self.plots, self.groups, loops.signal_mv, strict=False):
            for curve, cycles in zip(curves, model.groups(), strict=True):
                curve.set(*loops.broken(loops.pressure_kpa, signal_mv, cycles))
            plot.fit()
        self.readout.setText(f"cycles {loops.numbers[0]}\u2013{loops.numbers[-1]}, dark first")


class CycleFigureCard(PlotCard):
    """A figure of every cycle over its number, all sensors."""

    def __init__(self, title: str, axis: str, unit: str) -> None:
        super().__init__(title)
        self.plot = self.add(axis, unit, x_title="Cycle")
        self.sensors = self.points("Sensor {}")

    def points(self, name: str, *, filled: bool = True) -> list[Points]:
        """Add points for each sensor; its number is put into `name`."""
        return [
            self.plot.points(name.format(n), sensor_colour(n), filled=filled, symbol=symbol, size=6)
            for n, symbol in enumerate(SYMBOLS, 1)
        ]

    def explain_symbols(self, sensors: int) -> None:
        """Name the symbols of so many sensors."""
        self.readout.setText("  ".join(f"{symbol} {n}" for n, symbol in enumerate(FILLED[:sensors], 1)))

    def frame(self) -> None:
        """Show all points, or that no cycle has this figure."""
        self.show_empty("" if any(layer.y.size for layer in self.plot.layers) else NO_FIGURE)
        self.plot.fit()


class DriftCard(CycleFigureCard):
    """The change of the signal at the highest and at the lowest level of every cycle."""

    def __init__(self) -> None:
        super().__init__("Drift", "Change", "mV")
        self.low_ends = self.points("Sensor {}, lowest", filled=False)

    def explain_symbols(self, sensors: int) -> None:
        """Name the symbols of the two levels; the colours are those of the other cards."""
        self.readout.setText(f"{FILLED[:sensors]} high  {_OPEN[:sensors]} low")


class RepeatPage(QWidget):
    """The repeatability page."""

    def __init__(self, model: RepeatabilityModel, choose_plan: Callable[[], None], services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._revision = -1
        self.headline = widgets.label("", "subtitle", elide=True)
        self.warm_up = widgets.label("", "muted")
        self.known = widgets.label("", "muted", name="Uncertainty of drift and repeatability", wrap=True)
        self.loops = LoopsByCycle()
        self.drift = DriftCard()
        self.hysteresis = CycleFigureCard("Hysteresis", "Per cycle", "% FSO")
        self.sensitivity = CycleFigureCard("Sensitivity", "Per cycle", "mV/mm")
        self.snr = CycleFigureCard("SNR", "Per cycle", "dB")
        self.figures = (self.drift, self.hysteresis, self.sensitivity, self.snr)
        self.table = FigureTable()
        self.break_texts = widgets.label("", "small", wrap=True)
        self.tests = DataTable("Both sides of each interruption compared", BREAK_HEADINGS)
        self.tests.explain(BREAK_TIPS)
        self.breaks = widgets.inside(widgets.column(style.GAP, self.break_texts, (self.tests, 1), spacing=style.GAP))
        self.break_lines: list[tuple[CycleFigureCard, Any]] = []
        self.missing = EmptyState(*model.missing(), "Choose the plan", choose_plan)
        self.stack = Leaves(self.missing, self._filled())
        widgets.page_layout(self).addWidget(self.stack)

    def _filled(self) -> QWidget:
        report = widgets.button("Report \u2026", partial(self.services.show, Panel.REPORT))
        parts = self.headline, self.warm_up, None, report
        head, _ = widgets.card(widgets.row(*parts), self.known)
        keep = self.services.preferences
        columns = ((self.drift, self.sensitivity), (self.hysteresis, self.snr))
        halves = [Shares(f"repeat {i}", keep, *((card, 1) for card in cards)) for i, cards in enumerate(columns)]
        left = Shares("repeat", keep, (self.loops, 4), *((half, 3) for half in halves), beside=True)
        self.tabs = widgets.tabs("Figures, and the interruptions of the run", (self.table, "Figures"))
        self.tabs.setTabBarAutoHide(True)
        side, _ = widgets.card((self.tabs, 1))
        sides = Divided("repeat", self.services.preferences, left, side, SIDE, stacks=True)
        return widgets.holder(widgets.column(head, (sides, 1), spacing=style.GAP))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the result where it has changed."""
        model = self.model
        if model.revision == self._revision:
            return
        self._revision = model.revision
        result = model.result
        title, text = model.missing()
        self.stack.setCurrentIndex(0 if title else 1)
        if title:
            self.missing.say(title, text, self.missing.button.text())
        self.headline.setText(model.headline)
        self.warm_up.setText(model.warm_up())
        self.known.setText(model.known())
        self.known.setVisible(bool(self.known.text()))
        if result is None or not result.cycles:
            return
        sensors = len(result.sensors)
        self.loops.show_groups(model)
        for shown in self.figures:
            shown.plot.clear()
            shown.explain_symbols(sensors)
        for i, sensor in enumerate(result.sensors):
            numbers, top, bottom = model.extremes(i)
            each = sensor.cycles
            for points, values in (
                (self.drift.sensors[i], top),
                (self.drift.low_ends[i], bottom),
                (self.hysteresis.sensors[i], each.hysteresis_percent_fso),
                (self.sensitivity.sensors[i], each.sensitivity),
                (self.snr.sensors[i], each.snr_db),
            ):
                known = np.isfinite(values)  # cycles that have the figure
                points.set(numbers[known], values[known])
            self.sensitivity.plot.set_title("Per cycle", each.sensitivity_unit)
        for shown in self.figures:
            shown.frame()
        self._show_breaks(result)
        self.table.show_rows(result.figures, [sensor.label for sensor in result.sensors])

    def _show_breaks(self, result: RunResult) -> None:
        """Draw a line at each interruption, and show the tests across it in a tab of their own."""
        for card, line in self.break_lines:
            card.plot.remove_line(line)
        self.break_lines = [
            (card, card.plot.line(lambda t: t.warn, at=found.at_cycle, vertical=True, label="interrupted"))
            for found in result.breaks
            for card in self.figures
        ]
        self.break_texts.setText("\n".join(found.sentence for found in result.breaks))
        self.tests.fill([row for found in result.breaks for row in found.rows])
        at = self.tabs.indexOf(self.breaks)
        if result.breaks and at < 0:
            self.tabs.addTab(self.breaks, "Interruptions")
        elif not result.breaks and at >= 0:
            self.tabs.removeTab(at)
            self.breaks.setParent(None)
