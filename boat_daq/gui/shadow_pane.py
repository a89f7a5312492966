"""The pane beside the plots: the actuator as it is now over its outline at rest."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QGridLayout, QWidget

from boat_daq.engine.session import SessionSnapshot
from boat_daq.gui import style, widgets
from boat_daq.gui.style import Theme
from boat_daq.viewmodels.desk import Desk
from boat_daq.viewmodels.shadow_live import ShadowPicture

ROOM_MM = QRectF(-30.0, -4.0, 60.0, 92.0)  # what the view shows of (r, z)
LINES = 4


class ShadowView(QWidget):
    """Draws a `ShadowPicture` to scale."""

    def __init__(self) -> None:
        super().__init__()
        self.setAccessibleName("The actuator now, over its outline at rest")
        self.setMinimumHeight(8 * style.CONTROL_HEIGHT)
        self.theme: Theme = style.LIGHT
        self.picture: ShadowPicture | None = None

    def show_picture(self, picture: ShadowPicture) -> None:
        """Draw another picture."""
        self.picture = picture
        self.update()

    def _place(self) -> tuple[float, float, float]:
        """Return the scale (pixels per mm) and where (0, 0) mm lies."""
        scale = min(self.width() / ROOM_MM.width(), self.height() / ROOM_MM.height())
        return scale, self.width() / 2, self.height() / 2 + (ROOM_MM.top() + ROOM_MM.height() / 2) * scale

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw rest, now, base and tips."""
        if self.picture is None:
            return
        scale, x0, y0 = self._place()

        def polygon(points: object) -> QPolygonF:
            return QPolygonF([QPointF(x0 + r * scale, y0 - z * scale) for r, z in points])  # type: ignore[attr-defined]

        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(QPen(QColor(self.theme.elongation), 1.5))
        painter.setBrush(style.colour(self.theme.elongation, style.BAND_ALPHA_WIDE))
        painter.drawPolygon(polygon(self.picture.now))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QPen(QColor(self.theme.muted), 1, Qt.PenStyle.DashLine))
        painter.drawPolygon(polygon(self.picture.rest))
        painter.setPen(QPen(QColor(self.theme.text), 2))
        painter.drawPolyline(polygon([(-28.0, 0.0), (28.0, 0.0)]))
        painter.end()


class ShadowPane(QWidget):
    """The pane on a `Desk`."""

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk = desk
        self.view = ShadowView()
        frame, inside = widgets.card()
        inside.addWidget(self.view, 1)
        grid = QGridLayout()
        grid.setVerticalSpacing(2)
        self.names = [widgets.label("", "muted") for _ in range(LINES)]
        self.values = [widgets.label("") for _ in range(LINES)]
        for i in range(LINES):
            grid.addWidget(self.names[i], i, 0)
            grid.addWidget(self.values[i], i, 1, Qt.AlignmentFlag.AlignRight)
        inside.addLayout(grid)
        layout = widgets.column(frame)
        layout.setContentsMargins(0, style.GAP, 0, 0)
        self.setLayout(layout)

    def draw(self) -> None:
        """Draw one frame."""
        if self.isVisible():
            self.view.show_picture(self.desk.shadow.picture())

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the figures under the picture."""
        lines = self.desk.shadow.picture().lines
        for i in range(LINES):
            name, value, state = lines[i] if i < len(lines) else ("", "", "")
            widgets.set_text(self.names[i], name)
            widgets.set_text(self.values[i], value)
            widgets.set_state(self.values[i], state)

    def paint(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self.view.theme = theme
        self.view.update()
