"""Pictures from anywhere: decompression bombs, torn files, other formats, no file. Refused in bounded memory."""

from __future__ import annotations

import gzip
import io
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
from PIL import Image
from PySide6.QtWidgets import QWidget

from boat_daq.gui.live.photograph_panel import FILE_BYTES_MAX, PhotographPanel, read_picture
from protocol.base.errors import RequestError
from tests.faults.drill import ROOT


def chunk(kind: bytes, content: bytes) -> bytes:
    """A chunk of a PNG."""
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width: int, height: int, data: bytes, more: bytes = b"") -> bytes:
    """Return a PNG whose header states this size, of 8-bit grey; `more` are chunks before its data."""
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + more + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def picture(kind: str, size: tuple[int, int] = (64, 48), **options: object) -> bytes:
    """A picture of that kind."""
    file = io.BytesIO()
    Image.new("L", size, 128).save(file, kind, **options)
    return file.getvalue()


def svg(content: str, head: str = "") -> bytes:
    """A drawing of 100 x 100."""
    names = "xmlns='http://www.w3.org/2000/svg' xmlns:xlink='http://www.w3.org/1999/xlink'"
    return f"{head}<svg {names} width='100' height='100'>{content}</svg>".encode()


def repeated() -> str:
    """Ten drawings of ten drawings of ten ...: 10^9 rectangles."""
    levels = [f"<g id='g{n + 1}'>" + f"<use xlink:href='#g{n}'/>" * 10 + "</g>" for n in range(9)]
    return f"<defs><g id='g0'><rect width='1' height='1'/></g>{''.join(levels)}</defs><use xlink:href='#g9'/>"


ENTITIES = "".join(f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
RAW = zlib.compress(bytes(101 * 100))
# Made when they are needed: every worker of the tests reads this file.
HOSTILE: dict[str, Callable[[], bytes]] = {
    "bomb.png": lambda: png(60_000, 60_000, zlib.compress(bytes(60_000_000), 9)),
    "giant.png": lambda: png(2**31 - 1, 2**31 - 1, b""),
    "nothing.png": lambda: png(0, 0, zlib.compress(b"")),
    "truncated.png": lambda: png(100, 100, RAW)[:60],
    "cut.png": lambda: png(100, 100, RAW)[:-30],
    "bomb.jpg": lambda: picture("jpeg", (20_000, 14_000)),
    "truncated.jpg": lambda: picture("jpeg")[:300],
    "head.jpg": lambda: b"\xff\xd8\xff\xe0" + bytes(100),
    "bomb.tif": lambda: picture("tiff", (20_000, 14_000), compression="tiff_adobe_deflate"),
    "truncated.tif": lambda: picture("tiff")[:60],
    "empty.jpg": lambda: b"",
    "text.png": lambda: b"this is no picture",
    "gif.png": lambda: picture("gif"),
    "plain svg.png": lambda: svg("<rect width='50' height='50'/>"),
    "svg of a file.png": lambda: svg("<image xlink:href='file:///etc/passwd' width='50' height='50'/>"),
    "svg of an address.png": lambda: svg("<image xlink:href='http://192.0.2.1/x.png' width='50' height='50'/>"),
    "svg without end.png": lambda: svg(repeated()),
    "svg of entities.png": lambda: svg("<text>&i;</text>", f"<!DOCTYPE s [<!ENTITY a 'aaaaaaaaaa'>{ENTITIES}]>"),
    "packed svg.svgz": lambda: gzip.compress(svg("<rect width='50' height='50'/>") + b" " * 20_000_000),
    "program.xpm": lambda: b'/* XPM */\nstatic char*x[]={"1 1 1 1","a c red","a"};\n',
}
HARMLESS: dict[str, Callable[[], bytes]] = {
    "right.png": lambda: png(64, 48, zlib.compress(bytes(65 * 48))),
    "a jpeg.png": lambda: picture("jpeg"),
    "grey.tif": lambda: picture("tiff"),
    "dots.bmp": lambda: picture("bmp"),
    "text bomb.png": lambda: png(
        64, 48, zlib.compress(bytes(65 * 48)), chunk(b"zTXt", b"a\0\0" + zlib.compress(bytes(10**8)))
    ),
    "huge exif.jpg": lambda: picture("jpeg").replace(
        b"\xff\xd8", b"\xff\xd8" + 200 * (b"\xff\xe1\xff\xffExif\0\0" + bytes(65527)), 1
    ),
}
REFUSED = "is not a picture|larger than|unsupported format|cannot be decoded"
SHORT = 500 << 20  # what decoding may take beyond the program itself: 256 MB of pixels, and the same as a pixmap


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of all these files."""
    folder = tmp_path_factory.mktemp("pictures")
    for name, content in (HOSTILE | HARMLESS).items():
        (folder / name).write_bytes(content())
    return folder


@pytest.mark.fault(52, how="pictures that are bombs, torn, of other kinds, drawings that name files", times=20)
@pytest.mark.parametrize("name", sorted(HOSTILE))
def test_hostile_picture_is_refused(pictures: Path, qtbot: object, name: str) -> None:
    """The photograph panel raises the error and keeps its picture."""
    parent = QWidget()
    panel = PhotographPanel(parent, cast("Any", None), cast("Any", None))
    before = panel.state
    with pytest.raises(RequestError, match=REFUSED) as refusal:
        panel.load(pictures / name)
    assert refusal.value.remedy
    assert panel.state is before
    parent.deleteLater()


@pytest.mark.parametrize("name", sorted(HARMLESS))
def test_picture_is_recognised_by_its_content(pictures: Path, qtbot: object, name: str) -> None:
    """Wrong suffixes and giant comments are accepted."""
    shown = read_picture(pictures / name)
    assert (shown.width(), shown.height()) == (64, 48)


def test_picture_is_rotated_by_its_orientation(tmp_path: Path, qtbot: object) -> None:
    """Orientation 6: rotated by 90 degrees."""
    turned = Image.Exif()
    turned[0x112] = 6
    (tmp_path / "a.jpg").write_bytes(picture("jpeg", exif=turned))
    assert (read_picture(tmp_path / "a.jpg").width(), read_picture(tmp_path / "a.jpg").height()) == (48, 64)


@pytest.mark.skipif(sys.platform == "win32", reason="pipes and devices with names")
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "missing", "hole"])
def test_pipe_or_device_is_not_opened_as_a_picture(tmp_path: Path, qtbot: object, kind: str) -> None:
    """Reading a pipe would wait, reading a device would not end."""
    path = tmp_path / "a.png"
    match kind:
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "folder":
            path.mkdir()
        case "hole":
            path.write_bytes(HARMLESS["right.png"]()[:33])
            os.truncate(path, FILE_BYTES_MAX + 1)
    with pytest.raises(RequestError, match=REFUSED):
        read_picture(path)


BOUNDED = """
import os, resource, sys
from pathlib import Path
from PySide6.QtWidgets import QApplication
from boat_daq.gui.live.photograph_panel import read_picture
application = QApplication([])
pages = int(Path("/proc/self/statm").read_text().split()[0])
limit = pages * resource.getpagesize() + int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
for path in sorted(Path(sys.argv[1]).iterdir()):
    try:
        print(path.name, "TAKEN", read_picture(path).width())
    except Exception as error:
        if not getattr(error, "cause", ""):
            print(path.name, "TRACEBACK", repr(error))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS is Linux's")
def test_hostile_pictures_take_bounded_memory(pictures: Path) -> None:
    """All of them in one process that may use 500 MB and one minute beyond the program itself."""
    command = [sys.executable, "-c", BOUNDED, str(pictures), str(SHORT)]
    env = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=env, timeout=200)
    assert done.returncode == 0, done.stderr[-2000:]
    assert sorted(line.split(" TAKEN ")[0] for line in done.stdout.splitlines()) == sorted(HARMLESS)
