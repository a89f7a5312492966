"""One plot as every page uses it: a thin wrapper around pyqtgraph that keeps its fast paths.

Rules: width-1 cosmetic pens, no antialiasing, no autorange (a page sets the range, from a view model), fixed axis
widths so that nothing jumps, ticks at 1-2-5, colours by role so that a change of theme repaints them. What a plot
shows can be had as columns (`columns`), which is what its CSV is made of.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGraphicsItem

from analysis.arrays import FloatArray
from boat_daq.gui import style
from boat_daq.gui.plotting.drawn import Drawn
from boat_daq.gui.plotting.tick_axis import TickAxis
from boat_daq.gui.style import Theme
from boat_daq.viewmodels.live import axis

Ink = Callable[[Theme], str]
L = TypeVar("L", bound="Layer")
EMPTY: FloatArray = np.zeros(0)
CLOCK = "min:s"  # the unit of an axis whose labels are a clock's

pg.setConfigOptions(antialias=False, useOpenGL=False, segmentedLineMode="off")


def sensor_ink(number: int) -> Ink:
    """Return the colour role of a sensor, numbered from 1."""
    return lambda theme: theme.sensors[(number - 1) % len(theme.sensors)]


def ramp_ink(place: int, of: int) -> Ink:
    """Return the colour role of one of several in a row, on viridis."""
    return lambda theme: style.sequential(theme, place, of)


class Layer:
    """One thing drawn in a plot: its pyqtgraph item, its colour role, its data for the CSV."""

    def __init__(self, name: str, item: Any, ink: Ink, paint: Callable[[Any, str], None]) -> None:
        self.name = name
        self.item = item
        self.ink = ink
        self._paint = paint
        self.x: FloatArray = EMPTY
        self.y: FloatArray = EMPTY

    def paint(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self._paint(self.item, self.ink(theme))

    def clear(self) -> None:
        """Draw nothing any more."""
        self.x = self.y = EMPTY

    def show(self, visible: bool) -> None:
        """Show or hide."""
        self.item.setVisible(visible)


class Curve(Layer):
    """A polyline; NaN breaks it when `gaps` is set."""

    gaps = False

    def set(self, x: FloatArray, y: FloatArray) -> None:
        """Draw `y` over `x` (same length)."""
        self.x, self.y = x, y
        self.item.draw_line(x, y, gaps=self.gaps)

    def go_on(self, x: FloatArray, y: FloatArray) -> None:
        """Draw on from the curve's end until it is set anew; `x` begins there."""
        self.item.go_on(x, y, gaps=self.gaps)

    def clear(self) -> None:
        """Draw nothing any more."""
        self.set(EMPTY, EMPTY)


class Band(Layer):
    """The surface between two curves."""

    low: FloatArray = EMPTY

    def set(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Fill between `low` and `high` over `x` (same length, finite)."""
        self.x, self.low, self.y = x, low, high
        self.item.fill_between(x, low, high)

    def clear(self) -> None:
        """Draw nothing any more."""
        self.set(EMPTY, EMPTY, EMPTY)


class Points(Layer):
    """Markers; filled or open, of one shape."""

    def set(self, x: FloatArray, y: FloatArray) -> None:
        """Put a marker at each (x, y)."""
        self.x, self.y = x, y
        self.item.setData(x=x, y=y)

    def clear(self) -> None:
        """Draw nothing any more."""
        self.set(EMPTY, EMPTY)


class Plot:
    """One plot of a card.

    Parameters
    ----------
    item : the pyqtgraph item, made by `make_item`.
    title : what its vertical axis measures, e.g. "Signal".
    unit : e.g. "mV".
    """

    def __init__(self, item: Any, title: str, unit: str, *, x_title: str = "", x_unit: str = "") -> None:
        self.item, self.title, self.unit = item, title, unit
        self.x_title, self.x_unit = x_title, x_unit
        self.layers: list[Layer] = []
        self._y_shown = (math.nan, math.nan)
        self._theme: Theme | None = None
        self.short = ""  # what stands beside the vertical axis where there is no room for title and unit
        self._lines: list[tuple[Any, Ink, Qt.PenStyle]] = []
        item.hideButtons()
        item.setMenuEnabled(False)
        item.getViewBox().disableAutoRange()
        item.getAxis("left").setWidth(style.AXIS_WIDTH)
        left, bottom = item.getAxis("left"), item.getAxis("bottom")
        if isinstance(left, TickAxis) and isinstance(bottom, TickAxis):
            bottom.draw_grid_of(left)
        else:
            item.showGrid(x=True, y=True, alpha=1.0)
        for side in ("left", "bottom"):
            item.getAxis(side).setZValue(-1000)  # the grid belongs behind the data
        item.getAxis("left").setCacheMode(QGraphicsItem.CacheMode.DeviceCoordinateCache)  # it changes seldom
        for side in ("right", "top"):
            item.getAxis(side).unlinkFromView()  # hidden, they would still be set anew in every frame

    def curve(self, name: str, ink: Ink, *, gaps: bool = False, dashed: bool = False) -> Curve:
        """Add a curve; `dashed` is for what is set, not measured."""
        pen_style = Qt.PenStyle.DashLine if dashed else Qt.PenStyle.SolidLine
        layer = Curve(name, Drawn(), ink, lambda it, colour: it.ink_line(colour, pen_style))
        layer.gaps = gaps
        return self._add(layer)

    def band(self, name: str, ink: Ink, *, alpha: int = style.BAND_ALPHA) -> Band:
        """Add a translucent fill between two curves, behind the rest."""
        item = Drawn()
        item.setZValue(-10)
        return self._add(Band(name, item, ink, lambda it, colour: it.ink_surface(style.colour(colour, alpha))))

    def points(
        self, name: str, ink: Ink, *, filled: bool = True, symbol: str = "o", size: int = style.POINT_SIZE
    ) -> Points:
        """Add markers: filled for loading, open for unloading."""
        item = pg.ScatterPlotItem(size=size, symbol=symbol, pxMode=True)

        def paint(it: Any, colour: str) -> None:
            it.setPen(pg.mkPen(colour, width=1))
            it.setBrush(pg.mkBrush(colour if filled else None))

        return self._add(Points(name, item, ink, paint))

    def line(
        self,
        ink: Ink,
        *,
        at: float = 0.0,
        vertical: bool = False,
        style_: Qt.PenStyle = Qt.PenStyle.DashLine,
        movable: bool = False,
        label: str = "",
    ) -> Any:
        """Add a straight line over the whole plot."""
        words = label.replace("{", "{{").replace("}", "}}")  # a note is no format
        item = pg.InfiniteLine(pos=at, angle=90 if vertical else 0, movable=movable, label=words or None)
        if label:
            item.label.setFont(style.small_font())
            if vertical:  # its words hang from the upper edge, whole on a low plot too, on the side that has room
                item.label.anchors = [(0, 0), (1, 0)]
            item.label.setPosition(1.0 if vertical else 0.94)
        self._lines.append((item, ink, style_))
        self.item.addItem(item, ignoreBounds=True)
        return item

    def forget_line(self, item: Any) -> None:
        """Take a line away."""
        self._lines = [entry for entry in self._lines if entry[0] is not item]
        self.item.removeItem(item)

    def _add(self, layer: L) -> L:
        self.layers.append(layer)
        self.item.addItem(layer.item, ignoreBounds=True)
        return layer

    def rename(self, title: str, unit: str) -> None:
        """Measure something else from now on."""
        if (title, unit) != (self.title, self.unit):
            self.title, self.unit = title, unit
            if self._theme is not None:
                self._titles(self._theme)

    def clear(self) -> None:
        """Take all data away; what was added stays."""
        for layer in self.layers:
            layer.clear()

    def x_range(self, low: float, high: float) -> None:
        """Show [low, high] horizontally."""
        if high > low:
            # ranges are never automatic here: to switch that off each time costs as much as the range
            self.item.getViewBox().setRange(xRange=(low, high), padding=0, disableAutoRange=False)

    def y_range(self, low: float, high: float) -> None:
        """Show [low, high] vertically; costs nothing where it is shown already."""
        if high > low and (low, high) != self._y_shown:
            self._y_shown = (low, high)
            self.item.getViewBox().setYRange(low, high, padding=0)

    def fit(self, *, x_margin: float = 0.04, smallest: float = 0.0) -> None:
        """Frame all that is drawn, at least `smallest` high; for pages that change on request, never in a frame."""
        layers = [layer for layer in self.layers if layer.item.isVisible() and layer.x.size]
        x_low, x_high = axis.extremes(*(layer.x for layer in layers))
        bands = (layer.low for layer in layers if isinstance(layer, Band))
        y_low, y_high = axis.extremes(*(layer.y for layer in layers), *bands)
        if x_low <= x_high and y_low <= y_high:
            self._y_shown = axis.framed(y_low, y_high, smallest=smallest)
            box = self.item.getViewBox()  # both at once, or a locked aspect would cut one of them off
            box.setRange(xRange=axis.padded(x_low, x_high, x_margin), yRange=self._y_shown, padding=0)

    @property
    def x_name(self) -> str:
        """What the lower axis measures, with the unit of its numbers: a clock's are seconds."""
        return named(self.x_title, "s" if self.x_unit == CLOCK else self.x_unit)

    def columns(self, x_name: str = "") -> dict[str, FloatArray]:
        """Return what is drawn: for each layer its x (called `x_name` where the lower axis says nothing) and y."""
        result: dict[str, FloatArray] = {}
        for layer in self.layers:
            if layer.x.size and layer.item.isVisible():
                result[f"{layer.name}: {self.x_name or x_name}"] = layer.x
                if isinstance(layer, Band):
                    result[f"{layer.name}: {named(f'{self.title}, low', self.unit)}"] = layer.low
                    result[f"{layer.name}: {named(f'{self.title}, high', self.unit)}"] = layer.y
                else:
                    result[f"{layer.name}: {named(self.title, self.unit)}"] = layer.y
        return result

    def paint(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self._theme = theme
        for side in ("left", "bottom"):
            ruler = self.item.getAxis(side)
            ruler.setPen(pg.mkPen(theme.grid, width=1))
            ruler.setTickPen(pg.mkPen(theme.grid, width=1))
            ruler.ground = style.colour(theme.surface)
            ruler.setTextPen(pg.mkPen(theme.muted))
            ruler.setStyle(tickFont=style.small_font())
        self._titles(theme)
        for layer in self.layers:
            layer.paint(theme)
        for item, ink, pen_style in self._lines:
            item.setPen(pg.mkPen(ink(theme), width=1, style=pen_style))
            if hasattr(item, "label"):
                item.label.setColor(ink(theme))

    def repaint(self) -> None:
        """Take the theme's colours again, for what was added since."""
        if self._theme is not None:
            self.paint(self._theme)

    def _titles(self, theme: Theme) -> None:
        look = {"color": theme.muted, "font-size": f"{style.FONT_SMALL}px"}
        words = self.short or named(self.title, self.unit)
        self.item.getAxis("left").setLabel(words, **look)
        self.item.getAxis("left").resizeEvent()  # else the label stays where the middle of the one before it was
        if self.x_title:
            self.item.getAxis("bottom").setLabel(named(self.x_title, self.x_unit), **look)


def named(title: str, unit: str) -> str:
    """Return what is measured with its unit in brackets, where it has one."""
    return f"{title} ({unit})" if unit else title


def make_item(*, time: bool = False, whole: bool = False) -> Any:
    """Return an empty pyqtgraph plot with our axes; the lower one shows a time, or whole numbers."""
    item = pg.PlotItem(
        axisItems={"left": TickAxis("left"), "bottom": TickAxis("bottom", time=time, whole=whole)}, enableMenu=False
    )
    for frame in (item, item.getViewBox()):
        frame.setFlag(QGraphicsItem.GraphicsItemFlag.ItemHasNoContents)  # Qt need not ask Python what they look like
    item.getViewBox().borderRect.hide()
    return item
