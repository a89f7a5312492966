"""Arc splines: exact circles, smooth joints, offsets that keep their distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.optics.scene.arc_spline import ArcSpline, biarcs, ring, smooth, straight
from analysis.optics.scene.frame import offset_of
from protocol.base.errors import DataError


def wave(bow: float) -> ArcSpline:
    z = np.linspace(0.0, 75.0, 7)
    return biarcs(*smooth(np.stack([bow * np.sin(np.pi * z / 75), z], axis=1)))


def test_biarcs_of_a_circle_are_that_circle() -> None:
    """Points and tangents taken from a circle give arcs of its curvature and its length."""
    angle = np.linspace(0.2, 1.7, 6)
    points = 40 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve = biarcs(points, np.stack([-np.sin(angle), np.cos(angle)], axis=1))
    np.testing.assert_allclose(curve.curvature, 1 / 40, rtol=1e-12)
    assert curve.length == pytest.approx(40 * 1.5, rel=1e-13)


def test_joints_share_point_and_tangent() -> None:
    """Each arc, run to its end by its own curvature, arrives at the next one's start with its tangent."""
    curve = wave(12.5)
    for i, k in enumerate(curve.curvature):
        alone = ArcSpline(np.array([curve.nodes[i], curve.nodes[i + 1]]), np.array([k]))
        point, tangent = alone.frame(np.array([curve.nodes[i + 1, 4] - 1e-13]))
        np.testing.assert_allclose(point[0], curve.nodes[i + 1, :2], atol=1e-11)
        np.testing.assert_allclose(tangent[0], curve.nodes[i + 1, 2:4], atol=1e-11)


def test_the_centreline_follows_the_sine_it_was_sampled_from() -> None:
    """Seven points of half a sine of 12.5 mm are met by the arcs to 0.02 mm everywhere."""
    curve = wave(12.5)
    point, _ = curve.frame(np.linspace(0, curve.length, 400))
    assert np.max(np.abs(point[:, 0] - 12.5 * np.sin(np.pi * point[:, 1] / 75))) < 0.02


@given(u=st.floats(-2.0, 2.0), part=st.floats(0.01, 0.99), bow=st.floats(-15, 15))
def test_offsets_keep_their_distance(u: float, part: float, bow: float) -> None:
    """A point offset by u lies at distance u from the curve, its foot at the arc length it was offset from."""
    curve = wave(bow)
    s = np.array([part * curve.length])
    found, foot = offset_of(curve, curve.offset(s, u))
    assert found[0] == pytest.approx(u, abs=1e-11)
    assert foot[0] == pytest.approx(s[0], abs=1e-9)


def test_reversed_curve_has_opposite_tangents() -> None:
    """The reversed curve passes the same points with opposite tangents and curvature."""
    curve = wave(9.0)
    back = curve.reversed()
    s = np.linspace(0.5, curve.length - 0.5, 30)
    np.testing.assert_allclose(back.frame(curve.length - s)[0], curve.frame(s)[0], atol=1e-10)
    np.testing.assert_allclose(back.frame(curve.length - s)[1], -curve.frame(s)[1], atol=1e-10)


def test_straight_is_an_arc_without_curvature() -> None:
    """A line's curvature is zero to the last bit, and its offset is parallel."""
    line = straight((1.0, 2.0), (4.0, 6.0))
    assert line.curvature[0] == 0.0
    assert line.length == pytest.approx(5.0, rel=1e-15)
    np.testing.assert_allclose(line.offset(np.array([5.0]), 1.0)[0], [4 - 0.8, 6 + 0.6], atol=1e-14)


def test_ring_is_exact() -> None:
    """A quarter ring's end lies on the y axis."""
    np.testing.assert_allclose(ring(30.0, np.pi / 2, 3).nodes[-1, :2], [0, 30], atol=1e-14)


def test_repeated_points_and_turning_back_are_refused() -> None:
    """A guide whose points repeat or double back is refused with a remedy."""
    z = np.array([0.0, 10, 20, 20, 40, 50, 60])
    with pytest.raises(DataError, match="coincide") as repeated:
        smooth(np.stack([0 * z, z], axis=1))
    assert repeated.value.remedy
    with pytest.raises(DataError, match="doubles back"):
        biarcs(np.array([[0.0, 0], [1, 0]]), np.array([[-1.0, 0], [1, 0]]))
