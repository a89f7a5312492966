"""The plots of the live page: signals, elongation, pressure over one time axis, or the last cycles overlaid.

Drawing is pulled: `draw` asks the view model for one frame. Nothing here knows how many samples there are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from time import monotonic
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, QPointF, Qt
from PySide6.QtGui import QResizeEvent

from analysis.arrays import FloatArray
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Curve, Plot, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common.formatting import clock, number
from boat_daq.viewmodels.live.live_model import CYCLES_KEPT, LiveModel, OverlayModel, PlotFrame, sensor_names

MOST_OF_A_NOTE = 28  # letters beside a marker; the whole of it on hover
WHOLE_S = 0.1  # a change that no sample tells of, such as another calibration, is seen after so long


def shortened(note: str) -> str:
    """Return a note shortened for its marker."""
    return note if len(note) <= MOST_OF_A_NOTE else f"{note[: MOST_OF_A_NOTE - 1].rstrip()}\u2026"


class LivePlots(PlotCard):
    """Plots over one time axis: a signal each (or all in the first), elongation, pressure; values at the mouse."""

    def __init__(self, model: LiveModel) -> None:
        super().__init__("Live signals", show_title=False)
        self.model = model
        self.last: PlotFrame | None = None  # drawn whole
        self._whole_until_s = -math.inf  # of `monotonic`: after it the picture is drawn whole again, moved or not
        self.signals: list[Plot] = []  # by sensor, as many as any board so far had
        self.curves: list[tuple[Curve, Curve]] = []  # by sensor: in the plot of its own, in the first plot
        self._cursors: dict[str, list[tuple[Plot, Any]]] = {"a": [], "b": []}
        self._markers: list[tuple[Plot, Any]] = []
        self._hairs: dict[Plot, Any] = {}  # lines at the mouse
        self._mouse: QPointF | None = None  # over the plots
        self._age = ""
        for sensor in (1, 2):
            self._add_signal(sensor)
        self.length = self.add("Elongation", "mm", time=True)
        self.pressure = self.add("Pressure", "kPa", x_title="Time", x_unit="s", time=True)
        for plot in (self.length, self.pressure):
            self._link(plot)
        self.band = self.length.band("Band, k = 2", lambda t: t.elongation)
        self.read = self.length.points("Readings", lambda t: t.text, filled=False)
        self.mm = self.length.curve("Elongation", lambda t: t.elongation, gaps=True)
        self.kpa = self.pressure.curve("Pressure", lambda t: t.pressure, gaps=True)
        self.target = self.pressure.curve("Target", lambda t: t.target, gaps=True, pen_style=Qt.PenStyle.DashLine)
        self.limits = self.pressure.curve("Limits", lambda t: t.fault, gaps=True, pen_style=Qt.PenStyle.DotLine)
        self.limits_kpa: list[float] = []
        self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)  # the live page never scrolls
        self.rows: list[Plot] = []
        self._arranged = (False, 0)  # whether all signals are in the first plot, number of sensors
        self.first_row = widgets.choice("First plot shown", (), lambda _: self.arrange())
        self.bar.insertWidget(0, self.first_row)
        self.arrange()
        self.view.scene().sigMouseMoved.connect(self._hover)
        self.view.viewport().installEventFilter(self)

    @property
    def first(self) -> Plot:
        """The plot of sensor 1, or of all sensors together."""
        return self.signals[0]

    def _add_signal(self, sensor: int) -> None:
        """Add the plot of a sensor."""
        plot, name = self.add(f"Sensor {sensor}", "mV", time=True), f"Sensor {sensor}"
        self.signals.append(plot)
        own = together = plot.curve(name, sensor_colour(sensor), gaps=True)
        if plot is not self.first:
            together = self.first.curve(name, sensor_colour(sensor), gaps=True)
        self.curves.append((own, together))
        self._link(plot)

    def _link(self, plot: Plot) -> None:
        """Link a plot's time to the first one's, and let the mouse move it along time only."""
        box = plot.item.getViewBox()
        box.setMouseEnabled(x=True, y=False)
        box.sigRangeChangedManually.connect(self._moved)  # no lambda: it would keep all this alive
        if plot is not self.first:
            plot.item.setXLink(self.first.item)

    def arrange(self) -> None:
        """Show the rows that have something to show."""
        both, sensors = self.model.together, self.model.sensors() or 2
        for sensor in range(len(self.signals) + 1, sensors + 1):
            self._add_signal(sensor)
            self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)
        rows = [*(self.signals[:1] if both else self.signals[:sensors]), self.pressure]
        if self.model.inverse is not None:
            rows.insert(-1, self.length)
        numbers = ", ".join(str(n) for n in range(1, sensors + 1))
        self.first.set_title(f"Sensors {numbers}" if both and sensors > 1 else "Sensor 1", "mV")
        rows = self._fitting(rows)
        if rows == self.rows and (both, sensors) == self._arranged:
            return
        self.rows, self._arranged, self._whole_until_s = rows, (both, sensors), -math.inf
        for i, (_, together) in enumerate(self.curves[1:], 2):
            together.show(both and i <= sensors)
        self.show_only(rows)
        self.paint_theme(self.theme)

    def _fitting(self, rows: list[Plot]) -> list[Plot]:
        """Return the rows from the chosen one on that are high enough to be read; the choice is hidden if all are."""
        names = [plot.title for plot in rows]
        if names != [self.first_row.itemText(i) for i in range(self.first_row.count())]:
            self.first_row.clear()
            self.first_row.addItems(names)
        least = style.ROW_LOW if self.window().height() < style.LOW_BELOW else style.ROW_LEAST
        fit = max(1, int(self.view.height() - style.AXIS_HEIGHT) // least)
        self.first_row.setVisible(fit < len(rows))
        first = min(self.first_row.currentIndex(), len(rows) - fit) if fit < len(rows) else 0
        return rows[first : first + fit]

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show as many rows as the new height can show."""
        super().resizeEvent(event)
        self.arrange()

    def columns(self) -> Columns:
        """Return the columns of the CSV: what was recorded over the span that is drawn."""
        return self.model.table(self.last)

    def draw(self) -> bool:
        """Draw one frame; returns whether there was anything to draw."""
        width, now_s = self.view.width(), monotonic()
        added = self.model.newest(self.last, width) if self.last and now_s < self._whole_until_s else None
        if added is not None:
            for curve, values in self._lines(added):
                curve.extend(added.columns["time_s"], values)
        else:
            frame = self.model.frame(width)
            if frame is None:
                return False
            self.last, self._whole_until_s = frame, now_s + WHOLE_S
            self._draw_whole(frame)
        self.view.scene().prepareForPaint()  # now, or the paint itself would ask for a second one
        return True

    def _draw_whole(self, frame: PlotFrame) -> None:
        time_s = frame.columns["time_s"]
        for curve, values in self._lines(frame):
            curve.set(time_s, values)
        if frame.elongation is not None:
            self.band.fill(*frame.elongation.band(time_s))
        ends = [frame.low_s, frame.high_s, frame.high_s]
        kpa = [value for limit in self.limits_kpa for value in (limit, limit, math.nan)]
        self.limits.set(np.array(ends * len(self.limits_kpa)), np.array(kpa))
        self.x_range(frame.low_s, frame.high_s)
        self._ranges(frame)

    def _lines(self, frame: PlotFrame) -> list[tuple[Curve, FloatArray]]:
        """Return what each curve shows of a frame."""
        columns, names = frame.columns, sensor_names(frame.columns)
        lines = [(self.kpa, columns["pressure_kpa"]), (self.target, columns["target_kpa"])]
        for i, (name, (own, together)) in enumerate(zip(names, self.curves, strict=False)):
            lines.append((together if i and self.model.together else own, columns[name]))
        if frame.elongation is not None:
            lines.append((self.mm, frame.elongation.mm))
        return lines

    def _ranges(self, frame: PlotFrame) -> None:
        ranges = self.model.ranges(frame, monotonic())
        plots = dict(zip(sensor_names(frame.columns), self.signals, strict=False))
        for name, plot in (plots | {"pressure_kpa": self.pressure, "elongation_mm": self.length}).items():
            if name in ranges:
                plot.y_range(*ranges[name])

    def show_limits(self, low_kpa: float | None, high_kpa: float | None) -> None:
        """Draw the pressure limits in force from the next whole frame on."""
        self.limits_kpa = [limit for limit in (low_kpa, high_kpa) if limit is not None]

    def show_readings(self, points: list[tuple[float, float]]) -> None:
        """Mark the plateaus' readings (s, mm) on the elongation."""
        if len(points) != self.read.x.size or (points and points[-1][0] != self.read.x[-1]):
            self.read.set(*np.array(points).reshape(-1, 2).T)

    def show_age(self, age: str) -> None:
        """Draw the curves faint, with the age of their last data; fully where it is empty and data arrive."""
        if bool(age) is not bool(self._age):
            for layer in (layer for plot in self.plots for layer in plot.layers):
                layer.item.setOpacity(style.STALE_OPACITY if age else 1.0)
        self._age = age
        widgets.set_text(self.heading, f"Last data {age}" if age else "")

    def _hover(self, at: QPointF) -> None:
        self._mouse = at
        self.show_values()

    def show_values(self) -> None:
        """Show the values at the mouse, each in its plot beside a line."""
        at, values = self._mouse, {}
        boxes = [plot.item.getViewBox() for plot in self.rows] if at is not None else []
        for box in (box for box in boxes if box.sceneBoundingRect().contains(at)):
            values = self.model.values_at(box.mapSceneToView(at).x())
        texts = self._texts(values)
        for plot in self.plots:
            shown = plot in self.rows and plot in texts
            if shown and plot not in self._hairs:
                self._hairs[plot] = plot.line(lambda t: t.text, vertical=True, label=" ")
            if plot in self._hairs:
                self._hairs[plot].setVisible(shown)
            if shown:
                self._hairs[plot].label.fill = pg.mkBrush(self.theme.surface)
                self._hairs[plot].label.setFormat(texts[plot])
                self._hairs[plot].setValue(values["time_s"])

    def _texts(self, values: Mapping[str, float]) -> dict[Plot, str]:
        """Return what each plot shows of the values at the mouse; the lowest one their time, too."""
        if not values:
            return {}
        mv = [number(values[name], 1) for name in sensor_names(values)]
        groups = [mv] if self.model.together else [[text] for text in mv]
        texts = {plot: f"{', '.join(group)} mV" for plot, group in zip(self.signals, groups, strict=False)}
        if "elongation_mm" in values:
            known = math.isfinite(values["elongation_mm"])
            band = f" \u00b1{number(values['expanded_mm'], 2)}" if known else ""
            texts[self.length] = f"{number(values['elongation_mm'], 2, sign=True)}{band} mm"
        texts[self.pressure] = f"{number(values['pressure_kpa'], 1, sign=True)} kPa"
        lowest = self.rows[-1]
        texts[lowest] = f"{texts[lowest]}   {clock(values['time_s'])}"
        return texts

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Hide the values when the mouse leaves the plots."""
        if event.type() is QEvent.Type.Leave:
            self._mouse = None
            self.show_values()
        return super().eventFilter(watched, event)

    def _moved(self, *_: object) -> None:
        low, high = self.first.item.getViewBox().viewRange()[0]
        self.model.frozen_s = (low, high)

    def place_cursor(self, which: str) -> None:
        """Put cursor "a" or "b" at a third or two thirds of the picture, or take it away."""
        if self._cursors[which]:
            for plot, line in self._cursors[which]:
                plot.remove_line(line)
            self._cursors[which] = []
            del self.model.cursors_s[which]
            return
        at = self.model.cursors_s[which] = self.model.place(which)
        for plot in self.plots:
            name, solid = which.upper() if plot is self.first else "", Qt.PenStyle.SolidLine
            line = plot.line(lambda t: t.text, at=at, vertical=True, movable=True, style_=solid, label=name)
            line.setHoverPen(style.colour(self.theme.accent))
            line.sigDragged.connect(lambda moved, which=which: self._drag(which, moved.value()))
            self._cursors[which].append((plot, line))
        self.paint_theme(self.theme)

    def _drag(self, which: str, at: float) -> None:
        self.model.cursors_s[which] = at
        for _, line in self._cursors[which]:
            line.setValue(at)

    def show_markers(self) -> None:
        """Draw the markers that are new."""
        for time_s, note in self.model.markers[len(self._markers) :]:
            label, dots = shortened(note) or "\u25be", Qt.PenStyle.DotLine
            line = self.first.line(lambda t: t.muted, at=time_s, vertical=True, style_=dots, label=label)
            line.label.setToolTip(note)
            self._markers.append((self.first, line))
            self.paint_theme(self.theme)


class OverlayPlots(PlotCard):
    """A plot over the time in the cycle for each sensor, made when it has something to show."""

    def __init__(self, model: OverlayModel) -> None:
        super().__init__("Last cycles overlaid")
        self.model = model
        self.curves: list[list[Curve]] = []
        self._shown = 0

    def _arrange(self, sensors: int) -> None:
        """Show the plots of the sensors that the board has."""
        if sensors == self._shown:
            return
        self._shown = sensors
        for sensor in range(len(self.plots) + 1, sensors + 1):
            plot = self.add(f"Sensor {sensor}", "mV", x_title="Time in the cycle", x_unit="s", time=True)
            faint = [plot.curve(f"{n} cycles ago", lambda t: t.line) for n in range(CYCLES_KEPT - 1, 0, -1)]
            self.curves.append([*faint, plot.curve("This cycle", sensor_colour(sensor))])
        self.link_x()
        self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)
        self.show_only(self.plots[:sensors])
        self.paint_theme(self.theme)

    def draw(self) -> None:
        """Draw the cycles there are."""
        cycles = self.model.cycles()
        self.readout.setText(f"{len(cycles)} of the last {CYCLES_KEPT} cycles" if cycles else "")
        self.show_empty("" if cycles else "The cycles of a run are drawn here once the first has begun.")
        if not cycles:
            return
        names = sensor_names(cycles[-1][1])
        self._arrange(len(names))
        for name, curves in zip(names, self.curves, strict=False):
            for curve, (_, columns) in zip(reversed(curves), reversed(cycles), strict=False):
                curve.set(columns["time_s"], columns[name])
        for plot in self.plots[: len(names)]:
            plot.fit(x_margin=0.0)
