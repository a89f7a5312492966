"""Rays against closed forms: straight guides, rings, Fresnel, reversal; and where a ray tracer breaks."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.optics.scene.arc_spline import ArcSpline, ring, straight
from analysis.optics.scene.curves import frame_of
from analysis.optics.scene.frame import JUNCTION_END, SceneFrame, one_strip
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import TraceResult, ray_paths, trace
from analysis.optics.tracer.tracer import reflected_part

PLAIN = Design(cavities=0)


def strip(curve: ArcSpline, guide: Waveguide, light: Light) -> TraceResult:
    return trace(one_strip(curve, guide), PLAIN, guide, light)


def test_straight_guide_meets_its_closed_form() -> None:
    """Inside the critical angle every ray arrives after round((x tan a) / t) bounces: counted exactly, ray by ray."""
    guide, light = Waveguide(thickness_mm=2.0), Light(rays=400, cone_deg=80.0, secondary=0)
    out = strip(straight((0, 0), (80, 0)), guide, light)
    angle = np.radians(80) * ((np.arange(400) + 0.5) / 400 - 0.5)
    bounces = np.floor((80 - 0.1) * np.tan(np.abs(angle)) / 2.0 + 0.5)
    assert out.ledger["detected"] == 400
    assert out.hits == int(np.sum(bounces)) + 400
    assert out.power == pytest.approx(1.0, abs=1e-13)


def test_straight_guide_loses_rays_beyond_the_critical_angle() -> None:
    """Beyond the critical angle a ray refracts out at once; with a full fan the detected part is the guided one."""
    guide = Waveguide()
    out = strip(straight((0, 0), (60, 0)), guide, Light(rays=3600, cone_deg=120.0, secondary=0))
    guided = 90 - math.degrees(math.asin(1 / guide.index))
    angle = 120 * ((np.arange(3600) + 0.5) / 3600 - 0.5)
    assert out.ledger["detected"] == int(np.sum(np.abs(angle) < guided))
    assert out.ledger["escaped"] == 3600 - out.ledger["detected"]


def test_the_path_cap_tallies_what_it_ends() -> None:
    """In a guide longer than the cap every guided ray is tallied as trapped, its power as cut."""
    out = strip(straight((0, 0), (80, 0)), Waveguide(), Light(rays=200, cone_deg=80.0, secondary=0, path_cap_mm=60.0))
    assert out.ledger["trapped"] == 200
    assert out.energy["cut"] == pytest.approx(1.0, abs=1e-13)


def test_rays_that_can_never_leave_end_at_the_cap(curves: np.ndarray) -> None:
    """Without a receiver a junction's stem sends light back and forth; what never leaves is tallied, not followed for
    ever.
    """
    guide = Waveguide(index=1.9, receiver_mm=0.0)
    out = trace(frame_of(curves, 7, guide), Design(cavities=0), guide, Light(rays=500, secondary=0))
    assert out.ledger["detected"] == 0
    assert out.ledger["trapped"] > 0
    assert sum(out.ledger.values()) == 2 * out.ledger["released"]


def test_a_ring_keeps_every_rays_distance_from_its_centre() -> None:
    """In a ring total reflection keeps angular momentum: each chord passes the centre at the first one's distance."""
    guide = Waveguide(thickness_mm=2.0)
    frame = one_strip(ring(50.0, math.pi / 2, 5), guide)
    for path in ray_paths(frame, PLAIN, guide, Light(rays=40, cone_deg=60.0, secondary=0)):
        step = np.diff(path.points, axis=0) / np.hypot(*np.diff(path.points, axis=0).T)[:, None]
        momentum = path.points[:-1, 0] * step[:, 1] - path.points[:-1, 1] * step[:, 0]
        np.testing.assert_allclose(momentum, momentum[0], rtol=1e-12)


def test_whispering_ray_stays_on_the_outer_wall() -> None:
    """A ray flatter than the bend's own angle never sees the inner wall; its hits are the arc over a chord's angle."""
    radius, angle = 50.0, 0.1
    guide = Waveguide(thickness_mm=2.0)
    outer = radius + 1.0
    start = np.array([outer - 1e-10, 0.0, -math.sin(angle), math.cos(angle)])
    frame = one_strip(ring(radius, math.pi / 2, 7), guide, start)
    path = ray_paths(frame, PLAIN, guide, Light(rays=1, cone_deg=0.001, secondary=0))[0]
    r = np.hypot(*path.points[1:-1].T)
    np.testing.assert_allclose(r, outer, rtol=1e-12)
    assert len(r) == int((math.pi / 2) / (2 * angle))
    np.testing.assert_allclose(np.hypot(*np.diff(path.points[1:-1], axis=0).T), 2 * outer * math.sin(angle), rtol=1e-8)


@pytest.mark.parametrize("index", [1.33, 1.5, 2.0])
def test_fresnel_at_the_known_angles(index: float) -> None:
    """Normal incidence gives ((n-1)/(n+1))^2; at Brewster's angle only half of the s part is left."""
    assert reflected_part.py_func(index, 1.0, 1.0) == pytest.approx(((index - 1) / (index + 1)) ** 2, rel=1e-14)
    brewster = math.atan(1 / index)
    ci, ct = math.cos(brewster), math.sqrt(1 - (index * math.sin(brewster)) ** 2)
    s = ((index * ci - ct) / (index * ci + ct)) ** 2
    assert reflected_part.py_func(index, ci, ct) == pytest.approx(0.5 * s, rel=1e-12)


def test_rays_drawn_are_evenly_chosen_of_those_traced(frames: list[SceneFrame]) -> None:
    """Each is one of the fan, to the last bit; all are drawn where there are no more; secondaries are in proportion."""
    guide, light = Waveguide(), Light(rays=1_003, secondary=0, phase=0.25)
    every = [path.points for path in ray_paths(frames[3], Design(), guide, light)]
    few = [path.points for path in ray_paths(frames[3], Design(), guide, light, released_rays=250)]
    assert len(few) == 250
    places = [next(i for i, points in enumerate(every) if np.array_equal(points, path)) for path in few]
    assert {3, 4, 5} >= set(np.diff(places).tolist()) > {4}
    assert len(ray_paths(frames[3], Design(), guide, light, released_rays=2_000)) == 1_003
    bright = Light(rays=1_000, secondary=400)
    paths = ray_paths(frames[3], Design(), guide, bright, released_rays=250)
    assert sum(path.secondary for path in paths) == 100


def test_rays_traced_backwards_return(frames: list[SceneFrame]) -> None:
    """Turned round where it was detected, a ray runs back through the same points to the emitter."""
    guide, frame = Waveguide(), frames[7]
    light = Light(rays=60, secondary=0)
    checked = 0
    for path in ray_paths(frame, Design(), guide, light):
        end, before = path.points[-1], path.points[-2]
        if np.linalg.norm((end - frame.emitter[:2]) @ frame.emitter[2:]) < 80 or not path.in_resin.all():
            continue
        way = (before - end) / np.hypot(*(before - end))
        inside = end + 1e-7 * way
        back_frame = frame._replace(emitter=np.concatenate([inside, way]), source_cell=JUNCTION_END)
        back = ray_paths(back_frame, Design(), guide, Light(rays=1, cone_deg=0.001, secondary=0))[0].points
        np.testing.assert_allclose(back[1 : len(path.points) - 1], path.points[1:-1][::-1], atol=1e-7)
        checked += 1
    assert checked >= 10


@pytest.mark.fault(45, how="an index of 1", times=1)
def test_index_one_is_no_guide_at_all(frames: list[SceneFrame]) -> None:
    """With index 1 nothing bends or reflects: only what flies straight to the receiver is detected, in full."""
    guide = Waveguide(index=1.0)
    out = trace(frames[7], Design(), guide, Light(rays=4000, secondary=100))
    x, half = 3.0 + 75.0 + 3.0, 1.0
    angle = np.radians(120) * ((np.arange(4000) + 0.5) / 4000 - 0.5)
    assert out.ledger["detected"] == int(np.sum(np.abs(np.tan(angle)) * x < half))
    assert out.power == pytest.approx(out.ledger["detected"] / 4000, abs=1e-12)
    assert out.granted == 0


@pytest.mark.fault(45, how="a ray along its own wall", times=1)
def test_grazing_ray_is_given_up_not_lost() -> None:
    """A ray that leaves along its own wall has no way to go: it is tallied, and the ledger still closes."""
    guide = Waveguide(thickness_mm=2.0)
    edge = np.array([0.5, 1.0, 1.0, 0.0])
    out = trace(
        one_strip(straight((0, 0), (10, 0)), guide, edge), PLAIN, guide, Light(rays=1, cone_deg=0.001, secondary=0)
    )
    assert sum(v for k, v in out.ledger.items() if k != "released") == 1


@pytest.mark.fault(45, how="a ray aimed at a corner", times=1)
def test_a_ray_into_a_corner_is_tallied() -> None:
    """Aimed at the corner of the end face a ray ends there, counted as a corner and with its power as cut."""
    guide = Waveguide(thickness_mm=2.0)
    way = np.array([-1.0, 1.0]) / math.sqrt(2)
    frame = one_strip(straight((0, 0), (10, 0)), guide, np.array([1.0, 0.0, *way]))
    out = trace(frame, PLAIN, guide, Light(rays=1, cone_deg=0.001, secondary=0))
    assert out.ledger["corner"] == 1
    assert out.energy["cut"] == pytest.approx(1.0, abs=1e-15)


def test_a_ray_at_a_smooth_joint_is_not_a_corner() -> None:
    """Where arcs join smoothly a hit on the very joint is an ordinary one: it bounces on and is detected."""
    guide = Waveguide(thickness_mm=2.0)
    curve = ring(50.0, 0.5, 2)
    joint = 51.0 * np.array([math.cos(0.25), math.sin(0.25)])
    start = np.array([50.0, 0.05])
    way = (joint - start) / np.hypot(*(joint - start))
    frame = one_strip(curve, guide, np.concatenate([start, way]))
    out = trace(frame, PLAIN, guide, Light(rays=1, cone_deg=0.001, secondary=0))
    assert out.ledger["detected"] == 1
    assert out.hits >= 2


def test_attenuation_follows_the_path_length() -> None:
    """Along a straight guide at 1 dB/cm a ray at angle a keeps 10^(-L / (100 cos a)); the rest is absorbed."""
    guide = Waveguide(attenuation_db_per_cm=1.0)
    out = strip(straight((0, 0), (80, 0)), guide, Light(rays=101, cone_deg=60.0, secondary=0))
    angle = np.radians(60) * ((np.arange(101) + 0.5) / 101 - 0.5)
    expected = np.mean(10 ** (-(80 - 0.1) / np.cos(angle) / 100))
    assert out.power == pytest.approx(expected, rel=1e-12)
    assert out.energy["absorbed"] == pytest.approx(1 - expected, rel=1e-12)
