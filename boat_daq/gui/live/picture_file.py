"""A picture file from anywhere into a pixmap, in bounded time and memory.

Rules: what it is says its content, not its name, and only the plain raster kinds are decoded: an SVG may name other
files and repeat itself without end. Its size is asked before it is decoded; a pipe or a device is not opened at all.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from PySide6.QtGui import QImageReader, QPixmap

from boat_daq.errors import OperatorError

KINDS: Final = ("png", "jpg", "jpeg", "bmp", "tif", "tiff")
FILE_BYTES_MAX: Final = 200_000_000
REMEDY: Final = "Copy or choose a PNG or JPEG of the millimetre grid."


def read_picture(path: Path) -> QPixmap:
    """Return the picture in a file, turned as its camera says.

    Raises
    ------
    OperatorError : it is no picture of these kinds, is torn, or is too large for this window (256 MB when decoded).
    """
    if not path.is_file():
        raise OperatorError(f"{path.name} is no picture file", REMEDY)
    if path.stat().st_size > FILE_BYTES_MAX:
        raise OperatorError(f"{path.name} holds no picture of less than {FILE_BYTES_MAX // 1_000_000} MB", REMEDY)
    reader = QImageReader(str(path))
    reader.setDecideFormatFromContent(True)
    reader.setAutoTransform(True)
    if reader.format().toStdString() not in KINDS:
        raise OperatorError(f"{path.name} holds no picture of a kind that is read here", REMEDY)
    image = reader.read()
    if image.isNull():
        raise OperatorError(f"{path.name} holds no picture that can be shown: {reader.errorString()}", REMEDY)
    return QPixmap.fromImage(image)
