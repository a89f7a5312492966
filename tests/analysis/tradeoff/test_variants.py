"""The same scenes by other ways: without cells, with chords for arcs, in single precision."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.optics.outline import outline
from analysis.optics.scene.frame import Frame
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import trace
from analysis.tradeoff.variants import trace_variant
from tests.analysis.optics import plain_tracer as plain

GUIDE = Waveguide()


@pytest.mark.parametrize(
    ("state", "design"),
    [(0, Design()), (7, Design(7, 0.6, 1.0, 0.5)), (14, Design(3, 0.7, 0.7, 0.7, "inner")), (4, Design(cavities=0))],
)
def test_walking_the_cells_is_searching_everything(frames: list[Frame], state: int, design: Design) -> None:
    """The walk from cell to cell, free surfaces cavities seen from inside: all as by searching every surface."""
    light = Light(rays=6000, secondary=500)
    walked = trace(frames[state], design, GUIDE, light)
    searched = trace_variant(frames[state], design, GUIDE, light, chord_mm=0.0)
    assert searched.ledger == walked.ledger
    assert searched.hits == walked.hits
    assert searched.power == pytest.approx(walked.power, abs=1e-9)


def test_chords_are_the_plain_tracers_chords(frames: list[Frame]) -> None:
    """With arcs chopped at 1 mm a second tracer, written for comparison, counts the same rays and the same hits."""
    light = Light(rays=100, secondary=0)
    shape = outline(frames[3], Design())
    ends, hits = plain.count(plain.chords(shape, 1.0), shape, 1.5, light.rays)
    out = trace_variant(frames[3], Design(), GUIDE, light, chord_mm=1.0)
    assert {name: out.ledger[name] for name in ends} == ends
    assert out.hits == hits


def test_finer_and_finer_chords_come_to_the_arcs(frames: list[Frame]) -> None:
    """Over the states NDR by chords of 1 mm is several rays off, by 1/16 mm less than half as much, by 1/256 mm less
    than a ray.
    """
    light = Light(rays=250, secondary=0)
    exact = np.array([trace(f, Design(), GUIDE, light).ndr for f in frames[::2]])

    def error(chord_mm: float) -> float:
        found = [trace_variant(f, Design(), GUIDE, light, chord_mm=chord_mm).ndr for f in frames[::2]]
        return float(np.sqrt(np.mean((np.array(found) - exact) ** 2)))

    coarse, fine, finest = (error(length) for length in (1.0, 1 / 16, 1 / 256))
    assert coarse > 2 * fine > 4 * finest
    assert coarse > 5.0
    assert finest < 1.0


def test_chords_of_no_length_are_refused(frames: list[Frame]) -> None:
    """Lengths that are negative, not a number or below a micrometre are refused with a remedy."""
    for length in (-1.0, 1e-6, float("nan"), float("inf")):
        with pytest.raises(RequestError, match="chords of") as refused:
            trace_variant(frames[7], Design(), GUIDE, Light(rays=2), chord_mm=length)
        assert refused.value.remedy


@pytest.mark.nightly
def test_single_precision_loses_a_ray_in_a_thousand_at_most(frames: list[Frame]) -> None:
    """Made from the same source in float32 the tracer counts nearly the same, and its energy closes to float32 only."""
    light = Light(rays=20_000)
    double = trace(frames[7], Design(), GUIDE, light)
    single = trace_variant(frames[7], Design(), GUIDE, light, single=True)
    assert abs(single.ledger["detected"] - double.ledger["detected"]) <= 20
    assert 0 < abs(sum(single.energy.values()) - 1.0) < 1e-5
    assert single.power != double.power
    assert single.power == pytest.approx(double.power, abs=1e-3)
