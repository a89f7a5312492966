"""All methods at once: time and error of each default, as a chart and a table; a click shows the method.

Errors of unlike units are compared by what is noticeable in each: 100 % is noticed, and the rule accepts half.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from PySide6.QtCore import QPointF, Qt

from analysis.studies.tradeoff.measure import MARGIN
from boat_daq.formatting import duration_text, number, quantity
from boat_daq.gui.models.tradeoff_chart import LABEL_SHARE, NUMBER_ANCHOR, framed, limit_lines, log_card
from boat_daq.gui.plotting.plot import sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.wrapped_table import WrappedTable
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.models.tradeoff import JOB_NAMES, METHOD_NAMES, OVERVIEW, ROWS, TradeoffModel

_REACH = 40.0  # pixels from a point within which a click is meant for it
_HEADINGS = ("No.", "Method", "Default", "Time", "Error", "Share")
SHARE_TIP = "The error in percent of the least that is noticeable; the rule accepts a setting up to 50 %"
_LEAST_SHARE = 0.05
"""Smaller errors are drawn here, so that the others are apart."""
_KEY = "● a method   ■ a whole job   lower: more exact   further left: faster   click one to see its settings"
_ANCHORS = NUMBER_ANCHOR, (-0.15, 0.0), (1.15, 1.0), (1.15, 0.0)  # of a number at its point, the best first
_REACHES, _APART = (0.35, 0.2), (0.3, 0.13)  # decades of time and of error: to its middle, and to what it would cover
_NUMBERS = {name: number for number, name in enumerate(METHOD_NAMES, 1)}


class OverviewCard(PlotCard):
    """Time and error of every default."""

    def __init__(self, model: TradeoffModel) -> None:
        super().__init__(ROWS[OVERVIEW])
        self.model = model
        self.plot = log_card(self, "Error", "% of noticeable", "Processor time of one call")
        self.points = {
            job: self.plot.points("Jobs" if job else "Methods", sensor_colour(2 if job else 1), symbol=symbol)
            for job, symbol in ((False, "o"), (True, "s"))
        }
        self.noticed, accepted = limit_lines(self.plot)
        for line, corner in ((self.noticed, (0, 1)), (accepted, (0, 0))):  # at the left, where points are few
            line.label.anchors = [corner, corner]
            line.label.setPosition(1.0 - LABEL_SHARE)
        self.noticed.setValue(math.log10(100.0))
        accepted.setValue(math.log10(100.0 / MARGIN))
        self.numbers = [self.plot.labels(anchor) for anchor in _ANCHORS]
        self.inside.addWidget(controls.label(_KEY, "small", wrap=True, name="Key of the overview"))
        self.view.setCursor(Qt.CursorShape.PointingHandCursor)
        self.view.scene().sigMouseClicked.connect(lambda event: self.click(event.scenePos()))
        self._at: dict[str, tuple[float, float]] = {}

    def show_defaults(self) -> None:
        """Draw what was measured."""
        self._at = {
            d.name: (math.log10(d.point.seconds), math.log10(100.0 * max(d.share, _LEAST_SHARE)))
            for d in self.model.defaults
            if d.point is not None
        }
        for job, layer in self.points.items():
            places = [at for name, at in self._at.items() if (name in JOB_NAMES) is job]
            layer.set(np.array([x for x, _ in places]), np.array([y for _, y in places]))
        x, y = np.array(list(self._at.values())).reshape(-1, 2).T
        self.plot.x_range(*framed(x))
        self.plot.y_range(*framed(np.append(y, self.noticed.value())))
        for labels, placed in zip(self.numbers, self._numbers(), strict=True):
            labels.set(placed)
        self.paint_theme(self.theme)

    def _numbers(self) -> list[list[tuple[float, float, str]]]:
        """Return the numbers for each anchor: each beside its point, where it covers no other point or number."""
        placed: list[list[tuple[float, float, str]]] = [[] for _ in _ANCHORS]
        taken = [*self._at.values()]
        for name, (x, y) in sorted(self._at.items(), key=lambda place: place[1]):
            middles = [(x + _REACHES[0] * (0.5 - right), y + _REACHES[1] * (top - 0.5)) for right, top in _ANCHORS]
            free = [
                all(abs(at[0] - u) > _APART[0] or abs(at[1] - v) > _APART[1] for u, v in taken if (u, v) != (x, y))
                for at in middles
            ]
            best = free.index(True) if any(free) else 0
            placed[best].append((x, y, str(_NUMBERS[name])))
            taken.append(middles[best])
        return placed

    def click(self, at: QPointF) -> None:
        """Show the method whose point is nearest to a place of the scene, where one is near."""
        box = self.plot.item.getViewBox()
        far = {name: (box.mapViewToScene(QPointF(*place)) - at).manhattanLength() for name, place in self._at.items()}
        name = min(far, key=lambda n: far[n], default="")
        if name and far[name] <= _REACH:
            self.model.show(name)

    def columns(self) -> Columns:
        """Return each default with its time and error."""
        rows = [
            (METHOD_NAMES[d.name], d.point.setting, d.point.seconds, d.chart.per, d.point.error, d.chart.unit, d.share)
            for d in self.model.defaults
            if d.chart is not None and d.point is not None
        ]
        names = ("method", "default", "processor time (s)", "for", "error", "unit", "error / noticeable error")
        return tables.by_column(names, rows)


class DefaultsTable(WrappedTable):
    """Every method with its default; a click or Enter shows the method."""

    def __init__(self, model: TradeoffModel) -> None:
        name = "Default of each method; Enter shows the method"
        super().__init__(name, _HEADINGS, stretched=(1, 2, 3, 4), right=(0, 5))
        self.explain({_HEADINGS.index("Share"): SHARE_TIP})
        self.tradeoff = model
        self.cellClicked.connect(self._chosen)
        self.cellActivated.connect(self._chosen)

    def show_defaults(self) -> None:
        """Show what was measured."""
        rows: list[tuple[str, ...]] = []
        for name, chart, point in self.tradeoff.defaults:
            first = (str(_NUMBERS[name]), METHOD_NAMES[name])
            if chart is None or point is None:
                rows.append((*first, self.tradeoff.entry(name), "", "", ""))
                continue
            percent = 100 * point.error / chart.tolerance
            share = f"{number(percent, 0)} %" if percent >= 1 else "< 1 %"
            time = f"{duration_text(point.seconds, 2)} for {chart.per}"
            rows.append((*first, point.setting, time, quantity(point.error, chart.unit), share))
        self.fill(rows)

    def _chosen(self, row: int, *_: Any) -> None:
        self.tradeoff.show(self.tradeoff.defaults[row].name)
