"""Elongation from textured patches, against the elongation that the pictures were rendered with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import DataError, RequestError
from analysis.tracking.marks import PictureFault
from analysis.tracking.patches import Patch, PatchTracker
from boat_daq.engine.simulator.picture import Disturbance, Renderer
from tests.analysis.tracking.filmed_run import SMALL

BASE, TIP = Patch(35, 75, 90, 90), Patch(177, 75, 90, 90)


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    """Return a camera that sees a texture on base and tip."""
    return Renderer(replace(SMALL, texture=True))


def test_patches_follow_the_elongation_with_the_scale_of_the_grid(renderer: Renderer) -> None:
    """Within 5 um over 3 mm."""
    tracker = PatchTracker(BASE, TIP)
    true = np.concatenate([[0.0], np.linspace(0.0, 3.0, 9)])
    found = [tracker.read_checked(renderer.frame(n, np.array([x]), n / 30), n / 30) for n, x in enumerate(true)]
    error = np.array([one.elongation_mm for one in found]) - true
    assert float(abs(error).max()) < 0.008
    assert all(abs(e) < 3 * one.u_mm for e, one in zip(error, found, strict=True))


def test_a_covered_patch_gives_no_value(renderer: Renderer) -> None:
    """The correlation is too low."""
    tracker = PatchTracker(BASE, TIP, mm_per_px=0.1)
    tracker.read_checked(renderer.frame(0, np.zeros(1), 0.0), 0.0)
    found = tracker.read_checked(renderer.frame(1, np.zeros(1), 0.03, Disturbance(covered=0.6)), 0.03)
    assert found.fault in (PictureFault.COVERED, PictureFault.LOST, PictureFault.JUMPED)


def test_unusable_patches_are_refused(renderer: Renderer) -> None:
    """Too small, outside the picture, or without texture."""
    blank = np.full((240, 320), 128, np.uint8)
    with pytest.raises(RequestError, match="smaller than 16 px"):
        PatchTracker(Patch(0, 0, 4, 4), TIP)
    with pytest.raises(RequestError, match="outside the picture"):
        PatchTracker(Patch(300, 75, 90, 90), TIP).read_checked(blank, 0.0)
    with pytest.raises(DataError, match="no texture"):
        PatchTracker(BASE, TIP).read_checked(blank, 0.0)
