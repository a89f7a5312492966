"""Elongation from marks in rendered pictures, against the elongation that they were rendered with."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from analysis.tracking.lens import Picture
from analysis.tracking.marks import Mark, PictureFault
from analysis.tracking.tracker import (
    LEARNED_PICTURES,
    MarkTracker,
    Optics,
    Plane,
    Tracked,
    grid_ratio,
    similarity,
    square,
)
from boat_daq.engine.simulator.picture import FAULTLESS, CameraScene, Disturbance, Renderer
from protocol.base.errors import DataError
from tests.analysis.tracking.filmed_run import SMALL

Draw = Callable[..., Picture]


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    """Return a camera of few pixels, so that a picture is drawn in a few milliseconds."""
    return Renderer(SMALL)


@pytest.fixture(scope="module")
def learned(renderer: Renderer) -> MarkTracker:
    """Return a tracker that knows the plane of the marks."""
    tracker = MarkTracker(Optics(SMALL.mark_mm))
    read(tracker, renderer, np.zeros(LEARNED_PICTURES))
    assert tracker.plane is not None
    return tracker


def read(
    tracker: MarkTracker, renderer: Renderer, true_mm: Iterable[float], wrong: Disturbance = FAULTLESS, first: int = 0
) -> list[Tracked]:
    """Return the readings of pictures at 30 Hz."""
    found = []
    for n, x in enumerate(true_mm, first):
        picture = renderer.frame(n, np.array([x]), n / 30, wrong)
        found.append(tracker.read(picture, n / 30))
    return found


def fresh(learned: MarkTracker) -> MarkTracker:
    """Return a tracker with the plane of another one."""
    tracker = MarkTracker(learned.optics)
    tracker.plane, tracker.grid = learned.plane, learned.grid
    return tracker


def test_elongation_is_that_of_the_picture_within_its_uncertainty(renderer: Renderer, learned: MarkTracker) -> None:
    """To a tenth of a pixel of 0.1 mm everywhere in the travel; the stated uncertainty covers it."""
    true = np.linspace(-2.7, 3.8, 12)
    found = [read(fresh(learned), renderer, [x], first=100 + n)[0] for n, x in enumerate(true)]
    error = np.array([one.elongation_mm for one in found]) - true
    assert float(np.sqrt((error**2).mean())) < 0.005
    assert all(abs(e) < 3 * one.u_mm for e, one in zip(error, found, strict=True))


@pytest.mark.parametrize(("base_px", "tip_px"), [(0.3, 0.0), (0.0, 0.3)])
def test_uncertainty_is_the_scatter_of_readings(base_px: float, tip_px: float) -> None:
    """Corners that scatter, of one mark alone: 2000 readings scatter as they state."""
    tracker = MarkTracker(Optics(10.0))
    tip_mm = np.array([0.0, 5.0])
    tracker.plane = Plane(np.diag([0.1, 0.1, 1.0]), tip_mm, np.array([0.0, 1.0]), 0.1, 0.0)
    tracker._size = 1.0
    rng, found = np.random.default_rng(0), []
    for _ in range(2000):
        marks = []
        for corners, sd in ((square(10.0), base_px), (square(10.0) + tip_mm, tip_px)):
            corners_px = corners * 10.0 + rng.normal(0.0, sd, (4, 2)) if sd else corners * 10.0
            marks.append(Mark(corners_px, corners_px, 0.0, 1.0))
        found.append(tracker._elongation(marks[0], marks[1], 0.0))
    stated = np.sqrt(np.mean([one.u_mm**2 for one in found]))
    assert np.std([one.elongation_mm for one in found]) == pytest.approx(stated, rel=0.06)


def test_similarity_leaves_what_no_turn_explains() -> None:
    """Of a square: a corner that moved alone, by least squares; a turned one twice as large, nothing."""
    points = square(10.0)
    turned = points @ np.array([[0.0, 2.0], [-2.0, 0.0]]) + 3.0
    assert similarity(points, turned)[2] == pytest.approx(0.0, abs=1e-9)
    z = points @ np.array([1.0, 1.0j])
    moved = points + np.array([[0.4, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    design = np.column_stack([z, np.ones(4)])
    left = np.linalg.lstsq(design, moved @ np.array([1.0, 1.0j]), rcond=None)[1][0]
    assert similarity(points, moved)[2] == pytest.approx(np.sqrt(left / 4.0))


def test_scale_and_its_uncertainty_are_those_of_the_marks(renderer: Renderer, learned: MarkTracker) -> None:
    """The default side is known to 0.02 mm; without a calibrated lens the scale to 0.2 %."""
    plane = learned.plane
    assert plane is not None
    assert plane.mm_per_px == pytest.approx(1.0 / SMALL.px_per_mm, rel=5e-3)
    assert np.hypot(0.02 / SMALL.mark_mm, 0.002) <= plane.u_scale < 1.5 * np.hypot(0.02 / SMALL.mark_mm, 0.002)


def test_a_shaken_camera_cancels(renderer: Renderer, learned: MarkTracker) -> None:
    """A shift of the whole picture by some pixels leaves the elongation as it is."""
    (still,) = read(fresh(learned), renderer, [1.0], first=200)
    (shaken,) = read(fresh(learned), renderer, [1.0], Disturbance(shift_px=(4.3, -2.6)), first=200)
    assert shaken.elongation_mm == pytest.approx(still.elongation_mm, abs=0.006)


def test_tilt_is_corrected_and_the_grid_confirms_the_marks() -> None:
    """At 6 degrees the scale changes by 5 % over the picture; without correction 3.8 mm would be 0.1 mm off."""
    tilted = Renderer(replace(SMALL, tilt_deg=6.0))
    tracker = MarkTracker(Optics(SMALL.mark_mm))
    read(tracker, tilted, np.zeros(LEARNED_PICTURES))
    found = read(tracker, tilted, np.arange(0.4, 3.9, 0.4), first=50)
    assert found[-1].elongation_mm == pytest.approx(3.6, abs=0.015)
    assert tracker.grid == pytest.approx(1.0, abs=0.003)


def test_scale_from_the_grid_alone() -> None:
    """Without a stated side the millimetre grid gives it."""
    tracker = MarkTracker(Optics(0.0))
    read(tracker, Renderer(SMALL), np.zeros(LEARNED_PICTURES))
    assert tracker.side_mm == pytest.approx(SMALL.mark_mm, rel=0.002)


def test_grid_is_read_along_both_axes() -> None:
    """Lines 1 mm apart in x and 1.08 mm apart in y, in a picture of 15 px/mm: the mean of both."""
    x, y = np.meshgrid(np.arange(900) / 15.0, np.arange(600) / 15.0)
    grey = np.where((x % 1.0 < 0.15) | (y % 1.08 < 0.15), 90, 210).astype(np.uint8)
    to_mm = np.array([[1 / 15, 0.0, -20.0], [0.0, 1 / 15, -20.0], [0.0, 0.0, 1.0]])
    plane = Plane(to_mm, np.array([15.0, 0.0]), np.array([1.0, 0.0]), 1 / 15, 0.0)
    assert grid_ratio(grey, plane, 4.0) == pytest.approx((1.0 + 1 / 1.08) / 2, abs=0.003)


def test_marks_that_contradict_the_grid_are_refused(renderer: Renderer) -> None:
    """10 mm are stated, the grid shows 8: cause and remedy."""
    tracker = MarkTracker(Optics(10.0))
    pictures = [renderer.frame(n, np.zeros(1), 0.0) for n in range(LEARNED_PICTURES)]
    with pytest.raises(
        DataError, match=r"8\.0\d mm by the millimetre grid in the picture, 10 mm are stated"
    ) as refusal:
        for n, picture in enumerate(pictures):
            tracker.read_checked(picture, n / 30)
    assert "black square" in refusal.value.remedy


FAULTS = {
    "covered": (Disturbance(covered=1.0), {PictureFault.LOST, PictureFault.LOW_CONTRAST}),
    "half": (Disturbance(covered=0.5), {PictureFault.COVERED, PictureFault.LOST, PictureFault.LOW_CONTRAST}),
    "base": (Disturbance(base_covered=1.0), {PictureFault.LOST, PictureFault.LOW_CONTRAST}),
    "swapped": (Disturbance(swapped=True), {PictureFault.MOVED}),
    "saturated": (Disturbance(gain=1.7), {PictureFault.SATURATED}),
    "dark": (Disturbance(gain=0.04), {PictureFault.LOST, PictureFault.LOW_CONTRAST}),
    "moved": (Disturbance(shift_px=(40.0, 10.0)), {PictureFault.MOVED, PictureFault.LOST}),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_picture_gives_no_value_and_the_reason(renderer: Renderer, learned: MarkTracker, name: str) -> None:
    """Never a wrong value, and the right value in the picture after it."""
    wrong, reasons = FAULTS[name]
    tracker = fresh(learned)
    read(tracker, renderer, [0.5], first=300)
    (faulty,) = read(tracker, renderer, [0.5], wrong, first=301)
    assert faulty.fault in reasons
    assert np.isnan(faulty.elongation_mm)
    (after,) = read(tracker, renderer, [0.5], first=302)
    assert after.elongation_mm == pytest.approx(0.5, abs=0.01)


def test_two_tips_give_no_value(renderer: Renderer) -> None:
    """Which of them belongs to the unit is not known."""
    scene = replace(SMALL, mark_mm=5.0, apart_mm=10.0)
    tracker = MarkTracker(Optics(5.0))
    (found,) = read(tracker, Renderer(scene), [0.0], Disturbance(second_tip=True))
    assert found.fault is PictureFault.AMBIGUOUS


def test_a_repeated_picture_gives_no_value_and_is_frozen_after_half_a_second(
    renderer: Renderer, learned: MarkTracker
) -> None:
    """Noise differs in every new picture."""
    tracker = fresh(learned)
    picture = renderer.frame(400, np.array([0.5]), 0.0)
    faults = [tracker.read(picture, n / 30).fault for n in range(20)]
    assert faults[0] is None
    assert set(faults[1:10]) == {PictureFault.REPEATED}
    assert faults[-1] is PictureFault.FROZEN


def test_a_tip_that_jumps_gives_no_value(renderer: Renderer, learned: MarkTracker) -> None:
    """3 mm in one frame are 90 mm/s."""
    tracker = fresh(learned)
    found = read(tracker, renderer, [0.0, 3.0], first=500)
    assert found[1].fault is PictureFault.JUMPED


def test_a_picture_without_marks_gives_no_value() -> None:
    """A blank picture, in grey and in colour."""
    tracker = MarkTracker(Optics())
    rng = np.random.default_rng(0)
    for n, shape in enumerate([(240, 320), (240, 320, 3)]):
        picture = rng.integers(100, 110, shape, np.uint8)
        assert tracker.read(picture, float(n)).fault is PictureFault.LOST


@pytest.mark.nightly
def test_default_camera_reads_within_a_hundredth_of_a_millimetre() -> None:
    """640 x 480 at 20 px/mm with default noise: 0.01 mm rms, the figure of the method."""
    scene = CameraScene()
    renderer, tracker = Renderer(scene), MarkTracker(Optics(scene.mark_mm))
    true = np.concatenate([np.zeros(LEARNED_PICTURES), np.linspace(0, 3.8, 60), np.linspace(3.8, -2.7, 90)])
    found = read(tracker, renderer, true)
    error = np.array([one.elongation_mm - x for one, x in zip(found, true, strict=True) if one.fault is None])
    assert error.size > 140
    assert float(np.sqrt((error**2).mean())) < 0.01


@pytest.mark.parametrize("px_per_mm", [5.0, 6.1])
def test_small_marks_are_measured_without_bias(px_per_mm: float) -> None:
    """Marks of 40 and 49 px: the profiles are shorter, whatever fraction of a pixel they would end at."""
    scene = replace(SMALL, width=200, height=100, px_per_mm=px_per_mm)
    renderer, tracker = Renderer(scene), MarkTracker(Optics(scene.mark_mm))
    read(tracker, renderer, np.zeros(LEARNED_PICTURES))
    true = np.arange(0.0, 1.2, 0.3)
    found = read(tracker, renderer, true, first=LEARNED_PICTURES)
    assert [one.elongation_mm for one in found] == pytest.approx(true.tolist(), abs=0.012)


def test_marks_that_are_too_small_give_no_value() -> None:
    """Below five pixels a module."""
    scene = replace(SMALL, px_per_mm=10.0, mark_mm=2.8, apart_mm=8.0)
    tracker = MarkTracker(Optics(2.8))
    (found,) = read(tracker, Renderer(scene), [0.0])
    assert found.fault in (PictureFault.TOO_SMALL, PictureFault.LOST)
