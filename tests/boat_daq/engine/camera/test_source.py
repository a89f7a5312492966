"""Sources of pictures: a file, an MJPEG address; and those that are refused, with cause and remedy."""

from __future__ import annotations

import contextlib
import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from boat_daq.engine.camera.source import VideoStore, _Capture, open_source, read_picture
from boat_daq.engine.simulator.virtual_camera import MjpegStream
from protocol.base.errors import DeviceError, RequestError
from protocol.base.optional import optional

PICTURE = np.tile(np.linspace(0, 255, 64, dtype=np.uint8), (48, 1))


def test_a_lossless_video_gives_its_pictures_and_times(tmp_path: Path) -> None:
    """FFV1: every grey level as it was."""
    store = VideoStore(tmp_path / "run.mkv")
    for n in range(3):
        store.write(np.roll(PICTURE, n, axis=1))
    store.close()
    source = open_source(str(tmp_path / "run.mkv"))
    frames = list(source.frames())
    assert [round(30 * frame.time_s) for frame in frames] == [0, 1, 2]
    assert not source.live
    assert (frames[2].decode()[..., 0] == np.roll(PICTURE, 2, axis=1)).all()


def test_mjpeg_gives_the_pictures_of_a_stream() -> None:
    """Through our own server and our own reader, in the host's time."""
    with contextlib.closing(MjpegStream(0)) as stream:
        seen = threading.Event()

        def film() -> None:  # a viewer gets the frames that come after it has connected
            while not seen.wait(0.02):
                stream.frame(PICTURE, 1.0)

        filming = threading.Thread(target=film)
        filming.start()
        try:
            source = open_source(stream.url)
            frame = next(source.frames())
        finally:
            seen.set()
            filming.join()
        assert source.live
        assert abs(frame.decode().astype(int) - PICTURE).max() < 12
        source.close()


def test_a_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    """Text, nothing, a folder, and a name that is none."""
    (tmp_path / "text.mp4").write_text("no video", encoding="utf-8")
    (tmp_path / "empty.mkv").touch()
    for name in ("text.mp4", "empty.mkv"):
        with pytest.raises(RequestError, match=f"{name} is not a video"):
            open_source(str(tmp_path / name))
    with pytest.raises(RequestError, match="is not a regular file"):
        open_source(str(tmp_path))
    with pytest.raises(RequestError, match="does not exist"):
        open_source("absent.mp4")
    with pytest.raises(RequestError, match="not a camera or video"):
        open_source("ftp://127.0.0.1/x")


def test_a_camera_that_is_not_there_is_refused() -> None:
    """With those that are."""
    with pytest.raises(RequestError, match="there is no camera 99; this computer has"):
        open_source("99")


def test_a_camera_that_gives_no_picture_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its device exists, and yields nothing."""
    monkeypatch.setattr(Path, "exists", lambda self: True)
    with pytest.raises(DeviceError, match="camera 98 gives no picture: another program uses it"):
        open_source("98")


@pytest.mark.parametrize("address", ["http://192.0.2.1/", "rtsp://camera.example/stream", "http://10.0.0.1:99/x"])
def test_another_computer_needs_permission(address: str) -> None:
    """Nothing is connected before."""
    with pytest.raises(RequestError, match="is another computer") as refusal:
        open_source(address)
    assert refusal.value.command == "boat-daq config set allow_remote=true"


@pytest.mark.parametrize("address", ["http:///x", "http://127.0.0.1:99999/", "rtsp://"])
def test_an_impossible_address_is_refused(address: str) -> None:
    """No host, no port."""
    with pytest.raises(RequestError, match=r"names no host|is not an address"):
        open_source(address)


def giant_jpeg() -> bytes:
    """A small picture whose header states 65,000 x 65,000 pixels, more than OpenCV takes."""
    content = optional("cv2").imencode(".jpg", PICTURE)[1].tobytes()
    at = content.index(b"\xff\xc0") + 5
    return content[:at] + 2 * (65_000).to_bytes(2, "big") + content[at + 4 :]


@pytest.fixture
def page() -> Iterator[str]:
    """Serve a page that is no stream; yield its address."""

    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            part = {"/broken": b"hello", "/giant": giant_jpeg()}.get(self.path, b"")
            kind = "multipart/x-mixed-replace; boundary=x" if part else "text/html"
            self.send_header("Content-Type", kind)
            self.end_headers()
            self.wfile.write(b"--x\r\nContent-Length: %d\r\n\r\n%b\r\n" % (len(part), part) if part else b"<html>")

        def log_message(self, *_: object) -> None:
            """Print nothing."""

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


def test_an_address_that_is_no_stream_is_refused(page: str) -> None:
    """A page; parts that are no JPEG, or a giant one; a port where nobody listens."""
    with pytest.raises(DeviceError, match="is no MJPEG stream: status 200, text/html"):
        open_source(page)
    for path in ("broken", "giant"):
        with pytest.raises(DeviceError, match="not a JPEG picture"):
            next(open_source(f"{page}/{path}").frames()).decode()
    with pytest.raises(DeviceError, match="does not answer"):
        open_source("http://127.0.0.1:9/")


def test_without_opencv_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """How to install it."""
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(RequestError, match="OpenCV is not installed") as refusal:
        open_source("0")
    assert "opencv-python-headless" in refusal.value.command


def test_a_picture_file_is_read_grey(tmp_path: Path) -> None:
    """And what is none is refused."""
    path = tmp_path / "board.png"
    assert optional("cv2").imwrite(str(path), PICTURE)
    assert (read_picture(path) == PICTURE).all()
    for content in (b"no picture", giant_jpeg()):
        path.write_bytes(content)
        with pytest.raises(RequestError, match="is not a picture"):
            read_picture(path)


def test_frames_of_a_video_have_their_own_times() -> None:
    """A telephone's frames are not evenly spaced: OpenCV tells the time of the frame that was read last."""

    class Video:
        """Stands for OpenCV's capture of a file with these times, ms; the fourth frame states none."""

        times_ms, read_so_far = (0.0, 50.0, 60.0, 0.0, 140.0), 0

        def get(self, key: int) -> float:
            cv = optional("cv2")
            if key == cv.CAP_PROP_POS_MSEC:
                return self.times_ms[self.read_so_far - 1] if self.read_so_far else 0.0
            return 25.0 if key == cv.CAP_PROP_FPS else 5.0

        def read(self) -> tuple[bool, np.ndarray]:
            self.read_so_far += 1
            return self.read_so_far <= len(self.times_ms), np.zeros((2, 2), np.uint8)

        def release(self) -> None:
            """Nothing to release."""

    frames = _Capture("phone.mp4", Video(), live=False).frames()
    assert [frame.time_s for frame in frames] == pytest.approx([0.0, 0.05, 0.06, 0.1, 0.14])
