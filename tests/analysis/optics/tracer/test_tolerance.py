"""As many rays as a tolerance takes, and an error that is true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves, frames_of, parametric_curves
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.fans import count_errors, light_within
from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
from analysis.optics.tracer.simulation import trace
from analysis.optics.tracer.tolerance import rays_for, stated_error, trace_within
from protocol.base.errors import RequestError


def covered(scenes: int, seed: int) -> tuple[float, float]:
    """Return the share of random scenes whose error is within the stated one, and its median cost in final rays."""
    rng, grid, inside, cost = np.random.default_rng(seed), paper_grid(), 0, []
    frames = [*frames_of(default_curves(), Waveguide()), *frames_of(parametric_curves(), Waveguide())]
    for _ in range(scenes):
        design, frame = grid[rng.integers(len(grid))], frames[rng.integers(len(frames))]
        tolerance = float(np.exp(rng.uniform(np.log(0.3), np.log(20.0))))
        found = trace_within(frame, design, Waveguide(), Light(), tolerance)
        assert found.error <= tolerance
        truth = trace(frame, design, Waveguide(), replace(Light().with_rays(60_000), phase=0.113), threads=1).ndr
        inside += abs(found.result.ndr - truth) <= found.error
        cost.append(found.work / found.light.rays)
    return inside / scenes, float(np.median(cost))


def test_the_stated_error_is_true_of_random_scenes() -> None:
    """Ten scenes: the error is within the stated one in eight or more (99 % of such samples), the pilot is cheap."""
    share, cost = covered(10, 3)
    assert share >= 0.8
    assert cost < 2.0


@pytest.mark.nightly
def test_the_stated_error_is_true_of_a_thousand_scenes() -> None:
    """In 93 to 97 % of 1,000 random scenes the true error is within the stated one, at k = 2."""
    share, cost = covered(1_000, 7)
    assert 0.93 <= share <= 0.97
    assert cost < 1.5


def test_a_tolerance_that_no_number_of_rays_meets_is_refused_with_the_best() -> None:
    """The refusal names an error that can be met; a tolerance of nothing is refused too."""
    frame = frames_of(default_curves(), Waveguide())[7]
    for tolerance, remedy in ((1e-7, "allow"), (0.0, "above 0"), (float("nan"), "above 0")):
        with pytest.raises(RequestError) as refused:
            trace_within(frame, PAPER_OPTIMUM, Waveguide(), Light(), tolerance)
        assert remedy in refused.value.remedy


def test_more_rays_are_chosen_for_less_error() -> None:
    """The predicted rays rise as the tolerance falls, and no ray is detected by a design that passes none."""
    fan = Light().with_rays(200)
    rays = [rays_for(fan, 7.0, tolerance, 2.0, mirrored=True) for tolerance in (10.0, 3.0, 1.0, 0.1)]
    assert rays == sorted(rays)
    assert len(set(rays)) == 4


def test_the_counts_of_a_sweep_meet_its_tolerance() -> None:
    """Rays chosen from a pilot leave 95 % of all counts within little more than the tolerance."""
    request = SweepRequest((*paper_grid()[::120], Design(7, 1.0, 0.5, 0.6)))
    light = light_within(request, 3.0)
    result = run_sweep(replace(request, light=light))
    errors = count_errors(result)
    assert 1.5 < errors["of_95_percent"] < 3.6
    assert errors["greatest"] == pytest.approx(np.max(stated_error(result.ndr_sd, light.rays)))
