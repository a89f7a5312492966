"""A reading from a picture: two clicks for the scale, one for the tip at rest, one for the tip now.

An untrusted picture file is read in bounded time and memory: its kind is found from the content, not the name, and only
plain raster kinds are decoded: an SVG may name other files and repeat itself without end. The size is checked before
decoding; a pipe or a device is not opened.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from PySide6.QtCore import QPoint, QPointF, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QGuiApplication,
    QImageReader,
    QKeySequence,
    QMouseEvent,
    QPainter,
    QPen,
    QPixmap,
    QShortcut,
    QWheelEvent,
)
from PySide6.QtWidgets import QDialog, QGraphicsPixmapItem, QGraphicsScene, QGraphicsView, QWidget

from boat_daq.formatting import plain_number
from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.photograph import Photograph
from boat_daq.viewmodels.live.run_model import RunModel
from protocol.base.errors import RequestError
from protocol.base.units import NOTHING

_KINDS: Final = ("png", "jpg", "jpeg", "bmp", "tif", "tiff")
FILE_BYTES_MAX: Final = 200_000_000
REMEDY: Final = "Copy or choose a PNG or JPEG of the millimetre grid."
TAKE = "Take the reading"
LOAD = "Load or paste (Ctrl+V) a picture of the millimetre grid. Wheel: zoom; right button: move."
NO_PLATEAU = "Measured. No plateau needs a reading now: take it at the next one, or type it."
_MARKS = ("scale 1", "scale 2", "rest", "tip")


def read_picture(path: Path) -> QPixmap:
    """Return the picture in a file, rotated as its camera recorded."""
    if not path.is_file():
        raise RequestError(f"{path.name} is not a picture", REMEDY)
    if path.stat().st_size > FILE_BYTES_MAX:
        raise RequestError(f"{path.name} is larger than {FILE_BYTES_MAX // 1_000_000} MB", REMEDY)
    reader = QImageReader(str(path))
    reader.setDecideFormatFromContent(True)
    reader.setAutoTransform(True)
    if reader.format().toStdString() not in _KINDS:
        raise RequestError(f"{path.name} is a picture of an unsupported format", REMEDY)
    image = reader.read()
    if image.isNull():
        raise RequestError(f"{path.name} cannot be decoded: {reader.errorString()}", REMEDY)
    return QPixmap.fromImage(image)


class PictureView(QGraphicsView):
    """The picture with the clicks on it; the wheel zooms, the right button drags."""

    clicked = Signal(float, float)

    def __init__(self) -> None:
        super().__init__()
        self.setAccessibleName("Picture of the millimetre grid")
        self.setScene(QGraphicsScene(self))
        self.picture = QGraphicsPixmapItem()
        self.picture.setTransformationMode(Qt.TransformationMode.SmoothTransformation)  # keeps the lines of the grid
        self.scene().addItem(self.picture)
        self.marks: tuple[tuple[float, float], ...] = ()
        self.colour = QColor(style.LIGHT.elongation)
        self._dragged_from: QPoint | None = None
        self.setTransformationAnchor(QGraphicsView.ViewportAnchor.AnchorUnderMouse)
        self.setCursor(Qt.CursorShape.CrossCursor)

    def set_picture(self, pixmap: QPixmap) -> None:
        self.picture.setPixmap(pixmap)
        self.scene().setSceneRect(self.picture.boundingRect())
        self.fitInView(self.picture, Qt.AspectRatioMode.KeepAspectRatio)

    def wheelEvent(self, event: QWheelEvent) -> None:
        factor = 1.25 if event.angleDelta().y() > 0 else 0.8
        self.scale(factor, factor)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() is Qt.MouseButton.LeftButton and not self.picture.pixmap().isNull():
            at = self.mapToScene(event.position().toPoint())
            self.clicked.emit(at.x(), at.y())
        elif event.button() is Qt.MouseButton.RightButton:
            self._dragged_from = event.position().toPoint()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if self._dragged_from is None or not event.buttons() & Qt.MouseButton.RightButton:
            return
        at = event.position().toPoint()
        gone, self._dragged_from = at - self._dragged_from, at
        self.horizontalScrollBar().setValue(self.horizontalScrollBar().value() - gone.x())
        self.verticalScrollBar().setValue(self.verticalScrollBar().value() - gone.y())

    def show_marks(self, marks: tuple[tuple[float, float], ...]) -> None:
        self.marks = marks
        self.viewport().update()

    def drawForeground(self, painter: QPainter, rect: object) -> None:
        """Draw a labelled cross at every click, of one size on the screen."""
        painter.resetTransform()
        arm, ground = style.POINT_SIZE, style.colour(style.LIGHT.surface)
        for (x, y), word in zip(self.marks, _MARKS, strict=False):
            at = self.mapFromScene(QPointF(x, y))
            for colour, width in ((ground, 4), (self.colour, 2)):  # light around dark, for any picture
                painter.setPen(QPen(colour, width))
                painter.drawLine(at.x() - arm, at.y(), at.x() + arm, at.y())
                painter.drawLine(at.x(), at.y() - arm, at.x(), at.y() + arm)
            box = painter.fontMetrics().boundingRect(word).adjusted(-style.STEP, 0, style.STEP, 0)
            painter.fillRect(box.translated(at.x() + arm + style.STEP, at.y() - arm), ground)
            painter.setPen(style.colour(style.LIGHT.text))
            painter.drawText(at.x() + arm + style.STEP, at.y() - arm, word)


class PhotographPanel(QDialog):
    def __init__(self, parent: QWidget, run: RunModel, services: Services) -> None:
        super().__init__(parent)
        self.run, self.services = run, services
        self.state = Photograph()
        self.setWindowTitle("Reading from a photograph")
        self.resize(*style.WINDOW_MINIMUM)
        self.view = PictureView()
        self.view.clicked.connect(self.click)
        self.instruction = controls.label(LOAD, "set", name="What to do next", wrap=True)
        self.distance = controls.field("Distance between scale marks in mm", "10", width=2 * style.CONTROL_HEIGHT)
        self.distance.textChanged.connect(lambda _: self._scale())
        self.value = controls.label(NOTHING, "title", name="Elongation read")
        self.take = controls.button(TAKE, self.accept_reading, "primary")
        self.take.setDefault(True)
        self.take.setEnabled(False)
        head = controls.row(
            controls.button("Load …", lambda: ask_open(self, services, "Open a picture", " ".join(_KINDS), self.load)),
            controls.button("Paste", self.paste), controls.label("Distance between scale marks:", "muted"),
            self.distance,
            controls.label("mm", "muted"), None, self.value, controls.button("Back", self.back), self.take,
        )  # fmt: skip
        self.setLayout(controls.column(head, self.instruction, (self.view, 1), spacing=style.GAP))
        QShortcut(QKeySequence.StandardKey.Paste, self, self.paste)

    def load(self, path: Path) -> None:
        self._show(read_picture(path))

    def paste(self) -> None:
        self.services.notices.attempt(lambda: self._show(QGuiApplication.clipboard().pixmap()))

    def _show(self, pixmap: QPixmap) -> None:
        if pixmap.isNull():
            raise RequestError("the clipboard holds no picture", REMEDY)
        self.state = self.state.next_picture()
        self.view.set_picture(pixmap)
        self._refresh()

    def click(self, x: float, y: float) -> None:
        self._take(self.state.click(x, y))

    def back(self) -> None:
        self._take(self.state.back())

    def _take(self, state: Photograph) -> None:
        self.state = state
        self._refresh()

    def _scale(self) -> None:
        try:
            self.state = self.state.with_distance(plain_number(self.distance.text()))
        except ValueError:
            controls.set_state(self.distance, "true", "wrong")
        else:
            controls.set_state(self.distance, "", "wrong")
            self._refresh()

    def refresh(self) -> None:
        """Follow the run: a plateau may begin or cease to wait meanwhile."""
        if self.isVisible():
            self._refresh()

    def _refresh(self) -> None:
        x, waiting = self.state.elongation_mm, self.run.snapshot.waiting_for_reading
        waits = waiting is not None
        step = LOAD if self.view.picture.pixmap().isNull() else self.state.instruction
        text = step if waits or x is None else NO_PLATEAU
        warning = self.run.readings.doubt(waiting.step_id, x) if waiting is not None and x is not None else ""
        question = f"\n{self.run.readings.question(self.run.snapshot)}" if waits else ""
        value = self.run.readings.text(x) if x is not None else NOTHING
        controls.set_text(self.instruction, (f"\u25b2 {value}? {warning}" if warning else text) + question)
        controls.set_state(self.instruction, "warning" if warning else "")
        controls.set_text(self.take, "Take it anyway" if warning else TAKE)
        self.value.setText(value)
        self.take.setEnabled(x is not None and waits)
        self.view.show_marks(self.state.clicks)

    def accept_reading(self) -> None:
        waiting, x = self.run.snapshot.waiting_for_reading, self.state.elongation_mm
        if waiting is None or x is None:
            return
        reading = (waiting.step_id, round(x, 3), "photograph", self.state.resolution_mm)
        if self.services.notices.attempt(lambda: self.run.readings.put(*reading)):
            self._take(self.state.next_picture())
            self.hide()
