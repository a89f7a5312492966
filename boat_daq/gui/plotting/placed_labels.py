"""Labels of a plot's points and lines that cover neither each other nor the points.

They are placed again where the plot has another size or range; those of lines also while a line is moved. The order is
that of `analysis.studies.tradeoff.label_places`: what has no free place is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import isfinite
from typing import Any, NamedTuple

from PySide6.QtCore import QPointF
from PySide6.QtGui import QFontMetricsF

from analysis.studies.tradeoff.label_places import RINGS, Box, beside, best_place
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Layer, Plot

DOCUMENT_MARGIN = 4.0  # of Qt around the text of a label, pixels
STROKE = 3.0  # width that a line is taken for, pixels
ALONG = 12.0  # between two candidates along a line, pixels
TITLE_GAP = 4.0
BETWEEN = 4.0  # from one label to the next, pixels


class PointLabel(NamedTuple):
    """A text at (x, y) of the plot; `clear` pixels around the point are its marker."""

    x: float
    y: float
    text: str
    clear: float


class PlacedLabels:
    """The labels of one plot.

    Parameters
    ----------
    markers : layers of points, each with the width of its markers in pixels.
    curves : layers of lines, with NaN between strokes.
    lines : horizontal lines with a label.
    rings : number of distances at which a label may be from its point.
    """

    def __init__(
        self,
        plot: Plot,
        markers: Sequence[tuple[Layer, float]],
        curves: Sequence[Layer] = (),
        lines: Sequence[Any] = (),
        *,
        at_left: bool = False,
        rings: int = RINGS,
    ) -> None:
        self.plot, self.lines, self._at_left, self._rings = plot, lines, at_left, rings
        self._markers, self._curves = markers, curves
        self._box = plot.item.getViewBox()
        self._shown = plot.labels((0.0, 0.0))
        self._wanted: Sequence[PointLabel] = ()
        self._taken: list[Box] = []
        self._on_lines: list[Box] = []
        self._fixed: list[Box] = []  # what no label may cover
        self._points: list[Box] = []  # what a label of a line may cover where it has no other place
        self._drawn: list[Box] = []  # strokes
        for signal in (self._box.sigResized, self._box.sigRangeChanged):
            signal.connect(self._place)
        for line in lines:
            line.sigPositionChanged.connect(self._place_lines)

    @property
    def texts(self) -> list[str]:
        """The labels of points that are shown."""
        return self._shown.texts

    @property
    def boxes(self) -> list[Box]:
        """Where the labels that are shown are in the plot, in pixels."""
        return [*self._taken, *self._on_lines]

    def set(self, wanted: Sequence[PointLabel]) -> None:
        """Show these labels, the important ones first, at what the layers and lines show now."""
        self._wanted = wanted
        self._place()

    @property
    def _view(self) -> Box:
        return Box(0.0, 0.0, self._box.width(), self._box.height())

    def _place(self, *_: object) -> None:
        view = self._view
        if min(view.width, view.height) <= 0:
            return
        self._drawn = list(self._stroke_boxes())
        self._fixed, self._points = self._title(), list(self._marker_boxes())
        self._taken = []
        self._place_lines()  # they have few places
        drawn, shown = [*self._drawn, *map(self._line_box, self.lines)], []
        for label in self._wanted:
            at = self._pixel(label.x, label.y)
            places = beside(at.x(), at.y(), *_size(label.text), label.clear, self._rings)
            box = best_place(places, view, [*self._fixed, *self._points, *self._on_lines, *self._taken], drawn)
            if box is not None:
                self._taken.append(box)
                corner = self._box.mapToView(QPointF(box.left - DOCUMENT_MARGIN, box.top - DOCUMENT_MARGIN))
                shown.append((corner.x(), corner.y(), label.text))
        self._shown.set(shown)

    def _place_lines(self, *_: object) -> None:
        view, self._on_lines = self._view, []
        if min(view.width, view.height) <= 0:
            return
        for line in (line for line in self.lines if line.isVisible()):
            others = [self._line_box(other) for other in self.lines if other is not line]
            level, size = self._pixel(0.0, line.value()).y(), _size(line.label.toPlainText())
            taken, drawn = [*self._fixed, *self._taken, *self._on_lines], [*self._drawn, *others]
            places = [*_along(level, view.width, *size)]
            if self._at_left:
                places.reverse()
            box = best_place(places, view, [*taken, *self._points], drawn)
            box = box or best_place(places, view, taken, [*drawn, *self._points])
            line.label.setVisible(box is not None)
            if box is not None:
                self._on_lines.append(box)
                line.label.anchors = [(0, 0 if box.top > level else 1)] * 2
                line.label.setPosition((box.left - DOCUMENT_MARGIN) / view.width)

    def _pixel(self, x: float, y: float) -> QPointF:
        return self._box.mapFromView(QPointF(x, y))  # type: ignore[no-any-return]

    def _marker_boxes(self) -> Iterator[Box]:
        for layer, size in self._markers:
            for x, y in zip(layer.x.tolist(), layer.y.tolist(), strict=True):
                at = self._pixel(x, y)
                yield Box(at.x() - size / 2, at.y() - size / 2, size, size)

    def _stroke_boxes(self) -> Iterator[Box]:
        """Return what the curves cover; their strokes are level or upright."""
        for layer in self._curves:
            for one, other in pairwise(zip(layer.x.tolist(), layer.y.tolist(), strict=True)):
                if all(map(isfinite, (*one, *other))):
                    a, b = self._pixel(*one), self._pixel(*other)
                    left, top = min(a.x(), b.x()) - STROKE / 2, min(a.y(), b.y()) - STROKE / 2
                    yield Box(left, top, abs(a.x() - b.x()) + STROKE, abs(a.y() - b.y()) + STROKE)

    def _line_box(self, line: Any) -> Box:
        return Box(0.0, self._pixel(0.0, line.value()).y() - STROKE / 2, self._box.width(), STROKE)

    def _title(self) -> list[Box]:
        """Return the title of the vertical axis where it is in the corner of a low plot."""
        ruler = self.plot.left
        if not ruler.covered:
            return []
        title = ruler.label.boundingRect()
        return [Box(0.0, 0.0, title.width() + TITLE_GAP, title.height() + TITLE_GAP)]


def _size(text: str) -> tuple[float, float]:
    """Return width and height of a label, pixels."""
    metrics = QFontMetricsF(style.small_font())
    return metrics.horizontalAdvance(text) + BETWEEN, metrics.height()


def _along(level: float, across: float, width: float, height: float) -> Iterator[Box]:
    """Return the candidates of a label along a line, from the right end to the left, above and below it."""
    left = across - width - DOCUMENT_MARGIN
    while left >= DOCUMENT_MARGIN:
        for top in (level - DOCUMENT_MARGIN - height, level + DOCUMENT_MARGIN):
            yield Box(left, top, width, height)
        left -= ALONG
