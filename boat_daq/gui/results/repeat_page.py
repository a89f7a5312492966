"""The repeatability page: loops coloured by cycle; drift, hysteresis, sensitivity and SNR of every cycle."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from PySide6.QtWidgets import QGridLayout, QTabWidget, QVBoxLayout, QWidget

from analysis.arrays import FloatArray
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, ramp_colour, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.results.figure_table import FigureTable
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.empty_page import EmptyState
from boat_daq.gui.widgets.page_scroll import Leaves
from boat_daq.gui.widgets.split_view import Divided
from boat_daq.viewmodels.common.formatting import sensor_words
from boat_daq.viewmodels.common.services import Panel, Services
from boat_daq.viewmodels.results.analysis_view import RunResult
from boat_daq.viewmodels.results.repeatability import GROUPS, RepeatabilityModel

SENSORS = 2
NO_FIGURE = "No cycle of this run has this figure; the table says why on hover."
BREAK_HEADINGS = ("", "before", "after", "p (t)", "p (F)")
BREAK_HOVERS = {
    3: "Chance of means so far apart if nothing changed (t-test)",
    4: "Chance of scatters so far apart if nothing changed (F-test)",
}


class LoopsByCycle(PlotCard):
    """One sensor's loops over pressure, early cycles dark, late ones bright."""

    def __init__(self, number: int) -> None:
        super().__init__(f"Sensor {number}")
        self.number = number
        self.plot = self.add("Signal", "mV", x_title="Pressure", x_unit="kPa")
        self.curves: list[Curve] = [
            self.plot.curve(f"Group {i + 1}", ramp_colour(i, GROUPS), gaps=True) for i in range(GROUPS)
        ]

    def show_groups(self, model: RepeatabilityModel) -> None:
        """Draw the groups of cycles."""
        result, groups = model.result, model.groups()
        assert result is not None
        for i, curve in enumerate(self.curves):
            cycles = groups[i] if i < len(groups) else range(0)
            curve.set(*result.loops.broken(result.loops.pressure_kpa, result.loops.signal_mv[self.number - 1], cycles))
        self.readout.setText(f"cycles {result.loops.numbers[0]} to {result.loops.numbers[-1]}, dark to bright")
        self.plot.fit()


def known(numbers: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the cycles that have a figure, with it."""
    finite = np.isfinite(values)
    return numbers[finite], values[finite]


class CycleFigureCard(PlotCard):
    """A figure of every cycle over its number, both sensors."""

    def __init__(self, title: str, axis: str, unit: str) -> None:
        super().__init__(title)
        self.plot = self.add(axis, unit, x_title="Cycle")
        self.sensors = [
            self.plot.points(f"Sensor {n}", sensor_colour(n), symbol=s, size=6) for n, s in ((1, "o"), (2, "s"))
        ]
        self.readout.setText("\u25cf 1  \u25a0 2")

    def frame(self) -> None:
        """Frame what there is; say so where no cycle has this figure."""
        self.show_empty("" if any(layer.y.size for layer in self.plot.layers) else NO_FIGURE)
        self.plot.fit()


class RepeatPage(QWidget):
    """The repeatability page."""

    def __init__(self, model: RepeatabilityModel, choose_plan: Callable[[], None], services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self._revision = -1
        self.words = widgets.label("", "subtitle", elide=True)
        self.warm_up = widgets.label("", "muted")
        self.loops = [LoopsByCycle(n) for n in range(1, SENSORS + 1)]
        self.drift = CycleFigureCard("Drift", "Change", "mV")
        self.low_ends = [
            self.drift.plot.points(f"Sensor {n}, lowest", sensor_colour(n), filled=False, symbol=s, size=6)
            for n, s in ((1, "o"), (2, "s"))
        ]
        self.drift.readout.setText("\u25cf\u25a0 high  \u25cb\u25a1 low")
        self.hysteresis = CycleFigureCard("Hysteresis", "Per cycle", "% FSO")
        self.sensitivity = CycleFigureCard("Sensitivity", "Per cycle", "mV/mm")
        self.snr = CycleFigureCard("SNR", "Per cycle", "dB")
        self.table = FigureTable()
        self.broken = widgets.label("", "small", wrap=True)
        self.tested = widgets.read_table("Both sides of each break compared", BREAK_HEADINGS)
        for column, words in BREAK_HOVERS.items():
            heading = self.tested.horizontalHeaderItem(column)
            if heading is not None:
                heading.setToolTip(words)
        self.breaks, inside = QWidget(), widgets.column(self.broken, self.tested, spacing=style.GAP)
        inside.setContentsMargins(0, style.GAP, 0, 0)
        self.breaks.setLayout(inside)
        self.break_lines: list[tuple[CycleFigureCard, Any]] = []
        self.stack = Leaves()
        self.missing = EmptyState(*model.missing(), "Choose the plan", choose_plan)
        self.stack.addWidget(self.missing)
        self.stack.addWidget(self._filled())
        widgets.page_layout(self).addWidget(self.stack)

    def _filled(self) -> QWidget:
        body = QWidget()
        layout = QVBoxLayout(body)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(style.GAP)
        head, inside = widgets.card()
        report = widgets.button("Report …", partial(self.services.show, Panel.REPORT))
        inside.addLayout(widgets.row(self.words, self.warm_up, None, report))
        layout.addWidget(head)
        grid = QGridLayout()
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(style.GAP)
        rows = ((self.loops[0], self.drift, self.hysteresis), (self.loops[1], self.sensitivity, self.snr))
        for i, row in enumerate(rows):
            for k, shown in enumerate(row):
                grid.addWidget(shown, i, k)
            grid.setRowStretch(i, 1)
        for k, share in enumerate((4, 3, 3)):
            grid.setColumnStretch(k, share)
        side, column = widgets.card()
        self.tabs = QTabWidget()
        self.tabs.setDocumentMode(True)
        self.tabs.tabBar().setDrawBase(False)
        self.tabs.setAccessibleName("Figures, and the run's breaks")
        self.tabs.tabBar().setAccessibleName("Figures, and the run's breaks")
        self.tabs.setTabBarAutoHide(True)
        self.tabs.addTab(self.table, "Figures")
        column.addWidget(self.tabs)
        width = style.PANE_WIDTH_WIDE - 8 * style.STEP
        sides = (widgets.holder(grid), side)
        layout.addWidget(Divided("repeat", self.services.preferences, *sides, width, stacks=True), 1)
        return body

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the result where it has changed."""
        model = self.model
        if model.revision == self._revision:
            return
        self._revision = model.revision
        result = model.result
        title, words = model.missing()
        self.stack.setCurrentIndex(0 if title else 1)
        if title:
            self.missing.say(title, words, self.missing.button.text())
        self.words.setText(model.words)
        self.warm_up.setText(model.warm_up())
        if result is None or not result.cycles:
            return
        for card in self.loops[: len(result.sensors)]:
            card.show_groups(model)
        for i in range(min(SENSORS, len(result.sensors))):
            numbers, top, bottom = model.extremes(i)
            each = model.cycles(i)
            self.drift.sensors[i].set(*known(numbers, top))
            self.low_ends[i].set(*known(numbers, bottom))
            for shown, values in (
                (self.hysteresis, each.hysteresis_percent_fso), (self.sensitivity, each.sensitivity),
                (self.snr, each.snr_db),
            ):  # fmt: skip
                shown.sensors[i].set(*known(numbers, values))
            self.sensitivity.plot.set_title("Per cycle", each.sensitivity_unit)
        for shown in (self.drift, self.hysteresis, self.sensitivity, self.snr):
            shown.frame()
        self._show_breaks(result)
        self.table.show_rows(result.figures, [sensor_words(s.name) for s in result.sensors])

    def _show_breaks(self, result: RunResult) -> None:
        """Draw a line where the run was broken and went on, and say what the tests on both sides of it found."""
        for card, line in self.break_lines:
            card.plot.remove_line(line)
        self.break_lines = [
            (card, card.plot.line(lambda t: t.warn, at=found.at_cycle, vertical=True, label="break"))
            for found in result.breaks
            for card in (self.drift, self.hysteresis, self.sensitivity, self.snr)
        ]
        for card, _ in self.break_lines:
            card.plot.repaint()
        self.broken.setText("\n".join(found.sentence for found in result.breaks))
        widgets.fill_table(self.tested, [row for found in result.breaks for row in found.rows])
        at = self.tabs.indexOf(self.breaks)
        if result.breaks and at < 0:
            self.tabs.addTab(self.breaks, "Breaks")
        elif not result.breaks and at >= 0:
            self.tabs.removeTab(at)
            self.breaks.setParent(None)
