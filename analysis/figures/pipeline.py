"""From a run to its figures, in one call.

Load, cycles, plateaus, elongations, loops, then each sensor (`analysis.figures.sensor_analysis`): this module hands the
result of one step to the next, collects the warnings, and writes the JSON of `analyze --json`. What cannot be computed
is void with a reason and the rest is computed; the same run, options and seed give the same numbers, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from analysis.calibration.type_b import SCALE
from analysis.data.load import load_recording
from analysis.data.recording import Recording
from analysis.fidelity import fidelity
from analysis.figures.across_breaks import compare_breaks, of_cycles, parts_of
from analysis.figures.figure import Figure, Figures, Reason, figure_frame, summary_html, summary_text
from analysis.figures.intervals import unsettled
from analysis.figures.loop_figures import hysteresis, joint_hysteresis, with_what_lies_between
from analysis.figures.reading_check import CheckedReading, checked_readings, without_wrong_readings
from analysis.figures.sensor_analysis import (
    AnalysedRun,
    Options,
    SegmentedRun,
    SensorAnalysis,
    actuator_loop,
    analyse_sensor,
    limited_by_reading,
)
from analysis.figures.uncertainty import ElongationBudgets, elongation_uncertainty, middle_budgets
from analysis.figures.warnings import reading_grid, run_warnings
from analysis.json_object import json_object
from analysis.progress import Progress, part_of
from analysis.segmentation.cycles import find_cycles
from analysis.segmentation.loops import Loops, LoopWidth, continuous_loops, staircase_loops, width_of_loops
from analysis.segmentation.losses import LossCounter
from analysis.segmentation.plateau_readings import Readings, elongations_of
from analysis.segmentation.plateaus import find_plateaus
from analysis.segmentation.signal_faults import mask_faulty_signals
from analysis.statistics import resampling_weights
from analysis.tracking.continuous import SOURCE as CAMERA
from analysis.tracking.continuous import CameraFigures, camera_elongations, camera_figures, scale_of
from analysis.tracking.run import Filmed, filmed
from analysis.warning import Warning
from protocol.base.arrays import FloatArray
from protocol.base.units import STORED_UNITS, in_signal_unit


@dataclass(frozen=True, slots=True)
class Part:
    """The figures of the cycles between two breaks over which the run changed."""

    cycles: tuple[int, ...]
    sensors: tuple[SensorAnalysis, ...]


@dataclass(frozen=True, slots=True, repr=False)
class Analysis(AnalysedRun):
    """All figures of one run.

    `budgets` are of an elongation in the middle of the calibrated range; `u_elongation` of each sensor [points, 2] x
    and U, mm; `parts` those that differ over a break, `sensors` the largest's; `checked` the readings to be checked, or
    confirmed.
    """

    system_sensitivity: Figure
    actuator_hysteresis: Figure
    actuator_hysteresis_per_cycle: tuple[float, ...]
    warnings: tuple[Warning, ...]
    budgets: ElongationBudgets | None
    u_elongation: tuple[FloatArray, ...]
    u_reason: tuple[str, ...]
    parts: tuple[Part, ...]
    camera: CameraFigures | None = None
    checked: tuple[CheckedReading, ...] = ()

    def __repr__(self) -> str:
        return summary_text(self._heading, self.sensors, self.system_figures, self.warnings)

    def _repr_html_(self) -> str:
        return summary_html(self._heading, self.sensors, self.system_figures, self.warnings)

    @property
    def _heading(self) -> str:
        mark, cycles = "SIMULATED, " if self.recording.simulated else "", self.cycles.as_json()["complete"]
        return f"Analysis of {self.recording.unit or 'a unit without a name'}: {mark}{self.kind}, {cycles} cycles"

    def to_frame(self) -> pd.DataFrame:
        """Return the figures, one a row: sensor, figure, value, low, high (95 %), unit, n, void.

        `attrs` hold `simulated` and `unit` (under test); the sensor of a figure of the whole unit is "".
        """
        frame = figure_frame(self.sensors, self.system_figures)
        frame.attrs = {"simulated": self.recording.simulated, "unit": self.recording.unit}
        return frame

    @property
    def kind(self) -> str:
        """What the run is: calibration (staircase and elongations), staircase (without), repeatability (cycles)."""
        if not self.plateaus:
            return "repeatability"
        return "calibration" if any(s.calibration for s in self.sensors) else "staircase"

    @property
    def system_figures(self) -> dict[str, Figure]:
        """The figures of the whole unit, by key."""
        return {
            "system_sensitivity_mv_per_mm": self.system_sensitivity,
            "actuator_hysteresis_percent": self.actuator_hysteresis,
        }

    def to_json(self) -> dict[str, Any]:
        """Return the object of `analyze --json`; NaN and infinities are left for the writer to turn into null."""
        recording = self.recording
        return {
            "simulated": recording.simulated,
            "signal_unit": recording.signal_unit,
            "kind": self.kind,
            "duration_s": recording.duration_s,
            "rate_hz": recording.rate_hz,
            "samples": recording.n,
            "gaps": len(recording.gaps),
            "lost_samples": recording.lost,
            "crc_errors": int(recording.meta.get("crc_errors", 0)),
            "masked": dict(recording.masked),
            "losses": [
                json_object(LossCounter.of(recording, i).of_windows([slice(0, recording.n)]))
                for i in range(recording.n_sensors)
            ],
            "cycles": self.cycles.as_json(),
            "excursions_left_out": len(self.cycles.excursions),
            "plateaus": len(self.plateaus),
            "sensors": [self._sensor_json(number) for number in range(len(self.sensors))],
            "system_sensitivity_mv_per_mm": self.system_sensitivity.value,
            "actuator_hysteresis_percent": {
                "abscissa": "pressure_kpa",
                "mean": self.actuator_hysteresis.value,
                "per_cycle": list(self.actuator_hysteresis_per_cycle),
            },
            "system_figures": {key: figure.as_json() for key, figure in self.system_figures.items()},
            "flags": [warning.as_flag() for warning in self.warnings],
            "warnings": [json_object(warning) for warning in self.warnings],
            "seed": self.options.seed,
            "fidelity": self.options.fidelity,
            "reading_grid": reading_grid(self),
            **self._breaks_json(),
            **({"camera": self.camera.as_json()} if self.camera else {}),
        }

    def _sensor_json(self, number: int) -> dict[str, Any]:
        """Return the object of a sensor: U over elongation, and the readings of its calibration to be checked."""
        found, u = self.sensors[number].as_json(), self.u_elongation[number]
        if found["calibration"] is not None:
            name = self.sensors[number].name
            own = [one for one in self.checked if name in one.sensors and not one.confirmed]
            found["calibration"] |= {"check": [one.as_json() for one in own]}
        return found | {"u_elongation_mm": u.tolist() if u.size else None, "u_reason": self.u_reason[number]}

    def _breaks_json(self) -> dict[str, Any]:
        """Return the keys that a broken run has besides."""
        if not self.breaks:
            return {}
        parts = [
            {"cycles": list(part.cycles), "sensors": [sensor.as_json() for sensor in part.sensors]}
            for part in self.parts
        ]
        return {"breaks": [found.as_json() for found in self.breaks], "parts": parts}


def analyse(
    recording: Recording | str | Path,
    elongation: Readings | None = None,
    *,
    seed: int = 0,
    mcmc: bool = True,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Analysis:
    """Compute every figure of a run.

    A run that is incomplete or damaged is no error: its figures are void, with reasons. Raises FileError or DataError
    if the run or the elongations cannot be read, or do not fit each other. `elongation`: CSV of elongations, a frame
    with its columns (`pressure_kpa`, `elongation_mm`), or [plateaus] values in mm in the order of the run, NaN where
    none was read; by default the recording's own readings. `seed`, `mcmc`: shorthands for the options of the same name;
    `options` overrides them.
    """
    options = options or Options(seed=seed, mcmc=mcmc)
    if not isinstance(recording, Recording):
        recording = load_recording(recording)
    film = filmed(recording) if recording.camera is not None else None
    if film is not None:
        recording = film.recording
        if all(one.name != SCALE for one in options.type_b):
            options = replace(options, type_b=(*options.type_b, scale_of(film)))
    run, parts, left_out = _segmented(recording, elongation, options, film)
    checked = checked_readings(run)
    count = recording.n_sensors
    sensors = [analyse_sensor(run, number, progress=part_of(progress, number, 1, count)) for number in range(count)]
    analysed = AnalysedRun(**_values(run), sensors=tuple(sensors))
    over_x = [elongation_uncertainty(analysed, i) for i in range(len(sensors))]
    actuator, actuator_cycles = _actuator_hysteresis(run, sensors)
    found = Analysis(
        **_values(analysed),
        system_sensitivity=_system_sensitivity(sensors),
        actuator_hysteresis=actuator,
        actuator_hysteresis_per_cycle=actuator_cycles,
        warnings=(*(film.warnings if film else ()), *left_out, *run_warnings(run, sensors, checked)),
        budgets=middle_budgets(analysed),
        u_elongation=tuple(u for u, _ in over_x),
        u_reason=tuple(why for _, why in over_x),
        parts=tuple(_part(run, part) for part in parts) if len(parts) > 1 else (),
        camera=_camera(film, run, sensors) if film is not None else None,
        checked=checked,
    )
    return _in_unit(found, recording.signal_unit)


def _in_unit(found: Analysis, unit: str) -> Analysis:
    """Return the analysis of signals in another unit than mV, its figures and warnings with that unit."""
    if unit == STORED_UNITS.voltage:
        return found

    def stated(figure: Figure) -> Figure:
        void, note, text = (in_signal_unit(one, unit) for one in (figure.void, figure.note, figure.definition))
        return replace(figure, unit=figure.unit.replace("mV", unit), void=void, note=note, definition=text)

    def of_sensors(sensors: tuple[SensorAnalysis, ...]) -> tuple[SensorAnalysis, ...]:
        return tuple(replace(s, figures=Figures({key: stated(f) for key, f in s.figures.items()})) for s in sensors)

    return replace(
        found,
        sensors=of_sensors(found.sensors),
        parts=tuple(replace(part, sensors=of_sensors(part.sensors)) for part in found.parts),
        system_sensitivity=stated(found.system_sensitivity),
        warnings=tuple(replace(one, text=in_signal_unit(one.text, unit)) for one in found.warnings),
    )


def _camera(film: Filmed, run: SegmentedRun, sensors: Sequence[SensorAnalysis]) -> CameraFigures:
    numbers = set(run.loops.numbers)
    cycles = [cycle for cycle in run.cycles.used if cycle.number in numbers]
    return camera_figures(film, run.recording, cycles, [sensor.calibration for sensor in sensors])


def _segmented(
    recording: Recording, elongation: Readings | None, options: Options, film: Filmed | None
) -> tuple[SegmentedRun, list[Loops], tuple[Warning, ...]]:
    """Return a run in cycles, plateaus and loops, its loops between breaks, and a warning for each reading left out.

    Parts that differ over a break are never pooled: the run's loops are those of the largest, the later one of two.
    """
    cycles = find_cycles(recording, options.plateau.tolerance_kpa)
    recording = mask_faulty_signals(recording, cycles.smooth_kpa)
    plateaus = find_plateaus(recording, cycles, options.plateau)
    if film is None or elongation is not None:
        elongations = elongations_of(recording, plateaus, elongation)
    else:
        own = recording.readings[recording.readings["source"] != CAMERA]
        elongations = camera_elongations(film, plateaus, elongations_of(replace(recording, readings=own), plateaus))
    if plateaus:
        x = elongations.elongation_mm if elongations else None
        loops = staircase_loops(plateaus, cycles, x, recording.n_sensors)
    else:
        loops = continuous_loops(recording, cycles)
    no_light = np.zeros((recording.n_sensors, len(plateaus)))
    run = SegmentedRun(recording, options, cycles, plateaus, elongations, loops, _weights(loops, options), (), no_light)
    left_out: tuple[Warning, ...] = ()
    if options.leave_out and plateaus:
        run, left_out = without_wrong_readings(run)
    breaks = compare_breaks(recording, cycles, run.loops)
    parts = [of_cycles(run.loops, numbers) for numbers in parts_of(breaks)]
    largest = max(reversed(parts), key=lambda part: part.n_cycles) if len(parts) > 1 else run.loops
    run = replace(run, loops=largest, weights=_weights(largest, options), breaks=breaks)
    return run.with_ambient(), parts, left_out


def _values(run: SegmentedRun) -> dict[str, Any]:
    return {field.name: getattr(run, field.name) for field in fields(run)}


def _weights(loops: Loops, options: Options) -> FloatArray:
    resamples = options.resamples or fidelity(options.fidelity).resamples
    rng = np.random.default_rng(options.seed)
    return resampling_weights(max(loops.n_cycles, 1), rng, resamples)[:, : loops.n_cycles]


def _part(run: SegmentedRun, loops: Loops) -> Part:
    """Return every figure of some cycles, without the posterior."""
    options = replace(run.options, mcmc=False)
    part = replace(run, loops=loops, options=options, weights=_weights(loops, options)).with_ambient()
    return Part(loops.numbers, tuple(analyse_sensor(part, sensor) for sensor in range(run.recording.n_sensors)))


def _actuator_hysteresis(run: SegmentedRun, sensors: Sequence[SensorAnalysis]) -> tuple[Figure, tuple[float, ...]]:
    """Return the hysteresis of the actuator, x over p, % of the span of x: of the mean loop, and of each cycle."""
    definition = "max over p of |x loading - x unloading| / span of x, mean loop"
    x = run.loops.elongation_mm
    if x is None or not np.isfinite(x).any():
        return Figure.nothing("%", Reason.NO_ELONGATION, "no elongation was read", definition), ()
    span = float(np.nanmax(x) - np.nanmin(x))
    width = width_of_loops(run.loops, run.loops.pressure_kpa, x, run.weights)
    per_cycle = tuple((100.0 / span * width.per_cycle).tolist()) if span > 0 else ()
    loop = actuator_loop(run, sensors)
    if loop is not None:
        low, high = loop.fit.predict(np.asarray(loop.fit.ends))
        figure = joint_hysteresis(loop.estimate, width, abs(float(high - low)), run.loops.n_cycles, over="p")
    else:
        per_mm = 100.0 / span if span > 0 else 0.0
        figure = limited_by_reading(hysteresis(width, span, run.loops.n_cycles, definition), run.reading_sd_mm, per_mm)
    grid = np.sqrt(12.0) * run.reading_sd_mm * 100.0 / span if span > 0 else 0.0
    figure = with_what_lies_between(figure, run.loops.level_kpa, x, span, grid)
    return _actuator_at_rest(replace(figure, unit="%"), run, sensors, width), per_cycle


def _actuator_at_rest(figure: Figure, run: SegmentedRun, sensors: Sequence[SensorAnalysis], width: LoopWidth) -> Figure:
    """Return the actuator's hysteresis; of holds that are not settled its interval also holds that at rest."""
    x = run.elongations
    known = [(s, c) for s in sensors if (c := s.calibration) is not None and not s.settling.settled]
    if x is None or not known:
        return figure
    with np.errstate(divide="ignore"):
        moved = np.mean([s.settling.remaining_mv / c.slope(x.elongation_mm) for s, c in known], axis=0)
    rest = run.with_elongations(replace(x, elongation_mm=x.elongation_mm + moved)).loops
    assert rest.elongation_mm is not None
    wider = width_of_loops(rest, rest.pressure_kpa, rest.elongation_mm, run.weights).mean_loop / width.mean_loop
    at_rest = replace(figure, value=figure.value * wider, low=figure.low * wider, high=figure.high * wider)
    return unsettled(figure, at_rest, known[0][0].settling.held_s)


def _system_sensitivity(sensors: Sequence[SensorAnalysis]) -> Figure:
    definition = "mean over the sensors of their end-to-end sensitivity"
    parts = [s.figures["sensitivity_mv_per_mm"] for s in sensors if s.calibration is not None]
    if len(parts) < len(sensors) or not parts:
        return Figure.nothing("mV/mm", Reason.NOT_CALIBRATED, "not every sensor is calibrated", definition)
    flat = [s.name for s, p in zip(sensors, parts, strict=True) if p.value == 0.0]
    if flat:
        return Figure.nothing("mV/mm", Reason.NO_FULL_SCALE, f"{', '.join(flat)} is flat", definition)
    # the sensors share their cycles and readings: half-widths are averaged, as for fully correlated parts
    value, low, high = (sum(ends) / len(parts) for ends in zip(*((p.value, p.low, p.high) for p in parts), strict=True))
    return Figure(value, "mV/mm", parts[0].n, low, high, definition=definition)
