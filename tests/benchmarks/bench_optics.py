"""How fast the optical sweep is: seconds, hits, ns a hit, and the ratio to the paper's 8 s a simulation.

Seconds on the clock need an idle machine; processor seconds are printed beside them and do not.
"""

from __future__ import annotations

import time

import pytest

from analysis.optics.scene.curves import default_curves, frame_of
from analysis.optics.scene.parameters import QUARTER_STEP, Design, Light, Waveguide
from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
from analysis.optics.tracer.simulation import trace
from tests.benchmarks.lengths import length

PAPER_S = 8.0
DESIGNS = length(648, 4)
SCENE_RAYS = length(1_000_000, 10_000)


def sweep(light: Light) -> int:
    """Print one sweep; return how many simulations it made."""
    run_sweep(SweepRequest(tuple(paper_grid()[:2])))
    began, busy = time.perf_counter(), time.process_time()
    result = run_sweep(SweepRequest(tuple(paper_grid()[:DESIGNS]), light=light))
    seconds, busy = time.perf_counter() - began, time.process_time() - busy
    print(
        f"\n{result.ndr.size} simulations of {light.rays} rays, turned by {light.phase:g} of a step: {seconds:.2f} s, "
        f"processor {busy:.2f} s, {result.hits} hits, "
        f"{1e9 * busy / result.hits:.0f} ns a hit and core, {PAPER_S * result.ndr.size / seconds:.0f} times "
        f"the paper's {PAPER_S:g} s a simulation"
    )
    return int(result.ndr.size)


def test_the_papers_sweep() -> None:
    """All 9,720 simulations of 250 rays, half of which are mirror images; target 2 s on two cores, 55 ns a hit."""
    assert sweep(Light()) == 15 * DESIGNS


def test_the_papers_sweep_with_every_ray_followed() -> None:
    """The same with the fan turned, so that no ray is another one's mirror image."""
    assert sweep(Light(phase=QUARTER_STEP)) == 15 * DESIGNS


@pytest.mark.timeout(1800)
def test_the_papers_sweep_with_a_hundred_times_the_rays() -> None:
    """All 9,720 simulations of 25,000 rays; target 3 minutes on two cores."""
    assert sweep(Light(rays=25_000, phase=QUARTER_STEP)) == 15 * DESIGNS


def test_one_scene() -> None:
    """A million rays on one scene; target 1 s, and 60 ns a hit on one core."""
    frame = frame_of(default_curves(), 7, Waveguide())
    trace(frame, Design(), Waveguide(), Light(rays=10))
    for threads in (1, 2):
        began, busy = time.perf_counter(), time.process_time()
        out = trace(frame, Design(), Waveguide(), Light(rays=SCENE_RAYS, phase=QUARTER_STEP), threads=threads)
        seconds, busy = time.perf_counter() - began, time.process_time() - busy
        print(
            f"\n{SCENE_RAYS:,} rays on {threads} threads: {seconds:.2f} s, processor {busy:.2f} s, {out.hits} hits, "
            f"{1e9 * busy / out.hits:.0f} ns a hit and core (a naive tracer with 800 chords: 200), "
            f"{PAPER_S / seconds:.0f} times the paper's {PAPER_S:g} s for 250 rays"
        )
        assert out.hits > SCENE_RAYS
