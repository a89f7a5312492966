"""Short words beside points of a plot; a label once made is kept and hidden until it is needed again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pyqtgraph as pg

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Plot
from boat_daq.gui.style import Theme


class PointLabels:
    """The labels of one plot.

    Parameters
    ----------
    anchor : which place of a label stands at its point, in widths and heights of the label.
    ground : whether a label covers what it stands on, as one on a curve must.
    """

    def __init__(self, plot: Plot, anchor: tuple[float, float], *, ground: bool = False) -> None:
        self._plot, self._anchor, self._ground = plot, anchor, ground
        self._theme: Theme = style.LIGHT
        self._items: list[Any] = []
        self.texts: list[str] = []

    def set(self, labels: Sequence[tuple[float, float, str]]) -> None:
        """Show these labels, each at (x, y) of the plot, and no others."""
        self.texts = [text for _, _, text in labels]
        while len(self._items) < len(labels):
            self._items.append(self._made())
        for i, item in enumerate(self._items):
            item.setVisible(i < len(labels))
        for item, (x, y, text) in zip(self._items, labels, strict=False):
            item.setText(text)
            item.setPos(x, y)

    def _made(self) -> Any:
        item = pg.TextItem("", anchor=self._anchor)
        item.setFont(style.small_font())
        self._ink(item)
        self._plot.item.addItem(item, ignoreBounds=True)
        return item

    def paint(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self._theme = theme
        for item in self._items:
            self._ink(item)

    def _ink(self, item: Any) -> None:
        item.setColor(self._theme.text)
        item.fill = pg.mkBrush(self._theme.surface if self._ground else None)
