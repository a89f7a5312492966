"""From a run to its figures, in one call.

Strategy: load, cycles, plateaus, elongations, loops, then for each sensor calibration, posterior and figures. Every
step is a function of its own elsewhere; this file only hands one's result to the next, collects what each had to say
(`flags`), and writes the JSON that `analyze --json` promises.

Rules: what cannot be computed is void with a reason and the rest goes on; the same run, options and seed give the
same numbers, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis import metrics
from analysis.break_comparison import Break, compare_breaks, of_cycles, parts_of
from analysis.calibration import Calibration, fit_calibration
from analysis.cycles import Cycles, find_cycles
from analysis.elongation import Elongations, elongations_of
from analysis.errors import AnalysisError
from analysis.fidelity import Level, fidelity
from analysis.figure_windows import with_losses
from analysis.flags import flags_of
from analysis.loops import Loops, cluster_levels, continuous_loops, loop_width, sensor_loop_width, staircase_loops
from analysis.losses import LossCounter
from analysis.plateaus import Plateau, PlateauSettings, find_plateaus
from analysis.posterior import Posterior, sample_posterior
from analysis.recording import BoolArray, FloatArray, Recording, load_recording
from analysis.signal_faults import mask_faulty_signals
from analysis.statistics import Figure, resampling_weights

Progress = Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class Options:
    """How a run is analysed.

    Attributes
    ----------
    degree : of the calibration.
    x_resolution_mm : grid of the readings; None takes what the recording says, else 0.5 mm.
    monotone : only monotone curves in the posterior.
    seed : of the bootstrap and the sampler.
    mcmc : sample the posterior.
    plateau : what counts as settled.
    fidelity : how fine bootstrap and sampler are, see `analysis.fidelity`.
    """

    degree: int = 3
    x_resolution_mm: float | None = None
    monotone: bool = False
    seed: int = 0
    mcmc: bool = True
    plateau: PlateauSettings = field(default_factory=PlateauSettings)
    fidelity: Level = "normal"


@dataclass(frozen=True, slots=True)
class SensorAnalysis:
    """What is known of one sensor. `figures` by name; loops are % FSO over `sensor_loop` (x) and `system_loop` (p)."""

    name: str
    calibration: Calibration | None
    calibration_void: str
    posterior: Posterior | None
    figures: Mapping[str, Figure]
    hysteresis_abscissa: str
    hysteresis_per_cycle: tuple[float, ...]
    system_hysteresis_per_cycle: tuple[float, ...]
    drift_by_level: FloatArray
    point_plateau: FloatArray
    point_cycle: FloatArray


@dataclass(frozen=True, slots=True)
class Part:
    """The figures of the cycles between two breaks over which the run changed."""

    cycles: tuple[int, ...]
    sensors: tuple[SensorAnalysis, ...]


@dataclass(frozen=True, slots=True)
class Analysis:
    """All figures of one run."""

    recording: Recording
    options: Options
    cycles: Cycles
    plateaus: tuple[Plateau, ...]
    elongations: Elongations | None
    loops: Loops
    sensors: tuple[SensorAnalysis, ...]
    system_sensitivity: Figure
    actuator_hysteresis: Figure
    actuator_hysteresis_per_cycle: tuple[float, ...]
    flags: tuple[dict[str, str], ...]
    reading_sd_mm: float
    breaks: tuple[Break, ...] = ()
    parts: tuple[Part, ...] = ()  # of a run whose parts differ over a break: `sensors` are those of the largest

    @property
    def kind(self) -> str:
        """What the run is: calibration (staircase and elongations), staircase (without), repeatability (cycles)."""
        if not self.plateaus:
            return "repeatability"
        return "calibration" if any(s.calibration for s in self.sensors) else "staircase"

    def to_json(self) -> dict[str, Any]:
        """Return the object of `analyze --json`; NaN and infinities are left for the writer to turn into null."""
        recording = self.recording
        return {
            "simulated": recording.simulated,
            "kind": self.kind,
            "duration_s": recording.duration_s,
            "rate_hz": recording.rate_hz,
            "samples": recording.n,
            "gaps": len(recording.gaps),
            "lost_samples": recording.lost,
            "crc_errors": int(recording.meta.get("crc_errors", 0)),
            "masked": dict(recording.masked),
            "losses": [
                LossCounter.of(recording, i).of_windows([slice(0, recording.n)]).as_json()
                for i in range(recording.n_sensors)
            ],
            "cycles": self.cycles.as_json(),
            "excursions_left_out": len(self.cycles.excursions),
            "plateaus": len(self.plateaus),
            "sensors": [_sensor_json(sensor) for sensor in self.sensors],
            "system_sensitivity_mv_per_mm": self.system_sensitivity.value,
            "actuator_hysteresis_percent": {
                "abscissa": "pressure_kpa",
                "mean": self.actuator_hysteresis.value,
                "per_cycle": list(self.actuator_hysteresis_per_cycle),
            },
            "system_figures": {
                "system_sensitivity_mv_per_mm": self.system_sensitivity.as_json(),
                "actuator_hysteresis_percent": self.actuator_hysteresis.as_json(),
            },
            "flags": list(self.flags),
            "seed": self.options.seed,
            "fidelity": self.options.fidelity,
            **self._breaks_json(),
        }

    def _breaks_json(self) -> dict[str, Any]:
        """Return the keys that a broken run has besides."""
        if not self.breaks:
            return {}
        parts = [
            {"cycles": list(part.cycles), "sensors": [_sensor_json(sensor) for sensor in part.sensors]}
            for part in self.parts
        ]
        return {"breaks": [found.as_json() for found in self.breaks], "parts": parts}


def analyse(
    recording: Recording | str | Path,
    elongation: str | Path | None = None,
    *,
    seed: int = 0,
    mcmc: bool = True,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Analysis:
    """Compute every figure of a run.

    Parameters
    ----------
    recording : a loaded run, or its file.
    elongation : CSV of elongations; without one the recording's own readings are used.
    seed, mcmc : shorthands for the options of the same name.
    options : all settings; overrides the shorthands.
    progress : called as progress(done, total); raising from it cancels.

    Raises
    ------
    FileError, DataError : the run or the elongations cannot be read, or do not fit each other. A run that is merely
        incomplete or damaged is no error: its figures are void, with reasons.
    """
    options = options or Options(seed=seed, mcmc=mcmc)
    if not isinstance(recording, Recording):
        recording = load_recording(recording)
    cycles = find_cycles(recording)
    recording = mask_faulty_signals(recording, cycles.smooth_kpa)
    plateaus = find_plateaus(recording, cycles, options.plateau)
    elongations = elongations_of(recording, plateaus, elongation)
    if plateaus:
        x = elongations.elongation_mm if elongations else None
        loops = staircase_loops(plateaus, cycles, x, recording.n_sensors)
    else:
        loops = continuous_loops(recording, cycles)
    breaks = compare_breaks(recording, cycles, loops)
    parts = [of_cycles(loops, numbers) for numbers in parts_of(breaks)]
    if len(parts) > 1:  # never pooled: the figures are those of the largest part, the later one of two
        loops = max(reversed(parts), key=lambda part: part.n_cycles)
    run = _Run(recording, options, cycles, plateaus, elongations, loops, _weights(loops, options), breaks)
    sensors = []
    for number in range(recording.n_sensors):
        sensors.append(_analyse_sensor(run, number))
        if progress is not None:
            progress(number + 1, recording.n_sensors)
    actuator, actuator_cycles = _actuator_hysteresis(run)
    return Analysis(
        recording, options, cycles, plateaus, elongations, loops, tuple(sensors), _system_sensitivity(sensors),
        actuator, actuator_cycles, flags_of(run, sensors), run.reading_sd_mm, breaks,
        tuple(_part(run, part) for part in parts) if len(parts) > 1 else (),
    )  # fmt: skip


def _weights(loops: Loops, options: Options) -> FloatArray:
    rng, resamples = np.random.default_rng(options.seed), fidelity(options.fidelity).resamples
    return resampling_weights(max(loops.n_cycles, 1), rng, resamples)[:, : loops.n_cycles]


def _part(run: _Run, loops: Loops) -> Part:
    """Return every figure of some cycles, without the posterior."""
    options = replace(run.options, mcmc=False)
    part = replace(run, loops=loops, options=options, weights=_weights(loops, options))
    return Part(loops.numbers, tuple(_analyse_sensor(part, sensor) for sensor in range(run.recording.n_sensors)))


@dataclass(frozen=True, slots=True)
class _Run:
    recording: Recording
    options: Options
    cycles: Cycles
    plateaus: tuple[Plateau, ...]
    elongations: Elongations | None
    loops: Loops
    weights: FloatArray
    breaks: tuple[Break, ...] = ()

    @property
    def reading_sd_mm(self) -> float:
        resolution = self.options.x_resolution_mm
        if resolution is None:
            resolution = self.elongations.resolution_mm if self.elongations else 0.0
        return float(resolution / np.sqrt(12.0))

    def calibration_points(self, sensor: int) -> BoolArray:
        """[plateaus] True for plateaus of complete cycles whose elongation was read and that are not void."""
        used = set(self.loops.numbers)
        inside = np.asarray(
            [p.cycle in used and not p.void and np.isfinite(p.signal_mv[sensor]) for p in self.plateaus]
        )
        return inside & self.elongations.known if self.elongations is not None else np.zeros_like(inside)

    def position_of(self, points: np.ndarray[Any, Any]) -> FloatArray:
        """[points] number of the position of each plateau: its level and its branch, read once a cycle."""
        _, level = cluster_levels(np.asarray([p.pressure_kpa for p in self.plateaus]))
        loading = np.asarray([p.branch == "loading" for p in self.plateaus])
        return np.asarray(2.0 * level + loading, dtype=np.float64)[points]


def _analyse_sensor(run: _Run, sensor: int) -> SensorAnalysis:
    calibration, posterior, reason = None, None, ""
    points = np.flatnonzero(run.calibration_points(sensor))
    position = {number: k for k, number in enumerate(run.loops.numbers)}
    cycle_of = np.asarray([position[run.plateaus[i].cycle] for i in points], dtype=np.float64)
    try:
        calibration = _calibrate(run, sensor, points)
        if run.options.mcmc:
            posterior = sample_posterior(
                calibration.x, calibration.y, run.options.degree, reading_sd=run.reading_sd_mm,
                positions=run.position_of(points), monotone=run.options.monotone, seed=run.options.seed + sensor,
                max_steps=fidelity(run.options.fidelity).posterior_steps,
            )  # fmt: skip
    except AnalysisError as error:
        reason = error.cause
    resampled = None
    if calibration is not None:
        rng = np.random.default_rng((run.options.seed, 1))
        resampled = metrics.resample_fit(calibration, cycle_of, run.weights, rng)
    figures = {"fso_mv": metrics.full_scale(calibration, resampled, run.loops, sensor, run.weights)}
    if calibration is not None and resampled is not None:
        figures |= metrics.sensitivities(calibration, resampled)
        figures["nonlinearity_percent_fso"] = metrics.nonlinearity(calibration, resampled)
    fso = figures["fso_mv"].value
    loops_figures, per_cycle, system_per_cycle, levels = _loop_figures(run, sensor, calibration, fso)
    if calibration is not None:  # else the full scale is of the same samples, and in their bootstrap already
        loops_figures = {name: metrics.with_full_scale(f, figures["fso_mv"]) for name, f in loops_figures.items()}
    figures = loops_figures | figures
    abscissa = "elongation_mm" if calibration is not None else "pressure_kpa"
    chosen = "sensor_hysteresis_percent_fso" if calibration is not None else "system_hysteresis_percent_fso"
    figures["combined_error_percent_fso"] = metrics.combined_error(
        [figures[name] for name in ("nonlinearity_percent_fso", chosen, "repeatability_percent_fso")]
    )
    figures = with_losses(run, sensor, figures)
    return SensorAnalysis(
        run.recording.sensor_names[sensor], calibration, reason, posterior, figures, abscissa,
        per_cycle if calibration is not None else system_per_cycle, system_per_cycle, levels,
        points.astype(np.float64), cycle_of,
    )  # fmt: skip


def _calibrate(run: _Run, sensor: int, points: np.ndarray[Any, Any]) -> Calibration:
    from analysis.errors import DataError

    if run.elongations is None:
        raise DataError("no elongation was read", "Give a file with --elongation, or enter the readings.")
    if not points.size:
        raise DataError("no plateau of a complete cycle has an elongation", "Record at least one whole cycle.")
    y = np.asarray([run.plateaus[i].signal_mv[sensor] for i in points])
    calibration = fit_calibration(run.elongations.elongation_mm[points], y, run.options.degree)
    return calibration.with_reading(run.reading_sd_mm, run.position_of(points))


def _loop_figures(
    run: _Run, sensor: int, calibration: Calibration | None, fso: float
) -> tuple[dict[str, Figure], tuple[float, ...], tuple[float, ...], FloatArray]:
    loops, n = run.loops, run.loops.n_cycles
    figures: dict[str, Figure] = {}
    system = loop_width(loops.pressure_kpa, loops.signal_mv[sensor], run.weights)
    figures["system_hysteresis_percent_fso"] = metrics.hysteresis(
        system, fso, n, "max over p of |loading - unloading| / FSO, mean loop"
    )
    per_cycle: tuple[float, ...] = ()
    if loops.elongation_mm is not None:
        own = sensor_loop_width(loops, sensor, calibration, run.weights)
        figures["sensor_hysteresis_percent_fso"] = metrics.hysteresis(
            own, fso, n, "max over x of |loading - unloading| / FSO, mean loop"
        )
        per_cycle = tuple((100.0 / fso * own.per_cycle).tolist()) if fso > 0 else ()
        figures["sensor_hysteresis_percent_fso"] = _limited_by_reading(
            figures["sensor_hysteresis_percent_fso"], run.reading_sd_mm, loops.elongation_mm
        )
    system_cycles = tuple((100.0 / fso * system.per_cycle).tolist()) if fso > 0 else ()
    if run.plateaus:
        parts = metrics.staircase_noise(run.plateaus, sensor)
    else:
        parts = metrics.continuous_noise(run.recording, run.cycles, sensor)
    usable = run.recording.signal_mv[run.recording.usable[:, sensor], sensor]
    rounding = 4.0 * float(np.spacing(np.abs(usable).max(initial=0.0)))
    figures["noise_mv"], figures["snr_db"] = metrics.noise_and_snr(parts, loops.numbers, fso, run.weights, rounding)
    by_noise = metrics.loop_made_by_noise(run.plateaus, loops, run.cycles, sensor, figures["noise_mv"].value)
    if 0 < fso < by_noise and not figures["snr_db"].void:
        note = f"the full-scale output of {fso:.2g} mV is no more than noise alone makes ({by_noise:.2g} mV)"
        figures["snr_db"] = replace(figures["snr_db"], note=note)
    for name in [name for name in figures if "hysteresis" in name]:
        figures[name] = metrics.limited(figures[name], 100.0 / fso * by_noise if fso > 0 else 0.0, "noise")
    figures["nonlinearity_percent_fso"] = metrics.pressure_nonlinearity(loops, sensor, fso, run.weights)
    figures |= metrics.repeatability(loops, sensor, fso, run.weights)
    figures["drift_percent_fso_per_100_cycles"], levels = metrics.drift(loops, sensor, fso)
    return figures, per_cycle, system_cycles, levels


def _limited_by_reading(figure: Figure, reading_sd_mm: float, elongation_mm: FloatArray) -> Figure:
    """Say where the reading error of x alone would make most of the sensor's loop: two readings, two sigma."""
    span = float(np.nanmax(elongation_mm) - np.nanmin(elongation_mm)) if np.isfinite(elongation_mm).any() else 0.0
    floor = 100.0 * 2.0 * np.sqrt(2.0) * reading_sd_mm / span if span > 0 else 0.0
    return metrics.limited(figure, floor, f"a reading error of {reading_sd_mm:.2f} mm", 0.5)


def _actuator_hysteresis(run: _Run) -> tuple[Figure, tuple[float, ...]]:
    """The actuator's own loop: x over p, % of the span of x."""
    definition = "max over p of |x loading - x unloading| / span of x, mean loop"
    x = run.loops.elongation_mm
    if x is None or not np.isfinite(x).any():
        return Figure.nothing("%", "no elongation was read", definition), ()
    span = float(np.nanmax(x) - np.nanmin(x))
    width = loop_width(run.loops.pressure_kpa, x, run.weights)
    figure = metrics.hysteresis(width, span, run.loops.n_cycles, definition)
    per_cycle = tuple((100.0 / span * width.per_cycle).tolist()) if span > 0 else ()
    return _limited_by_reading(replace(figure, unit="%"), run.reading_sd_mm, x), per_cycle


def _system_sensitivity(sensors: list[SensorAnalysis]) -> Figure:
    definition = "mean over the sensors of their end-to-end sensitivity"
    parts = [s.figures["sensitivity_mv_per_mm"] for s in sensors if s.calibration is not None]
    if len(parts) < len(sensors) or not parts:
        return Figure.nothing("mV/mm", "not every sensor is calibrated", definition)
    n = len(parts)
    value = sum(p.value for p in parts) / n
    # the sensors share their cycles and readings: half-widths are averaged, as for fully correlated parts
    low = sum(p.value - p.low for p in parts) / n
    high = sum(p.high - p.value for p in parts) / n
    return Figure(value, "mV/mm", parts[0].n, value - low, value + high, definition=definition)


def _sensor_json(sensor: SensorAnalysis) -> dict[str, Any]:
    figures = sensor.figures
    chosen = "sensor_hysteresis_percent_fso" if sensor.calibration is not None else "system_hysteresis_percent_fso"
    plain = {name: figure.value for name, figure in figures.items() if "hysteresis" not in name}
    plain.setdefault("sensitivity_mv_per_mm", float("nan"))
    return {
        "name": sensor.name,
        "calibration": sensor.calibration.as_json() if sensor.calibration else None,
        "calibration_void": sensor.calibration_void if sensor.calibration is None else "",
        "posterior": sensor.posterior.as_json() if sensor.posterior else None,
        **plain,
        "hysteresis_percent_fso": {
            "abscissa": sensor.hysteresis_abscissa,
            "mean": figures[chosen].value,
            "per_cycle": list(sensor.hysteresis_per_cycle),
        },
        "system_hysteresis_percent_fso": {
            "abscissa": "pressure_kpa",
            "mean": figures["system_hysteresis_percent_fso"].value,
            "per_cycle": list(sensor.system_hysteresis_per_cycle),
        },
        "figures": {name: figure.as_json() for name, figure in figures.items()},
    }
