"""Read an untrusted picture file into a pixmap, in bounded time and memory.

Rules: the kind is found from the content, not the name, and only plain raster kinds are decoded: an SVG may name other
files and repeat itself without end. The size is checked before decoding; a pipe or a device is not opened.
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
    """Return the picture in a file, rotated as its camera recorded.

    Raises
    ------
    OperatorError : it is no picture of these kinds, is incomplete, or is too large (256 MB decoded).
    """
    if not path.is_file():
        raise OperatorError(f"{path.name} is no picture file", REMEDY)
    if path.stat().st_size > FILE_BYTES_MAX:
        raise OperatorError(f"{path.name} is no picture of less than {FILE_BYTES_MAX // 1_000_000} MB", REMEDY)
    reader = QImageReader(str(path))
    reader.setDecideFormatFromContent(True)
    reader.setAutoTransform(True)
    if reader.format().toStdString() not in KINDS:
        raise OperatorError(f"{path.name} is no picture of a kind that can be read", REMEDY)
    image = reader.read()
    if image.isNull():
        raise OperatorError(f"{path.name} holds no picture that can be decoded: {reader.errorString()}", REMEDY)
    return QPixmap.fromImage(image)
