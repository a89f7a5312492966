"""Curves of the guides: both sets, checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import analysis.optics.scene as package
from analysis.optics.scene.curve_file import read_curves
from analysis.optics.scene.curves import (
    checked_curves,
    default_curves,
    elongations,
    frame_of,
    frames_of,
    parametric_elongations,
)
from analysis.optics.scene.frame import SceneFrame, check_design
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import trace
from protocol.base.errors import BoatDaqError, DataError


def bowed(bow: float, points: int = 7) -> np.ndarray:
    part = np.linspace(0, 1, points)
    x = bow * np.sin(np.pi * part)
    return np.array([[np.stack([-x, 75 * part], axis=1), np.stack([x, 75 * part], axis=1)]])


def test_parametric_states_span_the_papers_range(curves: np.ndarray) -> None:
    """15 states from -2.7 to +3.8 mm, state 7 at rest, straighter in compression and more bent in elongation."""
    np.testing.assert_allclose(parametric_elongations()[[0, 7, 14]], [-2.7, 0.0, 3.8])
    np.testing.assert_allclose(np.ptp(curves[:, 0, :, 1], axis=1), 75 + parametric_elongations())
    assert np.all(np.diff(np.ptp(curves[:, 0, :, 0], axis=1)) > 0)


def test_default_states_are_the_shadows() -> None:
    """The packaged file is read as any curve file; its ends lie apart by the elongation more than at rest."""
    curves = default_curves()
    np.testing.assert_array_equal(read_curves(Path(package.__file__).with_name("shadow_states.csv")), curves)
    np.testing.assert_allclose(elongations()[[0, 7, 14]], [-2.7, 0.0, 3.8], atol=1e-3)
    length = np.ptp(curves[:, 0, :, 1], axis=1)
    np.testing.assert_allclose(length - length[7], elongations(), atol=1e-6)
    np.testing.assert_allclose(curves[:, 1, :, 0], -curves[:, 0, :, 0], atol=1e-8)
    curves[:] = 0.0
    assert default_curves().any()


def test_guides_that_end_apart_get_a_junction(curves: np.ndarray) -> None:
    """Tracked points that stop 10 mm off the axis are joined by a junction outside them, and light comes through."""
    apart = bowed(5.0) + np.array([[[-5.0, 0.0]], [[5.0, 0.0]]])
    frame = frame_of(apart, 0, Waveguide())
    assert frame.nodes[0, 0, 1] < 0 < 75 < frame.nodes[0, -1, 1]
    np.testing.assert_allclose(frame.nodes[0, 0, :2], frame.nodes[1, 0, :2])
    assert trace(frame, Design(), Waveguide(), Light()).ndr > 10


def test_any_direction_and_order_of_the_guides_is_one_scene(curves: np.ndarray) -> None:
    """Guides exchanged, or one of them listed backwards, give the same frame."""
    straight_on = frame_of(curves, 3, Waveguide())
    for other in (curves[:, ::-1], np.stack([curves[:, 0], curves[:, 1, ::-1]], axis=1)):
        np.testing.assert_allclose(frame_of(other, 3, Waveguide()).nodes, straight_on.nodes, atol=1e-9)


@pytest.mark.parametrize("shape", [(15, 2, 6, 2), (14, 2, 7, 2), (15, 1, 7, 2), (15, 2, 7, 3), (7, 2)])
def test_curves_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    """The reader of curves names what it requires."""
    with pytest.raises(BoatDaqError) as refused:
        checked_curves(np.ones(shape))
    assert refused.value.remedy


def test_curves_in_metres_or_with_holes_are_refused(curves: np.ndarray) -> None:
    """A size that no actuator has, and a missing number, are rejected."""
    with pytest.raises(DataError, match="mm"):
        checked_curves(curves / 1000)
    broken = curves.copy()
    broken[4, 1, 2, 0] = np.nan
    with pytest.raises(DataError, match="state 4, guide 2"):
        checked_curves(broken)


def test_all_default_states_are_built(frames: list[SceneFrame]) -> None:
    """Each of the 15 states of both sets has space for the longest row of the paper's grid."""
    assert len(frames) == 15
    for frame in [*frames, *frames_of(default_curves(), Waveguide(thickness_mm=2.5))]:
        check_design(frame, Design(7, 1.0, 1.0, 1.0), "a state")
    assert len(frames_of(default_curves(), Waveguide(thickness_mm=1.5))) == 15
