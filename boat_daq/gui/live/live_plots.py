"""The plots of the live page: signals, elongation, pressure over one time axis, or the last cycles overlaid.

Drawing is pulled: `draw` asks the view model for one frame. Nothing here knows how many samples there are. Once a
second the picture is drawn whole; in between its pixels are moved, and only what is new is painted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from time import monotonic
from typing import Any

import numpy as np
from PySide6.QtCore import QCoreApplication, QEvent, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QGraphicsView, QMenu

from boat_daq.engine.display.ring_buffer import CAMERA_U
from boat_daq.formatting import clock, in_units
from boat_daq.gui import style
from boat_daq.gui.plotting.axes import GRID_AHEAD
from boat_daq.gui.plotting.plot import IN_FRONT, Band, Curve, Layer, Plot, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.live.layout import CAMERA, ELONGATION, PRESSURE, Axes, Layout, title
from boat_daq.viewmodels.live.live_model import CYCLES_KEPT, LiveModel, OverlayModel, PlotFrame, sensor_names
from boat_daq.workflows.live_conversion import LiveElongation
from protocol.base.arrays import FloatArray
from protocol.recording import ExtraChannel

PREDICTED = "\u2504 predicted, band 95 %"
PREDICTED_TIP = "Predicted from the pressure by ray tracing; the band includes its distance from the readings"
MOST_OF_A_NOTE = 28  # letters beside a marker; the whole of it on hover
WHOLE_S = 1.0  # a change that no sample tells of, such as another calibration, is seen after so long
WHOLE_PX = 0.05  # pixels are moved by a whole number of them, up to so much
_CHANGES = QEvent.Type.MetaCall.value  # Qt's events by which a scene has its changes repainted
_DOT_EVERY_PX = 3  # from one dot of a limit to the next
AROUND_PX = 2  # a line's width, and the rounding of its end


def _past(theme: style.Theme) -> str:
    """Return the colour of the cycles before the last one."""
    return style.faint(theme.muted, style.PAST_ALPHA)


def value_text(quantity: str, values: Mapping[str, float], model: LiveModel) -> str:
    """Return a value at the mouse with its unit; elongations with their bands."""
    if quantity == CAMERA and math.isfinite(values[CAMERA]):
        return in_units(model.units, "mm", values[CAMERA], 3, band=2.0 * values[CAMERA_U])
    if quantity != ELONGATION:
        return model.text(quantity, values[quantity])
    known = math.isfinite(values[ELONGATION]) and math.isfinite(values["expanded_mm"])
    text = in_units(model.units, "mm", values[ELONGATION], 2, band=values["expanded_mm"] if known else -1.0)
    return f"{text}, U with a stated value" if known and values.get("stand_in") else text


def camera_band(columns: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, lower and upper edge of the camera's elongation, k = 2, where it is known."""
    time_s, mm, expanded = columns["time_s"], columns[CAMERA], 2.0 * columns[CAMERA_U]
    return LiveElongation(mm, expanded, np.zeros(mm.size, bool)).band(time_s)


def shortened(note: str) -> str:
    return note if len(note) <= MOST_OF_A_NOTE else f"{note[: MOST_OF_A_NOTE - 1].rstrip()}\u2026"


class LivePlots(PlotCard):
    """Plots over one time axis, by the layout of the view model; values at the mouse.

    Each quantity has a plot. Where it shares that of another one, its layers are drawn there.
    """

    layout_wanted = Signal(object)  # another layout, chosen in the menu

    def __init__(self, model: LiveModel) -> None:
        super().__init__("Live signals", show_title=False)
        self.model = model
        self.last: PlotFrame | None = None  # drawn whole, or added to it
        self.readout.setToolTip(PREDICTED_TIP)
        self._laid_until_s = math.inf  # of the ring's time: the dots of the limits end there
        self._whole_until_s = -math.inf  # of `monotonic`: after it the picture is drawn whole again, moved or not
        self.own: dict[str, Plot] = {}  # by quantity, as many as any board so far had
        self.layers: dict[str, list[Layer]] = {}  # of a quantity, in whichever plot
        self.curves: dict[str, Curve] = {}
        self.predicted: dict[str, tuple[Curve, Band]] = {}  # of a signal
        self.camera_band: Band | None = None
        self._cursors: dict[str, list[tuple[Plot, Any]]] = {"a": [], "b": []}
        self._markers: list[tuple[Plot, Any]] = []
        self._hairs: dict[Plot, Any] = {}  # lines at the mouse
        self._mouse: QPointF | None = None  # over the plots
        self._age = ""
        for sensor in (1, 2):
            self._add_signal(sensor)
        self.length = self._own(ELONGATION)
        self.pressure = self._own(PRESSURE, x_title="Time", x_unit="s")
        self.band = self.length.band("Band, k = 2", lambda t: t.elongation)
        self.read = self.length.points("Readings", lambda t: t.text, filled=False)
        self.curves[ELONGATION] = self.length.curve("Elongation", lambda t: t.elongation, gaps=True, thin=True)
        # before the pressure, so that what is measured is drawn over it
        self.target = self.pressure.curve("Target", lambda t: t.target, gaps=True, pen_style=Qt.PenStyle.DashLine)
        self.curves[PRESSURE] = self.pressure.curve("Pressure", lambda t: t.pressure, gaps=True, thin=True)
        self.limits = self.pressure.curve("Limits", lambda t: t.warn, gaps=True, pen_style=Qt.PenStyle.DotLine)
        for quantity, plot in ((ELONGATION, self.length), (PRESSURE, self.pressure)):
            self.layers[quantity] = list(plot.layers)
        self.limits_kpa: list[float] = []
        self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)  # the live page never scrolls
        self.rows: list[Plot] = []
        self._arranged_px = 0
        self._shown: tuple[Axes, ...] = ()  # of the rows
        self._layout: tuple[Axes, ...] = ()  # of all plots, also of those for which the window is too low
        self.first_row = controls.choice("First plot shown", (), lambda _: self.arrange())
        self.bar.insertWidget(0, self.first_row)
        self.arrange()
        self.view.scene().sigMouseMoved.connect(self._hover)
        self.view.viewport().installEventFilter(self)

    @property
    def first(self) -> Plot:
        return self.rows[0]

    def _own(self, quantity: str, *, x_title: str = "", x_unit: str = "") -> Plot:
        """Add the plot of a quantity; its time is linked."""
        name, stored = self.model.title(quantity), self.model.unit(quantity)
        plot = self.add(name, stored, x_title=x_title, x_unit=x_unit, time=True)
        box = plot.item.getViewBox()
        box.along = True
        box.sigRangeChangedManually.connect(self._moved)  # no lambda: it would keep all this alive
        box.autoscale_wanted.connect(self.autoscale)
        if self.own:
            plot.item.setXLink(next(iter(self.own.values())).item)
        self.own[quantity] = plot
        return plot

    def _add_signal(self, sensor: int) -> None:
        quantity = f"s{sensor}_mv"
        plot = self._own(quantity)
        band = plot.band("Predicted, 95 %", lambda t: t.muted, alpha=style.BAND_OPACITY // 2)
        predicted = plot.curve("Predicted", lambda t: t.muted, gaps=True, pen_style=Qt.PenStyle.DashLine)
        curve = plot.curve(f"Sensor {sensor}", sensor_colour(sensor), gaps=True, thin=True)
        self.curves[quantity], self.predicted[quantity] = curve, (predicted, band)
        self.layers[quantity] = [band, predicted, curve]

    def arrange(self) -> None:
        """Show the plots of the layout, those for which the window is high enough."""
        made = len(self.own)
        for sensor in range(3, self.model.sensors() + 1):
            if f"s{sensor}_mv" not in self.own:
                self._add_signal(sensor)
                self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)
        for quantity, channel in self.model.channels().items():
            if quantity not in self.own:
                plot = self._own(quantity)
                bands = [plot.band("Band, k = 2", lambda t: t.elongation)] if quantity == CAMERA else []
                colour = (lambda t: t.elongation) if bands else (lambda t: t.target)
                curve = plot.curve(channel.title, colour, gaps=True, thin=True)
                self.curves[quantity], self.layers[quantity] = curve, [*bands, curve]
                self.camera_band = bands[0] if bands else self.camera_band
                self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)
        for quantity in self.model.differences():
            if quantity not in self.own:
                curve = self._own(quantity).curve("Measured less predicted", lambda t: t.text, gaps=True, thin=True)
                self.curves[quantity], self.layers[quantity] = curve, [curve]
                self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)
        if len(self.own) > made:
            self._shown = ()  # a new plot is in the view until the layout places or hides it
        layout = self.model.plots()
        self._arranged_px = self.view.height()
        rows = self._fitting(layout)
        if rows == self._shown and layout == self._layout:
            return
        above = self.rows[0] if self.rows else None
        self.rows, self._shown, self._layout = [self.own[row.left[0]] for row in rows], rows, layout
        self._whole_until_s = -math.inf
        if self.rows and self.rows[0] is not above:
            self._take_markers_away()
        for plot in self.own.values():
            plot.hold([])
        for plot, row in zip(self.rows, rows, strict=True):
            self._fill(plot, row, style.AXIS_WIDTH if any(each.right for each in rows) else 0)
        self.show_empty("" if rows else "Every plot is hidden: View, Usual layout of the plots.")
        self.show_only(self.rows)
        self.paint_theme(self.theme)

    def _fill(self, plot: Plot, row: Axes, right_px: int) -> None:
        left, right = ([layer for name in names for layer in self.layers[name]] for names in (row.left, row.right))
        plot.hold(left, right)
        plot.set_title(self.model.titles(row.left), self.model.unit(row.left[0]))
        right_unit = self.model.unit(row.right[0]) if row.right else ""
        plot.set_right(self.model.titles(row.right), right_unit, right_px)
        for which, cursors in self._cursors.items():
            for each, line in cursors:
                line.label.setFormat(which.upper() if each is self.first else " ")

    def _fitting(self, layout: tuple[Axes, ...]) -> tuple[Axes, ...]:
        """Return the rows from the chosen one on that are high enough to be read, the pressure always among them.

        The choice is hidden if all are.
        """
        names = [self.model.titles(row.all) for row in layout]
        if names != [self.first_row.itemText(i) for i in range(self.first_row.count())]:
            self.first_row.clear()
            self.first_row.addItems(names)
        least = style.ROW_LOW if self.window().height() < style.LOW_BELOW else style.ROW_LEAST
        fit = max(2, int(self.view.height() - style.AXIS_HEIGHT) // least)
        self.first_row.setVisible(fit < len(layout))
        first = min(self.first_row.currentIndex(), len(layout) - fit) if fit < len(layout) else 0
        rows = layout[first : first + fit]
        pressure = [row for row in layout if PRESSURE in row.all and row not in rows]
        return (*rows[: fit - len(pressure)], *pressure)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show as many rows as the new height can show."""
        super().resizeEvent(event)
        self.arrange()

    def columns(self) -> Columns:
        """Return the columns of the CSV: what was recorded over the span that is drawn."""
        return self.model.table(self.last)

    def draw(self) -> bool:
        """Draw one frame; returns whether there was anything to draw."""
        if self.view.height() != self._arranged_px:  # the layout gives it its height after the card has its own
            self.arrange()
        width, now_s, last = self.view.width(), monotonic(), self.last
        if self.rows:
            width = max(1, round(self.first.item.getViewBox().width()))  # the data's alone: they move by whole columns
        if last is not None and now_s < self._whole_until_s:
            if self.model.past(last, width):
                return True
            added = self.model.newest(last, width)
            if added is not None and self._move_on(added, float(last.columns["time_s"][-1])):
                self.last = added
                return True
        frame = self.model.frame(width)
        if frame is None:
            return False
        self.last, self._whole_until_s = frame, now_s + WHOLE_S
        self._draw_whole(frame)
        self.view.scene().prepareForPaint()  # now, or the paint itself would ask for a second one
        return True

    def _move_on(self, added: PlotFrame, end_s: float) -> bool:
        """Move the pixels by whole columns and paint what is new, after `end_s`; return whether that was possible."""
        boxes = [plot.item.getViewBox() for plot in self.rows]
        if not boxes or added.high_s > self._laid_until_s:
            return False
        low, high = boxes[0].viewRange()[0]
        pixels_a_s = boxes[0].width() / (high - low)
        moved = round(pixels := (added.low_s - low) * pixels_a_s)
        if moved < 0 or abs(pixels - moved) > WHOLE_PX or (moved and not all(box.moves_alone() for box in boxes)):
            return False
        area = boxes[0].sceneBoundingRect().united(boxes[-1].sceneBoundingRect()).toAlignedRect()
        below = self.rows[-1].bottom.sceneBoundingRect().toAlignedRect()
        since = math.floor(area.left() + (end_s - low) * pixels_a_s) - moved - AROUND_PX
        with self._unseen():
            self._draw_added(added)
            if moved:
                self.x_range(added.low_s, added.high_s)
        port = self.view.viewport()
        if moved:
            port.scroll(-moved, 0, area)
            port.update(below)
        area.setLeft(max(since, area.left()))
        port.update(area)
        return True

    @contextmanager
    def _unseen(self) -> Iterator[None]:
        """Do not repaint what changes meanwhile; what has changed before is repainted."""
        changes = self.view.scene(), _CHANGES
        QCoreApplication.sendPostedEvents(*changes)
        usual = self.view.viewportUpdateMode()
        self.view.setViewportUpdateMode(QGraphicsView.ViewportUpdateMode.NoViewportUpdate)
        try:
            yield
            QCoreApplication.sendPostedEvents(*changes)
        finally:
            self.view.setViewportUpdateMode(usual)

    def _draw_added(self, frame: PlotFrame) -> None:
        """Continue lines and bands behind their ends."""
        for curve, values in self._lines(frame):
            curve.extend(frame.columns["time_s"], values)
        for band, edges in self._bands(frame):
            band.extend(*edges)

    def _draw_whole(self, frame: PlotFrame) -> None:
        time_s = frame.columns["time_s"]
        controls.set_text(self.readout, PREDICTED if frame.predicted is not None else "")
        for curve, values in self._lines(frame):
            curve.set(time_s, values)
        for band, edges in self._bands(frame):
            band.fill(*edges)
        if frame.predicted is None:
            for layer in (layer for layers in self.predicted.values() for layer in layers):
                layer.clear()
        span_s = frame.high_s - frame.low_s
        column_s, self._laid_until_s = span_s / frame.width, frame.high_s + max(WHOLE_S, GRID_AHEAD * span_s)
        # dot by dot, until they are drawn again: Qt begins a long dotted line anew where what is painted begins
        dots = _DOT_EVERY_PX * np.arange(
            frame.low_s / column_s // _DOT_EVERY_PX, self._laid_until_s / column_s / _DOT_EVERY_PX
        )
        ends_s = column_s * (dots[:, None] + [0.1, 0.9, math.nan]).ravel()
        kpa = [np.full(ends_s.size, limit) + 0.0 * ends_s for limit in self.limits_kpa]
        self.limits.set(np.tile(ends_s, len(kpa)), np.concatenate([*kpa, []]))
        for curve in (self.target, *(curve for curve, _ in self.predicted.values())):
            if curve.x.size:
                curve.item.lay_dashes(curve.x[0] / column_s, curve.x[-1] / column_s)
        self.x_range(frame.low_s, frame.high_s)
        self._ranges(frame)

    def _bands(self, frame: PlotFrame) -> Iterator[tuple[Band, tuple[FloatArray, FloatArray, FloatArray]]]:
        """Iterate over the bands of a frame, each with times, lower and upper edge."""
        time_s = frame.columns["time_s"]
        if frame.elongation is not None:
            yield self.band, frame.elongation.band(time_s)
        if self.camera_band is not None and CAMERA in frame.columns:
            yield self.camera_band, camera_band(frame.columns)
        if frame.predicted is not None:
            for i, quantity in enumerate(sensor_names(frame.columns)):
                values, half = (part[:, i] for part in frame.predicted)
                known = np.isfinite(values + half)
                yield self.predicted[quantity][1], (time_s[known], (values - half)[known], (values + half)[known])

    def x_range(self, low: float, high: float) -> None:
        """Show [low, high] in the rows, with the links blocked: each would compute two views' geometry a frame."""
        boxes = [plot.item.getViewBox() for plot in self.rows]
        for box in boxes:
            box.blockLink(True)
        try:
            for plot in self.rows:
                plot.scroll(low, high)
        finally:
            for box in boxes:
                box.blockLink(False)

    def _lines(self, frame: PlotFrame) -> list[tuple[Curve, FloatArray]]:
        """Return what each curve shows of a frame, those of hidden quantities aside."""
        columns, shown = frame.columns, [name for row in self._shown for name in row.all]
        lines = [(self.curves[name], columns[name]) for name in shown if name in columns]
        if PRESSURE in shown:
            lines.append((self.target, columns["target_kpa"]))
        if frame.predicted is not None:
            sensors = enumerate(sensor_names(columns))
            lines += [(self.predicted[q][0], frame.predicted[0][:, i]) for i, q in sensors if q in shown]
        if ELONGATION in shown and frame.elongation is not None:
            lines.append((self.curves[ELONGATION], frame.elongation.mm))
        return lines

    def _ranges(self, frame: PlotFrame) -> None:
        ranges = self.model.ranges(frame, monotonic())
        for plot, row in zip(self.rows, self._shown, strict=True):
            if row.left[0] in ranges:
                plot.y_range(*ranges[row.left[0]])
            if row.right and row.right[0] in ranges:
                plot.right_range(*ranges[row.right[0]])

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
            for layer in (layer for layers in self.layers.values() for layer in layers):
                layer.item.setOpacity(style.STALE_OPACITY if age else 1.0)
        self._age = age
        controls.set_text(self.heading, f"Last data {age}" if age else "", shorter=age)

    def _hover(self, at: QPointF) -> None:
        self._mouse = at
        self.show_values()

    def show_values(self) -> None:
        at, values = self._mouse, {}
        boxes = [plot.item.getViewBox() for plot in self.rows] if at is not None else []
        for box in (box for box in boxes if box.sceneBoundingRect().contains(at)):
            values = self.model.values_at(box.mapSceneToView(at).x())
        texts = self._texts(values)
        for plot in self.plots:
            shown = plot in self.rows and plot in texts
            if shown and plot not in self._hairs:
                self._hairs[plot] = plot.line(lambda t: t.text, vertical=True, label=" ", z=IN_FRONT + 2)
            if plot in self._hairs:
                self._hairs[plot].setVisible(shown)
            if shown:
                self._hairs[plot].label.setFormat(texts[plot])
                self._hairs[plot].setValue(values["time_s"])
        for plot, line in self._markers:  # a note below the value at the mouse is not seen in part
            hair = self._hairs.get(plot)
            value = hair.label.sceneBoundingRect() if hair is not None and hair.isVisible() else QRectF()
            line.label.setVisible(not value.intersects(line.label.sceneBoundingRect()))

    def _texts(self, values: Mapping[str, float]) -> dict[Plot, str]:
        """Return what each plot shows of the values at the mouse; the lowest one their time, too."""
        if not values:
            return {}
        shown = zip(self.rows, self._shown, strict=True)
        texts = {
            plot: ", ".join(value_text(name, values, self.model) for name in row.all if name in values)
            for plot, row in shown
        }
        lowest = self.rows[-1]
        texts[lowest] = f"{texts[lowest]}   {clock(values['time_s'])}"
        return texts

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() is QEvent.Type.Leave:
            self._leave()
        return super().eventFilter(watched, event)

    def _leave(self) -> None:
        """Hide the values at the mouse."""
        self._mouse = None
        self.show_values()

    def _moved(self, *_: object) -> None:
        """Keep the time that the mouse has moved to; a zoom in height alone follows on."""
        ranges = [tuple(plot.item.getViewBox().viewRange()[0]) for plot in self.rows]
        drawn = (self.last.low_s, self.last.high_s) if self.last is not None else ranges[0]
        moved = next((shown for shown in ranges if not np.allclose(shown, drawn, rtol=0.0, atol=1e-6)), None)
        if moved is not None:
            self.model.frozen_s = (max(moved[0], 0.0), max(moved[1], 1.0))

    def toggle_freeze(self) -> None:
        """Keep the current span, or follow the data again: the newest ones may lie above or below a box."""
        (self.model.toggle_freeze if self.model.following else self.autoscale)()

    def autoscale(self) -> None:
        """Follow the data again, each plot as high as they need."""
        self.model.frozen_s = None
        for plot in self.plots:
            plot.autoscale()

    def add_plot_actions(self, menu: QMenu, plot: Plot, x: float) -> None:
        menu.aboutToHide.connect(self._leave)  # the mouse may then be elsewhere, and no event says so
        for which in ("a", "b"):
            menu.addAction(f"Cursor {which.upper()} here", partial(self.move_cursor, which, x))
        if self.model.cursors_s:
            menu.addAction("Remove cursors", self.remove_cursors)
        self.add_zoom(menu, plot)
        layout, known = self.model.layout().complete(self.model.quantities()), self.model.quantities()
        axes = next((axes for row, axes in zip(self.rows, self._shown, strict=True) if row is plot), Axes(()))
        for quantity in axes.all:
            self._offer(menu, f"Hide {self.model.title(quantity)}", layout.without(quantity))
            if len(axes.left) > 1 and quantity in axes.left and not axes.right:
                self._offer(menu, f"Own axis: {self.model.title(quantity)}", layout.with_axis(quantity, right=True))
            if len(axes.all) > 1:
                self._offer(menu, f"Own plot: {self.model.title(quantity)}", layout.placed(quantity))
        if len(axes.all) == 1:
            for other in self._shown:
                if other is not axes:
                    host = other.left[0]
                    self._offer(menu, f"Draw with {self.model.title(host).lower()}", layout.placed(axes.left[0], host))
        for quantity in (q for q in layout.hidden if q in known):
            self._offer(menu, f"Show {self.model.title(quantity)}", layout.placed(quantity))

    def _offer(self, menu: QMenu, text: str, layout: Layout) -> None:
        menu.addAction(text, partial(self.layout_wanted.emit, layout))

    def move_cursor(self, which: str, at: float) -> None:
        if not self._cursors[which]:
            self.place_cursor(which)
        self._drag(which, at)

    def remove_cursors(self) -> None:
        for which in list(self.model.cursors_s):
            self.place_cursor(which)

    def place_cursor(self, which: str) -> None:
        """Put cursor "a" or "b" at a third or two thirds of the picture, or take it away."""
        if self._cursors[which]:
            for plot, line in self._cursors[which]:
                plot.remove_line(line)
            self._cursors[which] = []
            del self.model.cursors_s[which]
            self._part_labels()
            return
        at = self.model.cursors_s[which] = self.model.place(which)
        for plot in self.plots:
            name, solid = which.upper() if plot in self.rows[:1] else " ", Qt.PenStyle.SolidLine
            line = plot.line(
                lambda t: t.text, at=at, vertical=True, movable=True, style_=solid, label=name, z=IN_FRONT + 1
            )
            line.label.setPosition(0.0)  # apart from the markers' labels and the values at the mouse
            line.label.anchors = [(0, 1), (1, 1)]
            line.setHoverPen(style.colour(self.theme.accent))
            line.sigDragged.connect(lambda moved, which=which: self._drag(which, moved.value()))
            self._cursors[which].append((plot, line))
        self._part_labels()
        self.paint_theme(self.theme)

    def _drag(self, which: str, at: float) -> None:
        self.model.cursors_s[which] = at
        for _, line in self._cursors[which]:
            line.setValue(at)
        self._part_labels()

    def _part_labels(self) -> None:
        """Put the letters of two cursors on their outer sides."""
        first = min(self.model.cursors_s, key=lambda which: self.model.cursors_s[which], default="")
        for which, lines in self._cursors.items():
            for _, line in lines:
                line.label.side = int(which == first) if len(self.model.cursors_s) > 1 else None
                line.label.updatePosition()

    def show_markers(self) -> None:
        markers = self.model.notes()
        if len(markers) < len(self._markers):
            self._take_markers_away()
        for time_s, note in markers[len(self._markers) :] if self.rows else ():
            label, dots = shortened(note) or "\u25be", Qt.PenStyle.DotLine
            line = self.first.line(lambda t: t.muted, at=time_s, vertical=True, style_=dots, label=label)
            line.label.setToolTip(note)
            self._markers.append((self.first, line))
            self.paint_theme(self.theme)

    def _take_markers_away(self) -> None:
        """Remove the markers from the plot that is no longer at the top; `show_markers` draws them in the new one."""
        for plot, line in self._markers:
            plot.remove_line(line)
        self._markers = []


class OverlayPlots(PlotCard):
    """A plot over the time in the cycle for each sensor, made when it has something to show."""

    def __init__(self, model: OverlayModel) -> None:
        super().__init__("Last cycles overlaid")
        self.model = model
        self.curves: list[list[Curve]] = []  # by sensor
        self.others: dict[str, list[Curve]] = {}  # by column of an extra channel
        self._plots: dict[str, Plot] = {}  # by column
        self._shown: list[str] = []

    def _arrange(self, names: list[str], channels: Mapping[str, ExtraChannel]) -> None:
        if names == self._shown:
            return
        self._shown = names
        for name in (name for name in names if name not in self._plots):
            channel = channels.get(name)
            name_, unit_ = (channel.title, channel.unit) if channel is not None else (title(name), "mV")
            plot = self._plots[name] = self.add(name_, unit_, x_title="Time in the cycle", x_unit="s", time=True)
            faint = [plot.curve(f"{n} cycles ago", _past) for n in range(CYCLES_KEPT - 1, 0, -1)]
            if channel is not None:
                self.others[name] = [*faint, plot.curve("This cycle", lambda t: t.target)]
            else:
                self.curves.append([*faint, plot.curve("This cycle", sensor_colour(len(self.curves) + 1))])
        self.link_x()
        self.view.setMinimumHeight(style.LIVE_PLOTS_MINIMUM)
        self.show_only([self._plots[name] for name in names])
        self.paint_theme(self.theme)

    def draw(self) -> None:
        cycles = self.model.cycles()
        earlier = ", earlier ones grey" if len(cycles) > 1 else ""
        self.readout.setText(f"{len(cycles)} of the last {CYCLES_KEPT} cycles{earlier}" if cycles else "")
        self.show_empty("" if cycles else "The cycles of a run are drawn here once the first has begun.")
        if not cycles:
            return
        channels = self.model.channels()
        sensors, known = sensor_names(cycles[-1][1]), [n for n in channels if np.isfinite(cycles[-1][1][n]).any()]
        self._arrange([*sensors, *known], channels)
        drawn = dict(zip(sensors, self.curves, strict=False)) | {name: self.others[name] for name in known}
        for name, curves in drawn.items():
            for curve, (_, columns) in zip(reversed(curves), reversed(cycles), strict=False):
                curve.set(columns["time_s"], columns[name])
            self._plots[name].fit(x_margin=0.0)
