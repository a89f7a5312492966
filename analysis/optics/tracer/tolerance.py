"""As many rays as an error allows: a pilot fan predicts them, the traced fan gives the error of its own answer.

Strategy: the model of `sd_of_sum` gives how the error of a count falls with the rays. A pilot fan measures how often
detection changes along the fan, from which the standard deviation for any number of rays follows. The answer carries
its own error, measured along its own fan; where that is above the tolerance, more rays are traced. Each ray has a
random place in its own step: an even fan of some numbers of rays beats with the cavities, which its own error cannot
show. Differences of neighbours at random places are, on average, no smaller than the error that they have.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from analysis.numbers import rounded_up
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import ALL, MOST_RAYS, PAPER_RAYS, Design, Light, Waveguide
from analysis.optics.tracer.simulation import TraceResult, sd_of_sum, trace
from analysis.progress import Progress
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, RequestError
from protocol.base.units import COVERAGE_FACTOR

"""Standard deviations of a stated error: about 95 %."""
PILOT_RAYS, FEWEST_RAYS = 100, 50
SPARE, MORE, TRIES = 1.15, 1.2, 8
"""Part by which the prediction stays below the tolerance; factor of rays of another try, and how many there are."""
FOUND = 1.2  # factor on the least error by a pilot fan, so that the final fan meets the proposed error
SEED = 1  # seed of the rays' places: an answer is repeatable


@dataclass(frozen=True, slots=True)
class ToleratedTrace:
    """A simulation with the error that it has."""

    result: TraceResult  # with light: the simulation, and the light it was made with
    light: Light
    error: float  # error of its NDR or power, 2 standard deviations, rays of 250
    tolerance: float
    work: int  # rays released altogether, the pilot's among them


def check_tolerance(tolerance: float, unit: str) -> None:
    """Reject a tolerance that is not a number above 0. Raises RequestError where it is none."""
    if not 0.0 < tolerance < np.inf:
        raise ChoiceError(f"a tolerance of {tolerance:g} {unit}", "give a number above 0")


def jittered(light: Light) -> Light:
    """Return a light whose rays have random places, the same ones each time."""
    return replace(light, phase=0.0, jitter=SEED)


def rays_for(light: Light, sd: float, tolerance: float, thickness_mm: float, mirrored: bool) -> int:
    """Return the rays at which the error of a count is predicted to be the tolerance."""
    check_tolerance(tolerance, "rays")
    allowed, symmetric = tolerance / COVERAGE_FACTOR / SPARE, np.array(mirrored)
    now = sd_of_sum(light, thickness_mm, symmetric)

    def predicted(rays: int) -> float:
        return float(sd * sd_of_sum(replace(light, rays=rays), thickness_mm, symmetric) / now)

    if predicted(MOST_RAYS) > allowed:
        best = rounded_up(COVERAGE_FACTOR * SPARE * FOUND * predicted(MOST_RAYS))
        raise RequestError(
            f"an error of {tolerance:g} rays takes more than {MOST_RAYS:,} rays".replace(",", " "),
            f"allow {best:g} rays or more",
        )
    low, high = FEWEST_RAYS, MOST_RAYS
    while high > 1.02 * low:  # the error falls with the rays
        middle = int((low * high) ** 0.5) + 1
        low, high = (low, middle) if predicted(middle) <= allowed else (middle, high)
    return low if predicted(low) <= allowed else high


def trace_within(
    frame: SceneFrame,
    design: Design,
    guide: Waveguide,
    light: Light,
    tolerance: float,
    *,
    progress: Progress | None = None,
) -> ToleratedTrace:
    """Trace one scene with no more rays than an error of its count takes, rays of 250 at 2 standard deviations.

    Where all reflections are followed the error is that of the power of 250 rays: their number means nothing.
    """
    check_tolerance(tolerance, "rays")
    thickness, mirrored, work = 2 * frame.half_mm, bool(frame.mirrored), 0
    fan = jittered(light).with_rays(PILOT_RAYS)
    for _ in range(TRIES):
        result = trace(frame, design, guide, fan, progress=progress)
        work += fan.rays
        sd = PAPER_RAYS * result.power_sd if light.secondary == ALL else result.ndr_sd
        error = float(stated_error(sd, fan.rays))
        if error <= tolerance and fan.rays >= FEWEST_RAYS:
            return ToleratedTrace(result, fan, error, tolerance, work)
        traced, fan = fan.rays, finer(fan, error, tolerance, thickness, mirrored=mirrored)
    raise unmet(traced, error)


def finer(light: Light, error: float, tolerance: float, thickness_mm: float, *, mirrored: bool) -> Light:
    """Return a light with the rays that a tolerance is predicted to take, and notably more than it has."""
    needed = rays_for(light, error / COVERAGE_FACTOR, tolerance, thickness_mm, mirrored)
    return light.with_rays(max(needed, round(MORE * light.rays)))


def unmet(rays: int, error: float) -> RequestError:
    """Return the refusal of a tolerance that all tries have missed, with what the last one would meet."""
    cause = f"the error of {rays} rays is {error:.2g} rays of {PAPER_RAYS}"
    return RequestError(cause, f"allow {rounded_up(1.1 * error):g} rays or more")


def stated_error(sd: npt.ArrayLike, rays: int) -> FloatArray:
    """Return the errors of counts with standard deviations (...), no smaller than rounding to whole rays leaves."""
    return np.asarray(COVERAGE_FACTOR * np.hypot(sd, PAPER_RAYS / rays / np.sqrt(12.0)))
