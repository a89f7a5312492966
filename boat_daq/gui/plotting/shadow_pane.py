"""The shadow's pane: the actuator as it is now over its outline at rest, coloured by displacement or strain."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QGuiApplication, QPainter, QPaintEvent, QPen, QPolygonF, QResizeEvent, QTransform
from PySide6.QtWidgets import QGridLayout, QToolButton, QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.plotting.plot_card import export_button, save_export
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.connection import age_text
from boat_daq.viewmodels.live.shadow_live import COLOUR_LEVELS, SCALES, ShadowLive, ShadowPicture
from protocol.base.errors import RequestError

VIEW_MM = QRectF(-31.0, -15.0, 62.0, 108.0)  # of (x, z)
LINES = 6
DOT = 7
LEGEND_LINE, LEGEND_MARK = 16, 12
GUIDE, HALO = 1.5, 4.5  # pixels: a guide is visible on dark and on bright elements
REST_LENGTH_MM = 75.0
_RING = np.array([1, 1, 1, 1, 0], dtype=np.int32)  # joins the five points of a closed element, but not to the next one


class ShadowView(QWidget):
    """Draws a `ShadowPicture` to scale; it paints its whole rectangle, so that Qt paints no widget behind it."""

    def __init__(self) -> None:
        super().__init__()
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setAccessibleName("The actuator now, over its outline at rest")
        self.setMinimumHeight(3 * style.CONTROL_HEIGHT)  # beside the messages at 150 % on 1280 x 800
        self.picture: ShadowPicture | None = None
        self.stale = False
        self.scale_texts = ("0", "", "")
        self.paint_theme(style.LIGHT)

    def show_picture(self, picture: ShadowPicture) -> None:
        """Draw another picture; the same one is not drawn again."""
        if picture is not self.picture:
            self.picture = picture
            self.update()

    def show_stale(self, *, stale: bool) -> None:
        """Draw the picture faint, as of data that have ended, or fully again."""
        if stale is not self.stale:
            self.stale = stale
            self.update()

    def paint_theme(self, theme: Theme) -> None:
        self.theme = theme
        self.steps = [QColor(style.sequential(i, COLOUR_LEVELS)) for i in range(COLOUR_LEVELS)]
        self.small = style.small_font()
        self.update()

    def _transform(self) -> QTransform:
        """Return the transform from (x, z) mm to pixels."""
        area = QRectF(self.rect()).adjusted(0, 0, 0, -style.CONTROL_HEIGHT - 2 * LEGEND_LINE)
        scale = min(area.width() / VIEW_MM.width(), area.height() / VIEW_MM.height())
        centre = area.center()
        transform = QTransform()
        transform.translate(centre.x(), centre.y() + (VIEW_MM.top() + VIEW_MM.height() / 2) * scale)
        transform.scale(scale, -scale)
        return transform

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw elements, guides, points, outline at rest, tips and the scale."""
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(self.theme.surface))
        if self.picture is None:
            painter.end()
            return
        painter.setOpacity(style.STALE_OPACITY if self.stale else 1.0)
        painter.setTransform(self._transform())
        if not len(self.picture.corners):  # not ready, or outside the model's table
            self._rest(painter, self.picture)
            painter.end()
            return
        self._elements(painter, self.picture)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._guides(painter, self.picture)
        painter.setBrush(QColor(self.theme.surface))
        dot = DOT / painter.transform().m11() / 2
        tip = float(self.picture.corners[..., 1].max())
        for x, z in self.picture.tracked:
            if 0.0 <= z <= tip:  # else in a holder, where nothing is drawn that it could belong to
                painter.drawEllipse(QPointF(x, z), dot, dot)
        self._rest(painter, self.picture)
        self._tip(painter, self.picture.nominal_mm, self.theme.target, Qt.PenStyle.DashLine)
        self._tip(painter, self.picture.measured_mm, self.theme.elongation, Qt.PenStyle.SolidLine)
        painter.resetTransform()
        self._scale(painter)
        self._legend(painter, self.picture)
        painter.end()

    def _guides(self, painter: QPainter, picture: ShadowPicture) -> None:
        """Draw the light guides between base and tip, without the end pieces in the holders beyond."""
        painter.setClipRect(QRectF(VIEW_MM.left(), 0.0, VIEW_MM.width(), float(picture.corners[..., 1].max())))
        for colour, width in ((self.theme.surface, HALO), (self.theme.text, GUIDE)):
            self._pen(painter, colour, width)
            for guide in picture.guides:
                painter.drawPolyline(_polygon(guide))
        painter.setClipping(False)

    def _rest(self, painter: QPainter, picture: ShadowPicture) -> None:
        painter.setBrush(Qt.BrushStyle.NoBrush)
        self._pen(painter, self.theme.muted, 1, Qt.PenStyle.DashLine)
        painter.drawPolygon(_polygon(picture.rest))
        self._pen(painter, self.theme.text, 2)
        painter.drawLine(QPointF(-29, 0), QPointF(29, 0))

    def _legend(self, painter: QPainter, picture: ShadowPicture) -> None:
        """Name the lines and points that are drawn above the scale, in two rows."""
        solid, dash, t = Qt.PenStyle.SolidLine, Qt.PenStyle.DashLine, self.theme
        measured = (("measured", t.elongation, 3, solid),) if picture.measured_mm == picture.measured_mm else ()
        entries = (
            *measured, ("model", t.target, 3, dash), ("at rest", t.muted, 1, dash),
            ("guides", t.text, GUIDE, solid), ("points", t.text, 0, solid),
        )  # fmt: skip
        x, y = style.GAP, self.height() - style.CONTROL_HEIGHT - 2 * LEGEND_LINE + LEGEND_LINE // 2
        painter.setFont(self.small)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        for words, colour, width, pen_style in entries:
            text = style.text_width(self.small, words)
            if x + LEGEND_MARK + style.STEP + text > self.width():
                x, y = style.GAP, y + LEGEND_LINE
            self._pen(painter, colour, width or 1, pen_style)
            if width:
                painter.drawLine(QPointF(x, y), QPointF(x + LEGEND_MARK, y))
            else:
                painter.drawEllipse(QPointF(x + LEGEND_MARK / 2, y), DOT / 2, DOT / 2)
            painter.setPen(QColor(t.muted))
            x += LEGEND_MARK + style.STEP
            box = QRectF(x, y - LEGEND_LINE / 2, text + 1, LEGEND_LINE)
            painter.drawText(box, Qt.AlignmentFlag.AlignVCenter, words)
            x += text + style.GAP

    def _elements(self, painter: QPainter, picture: ShadowPicture) -> None:
        """Fill the elements, those of one colour step at once."""
        painter.setPen(Qt.PenStyle.NoPen)
        for level in np.unique(picture.levels):
            chosen: NDArray[np.float64] = picture.corners[picture.levels == level]
            closed = np.concatenate([chosen, chosen[:, :1]], axis=1).reshape(-1, 2)
            path = pg.functions.arrayToQPath(closed[:, 0], closed[:, 1], np.tile(_RING, len(chosen)))
            painter.fillPath(path, self.steps[level])

    def _tip(self, painter: QPainter, elongation_mm: float, colour: str, pen: Qt.PenStyle) -> None:
        if elongation_mm == elongation_mm:
            self._pen(painter, colour, 3, pen)
            height = REST_LENGTH_MM + elongation_mm
            painter.drawLine(QPointF(-29, height), QPointF(29, height))

    def _pen(
        self, painter: QPainter, colour: str, width: float, pen_style: Qt.PenStyle = Qt.PenStyle.SolidLine
    ) -> None:
        pen = QPen(QColor(colour), width * self.devicePixelRatioF(), pen_style)
        pen.setCosmetic(True)
        painter.setPen(pen)

    def _scale(self, painter: QPainter) -> None:
        area = QRectF(self.rect()).adjusted(2 * style.STEP, 0, -2 * style.STEP, 0)
        bar = QRectF(area.left(), area.bottom() - 6 * style.STEP, area.width(), style.GAP)
        step = bar.width() / COLOUR_LEVELS
        for i, colour in enumerate(self.steps):
            painter.fillRect(QRectF(bar.left() + i * step, bar.top(), step + 1, bar.height()), colour)
        painter.setPen(QColor(self.theme.muted))
        painter.setFont(self.small)
        below = bar.adjusted(0, bar.height(), 0, 4 * style.STEP)
        low, name, high = self.scale_texts
        painter.drawText(below, Qt.AlignmentFlag.AlignLeft, low)
        painter.drawText(below, Qt.AlignmentFlag.AlignRight, high)
        if style.text_width(self.small, name) + 2 * style.text_width(self.small, f"  {high}") < bar.width():
            painter.drawText(below, Qt.AlignmentFlag.AlignHCenter, name)  # else the choice above names it


def _polygon(points: NDArray[np.float64]) -> QPolygonF:
    return QPolygonF([QPointF(x, z) for x, z in points])


class ShadowPane(QWidget):
    """The pane on a `ShadowLive`; copied and saved like a `PlotCard`."""

    title = "Shadow"

    def __init__(self, model: ShadowLive, services: Services) -> None:
        super().__init__()
        self.model, self.services = model, services
        self.view = ShadowView()
        self.quantity = controls.choice("Colour shows", [(name.capitalize(), name) for name in SCALES], self._choose)
        self.names = [controls.label("", "muted") for _ in range(LINES)]
        self.values = [controls.label("", wrap=True) for _ in range(LINES)]
        grid = QGridLayout()
        grid.setVerticalSpacing(2)
        grid.setColumnStretch(1, 1)
        for i, (name, value) in enumerate(zip(self.names, self.values, strict=True)):
            grid.addWidget(name, i, 0)
            grid.addWidget(value, i, 1)
            name.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.colour = controls.label("Colour", "muted")
        head = controls.row(self.colour, self.quantity, None, self._menu_button())
        self.rows = controls.inside(grid)
        self.rows.setMaximumWidth(style.FORM_WIDTH)  # a value beside its name
        frame, _ = controls.card(head, (self.view, 1), self.rows)
        self.setLayout(controls.column(frame, margins=(0, style.GAP, 0, 0)))
        self._choose(model.quantity)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave out the name of the choice in a narrow pane: what is chosen is then shown whole."""
        super().resizeEvent(event)
        self.colour.setVisible(self.width() > style.PANE_WIDTH_NARROW + 4 * style.STEP)
        flag = Qt.AlignmentFlag
        side = flag.AlignRight if self.width() <= style.PANE_WIDTH_WIDE else flag.AlignLeft  # beside its name
        for value in self.values:
            value.setAlignment(side | flag.AlignTop)
        self._fit()

    def _fit(self) -> None:
        """Keep the height of the wrapped values, which the layouts around do not: they were drawn over the scale."""
        self.rows.setMinimumHeight(max(0, self.rows.heightForWidth(self.rows.width())))

    def _choose(self, quantity: str) -> None:
        self.model.quantity = quantity
        self._follow()

    def _follow(self) -> None:
        """Show the settings of the model, which menus change too."""
        quantity = self.model.quantity
        full, unit, _ = SCALES[quantity]
        texts = ("0", quantity, f"{full:g} {unit} or more")
        if self.view.scale_texts != texts:
            self.view.scale_texts = texts
            self.view.update()
        self.quantity.setCurrentIndex(self.quantity.findData(quantity))

    def _menu_button(self) -> QToolButton:
        copy = partial(self.services.notices.attempt, self.copy, done=f"Copied: {self.title}")
        tool = export_button("the shadow", "Copy or save this picture", copy, self._ask_save)
        self.view.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.view.customContextMenuRequested.connect(lambda at: tool.menu().popup(self.view.mapToGlobal(at)))
        return tool

    def _ask_save(self, suffix: str) -> None:
        if self.services.notices.attempt(self.require_data):
            ask_save(self, self.services, self.title, suffix, self.save)

    def require_data(self) -> None:
        """Check that there is something to copy or save."""
        if self.view.picture is None or not len(self.view.picture.corners):
            raise RequestError("the shadow is not drawn yet", "Wait until it is prepared.")

    def copy(self) -> None:
        self.require_data()
        QGuiApplication.clipboard().setPixmap(self.view.grab())

    def save(self, path: Path) -> None:
        """Save the picture as .png or .svg, or the guides and tracked points, (x, z) mm, as .csv."""
        save_export(path, "Shadow of the actuator", self.view, self.view.grab, self.columns)

    def columns(self) -> dict[str, Any]:
        """Return the outline at rest, the guides and the tracked points as they are drawn, mm."""
        picture = self.model.picture()
        named = {f"guide {i}": guide for i, guide in enumerate(picture.guides, 1)} | {"tracked": picture.tracked}
        named = {"outline at rest": picture.rest} | {name: points for name, points in named.items() if len(points)}
        return {f"{name}, {axis} (mm)": points[:, k] for name, points in named.items() for k, axis in enumerate("xz")}

    def draw(self) -> None:
        if self.isVisible():
            self.view.show_picture(self.model.picture())

    def refresh(self, snapshot: SessionSnapshot) -> None:
        self._follow()
        age = age_text(snapshot)
        self.view.show_stale(stale=bool(age))
        shown = self.model.lines()
        if age:  # nothing of it holds now: no verdict, in grey, with its age
            shown = (("Last data", age, "off"), *((name, value, "off") for name, value, _ in shown))
        lines = [*shown, *[("", "", "")] * LINES]
        for name, value, (name_text, value_text, state) in zip(self.names, self.values, lines, strict=False):
            controls.set_text(name, name_text)
            controls.set_text(value, value_text)
            controls.set_state(value, state)
        self._fit()
