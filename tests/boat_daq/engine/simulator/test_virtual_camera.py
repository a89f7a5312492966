"""The virtual camera: its frames at board time, its faults by name and time, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.tracking.marks import find_marks, measure_mark
from boat_daq.engine.simulator.picture import CameraScene, Renderer
from boat_daq.engine.simulator.virtual_camera import CAMERA_FAULTS, VirtualCamera, parse_camera_fault, scene_of
from protocol.base.errors import RequestError
from protocol.simulator.board import VirtualBoard

SMALL = CameraScene(width=160, height=120, px_per_mm=5.0)


class Kept:
    """A sink that keeps the frames."""

    wanted = True

    def __init__(self) -> None:
        self.frames: list[np.ndarray | None] = []

    def frame(self, picture: np.ndarray | None, time_s: float) -> None:
        """Keep a frame."""
        self.frames.append(picture)

    def close(self) -> None:
        """Nothing to close."""


def film(*faults: str) -> list[np.ndarray | None]:
    """Return the frames of half a second of a board at rest."""
    board, kept = VirtualBoard(log_elongation=True), Kept()
    camera = VirtualCamera(SMALL, kept, [parse_camera_fault(text) for text in faults], newest_only=False)
    for _ in range(5):
        board.advance(100_000)
        camera.take(*board.take_elongation())
    camera.close()
    return kept.frames


def test_a_frame_every_thirtieth_of_a_second_of_board_time() -> None:
    """However the board is advanced; the same seed gives the same pictures."""
    first, second = film(), film()
    assert len(first) == 15
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_faults_act_at_their_times() -> None:
    """Dropped frames are missing, frozen ones repeat the one before."""
    frames = film("dropped@0.1:0.1", "frozen@0.3:0.1")
    assert [n for n, frame in enumerate(frames) if frame is None] == [3, 4, 5]
    assert np.array_equal(frames[9], frames[8])
    assert not np.array_equal(frames[7], frames[8])


def test_every_fault_has_a_name_and_a_sentence() -> None:
    """Each is accepted with its time."""
    for name, (sentence, _) in CAMERA_FAULTS.items():
        assert sentence.endswith(".")
        assert parse_camera_fault(f"{name}@2:3").seconds == 3.0


def test_marks_are_where_the_elongation_puts_them() -> None:
    """1 mm is 10 px, from below a hundredth of a pixel."""
    scene = CameraScene(width=320, height=240, px_per_mm=10.0, noise_grey=0.0)
    renderer = Renderer(scene)
    places = []
    for x in (0.0, 1.0):
        picture = renderer.frame(0, np.array([x]), 0.0)
        mark = measure_mark(picture, 1, find_marks(picture)[1][0])
        places.append(mark.corners_px.mean(axis=0))
    assert places[1] - places[0] == pytest.approx([10.0, 0.0], abs=0.02)


@pytest.mark.parametrize("text", ["nonsense@1", "covered@x", "covered@1:0", "covered@-1"])
def test_an_impossible_fault_is_refused(text: str) -> None:
    """Name and times."""
    with pytest.raises(RequestError, match=r"there is no fault|no usable times"):
        parse_camera_fault(text)


@pytest.mark.parametrize(
    "values", [{"colour": "1"}, {"width": "x"}, {"width": "1"}, {"mark_mm": "0"}, {"width": "inf"}]
)
def test_an_impossible_scene_is_refused(values: dict[str, str]) -> None:
    """Field, number, size."""
    with pytest.raises(RequestError):
        scene_of(values)


def test_a_stream_leaves_out_what_is_late() -> None:
    """What has passed while a frame was drawn is taken at once: the newest frame is no older than the present."""
    board, kept = VirtualBoard(log_elongation=True), Kept()
    camera = VirtualCamera(SMALL, kept, [], newest_only=True)
    for _ in range(40):
        board.advance(500_000)
        camera.take(*board.take_elongation())
    camera.close()
    assert 1 <= len(kept.frames) < 400  # of 600
