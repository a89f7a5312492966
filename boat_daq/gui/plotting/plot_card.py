"""A framed surface with one or more plots over each other, their title, readout and the menu to copy and save them.

Every plot of the program is in one of these, so every plot is copied and saved as PNG, SVG and CSV the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QPoint, QRectF, QSize, Qt
from PySide6.QtGui import QGuiApplication, QPainter, QPixmap
from PySide6.QtSvg import QSvgGenerator
from PySide6.QtWidgets import QFrame, QGraphicsItem, QGraphicsView, QMenu, QToolButton, QWidget

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import Plot, make_item
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common import tables
from protocol.base.errors import RequestError
from protocol.base.units import STORED_UNITS
from protocol.base.whole_file import written_whole

Columns = Mapping[str, Any]


class PlotCard(QFrame):
    """Plots in a frame; `title` is also the accessible name and the stem of saved files."""

    def __init__(self, title: str, explanation: str = "", *, show_title: bool = True) -> None:
        super().__init__()
        self.setObjectName("card")
        self.setAccessibleName(f"Plot: {title}")
        self.title = title
        self.plots: list[Plot] = []
        self.theme: Theme = style.LIGHT
        self._signal_unit = STORED_UNITS.voltage
        self._readout_below, self._readout_at = False, 0
        self.view = pg.GraphicsLayoutWidget()
        self.view.setFrameShape(QFrame.Shape.NoFrame)
        self.view.setCacheMode(QGraphicsView.CacheModeFlag.CacheNone)  # filling one colour is faster than copying
        self.view.ci.setFlag(QGraphicsItem.GraphicsItemFlag.ItemHasNoContents)
        self.view.ci.layout.setContentsMargins(0, style.STEP, style.STEP, 0)
        self.view.ci.layout.setSpacing(style.STEP)
        self.view.setAccessibleName(title)
        self.view.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.view.customContextMenuRequested.connect(self._open_menu)
        self._stretch: dict[Plot, int] = {}
        self.heading = controls.ElidedLabel(title if show_title else "")
        self.heading.setTextFormat(Qt.TextFormat.PlainText)
        self.heading.setProperty("role", "subtitle")
        self.heading.least = style.HEADING_LEAST
        self.heading.explain(explanation)
        self.readout = controls.label("", "small", elide=True)
        tip = "Copy or save this plot; while this button has the focus, Ctrl+S saves it too"
        self.menu_button = export_button(title, tip, self._copy, self._save)
        self.bar = controls.row(self.heading, None, self.readout, self.menu_button)
        self.empty_text = controls.label("", "muted", wrap=True)
        self.empty_text.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.empty_text.hide()
        margins = (style.CARD_PADDING, style.GAP, style.STEP, style.STEP)
        self.inside = controls.column(self.bar, (self.view, 1), (self.empty_text, 1), spacing=0, margins=margins)
        self.setLayout(self.inside)

    def _copy(self) -> None:
        controls.owner(self, "copy_plot").copy_plot(self)

    def _save(self, suffix: str) -> None:
        controls.owner(self, "save_plot").save_plot(self, suffix)

    def _open_menu(self, at: QPoint) -> None:
        self.view.scene().clickEvents.clear()  # whose release goes to the menu: the next drag would be one of it
        menu = QMenu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        add_exports(menu, self._copy, self._save)
        scene = self.view.mapToScene(at)
        shown = (plot for plot in self.plots if plot.item in self.view.ci.items)
        plot = next((plot for plot in shown if plot.item.sceneBoundingRect().contains(scene)), None)
        if plot is not None:
            menu.addSeparator()
            self.add_plot_actions(menu, plot, plot.item.getViewBox().mapSceneToView(scene).x())
        menu.popup(self.view.mapToGlobal(at))

    def add_plot_actions(self, menu: QMenu, plot: Plot, x: float) -> None:
        menu.addAction("Cursor here", partial(plot.place_cursor, x))
        if plot.cursor is not None:
            menu.addAction("Remove cursor", plot.remove_cursor)
        self.add_zoom(menu, plot)
        curves = menu.addMenu("Show or hide")
        for layer in plot.layers:
            if layer.x.size:
                action = curves.addAction(layer.name)
                action.setCheckable(True)
                action.setChecked(layer.item.isVisible())
                action.toggled.connect(layer.show)
        curves.setEnabled(bool(curves.actions()))

    def add_zoom(self, menu: QMenu, plot: Plot) -> None:
        """Add the zoom by a box, and the way back, where the mouse may move the plot."""
        box = plot.item.getViewBox()
        if any(box.state["mouseEnabled"]):
            menu.addAction("Zoom to a box (Shift+drag)", box.zoom_to_next_box)
            menu.addAction("Autoscale (double click)", box.autoscale_wanted.emit)

    def event(self, event: QEvent) -> bool:
        """Place the readout again where the card or one of its texts has another width."""
        if event.type() in (QEvent.Type.LayoutRequest, QEvent.Type.Resize):
            self._place_readout()
        return super().event(event)

    def _place_readout(self) -> None:
        """Show the readout, where it has a text, beside the title, or below where both do not fit: neither is cut."""
        self.readout.setVisible(bool(self.readout.text()))
        margins = self.inside.contentsMargins()
        needed = self.bar.sizeHint().width() + margins.left() + margins.right()
        if self._readout_below and self.readout.text():
            needed += self.readout.sizeHint().width() + self.bar.spacing()
        below = needed + style.GAP > self.width()  # a label that is a pixel short would be cut
        if below is self._readout_below:
            return
        self._readout_below = below
        if below:
            self._readout_at = self.bar.indexOf(self.readout)
            self.bar.removeWidget(self.readout)
            self.inside.insertWidget(1, self.readout)
        else:
            self.inside.removeWidget(self.readout)
            self.bar.insertWidget(self._readout_at, self.readout)

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
        """Add a plot below or `beside` the others; its lower axis has labels only with an x title."""
        item = make_item(time=time, whole=bool(x_title) and not x_unit)
        at = 0 if beside else len(self.plots)
        self.view.addItem(item, row=at, col=len(self.plots) if beside else 0)
        self.view.setMinimumSize(style.PLOT_MINIMUM[0], style.PLOT_MINIMUM[1] + at * style.PLOT_MORE)
        plot = Plot(item, title, unit, x_title=x_title, x_unit=x_unit)
        self.plots.append(plot)
        item.getViewBox().sigResized.connect(self._repaint)
        self._stretch[plot] = stretch
        if not beside:
            self.view.ci.layout.setRowStretchFactor(at, stretch)
        return plot

    def _repaint(self, *_: object) -> None:
        """Paint all of it anew: Qt leaves lines of plots that have moved in the margins."""
        self.view.viewport().update()

    def show_only(self, plots: list[Plot], *, beside: bool = False) -> None:
        """Show only these plots, below one another over one lower axis, or `beside`; the others keep their data."""
        for plot in self.plots:
            if plot.item in self.view.ci.items:
                self.view.ci.removeItem(plot.item)
        named = next(plot for plot in reversed(self.plots) if plot.x_title)
        for at, plot in enumerate(plots):
            plot.label_x(named.x_title if beside or plot is plots[-1] else "", named.x_unit)
            self.view.ci.addItem(plot.item, row=0 if beside else at, col=at if beside else 0)
            if not beside:
                self.view.ci.layout.setRowStretchFactor(at, self._stretch[plot])

    def link_x(self) -> None:
        """Link the horizontal ranges of all plots to the first one's."""
        first, unit = self.plots[0].item, self.plots[-1].x_unit
        for plot in self.plots[1:]:
            plot.item.setXLink(first)
        for plot in self.plots:
            if not plot.x_title:  # a cursor names the unit above the labelled axis, too
                plot.label_x("", unit)

    def show_empty(self, text: str) -> None:
        """Show `text` in place of the plots, as empty axes look like data; an empty text shows the plots."""
        controls.set_text(self.empty_text, text)
        if self.empty_text.isHidden() is bool(text):
            self.empty_text.setVisible(bool(text))
            self.view.setVisible(not text)

    def show_stale(self, *, stale: bool) -> None:
        """Fade the plots while what they show is being renewed."""
        for plot in self.plots:
            plot.item.setOpacity(style.STALE_OPACITY if stale else 1.0)

    def clear(self) -> None:
        for plot in self.plots:
            plot.clear()
        self.readout.setText("")

    def show_signals_in(self, unit: str) -> None:
        """Take a run whose signals are in another unit than mV."""
        if unit != self._signal_unit:
            self._signal_unit = unit
            self.paint_theme(self.theme)

    def paint_theme(self, theme: Theme) -> None:
        self.theme = theme
        units = theme.units.of_signals_in(self._signal_unit)
        of_run = theme if units == theme.units else replace(theme, units=units)
        self.view.setBackground(theme.surface)
        for plot in self.plots:
            plot.paint(of_run)

    def columns(self) -> Columns:
        """Return the columns of the CSV: what is drawn; names with several meanings get the plot's title."""
        merged: dict[str, Any] = {}
        x_name = next((plot.x_name for plot in reversed(self.plots) if plot.x_title), "x")
        for plot in self.plots:
            for name, values in plot.columns(x_name).items():
                other = name in merged and not np.array_equal(merged[name], values)
                merged[f"{plot.title}, {name}" if other else name] = values
        return merged

    def require_data(self) -> None:
        """Check that there is something to copy or save."""
        if not self.columns():
            remedy = self.empty_text.text() if not self.empty_text.isHidden() else ""
            raise RequestError(f"nothing is drawn yet in \u201c{self.title}\u201d", remedy or "Wait until it is.")

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
        self.require_data()
        QGuiApplication.clipboard().setPixmap(self.picture())

    def save(self, path: Path) -> None:
        """Save as .png, .svg or .csv, by the suffix of `path`. OSError: it cannot be written."""
        save_export(path, self.title, self.view, self.picture, self.columns)


def save_export(
    path: Path, title: str, view: QWidget, picture: Callable[[], QPixmap], columns: Callable[[], Columns]
) -> None:
    """Save a picture or its numbers, by the suffix of `path`. OSError: it cannot be written."""
    if path.suffix == ".csv":
        tables.save_csv(path, columns())
        return
    with written_whole(path) as part:
        if path.suffix == ".svg":
            generator = QSvgGenerator()
            generator.setFileName(str(part))
            generator.setSize(view.size())
            generator.setViewBox(view.rect())
            generator.setTitle(title)
            painter = QPainter(generator)
            if not painter.isActive():
                raise OSError(f"{path} cannot be written")
            if isinstance(view, QGraphicsView):
                view.render(painter)
            else:
                view.render(painter, QPoint(0, 0))
            painter.end()
        elif not picture().save(str(part), "PNG"):
            raise OSError(f"{path} cannot be written")


def export_button(title: str, tip: str, copy: Callable[[], object], save: Callable[[str], object]) -> QToolButton:
    """Return the button whose menu copies and saves a picture; `save` takes the suffix: png, svg or csv."""
    tool = QToolButton()
    tool.setText("\u22ef")
    tool.setToolTip(tip)
    tool.setAccessibleName(f"Copy or save: {title}")
    tool.setProperty("role", "quiet")
    tool.setFixedSize(style.CONTROL_HEIGHT, style.TITLE_HEIGHT)  # no higher than a title: titles of cards are level
    tool.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
    menu = QMenu(tool)
    add_exports(menu, copy, save)
    controls.add_menu(tool, menu)
    tool.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    return tool


def add_exports(menu: QMenu, copy: Callable[[], object], save: Callable[[str], object]) -> None:
    """Add the actions that copy and save a picture; `save` is a function of the suffix."""
    menu.addAction("Copy picture", copy)
    for kind in ("PNG", "SVG", "CSV"):
        menu.addAction(f"Save {kind} \u2026", partial(save, kind.lower()))
