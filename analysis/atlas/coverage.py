"""Whether stated errors are true: random scenes, the true error against the stated one, and the cost of knowing it.

    python -m analysis.atlas.coverage bootstrap --scenes 1000

Strategy: each method is computed to a random tolerance in a random scene. The truth is a closed form, a far finer
computation, or, where that has an error of its own, one whose error is added in quadrature. An answer whose error is
zero is within any statement. A setting would have done if the root mean square of its errors over repeats with other
random numbers, times two, is within the tolerance. The cost, in the method's own work (draws, rays, elements, time), is
within three times the cheapest where no setting of a third of it would have done: errors fall with work, so that the
dearest of those settings is tried for all.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from analysis.atlas.drives import Drive
from analysis.atlas.runs import Stairs
from analysis.calibration.posterior import Posterior, sample_posterior
from analysis.data.recording import Recording
from analysis.errors import ConvergenceError, RequestError
from analysis.figures.pipeline import analyse, redrawn_run
from analysis.figures.sensor_analysis import AnalysedRun, Options
from analysis.numbers import finite
from analysis.optics.scene.curves import default_curves, frames_of, parametric_curves
from analysis.optics.scene.parameters import Light, Waveguide
from analysis.optics.sweep.sweep import paper_grid
from analysis.optics.tracer.simulation import trace
from analysis.optics.tracer.tolerance import FEWEST_RAYS, trace_within
from analysis.segmentation.stroke_sampling import sampling_within
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import build_table
from analysis.shadow.model.tolerance import (
    ACROSS,
    ALONG,
    ORDER,
    TABLES,
    on_mesh,
    reduced_error_mm,
    reduced_within,
    solve_within,
)
from analysis.stopping.accuracy import (
    FEWEST,
    FEWEST_SAMPLES,
    POINTS,
    accuracy_of,
    analyses_within,
    greatest_band_error,
    in_mm,
    sample_within,
)

_REFERENCE_RAYS, _REFERENCE_RESAMPLES = 60_000, 20_000
_REFERENCE_MESHES = ((48, 6), (64, 8))
_COARSER = 12  # elements along a cell that a cheaper setting might have had
REPEATS = 12


@dataclass(frozen=True, slots=True)
class Answer:
    """One scene: the true and the stated error, in the unit of the method.

    `third_does`: whether a third of its cost would have done; None where no tolerance was asked.
    """

    error: float
    stated: float
    third_does: bool | None = None


Method = Callable[[np.random.Generator], list[Answer]]


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def would_do(errors: Sequence[float], tolerance: float) -> bool:
    """Return whether a setting with these errors, of repeats, is within a tolerance at k = 2."""
    return 2.0 * float(np.sqrt(np.mean(np.square(errors)))) <= tolerance


def of_tracer(rng: np.random.Generator) -> list[Answer]:
    """Trace a design of the paper's grid in one of its states to 0.3 to 20 rays."""
    grid, curves = paper_grid(), default_curves() if rng.random() < 0.5 else parametric_curves()
    design, frame = grid[rng.integers(len(grid))], frames_of(curves, Waveguide())[rng.integers(15)]
    tolerance = log_uniform(rng, 0.3, 20.0)
    found = trace_within(frame, design, Waveguide(), Light(), tolerance)
    truth = trace(frame, design, Waveguide(), replace(Light().with_rays(_REFERENCE_RAYS), phase=0.113), threads=1).ndr
    third, errors = Light().with_rays(max(1, found.work // 3)), []
    for phase in rng.uniform(-0.5, 0.5, REPEATS):
        turned = replace(third, phase=float(phase))
        errors.append(trace(frame, design, Waveguide(), turned, threads=1).ndr - truth)
    does = third.rays >= FEWEST_RAYS and would_do(errors, tolerance)
    return [Answer(abs(found.result.ndr - truth), found.error, does)]


def of_posterior(rng: np.random.Generator) -> list[Answer]:
    """Sample the posterior of a polynomial without reading error, whose band is Student's, to a tolerance in mm."""
    degree, noise = int(rng.integers(1, 5)), log_uniform(rng, 0.3, 6.0)
    x = np.linspace(-2.5, 3.5, int(rng.integers(8, 14))).repeat(rng.integers(2, 7))
    y = 20.0 * x + rng.normal(0.0, 2.0) * x**2 + rng.normal(0.0, 0.3) * x**3 + rng.normal(0.0, noise, x.size)
    asked: list[Posterior] = []

    def sample(samples: int, seed: int = int(rng.integers(1 << 30))) -> Posterior:
        asked.append(sample_posterior(x, y, degree, samples=samples, seed=seed))
        return asked[-1]

    def error(found: Posterior) -> float:
        away = np.array(found.curve_band(at)) - np.array(found.calibration.band(at, 0.95))
        return float(np.abs(in_mm(found.calibration, at, away)).max())

    shortest = sample(FEWEST_SAMPLES)
    at, least = np.linspace(*shortest.calibration.x_range, POINTS), shortest.n_eff
    tolerance = greatest_band_error([shortest], "mm") * log_uniform(rng, 0.4, 1.5)
    asked.clear()
    found, stated = sample_within(sample, tolerance, "mm")
    work = sum(each.n_eff for each in asked)
    seeds = rng.integers(1 << 30, size=REPEATS if work >= 3.0 * least else 0)
    errors = [error(sample(int(work / 3.0), int(seed))) for seed in seeds]
    return [Answer(error(found), stated, bool(errors) and would_do(errors, tolerance))]


def random_run(rng: np.random.Generator, folder: Path) -> tuple[Recording, Path]:
    """Return a staircase of two sensors and 2 to 12 cycles with noise and loops, and the file of its elongations."""
    run = Stairs(
        cycles=int(rng.integers(2, 13)), rate_hz=15.0, dwell_s=1.0, noise_mv=log_uniform(rng, 0.2, 5.0),
        bulge_percent=rng.uniform(0.0, 8.0), bulge_at=rng.uniform(0.3, 0.7), seed=int(rng.integers(1 << 30)),
    )  # fmt: skip
    other = replace(run, seed=run.seed + 1, bulge_percent=rng.uniform(0.0, 8.0))
    return recorded((run, other), rng.uniform(0.0, 0.1), rng, folder)


def recorded(
    sensors: tuple[Stairs, ...], reading_sd_mm: float, rng: np.random.Generator, folder: Path
) -> tuple[Recording, Path]:
    """Return the recording of a staircase and the file of its elongations.

    Parameters
    ----------
    sensors : the same staircase with the signal of each sensor.
    """
    run = sensors[0]
    levels, branch = run.holds
    x = run.elongation(levels, branch) + rng.normal(0.0, reading_sd_mm, levels.size)
    file = folder / "elongation.csv"
    rows = "".join(f"{p:.6f},{each:.9f}\n" for p, each in zip(levels, x, strict=True))
    file.write_text(f"pressure_kpa,elongation_mm\n{rows}", encoding="ascii")
    at, pressure, _ = run.columns
    return Recording.from_arrays(at, pressure, np.stack([each.columns[2] for each in sensors], axis=1)), file


def limits_of(analysis: AnalysedRun) -> dict[tuple[int, str], tuple[float, float]]:
    """Return the limits of the intervals of the figures in % FSO, by sensor and key."""
    return {
        (number, key): (figure.low, figure.high)
        for number, sensor in enumerate(analysis.sensors)
        for key, figure in sensor.figures.items()
        if figure.unit == "% FSO" and not figure.void and np.isfinite([figure.low, figure.high]).all()
    }


def limits_away(analysis: AnalysedRun, truth: AnalysedRun) -> float:
    """Return how far the worst limit of an analysis is from that of another with other draws, % FSO."""
    limits, others = limits_of(analysis), limits_of(truth)
    return float(np.abs([np.subtract(limits[key], others[key]) for key in limits.keys() & others.keys()]).max())


def of_bootstrap(rng: np.random.Generator) -> list[Answer]:
    """Analyse a run, with elongations or without, to 3 to 15 times the error of many resamples.

    The work is the processor time of the analysis. None is cheaper than the first, with the fewest resamples; where all
    took more than three times as long, a third of the resamples is tried.
    """
    with tempfile.TemporaryDirectory() as folder:
        recording, file = random_run(rng, Path(folder))
        readings = file if rng.random() < 0.7 else None
        options = Options(mcmc=False, x_resolution_mm=0.0, seed=int(rng.integers(1 << 30)), resamples=FEWEST)
        fine = replace(options, resamples=_REFERENCE_RESAMPLES, seed=options.seed + 1)
        truth = redrawn_run(analyse(recording, readings, options=options), fine)
        of_truth = accuracy_of(truth).intervals_percent_fso
        tolerance = max(of_truth * log_uniform(rng, 3.0, 15.0), 0.01)
        tries, seconds = [], []
        began = time.process_time()
        for each in analyses_within(recording, readings, options, tolerance, "%FSO"):
            tries.append(each)
            now = time.process_time()
            seconds.append(now - began)
            began = now
    work, errors = sum(each.weights.shape[0] for each in tries), []
    cheaper = work >= 3 * FEWEST and sum(seconds) >= 3.0 * seconds[0]
    for seed in rng.integers(1 << 30, size=REPEATS if cheaper else 0):
        third = replace(options, resamples=work // 3, seed=int(seed))
        errors.append(limits_away(redrawn_run(truth, third), truth))
    does = bool(errors) and would_do(errors, float(np.hypot(tolerance, of_truth)))
    stated = float(np.hypot(accuracy_of(tries[-1]).intervals_percent_fso, of_truth))
    return [Answer(limits_away(tries[-1], truth), stated, does)]


def random_actuator(rng: np.random.Generator) -> ActuatorParameters:
    """Return an actuator of random moduli, wall, neck and belly."""
    rest = ActuatorParameters()
    return replace(
        rest, wall_modulus_kpa=rest.wall_modulus_kpa * rng.uniform(0.6, 1.6), wall_mm=rng.uniform(1.7, 2.7),
        neck_radius_mm=rest.neck_radius_mm * rng.uniform(0.8, 1.15), belly_radius_mm=rng.uniform(6.8, 8.2),
    )  # fmt: skip


def of_mesh(rng: np.random.Generator) -> list[Answer]:
    """Solve a random actuator at a random pressure to 0.5 to 50 µm, against the extrapolation of two finer meshes.

    The work is in elements along a cell; a mesh takes the next coarser one, too, without which it states no error.
    """
    actuator, pressure, tolerance = random_actuator(rng), rng.uniform(-25.0, 50.0), log_uniform(rng, 5e-4, 0.05)

    def elongation(along: int, across: int) -> float:
        return FullModel(on_mesh(actuator, along, across)).solver.solve(pressure_kpa=pressure).elongation_mm

    found = solve_within(actuator, pressure, tolerance)
    fine, finer = (elongation(*each) for each in _REFERENCE_MESHES)
    truth = finer + (finer - fine) / ((_REFERENCE_MESHES[1][0] / _REFERENCE_MESHES[0][0]) ** ORDER - 1.0)
    third = [mesh for coarser, mesh in pairwise((_COARSER, *ALONG)) if coarser + mesh <= sum(found.solved) / 3.0]
    does = any(abs(elongation(mesh, ACROSS) - truth) <= tolerance for mesh in third)
    return [Answer(abs(found.solution.elongation_mm - truth), found.error_mm, does)]


def of_reduced(rng: np.random.Generator) -> list[Answer]:
    """Build a small table of a random actuator, and find 20 of its states by it or in full, to 0.02 to 50 µm.

    Errors are those of the reduced states, used or not; a state without an estimate is always found in full.
    """
    actuator = replace(random_actuator(rng), axial_elements=6, wall_elements=2, lattice_elements=3)
    shadow = Shadow(actuator, build_table(actuator, TableSettings(*TABLES[rng.integers(len(TABLES) - 1)], 1)))
    model, found = shadow.model, []
    for _ in range(20):
        pressure = rng.uniform(*shadow.table.pressure_range_kpa) if (kind := rng.integers(3)) != 2 else None
        ends = shadow.table.nominal_range_mm if kind == 2 else shadow.table.elongation_range_mm
        elongation = rng.uniform(*ends) if kind != 1 else None
        tolerance = log_uniform(rng, 2e-5, 5e-2)
        state, _ = shadow.solution(pressure_kpa=pressure, elongation_mm=elongation)
        full = model.solve(pressure_kpa=pressure, elongation_mm=elongation)
        points = model.guides.tracked.weights @ (full.displacement_mm - state.displacement_mm)
        error = max(float(np.linalg.norm(points, axis=1).max()), abs(full.elongation_mm - state.elongation_mm))
        answered = reduced_within(shadow, pressure, elongation, tolerance)
        does = answered.used == "full" and error <= tolerance
        try:
            found.append(Answer(error, reduced_error_mm(model, state, pressure, elongation), does))
        except ConvergenceError:  # answered in full, without error
            found.append(Answer(0.0, 0.0, does))
    return found


def of_segmentation(rng: np.random.Generator) -> list[Answer]:
    """Find the strokes of a random drive by as few samples as 20 ms to 1 s of a period take: one of its periods."""
    cycles, steps = int(rng.integers(3, 16)), int(rng.integers(1, 10))
    dwell_s, ramp_kpa_per_s = rng.choice([0.0, log_uniform(rng, 0.05, 3.0)]), log_uniform(rng, 3.0, 60.0)
    rate_hz, noise_kpa = log_uniform(rng, 10.0, 200.0), log_uniform(rng, 0.01, 2.0)
    drive, tolerance_s = Drive(cycles, steps, dwell_s, ramp_kpa_per_s, rate_hz, noise_kpa), log_uniform(rng, 0.02, 1.0)
    run = drive.run(rng)
    found = sampling_within(run.time_s, run.pressure_kpa, tolerance_s)
    error_s = abs(rng.choice(run.errors_s(found.every)))
    third = [drive.run(rng).errors_s(3 * found.every) for _ in range(REPEATS)]
    return [Answer(error_s, found.period_error_s, would_do(np.concatenate(third).tolist(), tolerance_s))]


METHODS: dict[str, Method] = {
    "tracer": of_tracer, "posterior": of_posterior, "bootstrap": of_bootstrap, "mesh": of_mesh,
    "reduced": of_reduced, "segmentation": of_segmentation,
}  # fmt: skip


def measured(method: Method, scenes: int, seed: int = 0, seconds: float = np.inf) -> tuple[list[Answer], int]:
    """Return the outcomes of random scenes, and how many were refused.

    Parameters
    ----------
    method, scenes : what is computed, and how often.
    seconds : after which no further scene is begun.
    """
    found: list[Answer] = []
    refused, end = 0, time.monotonic() + seconds
    for number in range(scenes):
        if time.monotonic() > end:
            break
        try:
            found += method(np.random.default_rng((seed, number)))
        except (RequestError, ConvergenceError):
            refused += 1
    return found, refused


def share_within(outcomes: list[Answer]) -> float:
    """Return the share of the scenes whose true error is within the stated one."""
    return float(np.mean([each.error <= each.stated + 1e-9 for each in outcomes]))


def share_within_three(outcomes: list[Answer]) -> float:
    """Return the share of the scenes that no third of the cost would have done for; NaN where none was tried."""
    tried = [each.third_does for each in outcomes if each.third_does is not None]
    return float(np.mean(np.logical_not(tried))) if tried else float("nan")


def main() -> None:
    """Measure a method and print the shares as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("method", choices=METHODS)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=np.inf)
    chosen = parser.parse_args()
    outcomes, refused = measured(METHODS[chosen.method], chosen.scenes, chosen.seed, chosen.seconds)
    ratios = [each.error / max(each.stated, 1e-9) for each in outcomes]
    quantiles = {f"{share:g}": float(np.quantile(ratios, share)) for share in (0.5, 0.9, 0.95, 0.99)}
    print(json.dumps({
        "method": chosen.method, "seed": chosen.seed, "answers": len(outcomes), "refused": refused,
        "within": share_within(outcomes), "cost_within_three": finite(share_within_three(outcomes)),
        "error_over_stated": quantiles,
    }))  # fmt: skip


if __name__ == "__main__":
    main()
