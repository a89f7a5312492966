"""A framed surface with one or more plots over each other, their title, readout and the menu that takes them away.

Every plot of the program sits in one of these, so every plot copies, saves PNG, SVG and CSV the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QRectF, QSize, Qt, Signal
from PySide6.QtGui import QGuiApplication, QPainter, QPixmap
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QFrame, QGraphicsItem, QGraphicsView, QMenu, QToolButton, QWidget

from boat_daq.errors import OperatorError
from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Plot, make_item
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common import tables

Columns = Mapping[str, Any]


class PlotCard(QFrame):
    """Plots in a frame.

    Parameters
    ----------
    title : what the card shows; also its accessible name and the stem of saved files.
    """

    copy_wanted = Signal(object)  # the card: the window says that it has it
    save_wanted = Signal(object, str)  # the card and a suffix: the window asks where to

    def __init__(self, title: str, *, show_title: bool = True, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("card")
        self.setAccessibleName(f"Plot: {title}")
        self.title = title
        self.plots: list[Plot] = []
        self.columns_of: Callable[[], Columns] | None = None  # what CSV saves; by default what is drawn
        self.view = pg.GraphicsLayoutWidget()
        self.view.setFrameShape(QFrame.Shape.NoFrame)
        self.view.setCacheMode(QGraphicsView.CacheModeFlag.CacheNone)  # a ground of one colour is filled, not copied
        self.view.ci.setFlag(QGraphicsItem.GraphicsItemFlag.ItemHasNoContents)
        self.view.ci.layout.setContentsMargins(0, style.STEP, style.STEP, 0)
        self.view.ci.layout.setSpacing(style.STEP)
        self.view.setAccessibleName(title)
        self.heading = widgets.ElidedLabel(title if show_title else "")
        self.heading.setTextFormat(Qt.TextFormat.PlainText)
        self.heading.setProperty("role", "subtitle")
        self.heading.least = style.HEADING_LEAST
        self.readout = widgets.label("", "small", elide=True)
        self.menu_button = self._menu_button()
        layout = widgets.column(spacing=0)
        layout.setContentsMargins(style.GAP, style.STEP, style.STEP, style.STEP)
        self.bar = widgets.row(self.heading, None, self.readout, self.menu_button)
        layout.addLayout(self.bar)
        layout.addWidget(self.view, 1)
        self.nothing = widgets.label("", "muted", wrap=True)
        self.nothing.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.nothing.hide()
        layout.addWidget(self.nothing, 1)
        self.setLayout(layout)
        self.inside = layout

    def add(
        self,
        title: str,
        unit: str,
        *,
        x_title: str = "",
        x_unit: str = "",
        time: bool = False,
        stretch: int = 1,
        beside: bool = False,
    ) -> Plot:
        """Add a plot under or `beside` those there are; only one with an x title has labels on its lower axis."""
        item = make_item(time=time, whole=bool(x_title) and not x_unit)
        at = 0 if beside else len(self.plots)
        self.view.addItem(item, row=at, col=len(self.plots) if beside else 0)
        self.view.ci.layout.setRowStretchFactor(at, stretch)
        ruler = item.getAxis("bottom")
        if x_title:
            ruler.setHeight(style.AXIS_HEIGHT)
        else:
            ruler.setStyle(showValues=False)
            ruler.setHeight(style.STEP)
        self.view.setMinimumSize(style.PLOT_MINIMUM[0], style.PLOT_MINIMUM[1] + at * style.PLOT_MORE)
        plot = Plot(item, title, unit, x_title=x_title, x_unit=x_unit)
        self.plots.append(plot)
        return plot

    def show_only(self, plots: list[Plot]) -> None:
        """Show only these plots, over each other in this order; the others keep what they hold."""
        for plot in self.plots:
            if plot.item in self.view.ci.items:
                self.view.ci.removeItem(plot.item)
        for at, plot in enumerate(plots):
            self.view.ci.addItem(plot.item, row=at, col=0)

    def link_x(self) -> None:
        """Give all plots of the card the first one's horizontal range."""
        first = self.plots[0].item
        for plot in self.plots[1:]:
            plot.item.setXLink(first)

    def x_range(self, low: float, high: float) -> None:
        """Show [low, high] in all plots; for a frame: each link would ask for two views' places on the screen."""
        boxes = [plot.item.getViewBox() for plot in self.plots]
        for box in boxes:
            box.blockLink(True)
        try:
            for plot in self.plots:
                plot.x_range(low, high)
        finally:
            for box in boxes:
                box.blockLink(False)

    def say_empty(self, words: str) -> None:
        """Say what will be here, in the plots' place, as empty axes look like data; no words show the plots."""
        widgets.set_text(self.nothing, words)
        if self.nothing.isHidden() is bool(words):
            self.nothing.setVisible(bool(words))
            self.view.setVisible(not words)

    def clear(self, why: str = "") -> None:
        """Draw nothing any more, and say why."""
        for plot in self.plots:
            plot.clear()
        self.readout.setText(why)

    def paint_theme(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self.view.setBackground(theme.surface)
        for plot in self.plots:
            plot.paint(theme)

    def columns(self) -> Columns:
        """Return what the CSV holds; columns of one name and other numbers are told apart by their plot."""
        if self.columns_of is not None:
            return self.columns_of()
        merged: dict[str, Any] = {}
        x_name = next((plot.x_name for plot in reversed(self.plots) if plot.x_title), "x")
        for plot in self.plots:
            for name, values in plot.columns(x_name).items():
                other = name in merged and not np.array_equal(merged[name], values)
                merged[f"{plot.title}, {name}" if other else name] = values
        return merged

    def refuse_empty(self) -> None:
        """Let nothing be taken away where nothing is.

        Raises
        ------
        OperatorError : nothing is drawn yet.
        """
        if not self.columns():
            remedy = self.nothing.text() if not self.nothing.isHidden() else ""
            raise OperatorError(f"nothing is drawn yet in \u201c{self.title}\u201d", remedy or "Wait until it is.")

    def picture(self, scale: float = 2.0) -> QPixmap:
        """Return the card's plots as a picture of `scale` times the screen's size."""
        size = self.view.size()
        pixmap = QPixmap(QSize(round(size.width() * scale), round(size.height() * scale)))
        pixmap.fill(self.view.backgroundBrush().color())
        painter = QPainter(pixmap)
        self.view.render(painter, QRectF(pixmap.rect()), self.view.viewport().rect())
        painter.end()
        return pixmap

    def copy(self) -> None:
        """Put the picture on the clipboard.

        Raises
        ------
        OperatorError : nothing is drawn yet.
        """
        self.refuse_empty()
        QGuiApplication.clipboard().setPixmap(self.picture())

    def save(self, path: Path) -> None:
        """Save as the ending of `path` says: .png, .svg or .csv.

        Raises
        ------
        OSError : the path cannot be written.
        """
        if path.suffix == ".csv":
            tables.save_csv(path, self.columns())
        elif path.suffix == ".svg":
            self._save_svg(path)
        elif not self.picture().save(str(path), "PNG"):
            raise OSError(f"{path} cannot be written")

    def _save_svg(self, path: Path) -> None:
        generator = QSvgGenerator()
        generator.setFileName(str(path))
        generator.setSize(self.view.size())
        generator.setViewBox(self.view.viewport().rect())
        generator.setTitle(self.title)
        painter = QPainter(generator)
        if not painter.isActive():
            raise OSError(f"{path} cannot be written")
        self.view.render(painter)
        painter.end()

    def _menu_button(self) -> QToolButton:
        tool = QToolButton()
        tool.setText("\u22ef")
        tool.setToolTip("Copy or save this plot; while this button has the focus, Ctrl+Shift+C, Ctrl+S and Ctrl+E too")
        tool.setAccessibleName(f"Copy or save: {self.title}")
        tool.setProperty("role", "quiet")
        tool.setFixedSize(style.CONTROL_HEIGHT, style.CONTROL_HEIGHT)
        tool.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(tool)
        menu.addAction("Copy picture", partial(self.copy_wanted.emit, self))
        for kind in ("PNG", "SVG", "CSV"):
            menu.addAction(f"Save {kind} \u2026", partial(self.save_wanted.emit, self, kind.lower()))
        tool.setMenu(menu)
        tool.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        return tool
