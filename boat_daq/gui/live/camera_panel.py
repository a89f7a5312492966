"""The camera's panel: its picture with the marks, the elongation, and what is wrong."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QFontMetrics, QImage, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.camera import CameraModel, CameraView

HELP = "Reads two printed marks at every plateau."
WARNING_LINES = 3  # in the narrowest pane
MARK_TIP = "Side of the marks' black square; 0 takes the scale from the millimetre grid in the picture"
SOURCE_TIP = "Number of the camera (0 is the first), or the http:// or rtsp:// address of one on this computer"


def image_of(picture: npt.NDArray[np.uint8]) -> QImage:
    """Return an image on the memory of a picture, grey or BGR, [height, width(, 3)]."""
    kind = QImage.Format.Format_Grayscale8 if picture.ndim == 2 else QImage.Format.Format_BGR888
    height, width = picture.shape[:2]
    return QImage(picture.data, width, height, picture.strides[0], kind)


class MarkedPicture(QWidget):
    """The newest picture, fitted, with an outline on each mark."""

    def __init__(self) -> None:
        super().__init__()
        self.setAccessibleName("Picture of the camera")
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(style.PANE_WIDTH_NARROW, style.PANE_WIDTH_NARROW // 2)
        self._image = self._shown_image = QImage()  # as it came, and as it is on the screen
        self.shown: npt.NDArray[np.uint8] | None = None  # the image's own memory
        self.host_ns: int | None = None  # arrival of the frame that is shown
        self._outlines: list[npt.NDArray[np.float64]] = []

    def sizeHint(self) -> QSize:
        return QSize(style.PANE_WIDTH, 3 * style.PANE_WIDTH // 4)

    def show_view(self, view: CameraView) -> None:
        """Show the newest picture; nothing is drawn where it is the one before."""
        picture = view.state.picture if view.state is not None else None
        if picture is self.shown:
            return
        self.shown = picture
        reading = view.state.reading if view.state is not None else None
        self.host_ns = reading.host_ns if reading is not None else None
        self._image = QImage() if picture is None else image_of(picture)
        self._shown_image = QImage()
        tracked = view.state.tracked if view.state is not None else None
        self._outlines = [] if tracked is None else list(tracked.marks_px)
        self.update()

    @property
    def _scale(self) -> float:
        """Pixels of the screen for one of the picture."""
        return min(self.width() / self._image.width(), self.height() / self._image.height())

    def _fitted(self) -> QImage:
        """Return the picture in the pixels of the screen, made once for each picture and size: it is drawn often."""
        ratio, scale = self.devicePixelRatio(), self._scale
        size = QSize(round(ratio * scale * self._image.width()), round(ratio * scale * self._image.height()))
        if self._shown_image.size() != size:
            step = max(1, int(1.0 / (ratio * scale)))  # every so many pixels are enough, and the rest is interpolated
            assert self.shown is not None
            coarse = np.ascontiguousarray(self.shown[::step, ::step])
            smooth = Qt.TransformationMode.SmoothTransformation
            self._shown_image = image_of(coarse).scaled(size, Qt.AspectRatioMode.IgnoreAspectRatio, smooth)
            self._shown_image.convertTo(QImage.Format.Format_RGB32)
            self._shown_image.setDevicePixelRatio(ratio)
        return self._shown_image

    def paintEvent(self, event: QPaintEvent) -> None:
        if self._image.isNull():
            return
        painter, scale = QPainter(self), self._scale
        painter.drawImage(0, 0, self._fitted())
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for quad in self._outlines:
            shown = QPolygonF([QPointF(scale * (x + 0.5), scale * (y + 0.5)) for x, y in quad])
            for colour, width in ((style.colour(style.LIGHT.surface), 4), (style.colour(style.LIGHT.elongation), 2)):
                painter.setPen(QPen(colour, width))
                painter.drawPolygon(shown)


class CameraPanel(QWidget):
    def __init__(self, model: CameraModel, services: Services) -> None:
        super().__init__()
        self.model, self.services, self.notices = model, services, services.notices
        self.source = controls.field("Camera", model.source, on_enter=self.toggle)
        self.source.setToolTip(SOURCE_TIP)
        self.mark = controls.field(
            "Side of the marks in mm", model.mark, on_enter=self.toggle, width=2 * style.CONTROL_HEIGHT
        )
        self.mark.setToolTip(MARK_TIP)
        self.button = controls.button("Open", self.toggle, "primary", name="Open or close the camera")
        self.picture = MarkedPicture()
        tip = "Films the simulated unit, for practice; its readings are marked simulated"
        self.virtual = controls.button("Open the virtual camera", self._open_virtual, tip=tip)
        self.print = controls.button("Save the marks …", self._save_marks, tip="The two marks as a PDF to print")
        self.value = controls.label("", "title", name="Elongation by the camera")
        self.u = controls.label("", "muted")
        self.line = controls.label("", "small")
        self.warning = controls.label("", "small", name="Why the camera gives no elongation", wrap=True)
        self.help = controls.label(HELP, "muted", wrap=True)
        asked = controls.row(controls.label("Camera", "muted"), (self.source, 1))
        marks = controls.row(
            controls.label("Marks", "muted"), self.mark, controls.label("mm", "muted"), None, self.button
        )
        values = controls.row(self.value, self.u, (self.warning, 1), spacing=style.STEP)
        for text in (self.value, self.u, self.warning):
            values.setAlignment(text, Qt.AlignmentFlag.AlignVCenter)
        self.values = controls.inside(values)  # as high with a warning as without: the picture does not move
        self.values.setFixedHeight(WARNING_LINES * QFontMetrics(style.small_font()).lineSpacing())
        parts = (asked, marks, self.virtual, self.help, self.print, self.values, self.line, (self.picture, 100))
        self.setLayout(controls.column(*parts, None, spacing=style.GAP, margins=(0, 0, 0, 0)))
        self._show(model.view())

    def toggle(self) -> None:
        if self.model.channel is not None:
            self.model.close()
        else:
            self.notices.attempt(lambda: self.model.open(self.source.text(), self.mark.text()))
        self._show(self.model.view())

    def _open_virtual(self) -> None:
        self.notices.attempt(self.model.open_virtual)
        self._show(self.model.view())

    def _save_marks(self) -> None:
        ask_save(self, self.services, "marks", "pdf", lambda path: self.model.save_marks(path, self.mark.text()))

    def draw(self) -> None:
        """Draw the newest picture; called for each frame of the screen."""
        channel = self.model.channel
        if channel is None or channel.state.picture is not self.picture.shown:
            self._show(self.model.view())

    def refresh(self, snapshot: SessionSnapshot) -> None:
        self._show(self.model.view())

    def _show(self, view: CameraView) -> None:
        is_open = view.state is not None
        controls.set_text(self.button, "Close" if is_open else "Open")
        for control in (self.source, self.mark):
            control.setReadOnly(is_open)
        self.help.setVisible(not is_open)
        self.print.setVisible(not is_open)
        self.virtual.setVisible(not is_open and bool(self.model.virtual()))
        for shown in (self.picture, self.values, self.line):
            shown.setVisible(is_open)
        controls.set_text(self.value, view.elongation)
        controls.set_text(self.u, view.u)
        controls.set_text(self.line, view.line)
        controls.set_text(self.warning, f"\u25b2 {view.warning}" if view.warning else "")
        controls.set_state(self.warning, "warning" if view.warning else "")
        self.picture.show_view(view)
