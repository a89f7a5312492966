"""Whole scenes against a second tracer, finer and finer chords, and the symmetries that physics demands."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from analysis.optics.scene.curves import (
    frame_of,
    parametric_curves,
)
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.outline import outline
from analysis.optics.scene.parameters import ALL, FACES, ORDERS, Design, Light, Waveguide
from analysis.optics.tracer.simulation import TraceResult, follow_block, trace
from protocol.base.errors import BoatDaqError
from tests.analysis.optics import plain_tracer as plain
from tests.analysis.optics import second_tracer


@pytest.mark.parametrize(
    ("state", "design"),
    [
        (0, Design()),
        (7, Design(7, 0.6, 1.0, 0.5)),
        (14, Design(3, 0.7, 0.7, 0.7)),
        (10, Design(5, 0.9, 0.8, 0.6, "inner")),
        (4, Design(cavities=0)),
        (2, Design(5, 0.9, 0.7, 0.6, "both")),
        (12, Design(3, 1.0, 0.5, 0.9, "midline")),
    ],
)
def test_a_second_tracer_counts_the_same(frames: list[SceneFrame], state: int, design: Design) -> None:
    """Searching all circles by the textbook gives the same ends and the same number of hits, ray for ray."""
    shape = outline(frames[state], design)
    ends, hits = plain.count(plain.read(shape), shape, 1.5, 120)
    out = trace(frames[state], design, Waveguide(), Light(rays=120, secondary=0))
    assert {name: out.ledger[name] for name in ends} == ends
    assert out.hits == hits


@pytest.mark.parametrize(
    ("state", "design"),
    [
        (0, Design()),
        (7, Design(7, 0.6, 1.0, 0.5)),
        (14, Design(3, 0.7, 0.7, 0.7, "inner")),
        (4, Design(cavities=0)),
        (5, Design(7, 0.6, 0.5, 0.5, "both")),
        (9, Design(7, 0.7, 1.0, 0.8, "midline")),
    ],
)
def test_walking_the_cells_counts_as_searching_every_surface(
    frames: list[SceneFrame], state: int, design: Design
) -> None:
    """Cells, free edges and cavities seen from inside: a tracer that tries every segment detects the same rays."""
    shape = outline(frames[state], design)
    searched = second_tracer.detected(second_tracer.read(shape), shape, 3000, 500)
    walked = trace(frames[state], design, Waveguide(), Light(rays=3000, secondary=500))
    assert abs(walked.ledger["detected"] - searched) <= 1


def test_finer_and_finer_chords_converge_to_the_arcs(frames: list[SceneFrame]) -> None:
    """NDR by chords of 1 mm is several rays off, by 1/16 mm less than half as much, by 1/256 mm less than a ray."""
    exact = np.array([trace(f, Design(), Waveguide(), Light(secondary=0)).ndr for f in frames[::4]])
    shapes = [outline(f, Design()) for f in frames[::4]]

    def error(chord_mm: float) -> float:
        found = [second_tracer.detected(second_tracer.chords(shape, chord_mm), shape, 250, 0) for shape in shapes]
        return float(np.sqrt(np.mean((np.array(found) - exact) ** 2)))

    coarse, fine, finest = (error(length) for length in (1.0, 1 / 16, 1 / 256))
    assert coarse > 2 * fine > 4 * finest
    assert coarse > 5.0
    assert finest < 1.0


def moved(curves: np.ndarray, angle: float, shift: tuple[float, float], scale: float) -> np.ndarray:
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return scale * curves @ turn.T + np.array(shift)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(
    ("angle", "shift", "scale"),
    [(0.7, (0, 0), 1.0), (0.0, (31.0, -12.0), 1.0), (-2.1, (5.0, 9.0), 3.7), (math.pi, (0, 0), 0.25)],
)
def test_moving_turning_scaling_changes_nothing(
    curves: np.ndarray, order: str, angle: float, shift: tuple[float, float], scale: float
) -> None:
    """The ledger stays the same to the ray and the power to 1e-9 when the whole scene moves, turns or grows."""
    light = Light(rays=250, order=order, path_cap_mm=1000 * scale)  # type: ignore[arg-type]
    plain_light = Light(rays=250, order=order)  # type: ignore[arg-type]
    here = trace(frame_of(curves, 9, Waveguide()), Design(), Waveguide(), plain_light)
    guide = Waveguide(thickness_mm=2 * scale, stem_mm=3 * scale, backing_mm=0.1 * scale)
    design = Design(5, 1.0 * scale, 0.5 * scale, 0.9 * scale)
    there = trace(frame_of(moved(curves, angle, shift, scale), 9, guide), design, guide, light)
    assert there.ledger == here.ledger
    assert there.power == pytest.approx(here.power, abs=1e-9)


def test_mirroring_the_scene_changes_nothing(curves: np.ndarray) -> None:
    """The other hand's scene, guides exchanged, detects the same power."""
    out = [
        trace(frame_of(c, 5, Waveguide()), Design(), Waveguide(), Light(secondary=0))
        for c in (curves, curves * np.array([-1.0, 1.0]), curves[:, ::-1], curves[:, :, ::-1])
    ]
    assert [o.ledger["detected"] for o in out] == [out[0].ledger["detected"]] * 4


def ledger_closes(out: TraceResult) -> None:
    assert sum(v for k, v in out.ledger.items() if k != "released") == out.ledger["released"]
    assert abs(sum(out.energy.values()) - 1) < 1e-12
    assert min(out.energy.values()) >= 0
    assert out.ledger["corner"] <= 2


@st.composite
def guides(draw: st.DrawFn) -> tuple[np.ndarray, Waveguide]:
    """Curves and guide within and somewhat beyond what an actuator does; some cannot be built."""
    curves = parametric_curves(np.array([draw(st.floats(-12.0, 10.0))]))
    curves[:, :, 1:-1, 0] *= draw(st.floats(0.3, 1.5))
    curves[0, :, 1:-1] += np.array(draw(st.lists(st.floats(-0.6, 0.6), min_size=20, max_size=20))).reshape(2, 5, 2)
    return curves, Waveguide(
        thickness_mm=draw(st.floats(0.5, 4.0)),
        index=draw(st.floats(1.0, 2.5)),
        attenuation_db_per_cm=draw(st.sampled_from([0.0, 0.3, 5.0])),
        receiver_mm=draw(st.sampled_from([None, None, 0.0, 0.6, 3.0])),
    )


DESIGNS = st.builds(
    Design,
    st.integers(0, 9),
    st.floats(0.1, 3.0),
    st.floats(0.05, 2.0),
    st.floats(0.05, 2.0),
    st.sampled_from(FACES),
)
LIGHTS = st.builds(
    Light,
    rays=st.integers(2, 60),
    cone_deg=st.floats(1.0, 175.0),
    emission=st.sampled_from(["uniform", "lambertian"]),
    secondary=st.sampled_from([0, 3, 100]),
    order=st.sampled_from(ORDERS),
    path_cap_mm=st.sampled_from([30.0, 1000.0]),
)


def several(number: int) -> st.SearchStrategy[list[tuple[Design, Light]]]:
    """Designs and lights for one pair of guides: cutting and tracing are cheap, building a frame is not."""
    return st.lists(st.tuples(DESIGNS, LIGHTS), min_size=number, max_size=number)


def check_scenes(pair: tuple[np.ndarray, Waveguide], scenes: list[tuple[Design, Light]]) -> None:
    curves, guide = pair
    try:
        frame = frame_of(curves, 0, guide)
    except BoatDaqError as refused:
        assert refused.cause
        assert refused.remedy
        return
    for design, light in scenes:
        try:
            out = trace(frame, design, guide, light, threads=1)
        except BoatDaqError as refused:
            assert refused.cause
            assert refused.remedy
            continue
        ledger_closes(out)
        assert out.ledger["released"] == light.rays + out.granted
        assert out.granted <= light.secondary


@pytest.mark.fault(45, how="random scenes, those that cannot be built among them", times=120)
@given(guides(), several(4))
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
def test_ledgers_close_on_random_scenes(pair: tuple[np.ndarray, Waveguide], scenes: list[tuple[Design, Light]]) -> None:
    """Rays and energy are all accounted for in any scene that can be built; the others are refused with a remedy."""
    check_scenes(pair, scenes)


@pytest.mark.fault(45, how="random scenes, those that cannot be built among them", times=10000)
@pytest.mark.nightly
@pytest.mark.timeout(3600)
@given(guides(), several(10))
@settings(max_examples=1_000, deadline=None, suppress_health_check=list(HealthCheck))
def test_ledgers_close_on_ten_thousand_scenes(
    pair: tuple[np.ndarray, Waveguide], scenes: list[tuple[Design, Light]]
) -> None:
    """The same on 10,000 scenes: 1,000 pairs of guides, ten designs and lights in each."""
    check_scenes(pair, scenes)


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@given(guides(), DESIGNS, st.integers(2, 60))
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
def test_the_second_tracer_agrees_on_random_scenes(
    pair: tuple[np.ndarray, Waveguide], design: Design, rays: int
) -> None:
    """On any scene with a whole receiver both tracers detect the same rays, up to one that came near a corner."""
    curves = pair[0]
    guide = Waveguide(thickness_mm=pair[1].thickness_mm, index=pair[1].index)
    try:
        frame = frame_of(curves, 0, guide)
        shape = outline(frame, design)
    except BoatDaqError:
        return
    out = trace(frame, design, guide, Light(rays=rays, secondary=0))
    ends, _ = plain.count(plain.read(shape), shape, guide.index, rays)
    assert abs(out.ledger["detected"] - ends["detected"]) <= 1


def test_the_three_orders_spend_the_same_budget(frames: list[SceneFrame]) -> None:
    """Time, bounce and index all follow 100 secondaries, and NDR differs by a few rays only."""
    found = [trace(frames[7], Design(), Waveguide(), Light(order=order)) for order in ORDERS]
    assert [o.granted for o in found] == [100] * 3
    assert max(o.ndr for o in found) - min(o.ndr for o in found) < 25
    assert len({round(o.power, 9) for o in found}) == 3


def test_an_unlimited_budget_leaves_nothing_to_the_order(frames: list[SceneFrame]) -> None:
    """When every secondary is followed the order decides nothing, and no energy is cut but below the faintest."""
    found = [
        trace(frames[7], Design(), Waveguide(), Light(rays=100, secondary=500_000, order=order, faintest=1e-6))
        for order in ORDERS
    ]
    assert len({o.ledger["detected"] for o in found}) == 1
    assert found[0].refused == 0
    assert found[0].power == pytest.approx(found[2].power, abs=1e-12)


def test_threads_change_no_bit(frames: list[SceneFrame]) -> None:
    """Blocks of rays on one thread or two give the same numbers to the last bit."""
    one, two = (trace(frames[3], Design(), Waveguide(), Light(rays=20_000), threads=n) for n in (1, 2))
    assert one == two


def test_zero_receivers_detect_nothing(curves: np.ndarray) -> None:
    """A receiver of no width is allowed: NDR is 0 and the ledger closes."""
    guide = Waveguide(receiver_mm=0.0)
    out = trace(frame_of(curves, 7, guide), Design(), guide, Light())
    assert (out.ndr, out.power) == (0.0, 0.0)
    assert sum(out.energy.values()) == pytest.approx(1.0, abs=1e-12)


def test_a_wider_receiver_sees_more(curves: np.ndarray) -> None:
    """Detected power grows with the receiver's width, also beyond the end face."""
    found = [
        trace(frame_of(curves, 7, g), Design(), g, Light(rays=2000)).power
        for g in (Waveguide(receiver_mm=w) for w in (0.5, 1.0, 2.0, 30.0))
    ]
    assert found == sorted(found)
    assert found[-1] > found[2]


def test_all_secondaries_are_those_of_a_budget_that_refuses_none(curves: np.ndarray) -> None:
    """Followed directly after their ray or by rank, the same rays end the same way, in several blocks too."""
    frame, guide = frame_of(curves, 3, Waveguide()), Waveguide()
    for rays in (60, 4_200):
        every = Light(rays=rays, secondary=ALL, faintest=0.01, phase=0.1)
        out = [trace(frame, Design(), guide, light) for light in (every, replace(every, secondary=20 * rays))]
        assert out[0].ledger == out[1].ledger
        assert (out[0].granted, out[0].refused, out[1].refused) == (out[1].granted, 0, 0)
        assert out[0].power == pytest.approx(out[1].power, rel=1e-12)
        assert out[0].power_sd == pytest.approx(out[1].power_sd, rel=1e-9)
        assert sum(out[0].energy.values()) == pytest.approx(1.0, abs=1e-12)


def test_a_cancelled_scene_traces_no_further_block(frames: list[SceneFrame], monkeypatch: pytest.MonkeyPatch) -> None:
    """Raising from the progress leaves the blocks that wait untraced."""
    begun: list[int] = []

    def counted(*arguments: Any) -> None:
        begun.append(arguments[3])
        time.sleep(0.02)
        follow_block(*arguments)

    counted.compile, counted.typeof_pyval = follow_block.compile, follow_block.typeof_pyval  # type: ignore[attr-defined]
    monkeypatch.setattr("analysis.optics.tracer.simulation.follow_block", counted)
    monkeypatch.setattr("analysis.optics.tracer.simulation.BLOCK", 50)

    def cancel(done: float, total: float) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        trace(frames[0], Design(), Waveguide(), Light(rays=50 * 40, secondary=0), threads=1, progress=cancel)
    assert len(begun) < 10
