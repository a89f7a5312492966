"""The run's line under the plots: the staircase with the done part filled, cycle, step, time left, the buttons."""

from __future__ import annotations

from functools import partial

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QFrame, QPushButton, QVBoxLayout, QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.live.run_model import RunModel
from boat_daq.viewmodels.live.sequence import StaircaseDrawing, progress_text, state_text

LABELS = {
    "arm": "Arm", "disarm": "Disarm", "start": "Start", "pause": "Pause", "resume": "Resume", "stop": "Stop",
    "clear": "Clear fault",
}  # fmt: skip
TIPS = {
    "arm": "Check the plan against every limit; nothing moves yet", "disarm": "Put the armed plan away",
    "start": "Start recording and run the plan", "pause": "Vent and wait; the cycle under way is left out",
    "resume": "Go on at the next whole cycle", "stop": "Vent and end the run",
    "clear": "Forget the fault once its cause is gone",
}  # fmt: skip


class StaircasePicture(QWidget):
    """The plan's staircase with limits, the done part filled; drawn from points of the unit square."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setAccessibleName(name)
        self.drawing: StaircaseDrawing | None = None
        self.theme: Theme = style.LIGHT
        self.setMinimumHeight(2 * style.CONTROL_HEIGHT)

    def show_drawing(self, drawing: StaircaseDrawing) -> None:
        """Show another drawing."""
        if drawing != self.drawing:
            self.drawing = drawing
            self.update()

    def paint_theme(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self.theme = theme
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw zero, limits, the done part and the line."""
        if self.drawing is None:
            return
        painter = QPainter(self)
        room = QRectF(self.rect()).adjusted(1, style.STEP, -1, -style.STEP)

        def at(point: tuple[float, float]) -> QPointF:
            return QPointF(room.left() + point[0] * room.width(), room.bottom() - point[1] * room.height())

        for height in self.drawing.limits:
            painter.setPen(QPen(QColor(self.theme.fault), 1, Qt.PenStyle.DotLine))
            painter.drawLine(at((0.0, height)), at((1.0, height)))
        painter.setPen(QPen(QColor(self.theme.line), 1))
        painter.drawLine(at((0.0, self.drawing.zero)), at((1.0, self.drawing.zero)))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(style.colour(self.theme.accent, 2 * style.BAND_ALPHA_WIDE))
        painter.drawPolygon(QPolygonF([at(p) for p in self.drawing.done]))
        painter.setPen(QPen(QColor(self.theme.pressure), 1))
        painter.drawPolyline(QPolygonF([at(p) for p in self.drawing.line]))
        if self.drawing.done:
            painter.setPen(QPen(QColor(self.theme.accent), 2))
            x = self.drawing.done[-1][0]
            painter.drawLine(at((x, 0.0)), at((x, 1.0)))
        painter.end()


class SequencePanel(QFrame):
    """The line of a `RunModel`: state, progress, buttons."""

    def __init__(self, run: RunModel, notices: Notices) -> None:
        super().__init__()
        self.run, self.notices = run, notices
        self.setObjectName("card")
        self.picture = StaircasePicture("The plan and how far it is")
        self.state = widgets.label("", "subtitle")
        self.progress = widgets.label("", "muted", name="Progress of the run", elide=True)
        self.buttons: dict[str, QPushButton] = {
            key: widgets.button(
                text,
                partial(self.press, key),
                "primary" if key in ("arm", "start", "resume", "clear") else "",
                tip=TIPS[key],
            )
            for key, text in LABELS.items()
        }
        self.go_on = widgets.button("", self._go_on, "primary", tip="The rest of the broken run, in its own recording")
        self.calibrate = widgets.button(
            "Calibrate", self._calibrate, "primary", tip="Fit the curve through the readings of the run that has ended"
        )
        head = widgets.row(self.state, self.progress, None, *self.buttons.values(), self.go_on, self.calibrate)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(style.CARD_PADDING, style.GAP, style.CARD_PADDING, style.GAP)
        layout.setSpacing(style.STEP)
        layout.addLayout(head)
        layout.addWidget(self.picture)

    def press(self, key: str) -> None:
        """Press a button and show at once what it did."""
        self.run.press(key)
        self.refresh(self.run.snapshot)

    def _go_on(self) -> None:
        self.notices.attempt(self.run.resumption.arm)
        self.refresh(self.run.snapshot)

    def _calibrate(self) -> None:
        self.notices.attempt(self.run.calibration.take)

    def _show_choice(self, first_cycle: int) -> None:
        """Where a broken run can go on, part that from beginning anew; where one was read, calibrating comes first."""
        reads = self.run.calibration.open
        self.calibrate.setVisible(reads)
        self.go_on.setVisible(bool(first_cycle))
        widgets.set_text(self.go_on, f"Go on at cycle {first_cycle}")
        arm = self.buttons["arm"]
        widgets.set_text(arm, "Begin anew" if first_cycle else LABELS["arm"])
        widgets.set_state(arm, "" if first_cycle or reads else "primary", "role")
        arm.setToolTip("Arm the whole plan from its first cycle, in a new recording" if first_cycle else TIPS["arm"])

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show state, progress and the buttons that may be pressed."""
        model = self.run.sequence
        widgets.set_text(self.state, state_text(snapshot))
        widgets.set_text(self.progress, progress_text(snapshot) or f"{model.plan.name}: {model.estimate}")
        allowed = model.allowed(snapshot)
        for key, button in self.buttons.items():
            if key not in allowed and button.hasFocus():
                button.clearFocus()  # else it goes to the next button, and Space presses that one
            button.setVisible(key in allowed)
        self._show_choice(self.run.resumption.first_cycle if "arm" in allowed else 0)
        self.picture.show_drawing(model.drawing(snapshot))

    def paint_theme(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        self.picture.paint_theme(theme)
