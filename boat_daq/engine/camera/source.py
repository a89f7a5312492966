"""Where pictures come from: a camera of this computer, a video file, an MJPEG or an RTSP address.

Every source gives frames one after the other, each with its time: the host's monotonic clock at its arrival, or for a
file the time in the file. A source that fails raises a `DeviceError` with its cause; an address beyond this computer
needs the operator's permission, because its pictures decide on readings.
"""

from __future__ import annotations

import http.client
import ipaddress
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import SplitResult, urlsplit

import numpy as np
import numpy.typing as npt

from protocol.base.errors import DeviceError, RequestError
from protocol.base.optional import optional

CODECS = {".mkv": "FFV1", ".avi": "MJPG", ".mp4": "mp4v"}  # FFV1 is lossless
FRAMES_PER_S = 30.0


class VideoStore:
    """Writes pictures to a file that begins with the first of them."""

    def __init__(self, path: Path, rate_hz: float = FRAMES_PER_S) -> None:
        if path.suffix.lower() not in CODECS:
            raise RequestError(f"{path.name} is not the name of a video", f"end it in {', '.join(CODECS)}")
        if not path.absolute().parent.is_dir():
            raise RequestError(f"{path} cannot be written", "name a file in a folder that exists")
        self._path, self._rate_hz = path, rate_hz
        self._cv: Any = optional("cv2")
        self._writer: Any = None

    def write(self, picture: Picture) -> None:
        colour = picture if picture.ndim == 3 else self._cv.cvtColor(picture, self._cv.COLOR_GRAY2BGR)
        if self._writer is None:
            fourcc = self._cv.VideoWriter_fourcc(*CODECS[self._path.suffix.lower()])
            size = (colour.shape[1], colour.shape[0])
            self._writer = self._cv.VideoWriter(str(self._path), fourcc, self._rate_hz, size, True)
            if not self._writer.isOpened():
                raise RequestError(f"{self._path} cannot be written", "name a file in a folder that exists")
        self._writer.write(colour)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.release()


Picture = npt.NDArray[np.uint8]

_ANSWER_S = 5.0  # longest wait for an address
JPEG_BYTES_MAX = 32 * 2**20
PIXELS_MAX = 51_000_000  # of a sensor that is sold with 50 megapixels
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(PIXELS_MAX))  # it decodes no more; read when it is imported
_HEADER_LINES = 40
_VIDEO_SUFFIXES = (".mkv", ".avi", ".mp4", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".mjpeg", ".mjpg", ".wmv")


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """One frame: its time, s, and what decodes its picture, outside the thread that must keep up with the camera."""

    time_s: float
    decode: Callable[[], Picture]


class CameraSource(Protocol):
    """A source of pictures."""

    name: str
    live: bool  # whether its times are the host's monotonic clock
    frame_count: int  # of a file, as it states; 0 where it does not end

    def frames(self) -> Iterator[CameraFrame]:
        """Give the frames until the source ends or is closed."""

    def close(self) -> None:
        """End the source; may be called from another thread."""


def open_source(name: str, *, allow_remote: bool = False) -> CameraSource:
    """Open a source of pictures.

    `name`: number of a camera, path of a video, http://HOST:PORT/... (MJPEG) or rtsp://HOST/...
    """
    optional("cv2")
    if name.isascii() and name.isdecimal():
        return _Capture(name, _open_camera(int(name)), live=True)
    parts = urlsplit(name)
    if parts.scheme in ("http", "rtsp"):
        _check_address(name, parts, allow_remote=allow_remote)
        return MjpegAddress(name, parts) if parts.scheme == "http" else _Capture(name, _open_rtsp(name), live=True)
    if "://" in name:
        cause = f"{name} is not a camera or video"
        raise RequestError(cause, "give a camera's number, a video file, http:// or rtsp://")
    return open_video(Path(name))


def open_video(path: Path) -> CameraSource:
    """Open a video file. RequestError: no such file, it is no video, or OpenCV is not installed."""
    return _Capture(str(path), _open_file(path), live=False)


def cameras() -> list[tuple[int, str]]:
    """Return number and name of the cameras of this computer, as far as the system lists them."""
    found = []
    for folder in sorted(Path("/sys/class/video4linux").glob("video*")):
        try:
            found.append((int(folder.name[5:]), (folder / "name").read_text(encoding="utf-8").strip()))
        except (OSError, ValueError):
            continue
    return found


def read_picture(path: Path) -> Picture:
    """Return the picture in a file, grey. RequestError: it is no picture, or too large."""
    if not path.is_file() or path.stat().st_size > JPEG_BYTES_MAX * 4:
        raise RequestError(f"{path} is not a picture", "give a PNG or JPEG file")
    with _quiet() as cv:
        picture = _grey(lambda: cv.imread(str(path), cv.IMREAD_GRAYSCALE))
    if picture is None:
        raise RequestError(f"{path.name} is not a picture, or has more than 50 megapixels", "give a PNG or JPEG file")
    return picture


def _grey(read: Callable[[], Any]) -> Picture | None:
    """Return what OpenCV reads; None where that is no picture, or a giant one."""
    with suppress(optional("cv2").error):
        picture = read()
        return None if picture is None or picture.size > PIXELS_MAX else np.asarray(picture, np.uint8)
    return None


@contextmanager
def _quiet() -> Iterator[Any]:
    """Give OpenCV without its own messages: the errors here name cause and remedy."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv = optional("cv2")
    log = cv.utils.logging
    before = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield cv
    finally:
        log.setLogLevel(before)


def _open_camera(number: int) -> Any:
    with _quiet() as cv:
        capture = cv.VideoCapture(number)
        if capture.isOpened():
            capture.set(cv.CAP_PROP_BUFFERSIZE, 1)
            if capture.read()[0]:
                return capture
        capture.release()
    known = ", ".join(f"{n} ({text})" for n, text in cameras()) or "none"
    if Path(f"/dev/video{number}").exists():
        cause = f"camera {number} gives no picture: another program uses it, or it may not be opened"
        raise DeviceError(cause, "close the other program, or check the permissions")
    raise RequestError(f"there is no camera {number}; this computer has: {known}", "check the cable, or another number")


def _open_rtsp(name: str) -> Any:
    with _quiet() as cv:
        wait_ms = int(1000 * _ANSWER_S)
        limits = [cv.CAP_PROP_OPEN_TIMEOUT_MSEC, wait_ms, cv.CAP_PROP_READ_TIMEOUT_MSEC, wait_ms]
        capture = cv.VideoCapture(name, cv.CAP_FFMPEG, limits)
        if not capture.isOpened():
            raise DeviceError(f"{name} gives no pictures", "check the address, and that the camera is on")
        return capture


def _open_file(path: Path) -> Any:
    if not path.is_file():
        kind = "is not a regular file" if path.exists() else "does not exist"
        raise RequestError(f"the video {path} {kind}", "check its name")
    with _quiet() as cv:
        capture = cv.VideoCapture(str(path), cv.CAP_FFMPEG)
        size = capture.get(cv.CAP_PROP_FRAME_WIDTH) * capture.get(cv.CAP_PROP_FRAME_HEIGHT)
        if not capture.isOpened() or not 0 < size <= PIXELS_MAX:
            cause = f"{path.name} is not a video"
            raise RequestError(cause, f"choose a video file, such as {', '.join(_VIDEO_SUFFIXES[:5])}")
        return capture


def _check_address(name: str, parts: SplitResult, *, allow_remote: bool) -> None:
    """Refuse an address without a host, and one beyond this computer unless it is allowed."""
    try:
        host, _ = parts.hostname or "", parts.port
    except ValueError as error:
        raise RequestError(f"{name} is not an address: {error}", "use http://127.0.0.1:PORT/") from None
    if not host:
        raise RequestError(f"{name} names no host", "use http://127.0.0.1:PORT/")
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    if not local and not allow_remote:
        remedy = "allow it: the connection is neither encrypted nor authenticated"
        raise RequestError(f"{host} is another computer", remedy, command="boat-daq config set allow_remote=true")


class _Capture:
    """What OpenCV opens: a camera, an RTSP address or a file."""

    def __init__(self, name: str, capture: Any, *, live: bool) -> None:
        self.name, self.live = name, live
        self._capture, self._closed = capture, False
        stated = 0.0 if live else float(capture.get(optional("cv2").CAP_PROP_FRAME_COUNT))
        self.frame_count = int(stated) if 0 < stated < 1e9 else 0

    def frames(self) -> Iterator[CameraFrame]:
        """Give the frames; those of a file as fast as they are taken."""
        cv, number = optional("cv2"), 0
        rate_hz = self._capture.get(cv.CAP_PROP_FPS)
        step_s = 1.0 / rate_hz if math.isfinite(rate_hz) and rate_hz > 0.1 else 1.0 / 30.0
        last_s = -math.inf
        try:
            while not self._closed:
                taken, picture = self._capture.read()
                if not taken:
                    if self.live and not self._closed:
                        raise DeviceError(f"camera {self.name} gives no more pictures", "check its cable")
                    return
                time_s = time.monotonic() if self.live else self._capture.get(cv.CAP_PROP_POS_MSEC) / 1e3
                if not self.live and not time_s > last_s:  # a file without times
                    time_s = last_s + step_s if number else 0.0
                number, last_s = number + 1, time_s
                yield CameraFrame(time_s, partial(np.asarray, picture, np.uint8))
        finally:
            self._capture.release()

    def close(self) -> None:
        self._closed = True


class MjpegAddress:
    """JPEG pictures in one endless HTTP answer (multipart/x-mixed-replace), as webcam servers send them.

    Its own reader: what FFmpeg buffers of such a stream delays it by seconds.
    """

    live = True
    frame_count = 0

    def __init__(self, name: str, parts: SplitResult) -> None:
        self.name = name
        self._closed = False
        self._connection = http.client.HTTPConnection(parts.hostname or "", parts.port or 80, timeout=_ANSWER_S)
        path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        try:
            self._connection.request("GET", path)
            self._answer = self._connection.getresponse()
        except (OSError, http.client.HTTPException) as error:
            self._connection.close()
            remedy = "check the address, and that the camera is on"
            raise DeviceError(f"{name} does not answer: {error}", remedy) from None
        kind = self._answer.headers.get_content_type()
        if self._answer.status != 200 or not kind.startswith("multipart/"):
            self._answer.close()
            self._connection.close()
            cause = f"{name} is no MJPEG stream: status {self._answer.status}, {kind}"
            raise DeviceError(cause, "give the address of the stream itself, not of its page")

    def frames(self) -> Iterator[CameraFrame]:
        try:
            while not self._closed:
                jpeg = self._next_part()
                yield CameraFrame(time.monotonic(), partial(self._decoded, jpeg))
        except (OSError, ValueError, http.client.HTTPException) as error:
            if not self._closed:
                cause = f"{self.name} sends no more pictures: {error}"
                raise DeviceError(cause, "check that the camera is on") from None
        finally:
            self._answer.close()
            self._connection.close()

    def _decoded(self, jpeg: bytes) -> Picture:
        cv = optional("cv2")
        picture = _grey(lambda: cv.imdecode(np.frombuffer(jpeg, np.uint8), cv.IMREAD_GRAYSCALE))
        if picture is None:
            raise DeviceError(f"{self.name} sent data that are not a JPEG picture", "check the camera")
        return picture

    def close(self) -> None:
        self._closed = True
        if self._connection.sock is not None:
            self._connection.sock.close()

    def _next_part(self) -> bytes:
        length = -1
        for _ in range(_HEADER_LINES):
            line = self._answer.readline(1000)
            if not line:
                raise OSError("the stream ended")
            key, _, value = line.decode("latin-1").partition(":")
            if key.strip().lower() == "content-length":
                length = int(value)
            if not line.strip() and length >= 0:
                break
        if not 0 < length <= JPEG_BYTES_MAX:
            raise OSError("its parts have no usable Content-Length")
        data = self._answer.read(length)
        if len(data) < length:
            raise OSError("the stream ended")
        return data
