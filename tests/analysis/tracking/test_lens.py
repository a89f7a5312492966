"""A lens from pictures of a checkerboard, against the lens that they were rendered with."""

from __future__ import annotations

import struct
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from analysis.tracking.lens import Lens, Picture, calibrate_lens, lens_of, read_lens
from analysis.tracking.marks import homography, project
from analysis.tracking.tracker import UNKNOWN_LENS, Optics, learn_plane, square
from protocol.base.errors import DataError, FileError, RequestError
from tests.analysis.tracking.filmed_run import SMALL
from tests.boat_daq.engine.simulator.checkerboard import checkerboard

BENT = replace(SMALL, distortion=-0.12)
LENS = Lens(((500.0, 0.0, 160.0), (0.0, 500.0, 120.0), (0.0, 0.0, 1.0)), (-0.1, 0.0, 0.0, 0.0, 0.0), (320, 240), 0.1, 6)


def test_calibration_finds_the_distortion() -> None:
    """The corrected points of a bent picture are those of an ideal one to a few hundredths of a pixel."""
    pictures = [checkerboard(BENT, tilt, pitch_mm=3.0) for tilt in (-25.0, -12.0, 0.0, 10.0, 18.0, 28.0)]
    lens = calibrate_lens(pictures, corners=(8, 6), pitch_mm=3.0)
    assert lens.views >= 5
    assert lens.reprojection_px < 0.1
    matrix = BENT.matrix
    ideal = np.array([[60.0, 40.0], [160.0, 60.0], [260.0, 190.0]])
    rays = (ideal - matrix[:2, 2]) / matrix[0, 0]
    bent = rays * (1 - 0.12 * (rays**2).sum(axis=1, keepdims=True)) * matrix[0, 0] + matrix[:2, 2]
    straight = lens.undistorted(bent)
    span = np.linalg.norm(straight[2] - straight[0]) / np.linalg.norm(ideal[2] - ideal[0])
    middle = np.linalg.norm(straight[1] - straight[0]) / np.linalg.norm(ideal[1] - ideal[0])
    assert middle / span == pytest.approx(1.0, abs=1e-3)


def u_scale(lens: Lens | None, u_mark_mm: float) -> float:
    """Return the relative uncertainty of lengths in a plane that four exact marks of 10 mm show."""
    to_px = homography(square(10.0), np.array([[50.0, 60.0], [150.0, 62.0], [149.0, 160.0], [52.0, 161.0]]))
    base = project(to_px, square(10.0))
    tips = [project(to_px, square(10.0) + np.array([20.0 + x, 1.0])) for x in range(4)]
    return learn_plane(np.array([base] * 4), np.array(tips), 10.0, Optics(10.0, u_mark_mm, lens)).u_scale


def test_lens_and_mark_are_in_the_uncertainty_of_lengths() -> None:
    """The root of the sum of squares: of the mark's side, and of the lens by its own residuals, or 0.2 % unknown."""
    assert u_scale(None, 0.0) == pytest.approx(UNKNOWN_LENS, rel=1e-3)
    assert u_scale(None, 0.02) == pytest.approx(np.hypot(UNKNOWN_LENS, 0.002), rel=1e-3)
    of_lens = 4 * 0.1 / np.sqrt(6) / 320  # four times the residual of the mean view, over the picture's width
    assert u_scale(LENS, 0.0) == pytest.approx(of_lens, rel=1e-3)
    assert u_scale(LENS, 0.02) == pytest.approx(np.hypot(of_lens, 0.002), rel=1e-3)


def photograph(tilt_deg: tuple[float, float], *, width: int, height: int, focal_px: float) -> Picture:
    """Return a checkerboard of 9 x 7 squares as an ideal pinhole camera sees it, 20 squares away."""
    side = 100
    board = np.full((9 * side, 11 * side), 255, np.uint8)  # with a white margin of one square
    squares = np.indices((7, 9)).sum(axis=0) % 2 * 255
    board[side:-side, side:-side] = np.kron(squares, np.ones((side, side))).astype(np.uint8)
    rotation, _ = cv2.Rodrigues(np.radians([*tilt_deg, 5.0]))
    camera = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1.0]])
    centred = np.array([[1 / side, 0, -5.5], [0, 1 / side, -4.5], [0, 0, 1.0]])  # board pixels to squares
    pose = np.column_stack([rotation[:, :2], [0.0, 0.0, 20.0]])
    seen = cv2.warpPerspective(board, camera @ pose @ centred, (width, height), borderValue=200)
    return np.asarray(cv2.GaussianBlur(seen, (0, 0), 1.5), np.uint8)


@pytest.mark.skipif(sys.platform != "linux", reason="the peak memory of another process")
@pytest.mark.skipif(sys.platform != "linux", reason="the peak memory of another process")
@pytest.mark.fault(63, how="six photographs of 40 megapixels as a phone takes them, and a bomb of 900", times=2)
def test_photographs_need_bounded_memory(tmp_path: Path) -> None:
    """Below 1 GB and 20 s, with the focal length that they were projected with; the bomb is refused within them."""
    for number, tilt in enumerate([(-25.0, 5.0), (-12.0, 20.0), (0.0, -20.0), (10.0, 0.0), (18.0, -8.0), (28.0, 12.0)]):
        picture = cv2.resize(photograph(tilt, width=3650, height=2740, focal_px=4250.0), (7300, 5480))
        cv2.imwrite(str(tmp_path / f"{number}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 92])
    side = 30_000
    head, data = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0), zlib.compress(bytes(side * (side // 8 + 1)), 1)
    chunks = [(b"IHDR", head), (b"IDAT", data), (b"IEND", b"")]
    content = [struct.pack(">I", len(c)) + k + c + struct.pack(">I", zlib.crc32(k + c)) for k, c in chunks]
    (tmp_path / "bomb.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(content))
    program = """
import resource, sys
from pathlib import Path
from boat_daq.cli import main
from boat_daq.engine.camera.source import read_picture
sys.argv = ["boat-daq", "camera", "calibrate", *sys.argv[1:], "--out", "lens.json"]
try:
    main()
finally:
    try:
        read_picture(Path("bomb.png"))
    except Exception as error:
        print(getattr(error, "cause", repr(error)), file=sys.stderr)
    used = resource.getrusage(resource.RUSAGE_SELF)
    peak = open("/proc/self/status").read().split("VmHWM:")[1].split()[0]  # since it was started
    print(peak, used.ru_utime + used.ru_stime, file=sys.stderr)
"""
    command = [sys.executable, "-c", program, *sorted(map(str, tmp_path.glob("*.jpg")))]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    *_, refusal, used = ended.stderr.splitlines()
    assert refusal == "bomb.png is not a picture, or has more than 50 megapixels"
    peak_kb, seconds = map(float, used.split())
    assert peak_kb < 1_000_000
    assert seconds < 20
    lens = read_lens(tmp_path / "lens.json")
    assert lens.views == 6
    assert lens.matrix[0][0] == pytest.approx(8500.0, rel=2e-3)
    assert lens.reprojection_px < 0.3


def test_a_lens_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Through its file."""
    LENS.write(tmp_path / "lens.json")
    assert read_lens(tmp_path / "lens.json") == LENS


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"matrix": 1}', "[" * 5000, '{"matrix": "NaN"}'])
def test_a_file_that_is_no_lens_is_refused(tmp_path: Path, text: str) -> None:
    """Cause and remedy, for any content."""
    path = tmp_path / "lens.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match="is not a lens"):
        read_lens(path)


def test_impossible_numbers_of_a_lens_are_refused() -> None:
    """A focal length of 0."""
    with pytest.raises(FileError, match="impossible"):
        lens_of(LENS.as_json() | {"matrix": np.zeros((3, 3)).tolist()}, "it")


def test_unusable_pictures_of_a_board_are_refused() -> None:
    """Too few boards, pictures of two sizes, an impossible board."""
    blank = np.full((60, 80), 200, np.uint8)
    with pytest.raises(DataError, match="found in 0 of 3 pictures"):
        calibrate_lens([blank] * 3, corners=(8, 6), pitch_mm=3.0)
    with pytest.raises(DataError, match="2 different sizes"):
        calibrate_lens([blank, blank[:50]], corners=(8, 6), pitch_mm=3.0)
    with pytest.raises(RequestError, match="checkerboard"):
        calibrate_lens([blank], corners=(2, 6), pitch_mm=3.0)
