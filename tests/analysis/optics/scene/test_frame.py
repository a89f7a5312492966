"""Scenes that cannot be built are rejected by name."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.curves import (
    frame_of,
)
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import trace
from protocol.base.errors import DataError, RequestError


def bowed(bow: float, points: int = 7) -> np.ndarray:
    part = np.linspace(0, 1, points)
    x = bow * np.sin(np.pi * part)
    return np.array([[np.stack([-x, 75 * part], axis=1), np.stack([x, 75 * part], axis=1)]])


@pytest.mark.parametrize(
    ("bow", "thickness", "word"), [(0.5, 2.0, "touch"), (0.0, 2.0, "touch"), (12.5, 30.0, "touch|thick")]
)
def test_guides_that_touch_are_refused(bow: float, thickness: float, word: str) -> None:
    """Guides closer than their thickness are refused, the state is named and there is a remedy."""
    with pytest.raises(DataError, match=word) as refused:
        frame_of(bowed(bow), 0, Waveguide(thickness_mm=thickness))
    assert "state 0" in refused.value.cause
    assert refused.value.remedy


def test_guides_that_cross_are_named_as_such() -> None:
    """They share their ends: the remedy was to let them do so."""
    part = np.linspace(0, 1, 9)
    x = 10.0 * np.sin(2.0 * np.pi * part)
    curves = np.array([[np.stack([side * x, 75 * part], axis=1) for side in (1.0, -1.0)]])
    with pytest.raises(DataError, match="guides cross"):
        frame_of(curves, 0, Waveguide())


def test_a_bend_tighter_than_the_guide_is_refused() -> None:
    """Where an edge would fold over, the radius is named."""
    curves = bowed(12.5, 15)
    curves[0, 1, 7, 0] += 6.0
    with pytest.raises(DataError, match="radius"):
        frame_of(curves, 0, Waveguide(thickness_mm=6.0))


@pytest.mark.fault(45, how="cavities through the guide, or longer than it", times=3)
@pytest.mark.parametrize(
    ("design", "word"),
    [
        (Design(5, 1.0, 2.0, 0.9), "cuts through"),
        (Design(5, 1.0, 2.5, 0.9), "cuts through"),
        (Design(40, 1.0, 0.5, 1.0), "does not fit"),
    ],
)
def test_cavities_that_cannot_be_cut_are_refused(frames: list[SceneFrame], design: Design, word: str) -> None:
    """Through the guide, or longer than it: refused with cause and remedy."""
    with pytest.raises(RequestError, match=word) as refused:
        trace(frames[0], design, Waveguide(), Light())
    assert refused.value.remedy
