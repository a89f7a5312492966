"""The pictures of a run in a file, where the operator wants them: lossless FFV1, or Motion JPEG.

The readings and their times are in the recording; a video is for people, and for tracking it again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from boat_daq.engine.camera.source import Picture
from protocol.base.errors import RequestError
from protocol.base.optional import optional

CODECS = {".mkv": "FFV1", ".avi": "MJPG", ".mp4": "mp4v"}  # FFV1 is lossless
FRAMES_PER_S = 30.0


class VideoStore:
    """Writes pictures to a file that begins with the first of them."""

    def __init__(self, path: Path, rate_hz: float = FRAMES_PER_S) -> None:
        if path.suffix.lower() not in CODECS:
            raise RequestError(f"{path.name} is no name of a video", f"end it in {', '.join(CODECS)}")
        if not path.absolute().parent.is_dir():
            raise RequestError(f"{path} cannot be written", "name a file in a folder that exists")
        self._path, self._rate_hz = path, rate_hz
        self._cv: Any = optional("cv2")
        self._writer: Any = None

    def write(self, picture: Picture) -> None:
        """Add a picture [height, width] or [height, width, 3]."""
        colour = picture if picture.ndim == 3 else self._cv.cvtColor(picture, self._cv.COLOR_GRAY2BGR)
        if self._writer is None:
            fourcc = self._cv.VideoWriter_fourcc(*CODECS[self._path.suffix.lower()])
            size = (colour.shape[1], colour.shape[0])
            self._writer = self._cv.VideoWriter(str(self._path), fourcc, self._rate_hz, size, True)
            if not self._writer.isOpened():
                raise RequestError(f"{self._path} cannot be written", "name a file in a folder that exists")
        self._writer.write(colour)

    def close(self) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.release()
