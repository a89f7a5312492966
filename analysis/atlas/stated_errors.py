"""What the adversary searches: by method, the numbers of a scene, and its true error over the stated one (k = 2).

Rules: a ratio is the root mean square over the repeats of a scene with other random numbers (turns of a fan, noise,
draws), at the worst place where there are several; 1 means that the true standard deviation is twice the stated one.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from analysis.atlas.calibration import ReadSession
from analysis.atlas.coverage import limits_of, recorded
from analysis.atlas.drives import Drive
from analysis.atlas.runs import Stairs
from analysis.calibration.posterior import KEPT_SAMPLES, sample_posterior
from analysis.figures.pipeline import analyse
from analysis.figures.sensor_analysis import Options
from analysis.optics.scene.curves import default_curves, frames_of, parametric_curves
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import PAPER_RAYS, By, Design, Waveguide, light_by
from analysis.optics.sweep.figure_of_merit import FLOOR, merit, p_bounds
from analysis.optics.tracer.simulation import TraceResult, trace
from analysis.optics.tracer.tolerance import stated_error
from analysis.segmentation.stroke_sampling import sampling_within
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import build_table
from analysis.shadow.model.tolerance import ALONG, ORDER, TABLES, error_estimate, on_mesh, reduced_error_mm
from analysis.stopping.accuracy import POINTS, accuracy_of, greatest_band_error, in_mm

TURNS, SESSIONS, RESPONSES, CHAINS, DRIVES = 6, 12, 500, 3, 6
MISSED = 100.0
"""Ratio of a run whose strokes are missed."""
_REFERENCE_RAYS = {"count": 40_000, "power": 20_000}
_REFERENCE_RESAMPLES, _PLACES = 4_000, 21


@dataclass(frozen=True, slots=True)
class Objective:
    """What is searched: the bounds of a scene's numbers, and its ratio; a scene that is refused has none.

    Above the ratio `most` a scene is a find. It is above 1 where what one answer cannot show is known to be missed.
    """

    bounds: Mapping[str, tuple[float, float]]
    ratio: Callable[[Mapping[str, float], np.random.Generator], float]
    most: float = 1.0


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@cache
def _frames(paper: bool, thickness_mm: float) -> tuple[SceneFrame, ...]:
    """Return the states of a guide; its thickness is rounded, so that few are built."""
    curves = default_curves() if paper else parametric_curves()
    return tuple(frames_of(curves, Waveguide(thickness_mm=thickness_mm)))


def tracer_ratio(scene: Mapping[str, float], rng: np.random.Generator, by: By, *, even: bool = False) -> float:
    """Return the error of a count, or power, by the rays of a scene over the stated one, over random places of rays.

    Parameters
    ----------
    even : over turns of an even fan, which no tolerance chooses.
    """
    thickness = round(scene["thickness_mm"], 1)
    guide = Waveguide(thickness_mm=thickness, index=scene["index"])
    design = Design(round(scene["cavities"]), scene["width_mm"], scene["depth_mm"], scene["spacing_mm"])
    frame = _frames(scene["curves"] < 0.5, thickness)[round(scene["state"])]
    light = light_by(by, round(np.exp(scene["log_rays"])))

    def response(result: TraceResult) -> tuple[float, float]:
        return (
            (result.ndr, result.ndr_sd) if by == "count" else (PAPER_RAYS * result.power, PAPER_RAYS * result.power_sd)
        )

    truth, _ = response(trace(frame, design, guide, light_by(by, _REFERENCE_RAYS[by]), threads=1))
    ratios = []
    for _ in range(TURNS):
        other = replace(light, phase=0.0, jitter=int(rng.integers(1 << 30)))
        if even:
            other = replace(light, phase=float(rng.uniform(-0.5, 0.5)))
        found, sd = response(trace(frame, design, guide, other, threads=1))
        ratios.append((found - truth) / float(stated_error(sd, light.rays)))
    return _rms(ratios)


def mesh_ratio(scene: Mapping[str, float], _: np.random.Generator) -> float:
    """Return the greatest error of an elongation over the stated one, of all meshes but the first and the last."""
    known: dict[int, float] = {}
    stated = []
    for along in ALONG:
        solver = FullModel(on_mesh(_actuator(scene), along)).solver
        known[along] = solver.solve(pressure_kpa=scene["pressure_kpa"]).elongation_mm
        if len(known) > 1:
            stated.append(error_estimate(known))
    last, finest = ALONG[-2:]
    truth = known[finest] + (known[finest] - known[last]) / ((finest / last) ** ORDER - 1.0)
    found = [abs(known[along] - truth) / error for along, error in zip(ALONG[1:-1], stated[:-1], strict=True)]
    return float(max(found))


def reduced_ratio(scene: Mapping[str, float], _: np.random.Generator) -> float:
    """Return the error of a state of a small table over the one that its residual states."""
    actuator = replace(_actuator(scene), axial_elements=6, wall_elements=2, lattice_elements=3)
    shadow = Shadow(actuator, build_table(actuator, TableSettings(*TABLES[round(scene["table"])], 1)))
    (p0, p1), (q0, q1) = shadow.table.pressure_range_kpa, shadow.table.elongation_range_mm
    p, q = float(p0 + (p1 - p0) * scene["pressure"]), float(q0 + (q1 - q0) * scene["elongation"])
    state, _used = shadow.solution(pressure_kpa=p, elongation_mm=q)
    full = shadow.model.solve(pressure_kpa=p, elongation_mm=q)
    away = shadow.model.guides.tracked.weights @ (full.displacement_mm - state.displacement_mm)
    return float(np.linalg.norm(away, axis=1).max()) / reduced_error_mm(shadow.model, state, p, q)


def _actuator(scene: Mapping[str, float]) -> ActuatorParameters:
    return replace(
        ActuatorParameters(), wall_modulus_kpa=scene["wall_modulus_kpa"], neck_radius_mm=scene["neck_radius_mm"],
        wall_mm=scene["wall_mm"], belly_radius_mm=scene["belly_radius_mm"],
    )  # fmt: skip


def fit_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return the error of a fitted cubic over U, at its worst place, over sessions of readings."""
    session = ReadSession(
        round(scene["grid_mm"], 3), loop_mv=scene["loop_mv"], noise_mv=float(np.exp(scene["log_noise_mv"])),
        levels=round(scene["levels"]), cycles=round(scene["cycles"]), actuator_mm=scene["actuator_mm"],
    )  # fmt: skip
    ratios = []
    for seed in rng.integers(1 << 30, size=SESSIONS):
        fit = replace(session, seed=int(seed)).calibration()
        at = np.linspace(*fit.x_range, _PLACES)
        ratios.append((fit.predict(at) - session.signal(at)) / fit.expanded_u(at))
    return float(np.max(np.sqrt(np.mean(np.square(ratios), axis=0))))


def posterior_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return the error of the band by its draws over the stated one, mm; the true band is Student's."""
    x = np.linspace(-2.5, 3.5, round(scene["levels"])).repeat(round(scene["cycles"]))
    curve = np.polynomial.polynomial.polyval(x, [0.0, 20.0, scene["bend"], scene["twist"]])
    ratios = []
    for seed in rng.integers(1 << 30, size=CHAINS):
        y = curve + rng.normal(0.0, np.exp(scene["log_noise_mv"]), x.size)
        found = sample_posterior(x, y, round(scene["degree"]), samples=KEPT_SAMPLES // 2, seed=int(seed))
        at = np.linspace(*found.calibration.x_range, POINTS)
        away = np.array(found.curve_band(at)) - np.array(found.calibration.band(at, 0.95))
        stated = greatest_band_error([found], "mm")
        ratios.append(float(np.abs(in_mm(found.calibration, at, away)).max()) / stated)
    return _rms(ratios)


def bootstrap_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return the error of the intervals' limits by few resamples over the stated one, over resamplings of one run."""
    run = Stairs(
        cycles=round(scene["cycles"]), rate_hz=15.0, dwell_s=1.0, noise_mv=float(np.exp(scene["log_noise_mv"])),
        bulge_percent=scene["bulge_percent"], bulge_at=scene["bulge_at"], seed=int(rng.integers(1 << 30)),
    )  # fmt: skip
    options = Options(mcmc=False, x_resolution_mm=0.0)
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        recording, file = recorded((run,), scene["reading_sd_mm"], rng, Path(folder))
        truth = analyse(recording, file, options=replace(options, resamples=_REFERENCE_RESAMPLES))
        limits = limits_of(truth)
        for seed in rng.integers(1 << 30, size=CHAINS):
            few = replace(options, resamples=round(np.exp(scene["log_resamples"])), seed=int(seed))
            found = analyse(recording, file, options=few)
            away = [np.subtract(each, limits[key]) for key, each in limits_of(found).items() if key in limits]
            stated = accuracy_of(found).intervals_percent_fso
            ratios.append(np.abs(away).max() / np.hypot(stated, accuracy_of(truth).intervals_percent_fso))
    return _rms(ratios)


def segmentation_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return the error of periods by as few samples as a tolerance takes over the stated one, over runs of a drive."""
    drive = Drive(
        round(scene["cycles"]), round(scene["steps"]), scene["dwell_s"], float(np.exp(scene["log_ramp_kpa_per_s"])),
        float(np.exp(scene["log_rate_hz"])), float(np.exp(scene["log_noise_kpa"])),
    )  # fmt: skip
    ratios = []
    for _ in range(DRIVES):
        run = drive.run(rng)
        found = sampling_within(run.time_s, run.pressure_kpa, float(np.exp(scene["log_tolerance_s"])))
        ratios.append(min(_rms(run.errors_s(found.every).tolist()) / found.period_error_s, MISSED))
    return _rms(ratios)


def bounds_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return how often a bound of P fails over the stated probability, the worse of both bounds."""
    states, error = np.arange(15.0), 0.04
    waves = (np.sin(scene["turns"] * states + shift) for shift in (0.0, 1.3))
    truth = 100.0 - scene["slope"] * states + scene["wave"] * next(waves)
    sd = np.exp(scene["log_sd"] + scene["unequal"] * next(waves))
    noisy = truth + sd * rng.standard_normal((RESPONSES, states.size))
    low, high = p_bounds(noisy, np.broadcast_to(sd, noisy.shape), FLOOR, low_error=error, high_error=error)
    p = float(merit(truth, FLOOR).p)
    return float(max(np.mean(low > p), np.mean(high < p))) / error


_OPTICS = {
    "cavities": (0.0, 9.0), "width_mm": (0.1, 1.5), "depth_mm": (0.05, 1.4), "spacing_mm": (0.1, 1.5),
    "index": (1.3, 1.7), "thickness_mm": (1.5, 2.5), "state": (0.0, 14.0), "curves": (0.0, 1.0),
    "log_rays": (np.log(100), np.log(4_000)),
}  # fmt: skip
_ACTUATOR = {
    "wall_modulus_kpa": (600.0, 2_500.0), "neck_radius_mm": (3.0, 5.5), "wall_mm": (1.6, 2.8),
    "belly_radius_mm": (6.5, 8.5),
}  # fmt: skip
OBJECTIVES = {
    "tracer": Objective(_OPTICS, lambda scene, rng: tracer_ratio(scene, rng, "count")),
    "power": Objective(_OPTICS, lambda scene, rng: tracer_ratio(scene, rng, "power")),
    "race": Objective(
        {
            "slope": (0.0, 4.0), "wave": (0.0, 4.0), "turns": (0.0, 3.0), "log_sd": (np.log(0.01), np.log(2.0)),
            "unequal": (0.0, 1.0),
        },
        bounds_ratio,
        most=1.25,
    ),
    "mesh": Objective({**_ACTUATOR, "pressure_kpa": (-30.0, 50.0)}, mesh_ratio, most=2.25),
    "reduced": Objective(
        {**_ACTUATOR, "table": (0.0, 3.0), "pressure": (0.0, 1.0), "elongation": (0.0, 1.0)}, reduced_ratio, most=1.05
    ),
    "fit": Objective(
        {
            "levels": (6.0, 20.0), "cycles": (2.0, 8.0), "log_noise_mv": (np.log(0.01), np.log(3.0)),
            "grid_mm": (0.0, 0.5), "loop_mv": (0.0, 3.0), "actuator_mm": (0.0, 0.5),
        },
        fit_ratio,
    ),
    "posterior": Objective(
        {
            "levels": (8.0, 14.0), "cycles": (2.0, 7.0), "degree": (1.0, 4.0),
            "log_noise_mv": (np.log(0.3), np.log(6.0)), "bend": (-4.0, 4.0), "twist": (-0.6, 0.6),
        },
        posterior_ratio,
    ),
    "bootstrap": Objective(
        {
            "cycles": (2.0, 12.0), "log_noise_mv": (np.log(0.2), np.log(5.0)), "bulge_percent": (0.0, 8.0),
            "bulge_at": (0.3, 0.7), "reading_sd_mm": (0.0, 0.1), "log_resamples": (np.log(100), np.log(1_000)),
        },
        bootstrap_ratio,
    ),
    "segmentation": Objective(
        {
            "cycles": (5.0, 15.0), "steps": (1.0, 9.0), "dwell_s": (0.0, 3.0),
            "log_ramp_kpa_per_s": (np.log(3.0), np.log(60.0)), "log_rate_hz": (np.log(10.0), np.log(200.0)),
            "log_noise_kpa": (np.log(0.01), np.log(2.0)), "log_tolerance_s": (np.log(0.02), np.log(1.0)),
        },
        segmentation_ratio,
    ),
}  # fmt: skip
