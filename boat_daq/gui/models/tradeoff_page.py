"""Speed and accuracy: the precision of the program; time and error of each method's default, as a chart and a table.

Processor time is across and error up, both logarithmic. Errors of unlike units are compared as shares of the
tolerance of each; the program's rule accepts half.
"""

from __future__ import annotations

import math
from collections.abc import Container
from functools import partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget

from analysis.fidelity import LEVELS
from analysis.studies.tradeoff.measure import MARGIN
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import duration_text, number, quantity
from boat_daq.gui import style
from boat_daq.gui.plotting.axes import LogAxis
from boat_daq.gui.plotting.plot import Plot, PlotBox, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.layouts import ReflowingPage
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.preferences import Precision
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.models.tradeoff import JOB_NAMES, METHOD_NAMES, Default, TradeoffModel
from protocol.base.arrays import FloatArray


class DefaultsTable(DataTable):
    """All rows on one line each, without a scroll bar of its own: the page scrolls."""

    def __init__(self) -> None:
        super().__init__("Default of each method", _HEADINGS, stretched=_HEADINGS.index("Method"), right=(0, 5))
        self.explain({_HEADINGS.index("Of tol."): SHARE_TIP})
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - style.GAP)
        self.setAlternatingRowColors(True)  # its values are far from their names

    def show_defaults(self, defaults: list[Default]) -> None:
        self.fill([self._row(d) for d in defaults], [d.explanation for d in defaults])
        rows = self.verticalHeader().length() + self.horizontalHeader().sizeHint().height()
        self.setFixedHeight(rows + 2 * self.frameWidth())

    @staticmethod
    def _row(d: Default) -> tuple[str, ...]:
        first = (str(_NUMBERS[d.name]), METHOD_NAMES[d.name], d.setting.replace(" x ", " \u00d7 "))
        if not d.measured:
            return (*first, "", "failed" if d.unit else "", "")
        share = number(100 * d.share, 0) if d.share >= _LEAST_SHARE else LESS
        return (*first, duration_text(d.seconds, 2), quantity(d.error, d.unit), f"{share} %")


PRECISIONS = {"draft": "Draft: fast, rough", "normal": "Normal (sufficient)", "reference": "Reference: slow, exact"}
MEASURE = "Measure this computer"
MEASURE_TIP = "Takes some minutes, in a helper process"
MEASURING = "Under way: its progress and Cancel are at the foot of the window."
SHARE_TIP = "Error in percent of the tolerance; up to 50 % is sufficient"
_HEADINGS = ("No.", "Method", "Default", "Time", "Error", "Of tol.")
_KEY = "● a method   ■ a whole job   lower: more exact   further left: faster"
_NUMBERS = {name: number for number, name in enumerate(METHOD_NAMES, 1)}
_LEAST_SHARE, LESS = 0.01, "< 1"
"""Smaller errors are drawn here, with their number so marked: the others are apart."""
_SIDE_WIDTH = style.PANE_WIDTH_NARROW + 4 * style.STEP
MARGIN_DECADES = 0.25
LEAST_DECADES = 1.0  # so that timing noise looks small
LABEL_SHARE = 0.01  # of the width, where a text about a line begins: at the left, where points are few
_ANCHORS = (-0.15, 1.0), (-0.15, 0.0), (1.15, 1.0), (1.15, 0.0), (0.5, 1.6)  # of a number at its point, best first
_REACHES, _APART = (0.35, 0.28), (0.3, 0.18)  # decades of time and of error: to its middle, and to what it would cover
_LINE_APART = 0.09  # decades of error from the middle of a number to a line


class OverviewCard(PlotCard):
    def __init__(self, model: TradeoffModel) -> None:
        super().__init__("All methods")
        self.model = model
        axes = {"left": LogAxis("left"), "bottom": LogAxis("bottom")}
        item = pg.PlotItem(viewBox=PlotBox(), axisItems=axes, enableMenu=False)
        self.view.addItem(item, row=0, col=0)
        self.view.setMinimumSize(style.PLOT_MINIMUM[0], style.STRIP_PLOT_HEIGHT)
        item.setMouseEnabled(False, False)  # what is shown is all there is
        self.plot = Plot(item, "Error", "% of tolerance", x_title="Processor time of one call", x_unit="s")
        self.plots.append(self.plot)
        self.points = {
            job: self.plot.points("Jobs" if job else "Methods", sensor_colour(2 if job else 1), symbol=symbol)
            for job, symbol in ((False, "o"), (True, "s"))
        }
        self.noticed = self.plot.line(lambda t: t.muted, label="tolerance")
        accepted = self.plot.line(lambda t: t.ok, label="sufficient below")
        for line, corner, percent in ((self.noticed, (0, 1), 100.0), (accepted, (0, 0), 100.0 / MARGIN)):
            line.label.anchors = [corner, corner]
            line.label.setPosition(LABEL_SHARE)
            line.setValue(math.log10(percent))
        self.numbers = [self.plot.labels(anchor) for anchor in _ANCHORS]
        self.inside.addWidget(controls.label(_KEY, "small", elide=True, name="Key of the overview"))

    def show_defaults(self) -> None:
        places = {
            d.name: (math.log10(d.seconds), math.log10(100.0 * max(d.share, _LEAST_SHARE)))
            for d in self.model.defaults
            if d.measured
        }
        less = {d.name for d in self.model.defaults if d.share < _LEAST_SHARE}
        for job, layer in self.points.items():
            chosen = [at for name, at in places.items() if (name in JOB_NAMES) is job]
            layer.set(np.array([x for x, _ in chosen]), np.array([y for _, y in chosen]))
        x, y = np.array(list(places.values())).reshape(-1, 2).T
        self.plot.x_range(*framed(x))
        self.plot.y_range(*framed(np.append(y, self.noticed.value())))
        for labels, placed in zip(self.numbers, placed_numbers(places, less), strict=True):
            labels.set(placed)
        self.paint_theme(self.theme)

    def columns(self) -> Columns:
        rows = [
            (METHOD_NAMES[d.name], d.setting, d.seconds, d.per, d.error, d.unit, d.share)
            for d in self.model.defaults
            if d.measured
        ]
        names = ("method", "default", "processor time (s)", "for", "error", "unit", "error / tolerance")
        return tables.by_column(names, rows)


def framed(values: FloatArray) -> tuple[float, float]:
    """Return a range around logarithms, at least `LEAST_DECADES` and the margins."""
    if not len(values):
        return 0.0, LEAST_DECADES
    low, high = float(values.min()), float(values.max())
    margin = max(0.0, LEAST_DECADES - (high - low)) / 2 + MARGIN_DECADES * max(1.0, 0.3 * (high - low))
    return low - margin, high + margin


def placed_numbers(
    places: dict[str, tuple[float, float]], less: Container[str]
) -> list[list[tuple[float, float, str]]]:
    """Return the numbers for each anchor: each beside its point, where it covers no line, other point or number."""
    placed: list[list[tuple[float, float, str]]] = [[] for _ in _ANCHORS]
    taken = [*places.values()]
    lines = 2.0, 2.0 - math.log10(MARGIN)
    for name, (x, y) in sorted(places.items(), key=lambda place: place[1]):
        middles = [(x + _REACHES[0] * (0.5 - right), y + _REACHES[1] * (top - 0.5)) for right, top in _ANCHORS]
        free = [
            all(abs(at[1] - line) > _LINE_APART for line in lines)
            and all(abs(at[0] - u) > _APART[0] or abs(at[1] - v) > _APART[1] for u, v in taken if (u, v) != (x, y))
            for at in middles
        ]
        best = free.index(True) if any(free) else 0
        placed[best].append((x, y, f"{_NUMBERS[name]} ({LESS} %)" if name in less else str(_NUMBERS[name])))
        taken.append(middles[best])
    return placed


class TradeoffPage(ReflowingPage):
    def __init__(self, model: TradeoffModel, precision: Precision, services: Services) -> None:
        super().__init__()
        self.model, self.precision, self.services = model, precision, services
        self._revision = -1
        self.overview, self.defaults = OverviewCard(model), DefaultsTable()
        self.measured = controls.label("", "small", wrap=True)
        defaults, _ = controls.card(self.defaults)
        self.tall = (self.overview,)
        shown = controls.column((self.overview, 1), defaults, spacing=style.GAP)
        self.side = self._side()
        across = controls.row(self.side, (shown, 1))
        self.rows = (across,)
        controls.page_layout(self).addLayout(across)

    def _side(self) -> QWidget:
        levels = [(PRECISIONS[n], n) for n in LEVELS]
        tip = "Precision of optics, shadow, uncertainty and live plots"
        self.first = self.level = controls.choice("Precision of the program", levels, self.precision.choose, tip=tip)
        toggle = partial(self.services.notices.attempt, self.model.toggle)
        self.start = controls.button(MEASURE, toggle, "primary", tip=MEASURE_TIP)
        self.status = controls.label("", "small", wrap=True)
        measurement = (self.start, self.status, self.measured)
        parts: tuple[Any, ...] = (controls.label("Precision", "subtitle"), self.level, style.GAP)
        frame, _ = controls.card(*parts, controls.label("Measurement", "subtitle"), *measurement, None)
        frame.setMaximumWidth(_SIDE_WIDTH)
        return frame

    def reflow(self) -> None:
        """Put the settings above the table on a narrow page."""
        super().reflow()
        self.side.setMaximumWidth(style.UNLIMITED if self.narrow else _SIDE_WIDTH)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show whether it measures, or why it could not; the rest where it has changed."""
        self.level.setCurrentIndex(self.level.findData(self.precision.level))
        controls.allow(self.start, MEASURING if self.model.job is not None else "")
        controls.set_text(self.status, self.model.status())
        self.status.setVisible(bool(self.status.text()))
        if self._revision != self.model.revision:
            self._revision = self.model.revision
            self.measured.setText(self.model.measured)
            self.overview.show_defaults()
            self.defaults.show_defaults(self.model.defaults)
