"""One plot as every page uses it: a thin layer over pyqtgraph that keeps its fast paths.

Rules: width-1 cosmetic pens, no antialiasing, no autorange (a page sets the range, from a view model), fixed axis
widths so that nothing jumps, ticks at 1-2-5, colours by role so that a change of theme repaints them. What a plot
shows is available as columns (`columns`), from which its CSV is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import zip_longest
from typing import Any, TypeVar

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QBrush, QColor, QGuiApplication, QPainter, QPainterPath, QPen, QTransform
from PySide6.QtWidgets import QGraphicsItem, QGraphicsPathItem, QWidget

from boat_daq.gui import style
from boat_daq.gui.plotting.axes import TickAxis, named
from boat_daq.gui.style import Theme
from boat_daq.viewmodels.live import axis
from protocol.base.arrays import FloatArray

ThemeColour = Callable[[Theme], str]
L = TypeVar("L", bound="Layer")
_EMPTY: FloatArray = np.zeros(0)
IN_FRONT = 10  # of the data; what is higher covers other labels, too
FILLED_POINTS = 64  # points of a surface of a band
COSMETIC = 0.0  # a pen of this width is one pixel at any zoom and adds nothing to the bounds
_HALF_A_PIXEL = QTransform.fromTranslate(0.5, 0.5)
_SEEN_SHARE = 0.01  # of a height: a lower band is covered by its line
DASHES_PX = 6.0  # after so many the patterns of dashed and of dotted lines begin again

pg.setConfigOptions(antialias=False, useOpenGL=False, segmentedLineMode="off")


def line_width() -> float:
    """Return the width of a line: at twice the pixels one of a single pixel is hardly seen."""
    ratio = QGuiApplication.primaryScreen().devicePixelRatio()
    return ratio if ratio > 1.0 else COSMETIC


def sensor_colour(number: int) -> ThemeColour:
    """Return the colour role of a sensor, numbered from 1."""
    return lambda theme: theme.sensors[(number - 1) % len(theme.sensors)]


def ramp_colour(place: int, of: int) -> ThemeColour:
    """Return the colour role of one of several in a row, on viridis."""
    return lambda _: style.sequential(place, of)


class PathItem(QGraphicsPathItem):
    """A line or a filled surface: one path in the plot's units, painted by Qt alone.

    No Python runs while it is painted: pyqtgraph paints a curve through Python and joins its fills point by point,
    thousands of objects a frame. The shape under the mouse is the bounding rectangle: a stroked outline of a thousand
    points would be made for each move of the mouse.
    """

    _end: PathItem | None = None  # what was added since it was drawn
    _parts: tuple[PathItem, ...] = ()  # further surfaces of a band

    def draw_line(self, x: FloatArray, y: FloatArray, *, gaps: bool) -> None:
        """Draw `y` over `x` (same length); with `gaps`, a value that is not finite breaks the line."""
        broken = gaps and not (np.isfinite(y).all() and np.isfinite(x).all())
        self.setPath(pg.functions.arrayToQPath(x, y, "finite" if broken else "all", broken))
        if self._end is not None:
            self._end.setPath(QPainterPath())

    @property
    def end(self) -> PathItem:
        """The item that continues this one behind its end, until this one is drawn again."""
        if self._end is None:
            self._end = self._part()
        return self._end

    def _part(self) -> PathItem:
        part = type(self)(self)
        part.setPen(self.pen())
        part.setBrush(self.brush())
        return part

    def extend_line(self, x: FloatArray, y: FloatArray) -> None:
        """Continue the line behind its end; a value that is not finite breaks it."""
        path = self.end.path()
        drawn = not path.isEmpty()
        for at, value in zip(x.tolist(), y.tolist(), strict=True):
            if math.isfinite(value):
                (path.lineTo if drawn else path.moveTo)(at, value)
            drawn = math.isfinite(value)
        self.end.setPath(path)

    def extend_surface(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        path = self.end.path()
        path.addPath(_surface(x, low, high))
        path.setFillRule(Qt.FillRule.WindingFill)
        self.end.setPath(path)

    def lay_dashes(self, begin_px: float, end_px: float) -> None:
        """Let the pattern of a dashed line that begins and ends at these pixels move with it."""
        for line, at in ((self, begin_px), (self.end, end_px)):
            pen = line.pen()
            pen.setDashOffset(at % DASHES_PX)
            line.setPen(pen)

    def fill_between(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Fill between `low` and `high` over `x`, which never falls (same length, finite).

        Qt's time to fill a surface grows with the square of the edges that cross a line of pixels: many narrow surfaces
        of a noisy band are painted in a tenth of the time of a wide one.
        """
        begins = range(0, max(x.size - 1, 1), FILLED_POINTS)
        for _ in range(len(self._parts) + 1, len(begins)):
            self._parts = (*self._parts, self._part())
        for begin, part in zip_longest(begins, (self, *self._parts)):
            path = QPainterPath()
            if begin is not None:
                path = _surface(*(values[begin : begin + FILLED_POINTS + 1] for values in (x, low, high)))
            part.setPath(path)
        if self._end is not None:
            self._end.setPath(QPainterPath())

    def set_line_colour(self, colour: str, pen_style: Qt.PenStyle, *, thin: bool) -> None:
        for line in (self, self._end):
            if line is not None:
                pen = QPen(QColor(colour), COSMETIC if thin else line_width(), pen_style)
                pen.setCosmetic(True)
                line.setPen(pen)

    def set_fill_colour(self, colour: QColor) -> None:
        for part in filter(None, (self, *self._parts, self._end)):
            part.setPen(QPen(Qt.PenStyle.NoPen))
            part.setBrush(QBrush(colour))

    def shape(self) -> QPainterPath:
        bounds = QPainterPath()
        bounds.addRect(self.path().controlPointRect())
        return bounds


def _surface(x: FloatArray, low: FloatArray, high: FloatArray) -> QPainterPath:
    path: QPainterPath = pg.functions.arrayToQPath(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]))
    path.setFillRule(Qt.FillRule.WindingFill)
    return path


class TwicePathItem(PathItem):
    """A line painted twice, half a pixel apart: as wide at twice the pixels, in a fifth of the time of a wide pen."""

    def paint(self, painter: QPainter, option: Any, widget: QWidget | None = None) -> None:
        super().paint(painter, option, widget)
        painter.setWorldTransform(painter.worldTransform() * _HALF_A_PIXEL)
        super().paint(painter, option, widget)


class Layer:
    """One curve, band or set of points: its pyqtgraph item, its colour role, its data for the CSV."""

    def __init__(self, name: str, item: Any, colour: ThemeColour, paint: Callable[[Any, str], None]) -> None:
        self.name, self.item, self.colour, self._paint = name, item, colour, paint
        self.x: FloatArray = _EMPTY
        self.y: FloatArray = _EMPTY

    def set(self, x: FloatArray, y: FloatArray) -> None:
        """Draw `y` over `x` (same length)."""
        self.x, self.y = x, y

    def paint(self, theme: Theme) -> None:
        self._paint(self.item, self.colour(theme))

    def clear(self) -> None:
        if self.x.size:
            self.set(_EMPTY, _EMPTY)

    def show(self, visible: bool) -> None:
        self.item.setVisible(visible)


class Curve(Layer):
    """A polyline; NaN breaks it when `gaps` is set."""

    gaps = False

    def set(self, x: FloatArray, y: FloatArray) -> None:
        super().set(x, y)
        self.item.draw_line(x, y, gaps=self.gaps)

    def extend(self, x: FloatArray, y: FloatArray) -> None:
        """Continue the curve behind its end until it is set again; `x` begins there."""
        self.item.extend_line(x, y)


class Band(Layer):
    """The surface between two curves."""

    low: FloatArray = _EMPTY

    def fill(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Fill between `low` and `high` over `x` (same length, finite)."""
        super().set(x, high)
        self.low = low
        self.item.fill_between(x, low, high)

    def extend(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Continue the surface behind its end until it is filled again; `x` begins there."""
        self.item.extend_surface(x, low, high)

    def clear(self) -> None:
        if self.x.size:
            self.fill(_EMPTY, _EMPTY, _EMPTY)


class Points(Layer):
    """Markers; filled or open, of one shape."""

    def set(self, x: FloatArray, y: FloatArray) -> None:
        super().set(x, y)
        self.item.setData(x=x, y=y)


class PointLabels:
    """Short texts beside points of a plot, each made once and then hidden; with `ground` they cover what is below."""

    def __init__(self, item: Any, anchor: tuple[float, float], *, ground: bool = False) -> None:
        self._plot, self._anchor, self._ground = item, anchor, ground
        self._theme: Theme = style.LIGHT
        self._items: list[Any] = []
        self.texts: list[str] = []

    def set(self, labels: Sequence[tuple[float, float, str]]) -> None:
        """Show these labels, each at (x, y) of the plot, and no others."""
        self.texts = [text for _, _, text in labels]
        while len(self._items) < len(labels):
            item = pg.TextItem("", anchor=self._anchor)
            item.setFont(style.small_font())
            self._plot.addItem(item, ignoreBounds=True)
            self._items.append(item)
            self.paint(self._theme)
        for i, item in enumerate(self._items):
            item.setVisible(i < len(labels))
        for item, (x, y, text) in zip(self._items, labels, strict=False):
            item.setText(text)
            item.setPos(x, y)

    def paint(self, theme: Theme) -> None:
        self._theme = theme
        for item in self._items:
            item.setColor(theme.text)
            item.fill = pg.mkBrush(theme.surface if self._ground else None)


class CornerText:
    """A text in the upper right corner of a plot, whatever its range."""

    def __init__(self, item: Any) -> None:
        self._box = item.getViewBox()
        self._item = pg.TextItem("", anchor=(1.0, 0.0))
        self._item.setFont(style.small_font())
        self._item.setParentItem(self._box)
        self._box.sigResized.connect(self._place)
        self._place()

    @property
    def text(self) -> str:
        return str(self._item.toPlainText())

    def set(self, text: str) -> None:
        self._item.setText(text)

    def _place(self, *_: object) -> None:
        self._item.setPos(self._box.width(), 0.0)

    def paint(self, theme: Theme) -> None:
        self._item.setColor(theme.muted)
        self._item.fill = pg.mkBrush(theme.surface)


class LineLabel(pg.InfLineLabel):  # type: ignore[misc]
    """The text of a line: whole inside the plot, on the side with space; none where its line is outside."""

    side: int | None = None  # of an upright line, 0 right, 1 left; None: where there is space
    ground: QColor | None = None

    def valueChanged(self) -> None:
        self.fill = pg.mkBrush(self.ground if self.format.strip() else None)
        super().valueChanged()

    def updatePosition(self) -> None:
        super().updatePosition()
        box = self.line.getViewBox()
        if not isinstance(box, pg.ViewBox) or self.line.angle % 180 == 0 or not box.width():
            return
        low, high = box.viewRange()[0]
        at = (float(self.line.value()) - low) / (high - low)
        share = self.textItem.boundingRect().width() / box.width()
        across, down = self.anchors[at > 0.5 if self.side is None else self.side]
        if 0.0 < share < 1.0:
            across = min(max(across, 1.0 - (1.0 - at) / share), at / share)
        self.setAnchor((across, down))
        self.setOpacity(float(0.0 <= at <= 1.0))


class PlotBox(pg.ViewBox):  # type: ignore[misc]
    """The area of the data: a drag pans, with Shift it zooms to a box; the wheel zooms, over an axis along it alone.

    Attributes
    ----------
    along : whether drag and wheel over the data act on the lower axis alone, as in plots over time.
    box_next : whether the next drag zooms to a box without Shift.
    """

    autoscale_wanted = Signal()

    def __init__(self) -> None:
        super().__init__(enableMenu=False)
        self.along = self.box_next = self._boxes = False

    def mouseDragEvent(self, ev: Any, axis: int | None = None) -> None:
        if ev.button() is Qt.MouseButton.RightButton:
            ev.ignore()
            return
        if ev.isStart():
            shift = bool(ev.modifiers() & Qt.KeyboardModifier.ShiftModifier)
            self._boxes = axis is None and any(self.state["mouseEnabled"]) and (self.box_next or shift)
        self.state["mouseMode"] = self.RectMode if self._boxes else self.PanMode
        super().mouseDragEvent(ev, 0 if self.along and axis is None and not self._boxes else axis)
        if ev.isFinish():
            self.box_next = self._boxes = False
            self.unsetCursor()

    def showAxRect(self, ax: Any, **kwargs: Any) -> None:
        super().showAxRect(ax, padding=0, **kwargs)

    def wheelEvent(self, ev: Any, axis: int | None = None) -> None:
        """Zoom; with Ctrl in height alone."""
        upright = bool(ev.modifiers() & Qt.KeyboardModifier.ControlModifier)
        super().wheelEvent(ev, 1 if upright else 0 if self.along and axis is None else axis)

    def mouseClickEvent(self, ev: Any) -> None:
        if ev.double() and ev.button() is Qt.MouseButton.LeftButton:
            ev.accept()
            self.autoscale_wanted.emit()

    def scroll(self, low: float, high: float) -> bool:
        """Show [low, high] across; return whether that was possible.

        `setRange` informs links and items, which takes ten times as long; paths and points need nothing but the matrix.
        """
        if not self.moves_alone():
            return False
        self.state["targetRange"][0], self.state["viewRange"][0] = [low, high], [low, high]
        before, scale = self.childGroup.transform(), self.width() / (high - low)
        self.childGroup.setTransform(QTransform(scale, 0.0, 0.0, before.m22(), -low * scale, before.dy()))
        self.sigTransformChanged.emit(self)
        return True

    def moves_alone(self) -> bool:
        """Return whether all that is seen moves with the matrix: no line or text that is placed by the edges."""
        placed = (item for item in self.addedItems if isinstance(item, pg.GraphicsObject) and item.isVisible())
        return all(isinstance(item, pg.ScatterPlotItem) for item in placed)

    def zoom_to_next_box(self) -> None:
        self.box_next = True
        self.setCursor(Qt.CursorShape.CrossCursor)


class Plot:
    def __init__(self, item: Any, title: str, unit: str, *, x_title: str = "", x_unit: str = "") -> None:
        self.item, self.title, self.unit = item, title, unit
        self.x_title, self.x_unit = x_title, x_unit
        self.layers: list[Layer] = []
        self._y_shown = (math.nan, math.nan)
        self._home: tuple[tuple[float, float], tuple[float, float]] | None = None  # x and y of the last fit
        self.y_held = False  # the operator has zoomed in height
        self.cursor: Any = None
        self._x_shown = ("", "")  # title and unit below it
        self._theme: Theme | None = None
        self._lines: list[tuple[Any, ThemeColour, Qt.PenStyle]] = []
        self._labels: list[PointLabels | CornerText] = []
        self.right: TickAxis | None = None  # made where it is first needed
        self._right_shown = ("", "")  # title and unit beside it
        self._on_right: list[Layer] = []
        self._right_range = (0.0, 1.0)
        item.hideButtons()
        item.setMenuEnabled(False)
        box = item.getViewBox()
        box.disableAutoRange()
        reports = QGraphicsItem.GraphicsItemFlag.ItemSendsGeometryChanges
        box.childGroup.setFlag(reports, False)  # they would come to Python in each frame
        box.sigRangeChangedManually.connect(self._moved)
        box.autoscale_wanted.connect(self.autoscale)
        self.left, self.bottom = item.getAxis("left"), item.getAxis("bottom")
        self.left.setWidth(style.AXIS_WIDTH)
        for ruler in (self.left, self.bottom):  # what is painted beside them leaves them as they are
            ruler.setCacheMode(QGraphicsItem.CacheMode.DeviceCoordinateCache)
        self.label_x(x_title, x_unit)
        for ruler, across in ((self.bottom, self.left), (self.left, self.bottom)):
            ruler.add_grid(item, across)
        for side in ("right", "top"):
            item.getAxis(side).unlinkFromView()  # hidden, they would still be updated in every frame

    def curve(
        self,
        name: str,
        colour: ThemeColour,
        *,
        gaps: bool = False,
        thin: bool = False,
        pen_style: Qt.PenStyle = Qt.PenStyle.SolidLine,
    ) -> Curve:
        """Add a curve; dashed for a value that is set, not measured; `thin` where it is painted many times a second."""
        item = TwicePathItem() if thin and line_width() != COSMETIC else PathItem()
        layer = Curve(name, item, colour, lambda it, value: it.set_line_colour(value, pen_style, thin=thin))
        layer.gaps = gaps
        return self._add(layer)

    def band(self, name: str, colour: ThemeColour, *, alpha: int = style.BAND_OPACITY) -> Band:
        """Add a translucent fill between two curves, behind the rest."""
        item = PathItem()
        item.setZValue(-10)
        return self._add(Band(name, item, colour, lambda it, value: it.set_fill_colour(style.colour(value, alpha))))

    def points(
        self, name: str, colour: ThemeColour, *, filled: bool = True, symbol: str = "o", size: int = style.POINT_SIZE
    ) -> Points:
        """Add markers: filled for loading, open for unloading."""
        item = pg.ScatterPlotItem(size=size, symbol=symbol, pxMode=True)

        def paint(it: Any, value: str) -> None:
            it.setPen(pg.mkPen(value, width=1))
            it.setBrush(pg.mkBrush(value if filled else None))

        return self._add(Points(name, item, colour, paint))

    def line(
        self,
        colour: ThemeColour,
        *,
        at: float = 0.0,
        vertical: bool = False,
        style_: Qt.PenStyle = Qt.PenStyle.DashLine,
        movable: bool = False,
        label: str = "",
        z: int = IN_FRONT,
    ) -> Any:
        item = pg.InfiniteLine(pos=at, angle=90 if vertical else 0, movable=movable)
        if label:
            item.label = LineLabel(item, text=label.replace("{", "{{").replace("}", "}}"))  # pyqtgraph formats it
            item.setZValue(z)  # its text is in front of the data
            item.label.setFont(style.small_font())
            # below the upper edge on the side with space, or inside the right edge: visible on a small plot too
            item.label.anchors = [(0, 0), (1, 0)] if vertical else [(1, 0), (1, 1)]
            item.label.setPosition(1.0)
        self._lines.append((item, colour, style_))
        self.item.addItem(item, ignoreBounds=True)
        if self._theme is not None:
            self.paint(self._theme)
        return item

    def labels(self, anchor: tuple[float, float], *, ground: bool = False) -> PointLabels:
        made = PointLabels(self.item, anchor, ground=ground)
        self._labels.append(made)
        return made

    def corner_text(self) -> CornerText:
        made = CornerText(self.item)
        self._labels.append(made)
        return made

    def remove_line(self, item: Any) -> None:
        self._lines = [entry for entry in self._lines if entry[0] is not item]
        self.item.removeItem(item)

    def _add(self, layer: L) -> L:
        self.layers.append(layer)
        self.item.addItem(layer.item, ignoreBounds=True)
        return layer

    def hold(self, own: Sequence[Layer], on_right: Sequence[Layer] = ()) -> None:
        """Show these layers and no others, some by the right axis; they may have been in another plot."""
        wanted = [*own, *on_right]
        for layer in self.layers:
            if layer not in wanted:
                self.item.removeItem(layer.item)
        for layer in wanted:
            if layer not in self.layers:
                self.item.addItem(layer.item, ignoreBounds=True)
            layer.item.resetTransform()
        self.layers, self._on_right = wanted, list(on_right)
        self._place_right()

    def set_right(self, title: str, unit: str, width: int) -> None:
        """Set what the right axis measures; without a title it only takes `width` pixels, as those above and below."""
        if self.right is None and not width:
            return
        if self.right is None:
            self.right = TickAxis("right")
            self.item.setAxisItems({"right": self.right})
            self.right.unlinkFromView()  # its range is set here
        self._right_shown = (title, unit)
        self.right.setVisible(bool(width))
        self.right.setWidth(width)
        self.right.setStyle(showValues=bool(title))
        if self._theme is not None:
            self.right.set_theme(self._theme)
            self.right.set_title(title, unit)

    def right_range(self, low: float, high: float) -> None:
        if high > low and (low, high) != self._right_range:
            self._right_range = (low, high)
            self._place_right()

    def _place_right(self) -> None:
        """Draw what belongs to the right axis at its heights: scaled to the left one, by which Qt paints."""
        if self.right is None or not self._on_right:
            return
        (low, high), (left_low, left_high) = self._right_range, self.item.getViewBox().viewRange()[1]
        scale = (left_high - left_low) / (high - low)
        for layer in self._on_right:
            layer.item.setTransform(QTransform(1, 0, 0, scale, 0, left_low - scale * low))
        self.right.setRange(low, high)

    def set_title(self, title: str, unit: str) -> None:
        if (title, unit) != (self.title, self.unit):
            self.title, self.unit = title, unit
            if self._theme is not None:
                self._write_titles()

    def clear(self) -> None:
        for layer in self.layers:
            layer.clear()

    def x_range(self, low: float, high: float) -> None:
        if high > low:
            # ranges are never automatic: disabling autorange each time takes as long as the range
            self.item.getViewBox().setRange(xRange=(low, high), padding=0, disableAutoRange=False)

    def scroll(self, low: float, high: float) -> None:
        """Show [low, high] horizontally, as a frame does."""
        if high > low:
            if self.item.getViewBox().scroll(low, high):
                self.bottom.setRange(low, high)
            else:
                self.x_range(low, high)

    def is_seen(self, heights: FloatArray) -> bool:
        """Return whether one of some heights is more than a line at the shown range."""
        low, high = self._y_shown
        return bool(heights.max() > _SEEN_SHARE * (high - low))

    def y_range(self, low: float, high: float) -> None:
        """Show [low, high] vertically; nothing is done where it is shown already."""
        if high > low and (low, high) != self._y_shown:
            self._y_shown = (low, high)
            if not self.y_held:
                self.item.getViewBox().setYRange(low, high, padding=0)
                self._place_right()

    def _moved(self, *_: object) -> None:
        """Keep the height that the operator has zoomed to."""
        shown = self.item.getViewBox().viewRange()[1]
        self.y_held = self.y_held or not np.allclose(shown, self._y_shown, rtol=1e-9, atol=0.0)
        self._place_right()

    def autoscale(self) -> None:
        box = self.item.getViewBox()
        self.y_held = False
        if self._home is not None:
            box.setRange(xRange=self._home[0], yRange=self._home[1], padding=0)
        elif math.isfinite(self._y_shown[0]):
            box.setYRange(*self._y_shown, padding=0)
        self._place_right()

    def place_cursor(self, x: float) -> None:
        """Put the movable cursor at `x`; it shows the value of the first curve there."""
        if self.cursor is None:
            self.cursor = self.line(
                lambda t: t.text, vertical=True, movable=True, style_=Qt.PenStyle.SolidLine, label=" "
            )
            self.cursor.sigPositionChanged.connect(self._show_cursor)
        self.cursor.setValue(x)
        self._show_cursor()

    def remove_cursor(self) -> None:
        if self.cursor is not None:
            self.remove_line(self.cursor)
            self.cursor = None

    def _show_cursor(self, *_: object) -> None:
        """Show the cursor's place, and the curve's value there."""
        x = float(self.cursor.value())
        text = self.bottom.value_text(x)
        for layer in self.layers:
            rising = np.all(np.diff(layer.x) >= 0)
            if type(layer) is Curve and layer.x.size > 1 and rising and layer.x[0] <= x <= layer.x[-1]:
                text = f"{self.left.value_text(float(np.interp(x, layer.x, layer.y)))} at {text}"
                break
        self.cursor.label.setFormat(text)

    def fit(self, *, x_margin: float = 0.04, smallest: float = 0.0, also_y: Sequence[float] = ()) -> None:
        """Show all that is drawn and the heights `also_y`, at least `smallest` high; not in a frame."""
        layers = [layer for layer in self.layers if layer.item.isVisible() and layer.x.size]
        x_low, x_high = axis.extremes(*(layer.x for layer in layers))
        bands = (layer.low for layer in layers if isinstance(layer, Band))
        y_low, y_high = axis.extremes(*(layer.y for layer in layers), *bands, np.array(also_y, dtype=float))
        if x_low <= x_high and y_low <= y_high:
            self._y_shown = axis.framed(y_low, y_high, smallest=smallest)
            self._home = axis.padded(x_low, x_high, x_margin), self._y_shown
            self.autoscale()  # both ranges at once: a locked aspect would cut one of them off

    @property
    def x_name(self) -> str:
        """What the lower axis measures, with the unit of its numbers."""
        return named(self.x_title, self.x_unit)

    def columns(self, x_name: str = "") -> dict[str, FloatArray]:
        """Return what is drawn: for each layer its x (called `x_name` where the lower axis has no title) and y."""
        result: dict[str, FloatArray] = {}
        for layer in self.layers:
            if layer.x.size and layer.item.isVisible():
                result[f"{layer.name}: {self.x_name or x_name}"] = layer.x
                ends = {", low": layer.low, ", high": layer.y} if isinstance(layer, Band) else {"": layer.y}
                for end, y in ends.items():
                    result[f"{layer.name}: {named(self.title + end, self.unit)}"] = y
        return result

    def paint(self, theme: Theme) -> None:
        self._theme = theme
        for ruler in (self.left, self.bottom, self.right):
            if ruler is not None:
                ruler.set_theme(theme)
        self._write_titles()
        self.item.getViewBox().rbScaleBox.setPen(pg.mkPen(theme.accent, width=1))
        self.item.getViewBox().rbScaleBox.setBrush(style.colour(theme.accent, style.BAND_ALPHA_WIDE))
        for layer in self.layers:
            layer.paint(theme)
        for labels in self._labels:
            labels.paint(theme)
        for item, colour, pen_style in self._lines:
            item.setPen(pg.mkPen(colour(theme), width=max(line_width(), 1.0), style=pen_style))
            if getattr(item, "movable", False):
                item.setHoverPen(pg.mkPen(colour(theme), width=2, style=pen_style))
            if hasattr(item, "label"):
                item.label.setColor(colour(theme))
                opacity = style.LABEL_OPACITY if item.zValue() <= IN_FRONT else 255
                item.label.ground = style.colour(theme.surface, opacity)
                item.label.valueChanged()

    def label_x(self, title: str, unit: str) -> None:
        """Label the lower axis with its values and title; leave both out without a title."""
        self._x_shown = (title, unit)
        self.bottom.setStyle(showValues=bool(title))
        self.bottom.setHeight(style.AXIS_HEIGHT if title else style.STEP)

    def _write_titles(self) -> None:
        self.left.set_title(self.title, self.unit)
        self.bottom.set_title(*self._x_shown)
        if self.right is not None:
            self.right.set_title(*self._right_shown)


def make_item(*, time: bool = False, whole: bool = False) -> Any:
    """Return an empty pyqtgraph plot with our axes; the lower one shows a time, or whole numbers."""
    item = pg.PlotItem(
        viewBox=PlotBox(),
        axisItems={"left": TickAxis("left"), "bottom": TickAxis("bottom", time=time, whole=whole)},
        enableMenu=False,
    )
    for frame in (item, item.getViewBox()):
        frame.setFlag(QGraphicsItem.GraphicsItemFlag.ItemHasNoContents)  # Qt does not call their Python paint
    item.getViewBox().borderRect.hide()
    return item
