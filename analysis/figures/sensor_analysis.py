"""One sensor of a run: its calibration, its posterior, its figures.

Every figure is a function of its own in `curve_figures`, `loop_figures`, `noise_figures` or `cycle_figures`; this
module hands each what it needs. Figures of the calibration rest on the plateaus whose elongation was read, the others
on all plateaus or cycles that are used; above the limit of lost samples a figure is void.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from analysis.calibration.adequacy import Adequacy, CurveVerdict, judge_curve
from analysis.calibration.checks import fit_checks
from analysis.calibration.curve_choice import AUTO, SPLINE, USUAL_DEGREE, Degree
from analysis.calibration.fit import Calibration, fit_by_branch
from analysis.calibration.joint_fit import (
    WIDTH_DRAWS,
    JointFit,
    LoopEstimate,
    PolynomialBasis,
    PositionMeans,
    fit_of_best_loop,
    greatest_loop_width,
    joint_fit,
    loop_is_represented,
)
from analysis.calibration.posterior import Posterior, sample_calibration
from analysis.calibration.quantised_x import common_variance
from analysis.calibration.type_b import TypeBContribution
from analysis.data.recording import Recording
from analysis.fidelity import Level, fidelity
from analysis.figures.across_breaks import Break, of_cycles
from analysis.figures.curve_figures import CURVE_POINTS, curve_figures, draw_joint, lack_of_fit, resample_fit
from analysis.figures.cycle_figures import FiguresByCycle, Trend, drift, figures_by_cycle, repeatability
from analysis.figures.figure import (
    KEY_FIGURES,
    SENSOR_FIGURES,
    Figure,
    Figures,
    Reason,
    marked_implausible,
    not_driven,
    summary_html,
)
from analysis.figures.intervals import combined_error, unsettled, with_full_scale, with_reach, with_shared_error
from analysis.figures.loop_figures import (
    hysteresis,
    joint_hysteresis,
    limited,
    loop_made_by_noise,
    pressure_full_scale,
    pressure_nonlinearity,
    sensor_loop_width,
    with_what_lies_between,
)
from analysis.figures.noise_figures import continuous_noise, moving_noise, noise_and_snr, staircase_noise
from analysis.progress import Progress, part_of
from analysis.segmentation.ambient_light import ambient_in_means
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.influence import ChannelInfluence, influences
from analysis.segmentation.loops import (
    MAX_DAMAGED_CYCLE,
    Loops,
    LoopWidth,
    cluster_levels,
    continuous_loops,
    staircase_loops,
    width_of_loops,
)
from analysis.segmentation.losses import LossCounter, Losses
from analysis.segmentation.plateau_readings import Elongations
from analysis.segmentation.plateaus import Plateau, PlateauSettings
from analysis.segmentation.settling import Settling, settling_of
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import BoatDaqError, DataError

OF_POINTS = (  # figures of the calibration's points; the others are those of the loops
    "sensitivity_mv_per_mm", "slope_at_rest_mv_per_mm", "least_squares_slope_mv_per_mm",
    "sensor_hysteresis_percent_fso", "lack_of_fit_percent_fso",
)  # fmt: skip


_OWN_LOOP = "sensor_hysteresis_percent_fso"
_LACK_OF_FIT = "lack_of_fit_percent_fso"  # a verdict on the curve, at the dwell or at rest
ACTUATOR_DEGREE, ACTUATOR_LOOP_TERMS = 3, 4
MOST_RESAMPLES = 200_000  # more take gigabytes, and change no digit that is printed


@dataclass(frozen=True, slots=True)
class Options:
    """How a run is analysed."""

    degree: Degree = USUAL_DEGREE  # auto: the curve that predicts best, see `calibration.adequacy`
    x_resolution_mm: float | None = None  # grid of the readings; None infers it from their own steps
    monotone: bool = False  # only monotone curves in the posterior
    seed: int = 0
    mcmc: bool = True
    plateau: PlateauSettings = field(default_factory=PlateauSettings)
    fidelity: Level = "normal"
    leave_out: bool = False  # leave out readings whose points are off the curve, each with a warning
    type_b: tuple[TypeBContribution, ...] = ()  # contributions that no run shows
    resamples: int | None = None  # in place of the precision's, as the next
    posterior_samples: int | None = None


@dataclass(frozen=True, slots=True, repr=False)
class SensorAnalysis:
    """What is known of one sensor; `calibration_void` says why there is no calibration.

    The hysteresis per cycle is in % FSO over elongation (sensor) and over pressure (system), as are the mean loops;
    `drift_mv` is the significant drift over the run; `point_plateau` the plateau of each point, counted from 0;
    `joint_loop` is None if the loop is read from the points.
    """

    name: str
    calibration: Calibration | None
    calibration_void: str
    posterior: Posterior | None
    figures: Mapping[str, Figure]
    sensor_hysteresis_per_cycle: tuple[float, ...]
    system_hysteresis_per_cycle: tuple[float, ...]
    point_plateau: FloatArray
    system_loop: LoopWidth
    sensor_loop: LoopWidth | None
    by_cycle: FiguresByCycle
    checks: Mapping[str, Any] | None
    settling: Settling
    drift_mv: float
    joint_loop: JointFit | None = None
    influences: tuple[ChannelInfluence, ...] = ()
    simulated: bool = False

    def __repr__(self) -> str:
        lines = [f"  {SENSOR_FIGURES[key].label}: {self.figures[key]!r}" for key in KEY_FIGURES if key in self.figures]
        curve = f"  {self.calibration!r}" if self.calibration else f"  no calibration: {self.calibration_void}"
        return "\n".join([f"<{self._heading}", *lines, curve]) + ">"

    def _repr_html_(self) -> str:
        return summary_html(self._heading, [self], {}, ()) + (
            self.calibration._repr_html_() if self.calibration else ""
        )

    @property
    def _heading(self) -> str:
        return f"Sensor {self.name}{': SIMULATED' if self.simulated else ''}"

    def as_json(self) -> dict[str, Any]:
        """Return the sensor's object of `analyze --json`."""
        figures = self.figures
        system = {
            "abscissa": "pressure_kpa",
            "mean": figures["system_hysteresis_percent_fso"].value,
            "per_cycle": list(self.system_hysteresis_per_cycle),
        }
        hysteresis = system
        if self.calibration is not None:
            mean, per_cycle = figures["sensor_hysteresis_percent_fso"].value, list(self.sensor_hysteresis_per_cycle)
            hysteresis = {"abscissa": "elongation_mm", "mean": mean, "per_cycle": per_cycle}
        plain = {name: figure.value for name, figure in figures.items() if "hysteresis" not in name}
        plain.setdefault("sensitivity_mv_per_mm", float("nan"))
        return {
            "name": self.name,
            "calibration": self.calibration.as_json() if self.calibration else None,
            "calibration_void": self.calibration_void if self.calibration is None else "",
            "posterior": self.posterior.as_json() if self.posterior else None,
            **plain,
            "hysteresis_percent_fso": hysteresis,
            "system_hysteresis_percent_fso": system,
            "figures": {name: figure.as_json() for name, figure in figures.items()},
            "adequacy": self.checks["adequacy"] if self.checks is not None else None,
            "checks": dict(self.checks) if self.checks is not None else None,
            "settling": self.settling.as_json(),
            "influences": [influence.as_json() for influence in self.influences],
        }


@dataclass(frozen=True, slots=True)
class SegmentedRun:
    """A run cut into cycles, plateaus and loops: what every figure is computed from.

    `weights` are [resamples, cycles] of the bootstrap, `ambient_mv` [sensors, plateaus] the error by ambient light in
    every cycle alike (`segmentation.ambient_light`).
    """

    recording: Recording
    options: Options
    cycles: Cycles
    plateaus: tuple[Plateau, ...]
    elongations: Elongations | None
    loops: Loops
    weights: FloatArray
    breaks: tuple[Break, ...]
    ambient_mv: FloatArray

    @property
    def reading_sd_mm(self) -> float:
        """Standard deviation of a reading within its grid, mm."""
        resolution = self.options.x_resolution_mm
        if resolution is None:
            resolution = self.elongations.resolution_mm if self.elongations else 0.0
        return float(resolution / np.sqrt(12.0))

    def calibration_points(self, sensor: int) -> BoolArray:
        """[plateaus] True for plateaus of complete cycles whose elongation was read and that are not void."""
        used = set(self.loops.numbers)
        inside = np.asarray(
            [p.cycle in used and not p.void and np.isfinite(p.signal_mv[sensor]) for p in self.plateaus], dtype=bool
        )
        return inside & self.elongations.known if self.elongations is not None else np.zeros_like(inside)

    def with_ambient(self) -> SegmentedRun:
        """Return the run with what ambient light does to the cycles of its loops."""
        numbers = set(self.loops.numbers)
        used = np.asarray([i for i, p in enumerate(self.plateaus) if p.cycle in numbers and not p.void], dtype=np.int64)
        return replace(self, ambient_mv=ambient_in_means(self.recording, self.plateaus, used, self.position_of(used)))

    def ambient_sd_mv(self, sensor: int) -> float:
        """Return the rms of the error by ambient light over the plateaus, mV; sensors count from 0."""
        moved = self.ambient_mv[sensor][self.ambient_mv[sensor] != 0.0]
        return float(np.sqrt(np.mean(moved**2))) if moved.size else 0.0

    def with_elongations(self, elongations: Elongations) -> SegmentedRun:
        """Return the run with other readings; its loops keep their cycles."""
        whole = staircase_loops(self.plateaus, self.cycles, elongations.elongation_mm, self.recording.n_sensors)
        return replace(self, elongations=elongations, loops=of_cycles(whole, self.loops.numbers))

    def with_change(self, sensor: int, change_mv: FloatArray) -> SegmentedRun:
        """Return the run with a change of a sensor's signal at each plateau, [plateaus]; sensors count from 0."""

        def changed(plateau: Plateau, by_mv: float) -> Plateau:
            signal = plateau.signal_mv
            return replace(plateau, signal_mv=(*signal[:sensor], signal[sensor] + by_mv, *signal[sensor + 1 :]))

        plateaus = tuple(map(changed, self.plateaus, change_mv.tolist()))
        x = self.elongations.elongation_mm if self.elongations is not None else None
        whole = staircase_loops(plateaus, self.cycles, x, self.recording.n_sensors)
        return replace(self, plateaus=plateaus, loops=of_cycles(whole, self.loops.numbers))

    def trend(self, sensor: int) -> Trend:
        """Return the significant drift of a sensor's signal over time."""
        cycles = {cycle.number: cycle for cycle in self.cycles.used}
        time_s = [float(np.mean(self.recording.time_s[cycles[number].rows])) for number in self.loops.numbers]
        return Trend.of(self.loops, sensor, np.asarray(time_s))

    def without(self, trend: Trend, sensor: int) -> SegmentedRun:
        """Return the run without a drift of a sensor's signal, its value in the middle of the run kept."""
        if not trend.slope:
            return self
        if self.plateaus:
            middle = np.asarray([0.5 * (p.start_s + p.end_s) for p in self.plateaus])
            used = [p.cycle in self.loops.numbers for p in self.plateaus]
            return self.with_change(sensor, -trend.slope * (middle - middle[used].mean()))
        rows = [cycle.rows for cycle in self.cycles.used if cycle.number in self.loops.numbers]
        time_s, signal = self.recording.time_s, self.recording.signal_mv.copy()
        signal[:, sensor] -= trend.slope * (time_s - np.mean([time_s[each].mean() for each in rows]))
        whole = continuous_loops(replace(self.recording, signal_mv=signal), self.cycles)
        return replace(self, loops=of_cycles(whole, self.loops.numbers))

    def settling(self, sensor: int) -> Settling:
        """Test whether the holds of the used cycles are settled."""
        chosen = set(self.loops.numbers)
        used = np.asarray(
            [i for i, p in enumerate(self.plateaus)
             if p.cycle in chosen and p.branch in ("loading", "unloading") and np.isfinite(p.signal_mv[sensor])],
            dtype=np.int64,
        )  # fmt: skip
        return settling_of(self.recording, self.plateaus, sensor, used, self.position_of(used))

    def branch_of(self, points: np.ndarray[Any, Any]) -> FloatArray:
        """[points] 1 loading, -1 unloading, 0 at the end levels, which both branches share."""
        level, count = self._levels
        names = np.asarray([p.branch for p in self.plateaus])
        inner = (level > 0) & (level < count - 1)
        branch: FloatArray = np.where(inner, np.where(names == "loading", 1.0, -1.0), 0.0)[points]
        return branch

    def position_of(self, points: np.ndarray[Any, Any]) -> FloatArray:
        """[points] number of the position of each plateau: its level and its branch, read once a cycle."""
        position: FloatArray = 2.0 * self._levels[0][points] + (self.branch_of(points) > 0)
        return position

    @property
    def _levels(self) -> tuple[FloatArray, int]:
        """[plateaus] number of the level of each among those of the used cycles, and their count."""
        used = set(self.loops.numbers)
        pressure = np.asarray([p.pressure_kpa if p.cycle in used else np.nan for p in self.plateaus])
        levels, of_plateau = cluster_levels(pressure)
        return of_plateau.astype(np.float64), levels.size


@dataclass(frozen=True, slots=True)
class AnalysedRun(SegmentedRun):
    """A segmented run with its sensors analysed."""

    sensors: tuple[SensorAnalysis, ...]


def analyse_sensor(run: SegmentedRun, sensor: int, *, progress: Progress | None = None) -> SensorAnalysis:
    """Compute every figure of a sensor, counted from 0; `progress` is that of its posterior, then of all."""
    calibration, posterior, reason = None, None, ""
    trend, raw = run.trend(sensor), run
    run = run.without(trend, sensor)
    points = np.flatnonzero(run.calibration_points(sensor))
    try:
        calibration = replace(_calibrate(run, sensor, points), simulated=run.recording.simulated)
        posterior = _sampled(run, sensor, calibration, points, progress)
    except BoatDaqError as error:
        reason = error.cause
    settling = run.settling(sensor)
    drawn, system, own = _drawn(run, sensor, calibration, points, trend)
    if not settling.settled:
        drawn = _with_rest(run, sensor, drawn, calibration, settling)
    drawn |= _over_cycles(raw, sensor, drawn)
    fso, figures = drawn["fso_mv"].value, _usable(run, sensor, drawn)
    if progress is not None:
        progress(1, 1)
    return SensorAnalysis(
        run.recording.sensor_names[sensor], calibration, reason, posterior, Figures(figures),
        _percent(own.per_cycle, fso) if own is not None else (), _percent(system.per_cycle, fso),
        points.astype(np.float64), system, own,
        figures_by_cycle(raw.loops, sensor, figures["fso_mv"].value, system, _noise(run, sensor)),
        _checks(calibration, _cycle_of(run, points)) if calibration is not None else None,
        settling, trend.slope * float(raw.recording.duration_s),
        _joint_loop(calibration.adequacy) if calibration is not None else None,
        influences(
            raw.recording, raw.cycles, raw.plateaus, raw.loops, sensor, fso_mv=fso,
            sensitivity_mv_per_mm=figures["sensitivity_mv_per_mm"].value if calibration is not None else float("nan"),
        ),
        run.recording.simulated,
    )  # fmt: skip


def _with_rest(
    run: SegmentedRun, sensor: int, figures: dict[str, Figure], calibration: Calibration | None, settling: Settling
) -> dict[str, Figure]:
    """Return figures of holds that are not settled: of their dwell, with intervals that hold those at rest.

    A loop that is reversed by what is left of the creep may be zero at rest.
    """
    at_rest = run.with_change(sensor, settling.remaining_mv)
    points = np.flatnonzero(at_rest.calibration_points(sensor))
    rested = None
    with suppress(BoatDaqError):  # a run without a calibration has none at rest either
        rested = _calibrate(at_rest, sensor, points)
    rest = _drawn(at_rest, sensor, rested, points, Trend())[0]
    loops = [_joint_loop(one.adequacy) for one in (calibration, rested) if one is not None]
    if len(known := [loop for loop in loops if loop is not None]) == 2 and known[0].loop[0] * known[1].loop[0] < 0.0:
        rest[_OWN_LOOP] = replace(rest[_OWN_LOOP], low=0.0)
    held = settling.held_s
    return {k: f if k == _LACK_OF_FIT else unsettled(f, rest.get(k, f), held) for k, f in figures.items()}


def _sampled(
    run: SegmentedRun, sensor: int, calibration: Calibration, points: IntArray, progress: Progress | None
) -> Posterior | None:
    """Return the posterior of a calibration, where it is sampled."""
    if not run.options.mcmc or calibration.spline is not None:
        return None
    fineness = fidelity(run.options.fidelity)
    return sample_calibration(
        calibration, run.position_of(points), run.branch_of(points), reading_sd=run.reading_sd_mm,
        monotone=run.options.monotone, seed=run.options.seed + sensor,
        walkers=fineness.walkers, samples=run.options.posterior_samples or fineness.posterior_samples,
        progress=part_of(progress, 0, 4, 5),
    )  # fmt: skip


def _cycle_of(run: SegmentedRun, points: IntArray) -> FloatArray:
    position = {number: k for k, number in enumerate(run.loops.numbers)}
    return np.asarray([position[run.plateaus[i].cycle] for i in points], dtype=np.float64)


def _drawn(
    run: SegmentedRun, sensor: int, calibration: Calibration | None, points: IntArray, trend: Trend
) -> tuple[dict[str, Figure], LoopWidth, LoopWidth | None]:
    """Return the figures of a sensor, and the widths of its loops over pressure and over elongation.

    `trend` was taken out of the run: between the branches lies half a cycle, for which its error counts.
    """
    adequacy = calibration.adequacy if calibration is not None else None
    if calibration is not None:
        figures = _curve_figures(run, calibration, adequacy, _cycle_of(run, points))
    else:
        over_pressure = pressure_full_scale(run.loops, sensor, run.weights)
        figures = {"fso_mv": with_shared_error(over_pressure, run.ambient_sd_mv(sensor))}
    fso = figures["fso_mv"].value
    system = width_of_loops(run.loops, run.loops.pressure_kpa, run.loops.signal_mv[sensor], run.weights)
    own = None
    if run.loops.elongation_mm is not None:
        own = sensor_loop_width(run.loops, sensor, calibration, run.weights)
    loops_figures = _loop_figures(run, sensor, calibration, fso, (system, own), _noise(run, sensor))
    joint = _joint_loop(adequacy)
    if own is not None and joint is not None:
        rng = np.random.default_rng((run.options.seed, 2))
        estimate = greatest_loop_width(joint, rng, max(WIDTH_DRAWS, run.weights.shape[0] // 4))
        figure = joint_hysteresis(estimate, own, fso, run.loops.n_cycles)
        loops_figures[_OWN_LOOP] = figure
    if trend.slope and fso > 0:
        half_s = 0.5 * float(np.median([np.ptp(run.recording.time_s[c.rows]) for c in run.cycles.used]))
        reach = 100.0 / fso * trend.reach * half_s
        loops_figures |= {k: with_reach(f, reach) for k, f in loops_figures.items() if "hysteresis" in k}
    if calibration is not None:  # else the full scale is of the same samples, and in their bootstrap already
        loops_figures = {name: with_full_scale(f, figures["fso_mv"]) for name, f in loops_figures.items()}
    return loops_figures | figures, system, own


def _over_cycles(run: SegmentedRun, sensor: int, figures: Mapping[str, Figure]) -> dict[str, Figure]:
    """Return the figures over cycles, of the run with its drift, and the combined error; `figures` are the others."""
    fso = figures["fso_mv"]
    found = repeatability(run.loops, sensor, fso.value, run.weights, figures["noise_mv"].value)
    found["drift_percent_fso_per_100_cycles"] = drift(run.loops, sensor, fso.value)
    calibrated = "sensitivity_mv_per_mm" in figures
    if calibrated:  # else the full scale is of the same samples, and in their bootstrap already
        found = {name: with_full_scale(f, fso) for name, f in found.items()}
    loop = "sensor_hysteresis_percent_fso" if calibrated else "system_hysteresis_percent_fso"
    parts = [figures["nonlinearity_percent_fso"], figures[loop], found["repeatability_percent_fso"]]
    return found | {"combined_error_percent_fso": combined_error(parts)}


def _usable(run: SegmentedRun, sensor: int, figures: Mapping[str, Figure]) -> dict[str, Figure]:
    return not_driven(marked_implausible(with_losses(run, sensor, figures)), run.cycles.void)


def with_curve(run: AnalysedRun, sensor: int, degree: Degree) -> AnalysedRun:
    """Return the run with another curve of a sensor, and the figures of the one before; may raise DataError."""
    run, before = replace(run, options=replace(run.options, degree=degree)), run.sensors[sensor]
    calibration = _calibrate(run.without(run.trend(sensor), sensor), sensor, before.point_plateau.astype(np.int64))
    changed = replace(before, calibration=calibration, joint_loop=_joint_loop(calibration.adequacy))
    return replace(run, sensors=(*run.sensors[:sensor], changed, *run.sensors[sensor + 1 :]))


def _joint_loop(adequacy: Adequacy | None) -> JointFit | None:
    """Return the fit whose loop is that of the sensor; None where it does not represent the loop."""
    return adequacy.reference if adequacy is not None and loop_is_represented(adequacy.reference) else None


@dataclass(frozen=True, slots=True)
class ActuatorLoop:
    """The joint fit of elongation over pressure, and its greatest width, mm."""

    fit: JointFit
    estimate: LoopEstimate


def actuator_loop(run: SegmentedRun, sensors: Sequence[SensorAnalysis]) -> ActuatorLoop | None:
    """Fit the actuator's loop, x over p, to the means of the positions that a calibration rests on.

    The polygon through the plateaus misses the maximum between two of them; the loop of the fit does not. None if no
    calibration has a joint fit, or the positions do not carry the loop.
    """
    fitted = next((s for s in sensors if s.calibration is not None and s.calibration.joint is not None), None)
    if fitted is None:
        return None
    assert fitted.calibration is not None
    assert fitted.calibration.joint is not None
    read, means = fitted.calibration, fitted.calibration.joint.means
    points = fitted.point_plateau.astype(np.int64)
    _, of_point = np.unique(run.position_of(points), return_inverse=True)
    count = np.bincount(of_point)
    pressure = np.bincount(of_point, np.asarray([run.plateaus[i].pressure_kpa for i in points])) / count
    scatter = float(((read.x - means.x[of_point]) ** 2).sum()) / means.dof if means.dof > 0 else 0.0
    shared = common_variance(read.reading.reader_sd, read.reading.grid) if read.reading is not None else 0.0
    none = np.zeros(count.size)
    over_pressure = PositionMeans(pressure, means.x, means.branch, none, scatter / count + shared, means.dof)
    try:
        basis = judge_curve(joint_fit(over_pressure, PolynomialBasis(ACTUATOR_DEGREE))).preferred.fit.basis
    except DataError:
        return None
    fit = fit_of_best_loop(over_pressure, basis, ACTUATOR_LOOP_TERMS)
    return (
        None
        if fit is None
        else ActuatorLoop(fit, greatest_loop_width(fit, np.random.default_rng((run.options.seed, 3))))
    )


def _curve_figures(
    run: SegmentedRun, calibration: Calibration, adequacy: Adequacy | None, cycle_of: FloatArray
) -> dict[str, Figure]:
    rng = np.random.default_rng((run.options.seed, 1))
    if adequacy is None:
        figures = curve_figures(resample_fit(calibration, cycle_of, run.weights, rng))
        return {**figures, "lack_of_fit_percent_fso": lack_of_fit(None, calibration.n)}
    fits = [adequacy.chosen] + ([adequacy.reference] if adequacy.reference is not adequacy.chosen else [])
    count, verdict = run.weights.shape[0], "" if adequacy.verdict is CurveVerdict.ADEQUATE else str(adequacy.verdict)
    curves = [draw_joint(fit, calibration.x, run.loops.n_cycles, rng, count) for fit in fits]
    figures = curve_figures(*curves, verdict=verdict)
    return {**figures, "lack_of_fit_percent_fso": lack_of_fit(adequacy, calibration.n)}


def _checks(calibration: Calibration, cycle_of: FloatArray) -> dict[str, Any]:
    adequacy = calibration.adequacy
    return {**fit_checks(calibration, cycle_of), "adequacy": adequacy.as_json() if adequacy is not None else None}


def _noise(run: SegmentedRun, sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    if run.plateaus and not run.settling(sensor).settled:
        return moving_noise(run.plateaus, sensor, run.recording)
    if run.plateaus:
        return staircase_noise(run.plateaus, sensor)
    return continuous_noise(run.recording, run.cycles, sensor, run.recording.pressure_kpa)


def _percent(values: FloatArray, full_scale: float) -> tuple[float, ...]:
    """Return values in % of a full scale; none where it is zero."""
    return tuple((100.0 / full_scale * values).tolist()) if full_scale > 0 else ()


def _calibrate(run: SegmentedRun, sensor: int, points: np.ndarray[Any, Any]) -> Calibration:
    if run.elongations is None:
        raise DataError("no elongation was read", "Enter the readings, or give a file of them.")
    if not points.size:
        raise DataError("no plateau of a complete cycle has an elongation", "Record at least one whole cycle.")
    y = np.asarray([run.plateaus[i].signal_mv[sensor] for i in points])
    x, degree = run.elongations.elongation_mm[points], run.options.degree

    def fitted(of_degree: int | Literal["spline"]) -> Calibration:
        positions, branch = run.position_of(points), run.branch_of(points)
        return fit_by_branch(
            x, y, of_degree, positions=positions, branch=branch, reading_sd=run.reading_sd_mm,
            shared=run.ambient_mv[sensor][points],
        )  # fmt: skip

    if degree != AUTO:
        return fitted(degree)
    usual = fitted(USUAL_DEGREE)
    best = usual.adequacy.preferred.name if usual.adequacy is not None else usual.curve
    if best == usual.curve:
        return usual
    return fitted(SPLINE if best == SPLINE else int(best))


def _loop_figures(
    run: SegmentedRun,
    sensor: int,
    calibration: Calibration | None,
    fso: float,
    widths: tuple[LoopWidth, LoopWidth | None],
    noise: tuple[FloatArray, FloatArray, FloatArray],
) -> dict[str, Figure]:
    loops, (system, own) = run.loops, widths
    definition = "max over {} of |loading - unloading| / FSO, mean loop"
    over_pressure = hysteresis(system, fso, loops.n_cycles, definition.format("p"))
    figures = {
        "system_hysteresis_percent_fso": with_what_lies_between(
            over_pressure, loops.level_kpa, loops.signal_mv[sensor], fso
        )
    }
    if own is not None and loops.elongation_mm is not None:
        found = hysteresis(own, fso, loops.n_cycles, definition.format("x"))
        per_mm = _percent_per_mm(calibration, loops.elongation_mm)
        figures["sensor_hysteresis_percent_fso"] = limited_by_reading(found, run.reading_sd_mm, per_mm)
    if fso > 0:
        shared = 100.0 / fso * run.ambient_sd_mv(sensor)
        figures = {name: with_shared_error(figure, shared) for name, figure in figures.items()}
    usable = run.recording.signal_mv[run.recording.usable[:, sensor], sensor]
    rounding = 4.0 * float(np.spacing(np.abs(usable).max(initial=0.0)))
    figures["noise_mv"], figures["snr_db"] = noise_and_snr(noise, loops.numbers, fso, run.weights, rounding)
    by_noise = loop_made_by_noise(run.plateaus, loops, run.cycles, sensor, figures["noise_mv"].value)
    if 0 < fso < by_noise and not figures["snr_db"].void:
        note = f"the full-scale output of {fso:.2g} mV is no more than noise alone makes ({by_noise:.2g} mV)"
        figures["snr_db"] = replace(figures["snr_db"], note=note, reason=Reason.FULL_SCALE_IS_NOISE)
    for name in [name for name in figures if "hysteresis" in name]:
        figures[name] = limited(figures[name], 100.0 / fso * by_noise if fso > 0 else 0.0, "noise")
    figures["nonlinearity_percent_fso"] = pressure_nonlinearity(loops, sensor, fso, run.weights)
    return figures


def limited_by_reading(figure: Figure, reading_sd_mm: float, percent_per_mm: float) -> Figure:
    """Widen the interval of a loop, %, by the reading error of x, and mark an upper bound if that makes most of it.

    `percent_per_mm` is the slope at the steepest place. The largest of many differences of two readings comes near the
    grid's whole step (sqrt(12) sd) and lifts the maximum; the one at the loop's widest place may also hide it, within
    two sigma.
    """
    floor = np.sqrt(12.0) * reading_sd_mm * percent_per_mm
    hidden = 2.0 * np.sqrt(2.0) * reading_sd_mm * percent_per_mm
    figure = replace(figure, high=float(figure.value + np.hypot(figure.high - figure.value, hidden)))
    return limited(figure, float(floor), f"a reading error of {reading_sd_mm:.2f} mm", 0.5)


def _percent_per_mm(calibration: Calibration | None, elongation_mm: FloatArray) -> float:
    """Return the steepest slope of the fit in % of its full scale; without one, of the straight line; 0 if flat."""
    if calibration is not None and calibration.full_scale > 0:
        grid = np.linspace(*calibration.x_range, CURVE_POINTS)
        return 100.0 / calibration.full_scale * float(np.abs(calibration.slope(grid)).max())
    span = float(np.nanmax(elongation_mm) - np.nanmin(elongation_mm)) if np.isfinite(elongation_mm).any() else 0.0
    return 100.0 / span if span > 0 else 0.0


def with_losses(run: SegmentedRun, sensor: int, figures: Mapping[str, Figure]) -> dict[str, Figure]:
    """Return the figures with the losses of their windows; void above the limit, or where nothing is left."""
    counter, chosen = LossCounter.of(run.recording, sensor), set(run.loops.numbers)
    if run.plateaus:
        holds = [p for p in run.plateaus if p.cycle in chosen and p.branch]
        of_loops = counter.of_like_windows([slice(p.settled_first, p.last + 1) for p in holds])
        read = set() if run.elongations is None else set(np.flatnonzero(run.elongations.known).tolist())
        points = [p for i, p in enumerate(run.plateaus) if i in read and p.cycle in chosen and p.branch]
        of_points = counter.of_like_windows([slice(p.settled_first, p.last + 1) for p in points])
    else:
        of_loops = of_points = counter.of_like_windows([c.rows for c in run.cycles.used])
    return {name: _over(figure, of_points if name in OF_POINTS else of_loops) for name, figure in figures.items()}


def _over(figure: Figure, window: Losses) -> Figure:
    void, nan = window.void(), float("nan")
    if void and not figure.void:
        return replace(figure, value=nan, low=nan, high=nan, void=void, window=window, reason=Reason.LOSSES)
    if figure.void and window.void(MAX_DAMAGED_CYCLE):
        return replace(
            figure, void=f"{figure.void}: {window.void(MAX_DAMAGED_CYCLE)}", window=window, reason=Reason.LOSSES
        )
    return replace(figure, window=window)
