"""Axes of the plots: ticks at 1-2-5, clock divisions or decades, a typographic minus, the grid behind the data.

pyqtgraph's own axis makes pens, points and boxes for each range and replays them from a QPicture: half the time of a
scrolling frame. Here lines and labels are drawn directly, and laid-out labels are cached. The grid is one path for each
axis, in the units of the plot and longer than what is shown: Qt moves it with the data, and no Python runs while it is
painted. An axis without labels, and the left one, are cached as pixels; only the lower one with labels is painted in
each frame of a scrolling plot. The grid is opaque: translucent lines take three times as long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QFontMetrics, QPainter, QPainterPath, QPen, QStaticText
from PySide6.QtWidgets import QGraphicsItem, QGraphicsPathItem

from boat_daq.formatting import clock, number, power_text
from boat_daq.gui import style
from boat_daq.gui.style import Theme
from boat_daq.viewmodels.live import axis
from protocol.base.units import MINUS, Shown, as_text

CACHED_LABELS = 500
_OVER = 0.1  # of a label's height, which may be outside the area of the axis
_BEFORE = 26.0  # pixels before a level axis, under the labels of the upright one: half a label of a time
_BEYOND = 5.0  # pixels of that area above and below an upright axis: labels at its ends reach into the gap
_VALUE_PLACES = 2  # of a value beside ticks at 1 to 9
ON_TICK = 1e-9  # of a step
LOG_LABELS = 7
GRID_BEYOND, GRID_LONGEST = 2.0, 50.0  # of what is shown: lines of the grid are longer on either side; at most so long
GRID_AHEAD = 0.25  # of what is shown: lines are laid over so much of the time to come
_TITLE_LINES = 2  # of a title beside the axis
_SHORT = (("Elongation", "Elong."), ("Pressure", "Press."))  # beside a low plot
_LABEL_GAP = 8  # pixels between two labels of the lower axis
LOG_DIGITS = (1, 2, 5)
_FEW_DECADES = 2.0  # over fewer, the 2 and the 5 between are labelled too


class TickAxis(pg.AxisItem):  # type: ignore[misc]
    """A left, right or lower axis; the lower one shows numbers, whole numbers, or a time."""

    _grid: QGraphicsPathItem | None = None
    _step = 1.0  # of the ticks
    _step_of: object = None  # of a time: what the step is for
    _worded: object = None  # ticks and how they are shown
    _words: Sequence[str] = ()  # beside these ticks
    _laid: tuple[float, float, object] = (0.0, 0.0, None)  # the range of a grid over time, and what its step is for
    _grid_shown: object = None  # ticks, length and theme of the grid as it is
    _grid_reach = (0.0, 0.0)  # where its lines begin and end
    _across: TickAxis | None = None  # whose lines lie along this axis
    _title = _unit = ""
    _clock = "min:s"  # what the labels of a time axis show
    _shown = Shown("")  # how the labels show the values of the plot

    def __init__(self, orientation: str, *, time: bool = False, whole: bool = False) -> None:
        self.time, self.whole = time, whole
        super().__init__(orientation)
        self.autoSIPrefix = False
        self.setStyle(tickLength=-4, autoExpandTextSpace=False, hideOverlappingLabels=True)
        self.set_theme(style.LIGHT)

    def set_theme(self, theme: Theme) -> None:
        self._line, self._text, self._font = pg.mkPen(theme.grid, width=1), pg.mkPen(theme.muted), style.small_font()
        self._labels: dict[str, QStaticText] = {}
        self.background = style.colour(theme.surface)
        self.setStyle(tickFont=self._font)
        self._theme = theme
        self.update()
        self._lay_grid()

    def updateAutoSIPrefix(self) -> None:
        """Do nothing: numbers are in the unit of the title, which pyqtgraph would lay out again at each call."""

    def set_title(self, title: str, unit: str) -> None:
        """Set what the axis measures; the unit of a time axis follows its labels."""
        self._title, self._shown = title, self._theme.units.shown(unit)
        self._unit = self._clock if self.time else as_text(self._shown.symbol)
        self.setLabel(named(title, self._unit) if title else "", **label_style(self._theme))
        self.label.setFont(self._font)
        self.label.document().setDocumentMargin(0)
        self.label.setCacheMode(QGraphicsItem.CacheMode.DeviceCoordinateCache)
        self.resizeEvent()  # else it is centred with the width of the label before it

    def resizeEvent(self, ev: Any = None) -> None:
        """Place the title in the gutter, whole in one line or two where it fits, else elided: never on the data."""
        upright = self.orientation != "bottom"
        if self.label is not None and self._title:
            length = self.size().height() if upright else self.size().width()
            lines = title_lines(self._title, self._unit, self._font, length, most=_TITLE_LINES if upright else 1)
            self.label.setHtml(self._titled("<br>".join(map(escape, lines))))
            self.label.setToolTip("" if " ".join(lines) == self.labelText else self.labelText)
            self.label.setTextWidth(max(1.0, length))
        super().resizeEvent(ev)
        if self.label is not None:
            size, thick = self.size(), self.label.boundingRect().height()
            if upright:
                self.label.setX(0 if self.orientation == "left" else size.width() - thick)
            else:
                self.label.setY(size.height() - thick)
        self._lay_grid()

    def _titled(self, text: str) -> str:
        """Return a title as centred rich text."""
        look = "; ".join(f"{key}: {value}" for key, value in label_style(self._theme).items())
        return f"<div align='center' style='{look}'>{text}</div>"

    def tickValues(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, list[float]]]:
        """Return one level of ticks: the multiples of its step in the range, ends included; the step as it is shown."""
        shown = self._shown
        minVal, maxVal = shown.value(minVal), shown.value(maxVal)
        span = maxVal - minVal
        below = self.orientation == "bottom"
        known = (self._known(minVal, maxVal), size) if self.time else None
        if known is None or self._step_of != known:
            step = axis.time_step(span) if self.time else axis.tick_step(span, math.inf if below else size)
            if not below and size > 0.0 < span:
                step = axis.finer_step(minVal, maxVal, step, size)
            if self.whole:
                step = max(1.0, step)
            while below and 0.0 < size < span / step * self._label_width(minVal, maxVal, step):
                step = axis.next_step(step, time=self.time)
            self._step, self._step_of = step, known
        step = self._step
        first, last = math.ceil(minVal / step - ON_TICK), math.floor(maxVal / step + ON_TICK)
        return [(step, [(n * step - shown.offset) / shown.factor for n in range(first, last + 1)])]

    def _known(self, low: float, high: float) -> tuple[float, str, int]:
        """Return what the step of a time depends on, the length aside."""
        return round(high - low, 6), self._clock, int(high // 60.0)

    def _label_width(self, low: float, high: float, step: float) -> float:
        """Return the width of the widest label at the ends of a range, in pixels, with the space beside it."""
        ends = [(math.floor(end / step) * step - self._shown.offset) / self._shown.factor for end in (low, high)]
        return max(self._label(text).size().width() for text in self.tickStrings(ends, 1.0, step)) + _LABEL_GAP

    def tickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        if self.time:
            return [axis.clock(value, spacing, self._clock) for value in values]
        shown = [self._shown.value(value) for value in values]
        return [str(text).replace("-", MINUS) for text in super().tickStrings(shown, scale, spacing)]

    def value_text(self, value: float) -> str:
        """Return a value with its unit, as the axis shows it: to about a hundredth of the step of its ticks."""
        places = 0 if self.whole else max(0, _VALUE_PLACES - math.floor(math.log10(self._step)))
        text = clock(value) if self.time else number(self._shown.value(value), places)
        return text if self.time or not self._unit else f"{text} {self._unit}"

    def setRange(self, mn: float, mx: float) -> None:
        """Set the range, and lay the grid where other ticks are in it; what has no labels is not painted again."""
        self.range = [mn, mx]
        if self.style["showValues"]:
            self.update()
        clock = axis.clock_unit(mn, mx)
        if self.time and clock != self._clock:
            self._clock = clock
            if self._title:
                self.set_title(self._title, "")
        low, high, known = self._laid
        if not (low <= mn and mx <= high and known == self._known(mn, mx)):
            self._lay_grid()
        if self._across is not None and not self._across._reaches(mn, mx):
            self._across._lay_grid()

    def boundingRect(self) -> QRectF:
        """Return the area of the axis and of its labels."""
        width, height = self.size().width(), self.size().height()
        if self.orientation == "bottom":
            return QRectF(-_BEFORE, 0.0, width + _BEFORE, height)
        return QRectF(0.0, -_BEYOND, width, height + 2.0 * _BEYOND)

    def paint(self, painter: QPainter, option: Any, widget: Any) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        area = self.rect()
        self._draw_line(painter, area)
        if self.style["showValues"]:
            step, values, places = self._ticks()
            ticks = (step, values, self._clock, self._shown)
            if ticks != self._worded:
                self._worded, self._words = ticks, self.tickStrings(values, 1.0, step)
            self._draw_labels(painter, area, places, self._words)

    def add_grid(self, plot: Any, across: TickAxis) -> None:
        """Draw a grid in a pyqtgraph plot, behind its data; its lines lie along the axis `across`."""
        across._across = self
        self._grid = QGraphicsPathItem()
        self._grid.setZValue(-1000)
        plot.addItem(self._grid, ignoreBounds=True)
        self._lay_grid()

    def _reaches(self, begin: float, end: float) -> bool:
        """Return whether the lines of the grid go through a range along them, and are not much longer."""
        low, high = self._grid_reach
        return low <= begin and end <= high and high - low < GRID_LONGEST * (end - begin)

    def _lay_grid(self) -> None:
        """Lay a line of the grid through each tick, where these have changed or the lines end inside the plot."""
        (low, high), upright = self.range, self.orientation == "bottom"  # its lines are
        length = self.size().width() if upright else self.size().height()
        if self._grid is None or length <= 0 or high <= low:
            return
        ((step, ticks),), (begin, end) = self.tickValues(low, high, length), self.linkedView().viewRange()[upright]
        lines = len(ticks)
        if self.time:
            last, ahead = math.floor(high / step), (high - low) * GRID_AHEAD
            ticks = [*ticks, *((last + n) * step for n in range(1, int(ahead / step) + 2))]
            self._laid = low, high + ahead, self._known(low, high)
        shown = (ticks, round(length), self._theme)
        if shown == self._grid_shown and self._reaches(begin, end):
            return
        self._grid_shown, margin = shown, GRID_BEYOND * (end - begin)
        begin, end = self._grid_reach = begin - margin, end + margin
        path = QPainterPath()
        for at in ticks:
            path.moveTo(*((at, begin) if upright else (begin, at)))
            path.lineTo(*((at, end) if upright else (end, at)))
        self._grid.setPath(path)
        self._grid.setPen(QPen(self._grid_colour(lines, length), 0))

    def _grid_colour(self, lines: int, length: float) -> QColor:
        """Return the colour of so many lines over a length in pixels; a dense grid is faint."""
        share = min(1.0, 0.05 * length / (lines + 1))
        tick, ground = self._line.color(), self.background
        pairs = ((tick.red(), ground.red()), (tick.green(), ground.green()), (tick.blue(), ground.blue()))
        return QColor(*(round(there + (here - there) * share) for here, there in pairs))

    def _ticks(self) -> tuple[float, list[float], list[float]]:
        """Return the step, the ticks' values, and how far along the axis each is, in pixels."""
        area, (low, high) = self.rect(), self.range
        length = area.width() if self.orientation == "bottom" else area.height()
        if length <= 0 or high <= low:
            return 1.0, [], []
        ((step, values),) = self.tickValues(low, high, length)
        return step, values, [(value - low) / (high - low) * length for value in values]

    def _draw_line(self, painter: QPainter, area: QRectF) -> None:
        painter.setPen(self._line)
        if self.orientation == "left":
            painter.drawLine(QLineF(area.right() - 1, area.top() - 1, area.right() - 1, area.bottom() + 1))
        elif self.orientation == "right" and self._title:  # without a title it only takes the width of the others
            painter.drawLine(QLineF(area.left() + 1, area.top() - 1, area.left() + 1, area.bottom() + 1))
        elif self.orientation == "bottom":
            painter.drawLine(QLineF(area.left() - 1, area.top() + 1, area.right() + 1, area.top() + 1))

    def _label(self, text: str) -> QStaticText:
        if text not in self._labels:
            if len(self._labels) >= CACHED_LABELS:
                self._labels.clear()
            made = self._labels[text] = QStaticText(text)
            made.setTextFormat(Qt.TextFormat.PlainText)
            made.prepare(font=self._font)
        return self._labels[text]

    def _draw_labels(self, painter: QPainter, area: QRectF, places: list[float], words: Sequence[str]) -> None:
        """Write the labels that lie wholly inside the axis and on no other one."""
        around, written = self.boundingRect(), -math.inf
        across, along = (float(offset) for offset in self.style["tickTextOffset"])
        painter.setFont(self._font)
        painter.setPen(self._text)
        for place, text in zip(places, words, strict=True):
            label = self._label(text)
            width, height = label.size().width(), label.size().height()
            if self.orientation != "bottom":
                x = area.right() - across - width if self.orientation == "left" else area.left() + across
                y, margin = area.bottom() - place - height / 2, _OVER * height
                inside = around.top() <= y + margin and y + height - margin <= around.bottom()
            else:
                x, y = area.left() + place - width / 2, area.top() + along
                if place < 0.5 and (not self.time or self.range[0] == 0.0):  # the begin, where nothing scrolls
                    x = max(x, around.left())
                elif place > area.width() - 0.5 and not self.time:
                    x = min(x, around.right() - width)
                inside = max(around.left(), written) <= x and x + width <= around.right()
                written = x + width if inside else written
            if inside:
                painter.drawStaticText(QPointF(x, y), label)


class LogAxis(TickAxis):
    """An axis whose data are base-10 logarithms: labels at powers of ten, at 1-2-5 where few decades are shown."""

    def value_text(self, value: float) -> str:
        return power_text(10.0**value)

    def tickValues(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, list[float]]]:
        """Return the one level of ticks, as logarithms."""
        return [(1.0, log_ticks(minVal, maxVal))]

    def tickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        return [self.value_text(value) for value in values]


def title_lines(title: str, unit: str, font: QFont, length: float, *, most: int) -> list[str]:
    """Return a title with its unit in at most `most` lines no longer than `length` pixels; else shortened or elided."""
    short = title
    for whole, shorter in _SHORT:
        short = short.replace(whole, shorter)
    for text, count in ((text, count) for text in (title, short) for count in range(1, most + 1)):
        words = [*text.split(), *([f"({unit})"] if unit else [])]
        cuts = range(1, len(words)) if count > 1 else [len(words)]
        options = [[" ".join(part) for part in (words[:cut], words[cut:]) if part] for cut in cuts]
        fitting = [lines for lines in options if max(style.text_width(font, line) for line in lines) <= length]
        if fitting:
            return fitting[-1]  # the unit in a line of its own, where that fits
    lines = [f"({unit})"] if unit and most > 1 else [named(title, unit)]  # the values at its side have the name
    return [QFontMetrics(font).elidedText(line, Qt.TextElideMode.ElideRight, max(1, int(length))) for line in lines]


def log_ticks(low: float, high: float) -> list[float]:
    """Return the logarithms of round values between two logarithms, about `LOG_LABELS` of them."""
    first, last = math.floor(low), math.ceil(high)
    digits = LOG_DIGITS if high - low <= _FEW_DECADES else (1,)
    step = max(1, math.ceil((last - first) / LOG_LABELS))
    ticks = [n + math.log10(d) for n in range(first, last + 1, step) for d in digits]
    return [t for t in ticks if low - 1e-9 <= t <= high + 1e-9]


def fixed_plot() -> Any:
    """Return an empty pyqtgraph plot with its own axes that the mouse does not move."""
    item = pg.PlotItem(enableMenu=False)
    item.hideButtons()
    item.setMouseEnabled(False, False)
    return item


def paint_axis(item: Any, side: str, theme: Theme, title: str = "") -> None:
    """Give an axis of pyqtgraph's own kind the colours and fonts of the theme, and its title."""
    ruler = item.getAxis(side)
    ruler.setPen(theme.line)
    ruler.setTextPen(theme.muted)
    ruler.setStyle(tickFont=style.small_font())
    if title:
        ruler.setLabel(title, **label_style(theme))


def named(title: str, unit: str) -> str:
    """Return a title with its unit in parentheses, where it has one."""
    return f"{title} ({unit})" if unit else title


def label_style(theme: Theme) -> dict[str, str]:
    """Return colour and size of an axis's title, as pyqtgraph takes them."""
    return {"color": theme.muted, "font-size": f"{style.FONT_SMALL}px"}
