"""What a recorded run tells of the dynamics: its segments, their setpoints, and the elongation that followed them.

A recording of a profile keeps each segment with its step; the setpoint is computed from it again. The elongation is
that of the calibration in force, all sensors fused.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from analysis.calibration.inverse import Fusion
from analysis.data.recording import Recording
from analysis.elongation_control.controller import Tuning
from analysis.elongation_control.dynamic_figures import BodePoint, DynamicCalibration, DynamicFigure
from analysis.elongation_control.dynamics import Lag, bandwidth, bode_point, fit_lag, mean_bode_point, step_figures
from analysis.elongation_control.hysteresis import HysteresisModel, identify
from analysis.elongation_control.sensor_loop import SensorLoops
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError
from protocol.recording import NOT_FOR_FIGURES, SampleFlag, Segment


def dynamic_calibration(
    recording: Recording,
    fusion: Fusion,
    *,
    loops: SensorLoops | None = None,
    calibration_utc: str = "",
) -> DynamicCalibration:
    """Return the dynamics of a run with steps or sines of elongation."""
    segments = recorded_segments(recording)
    stepped, swept = any(one.step_mm for one in segments), any(one.is_sine_of_elongation for one in segments)
    if not (stepped or swept):
        cause = "this run has neither steps nor sines of elongation"
        raise DataError(cause, "Record one with the plan steps-mm or sine-sweep-mm.")
    steps: dict[float, list[StepResponse]] = step_responses(recording, fusion, loops) if stepped else {}
    bode: tuple[BodePoint, ...] = bode_of_run(recording, fusion, loops) if swept else ()
    return DynamicCalibration(
        recording.unit,
        recording.simulated,
        recording.source,
        TOLERANCE_MM,
        {size: step_response_figures(rows) for size, rows in steps.items()},
        bode,
        bandwidth(bode),
        {size: len(rows) for size, rows in steps.items()},
        recording.started_utc,
        calibration_utc,
    )


GRID_S = 0.01
TOLERANCE_MM = 0.05  # of settling
LEAST_PERIOD_S = 0.5  # of a sine that gives a gain of its own
BEFORE_S = 0.3  # of rest before a step, whose mean is its begin
LEAST_STEP_KPA = 3.0
_NO_SIGNAL = int(NOT_FOR_FIGURES & ~SampleFlag.PRESSURE_INVALID)


@dataclass(frozen=True, slots=True)
class RecordedSegment:
    """One segment of a run: what was wanted, and from when to when, s."""

    segment: Segment
    start: float
    quantity: str
    ramp_kpa_per_s: float
    begin_s: float
    end_s: float

    @property
    def step_mm(self) -> float:
        """The size of a step of elongation, signed; 0 for every other segment."""
        size = self.segment.target - self.start
        return size if self.segment.kind == "step" and self.quantity == "mm" and abs(size) > 1e-6 else 0.0

    @property
    def is_sine_of_elongation(self) -> bool:
        """Whether it is one."""
        return self.segment.kind == "sine" and self.quantity == "mm"

    def setpoint(self, time_s: FloatArray) -> FloatArray:
        """Return the setpoint at times [n], in its quantity."""
        return np.asarray([self.segment.at(t - self.begin_s, self.start)[0] for t in time_s.tolist()])


def run_elongation(
    recording: Recording, fusion: Fusion, loops: SensorLoops | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the elongation of every sample [n] and its expanded uncertainty (k = 2), mm; NaN where unknown."""
    usable = (recording.flags & _NO_SIGNAL) == 0
    signal_mv = np.where(usable[:, None], recording.signal_mv, np.nan)
    found = fusion.evaluate(signal_mv)
    if loops is not None:
        found = fusion.evaluate(signal_mv - _loop_signals(loops, _smoothed(found.elongation_mm)))
    return found.elongation_mm, 2.0 * found.standard_uncertainty_mm


def _loop_signals(loops: SensorLoops, elongation_mm: FloatArray) -> FloatArray:
    """Return what the loops add to signals [n, sensors] over an elongation [n] without noise, from rest."""
    memory, mm, rows = loops.rest(0.0), 0.0, np.empty((len(elongation_mm), len(loops.half_mv)))
    for i, now in enumerate(elongation_mm.tolist()):
        if math.isfinite(now):
            memory, mm = loops.after(memory, now), now
        rows[i] = loops.signal_mv(memory, mm)
    return rows


def recorded_segments(recording: Recording) -> tuple[RecordedSegment, ...]:
    """Return the whole segments of a run. Raises DataError where it has none."""
    found = []
    row: Any
    for row in recording.steps.itertuples():
        detail: dict[str, Any] = json.loads(str(row.detail) or "{}")
        if row.status != "reached" or "segment" not in detail or not row.cycle:  # the opening begins anywhere
            continue
        segment = Segment(**{k: v for k, v in detail["segment"].items() if k in Segment.__dataclass_fields__})
        times = float(row.ramp_kpa_per_s), float(row.started_s), float(row.ended_s)
        found.append(RecordedSegment(segment, float(detail["start"]), str(detail["quantity"]), *times))
    if not found:
        raise DataError("this run has no steps, ramps or sines", "Record one with the plan step-test or steps-mm.")
    return tuple(found)


def identify_run(recording: Recording, fusion: Fusion) -> HysteresisModel:
    """Return the hysteresis of a run by its elongation."""
    return identify(recording.pressure_kpa, run_elongation(recording, fusion)[0])


def tune_run(recording: Recording, fusion: Fusion, model: HysteresisModel) -> Tuning:
    """Return the gains from a recorded step test: steps of pressure, all averaged after scaling."""
    lag, ramp = step_test_lag(recording, fusion, model)
    return Tuning.of(lag, ramp)


def step_test_lag(recording: Recording, fusion: Fusion, model: HysteresisModel) -> tuple[Lag, float]:
    """Return lag and ramp (kPa/s) of a step test; parameters as `tune_run`."""
    elongation, _ = run_elongation(recording, fusion)
    steps = [
        one for one in recorded_segments(recording)
        if one.segment.kind == "step" and one.quantity == "kPa" and abs(one.segment.target - one.start) > LEAST_STEP_KPA
    ]  # fmt: skip
    if not steps:
        raise DataError("this run has no steps of pressure", "Record the plan step-test.")
    grid = np.arange(0.0, min(one.end_s - one.begin_s for one in steps), GRID_S)
    commands, responses = [], []
    for one in steps:
        ramp = math.copysign(one.ramp_kpa_per_s, one.segment.target - one.start)
        moved = np.minimum(np.abs(ramp) * grid, abs(one.segment.target - one.start))
        pressure = one.start + math.copysign(1.0, ramp) * moved
        x, before = _aligned(recording.time_s, elongation, one.begin_s, grid)
        memory = model.rest(one.start, before)
        command = np.asarray([model.elongation(model.after(memory, kpa)) for kpa in pressure.tolist()])
        size = command[-1] - command[0]
        commands.append((command - command[0]) / size)
        responses.append((x - before) / size)
    return fit_lag(grid, np.mean(commands, axis=0), np.mean(responses, axis=0)), steps[0].ramp_kpa_per_s


def bode_of_run(recording: Recording, fusion: Fusion, loops: SensorLoops | None = None) -> tuple[BodePoint, ...]:
    """Return gain and phase of the elongation over its setpoint, at each frequency and amplitude of a run's sines."""
    elongation, _ = run_elongation(recording, fusion, loops)
    sines: dict[tuple[float, float], list[RecordedSegment]] = {}
    for one in recorded_segments(recording):
        if one.is_sine_of_elongation:
            sines.setdefault((one.segment.frequency_hz, abs(one.segment.amplitude)), []).append(one)
    if not sines:
        raise DataError("this run has no sines of elongation", "Record the plan sine-sweep-mm.")
    points = []
    for (_, amplitude), repeats in sines.items():
        windows = [(one, *_whole_periods(one)) for one in repeats]
        if len(windows) == 1:
            windows = _each_period(*windows[0])
        found = [_bode_point(recording.time_s, elongation, *window) for window in windows]
        points.append(replace(mean_bode_point(found), amplitude_mm=amplitude))
    return tuple(points)


def _whole_periods(one: RecordedSegment) -> tuple[float, float]:
    """Return begin and end, s, of the whole periods of a sine after its transient."""
    period_s = 1.0 / one.segment.frequency_hz
    last_s = one.begin_s + one.segment.moving_s(one.start)
    first_s = min(one.begin_s + max(period_s, 1.0), last_s - period_s)
    return last_s - math.floor((last_s - first_s) / period_s + 1e-9) * period_s, last_s


def _each_period(one: RecordedSegment, first_s: float, last_s: float) -> list[tuple[RecordedSegment, float, float]]:
    """Return the window of each period; of each two or more where one holds too few samples."""
    periods = max(1, round((last_s - first_s) * one.segment.frequency_hz))
    parts = max(1, periods // math.ceil(LEAST_PERIOD_S * one.segment.frequency_hz))
    edges = first_s + (last_s - first_s) / periods * np.floor(np.arange(parts + 1) * periods / parts)
    return [(one, low, high) for low, high in pairwise(edges.tolist())]


def _bode_point(
    time_s: FloatArray, elongation: FloatArray, one: RecordedSegment, first_s: float, last_s: float
) -> BodePoint:
    rows = slice(*np.searchsorted(time_s, [first_s, last_s]).tolist())
    t = time_s[rows]
    return bode_point(t - one.begin_s, one.setpoint(t), elongation[rows], one.segment.frequency_hz)


@dataclass(frozen=True, slots=True)
class StepResponse:
    """One step: times since the setpoint changed [n], elongation less its begin [n], and the step's size, mm."""

    time_s: FloatArray
    moved_mm: FloatArray
    size_mm: float


def step_responses(
    recording: Recording, fusion: Fusion, loops: SensorLoops | None = None
) -> dict[float, list[StepResponse]]:
    """Return the responses to a run's steps in millimetres, by the size of the step."""
    elongation, _ = run_elongation(recording, fusion, loops)
    smooth = _smoothed(elongation)
    sizes: dict[float, list[StepResponse]] = {}
    for one in recorded_segments(recording):
        size = one.step_mm
        if not size:
            continue
        grid = np.arange(0.0, one.end_s - one.begin_s - GRID_S, GRID_S)
        x, _ = _aligned(recording.time_s, smooth, one.begin_s, grid)
        sizes.setdefault(round(abs(size), 6), []).append(StepResponse(grid, x - one.start, size))
    if not sizes:
        raise DataError("this run has no steps of elongation", "Record the plan steps-mm.")
    return dict(sorted(sizes.items()))


def step_response_figures(steps: Sequence[StepResponse]) -> dict[str, DynamicFigure]:
    """Return the figures of repeated steps of one size."""
    return step_figures(
        [one.time_s for one in steps], [one.moved_mm for one in steps], [one.size_mm for one in steps], TOLERANCE_MM
    )


def _smoothed(values: FloatArray) -> FloatArray:
    """Return the running mean: noise would else count as overshoot, and as leaving the tolerance."""
    known = np.isfinite(values)
    weights = np.ones(9)
    total = np.convolve(np.where(known, values, 0.0), weights, "same")
    count = np.convolve(known.astype(np.float64), weights, "same")
    return np.where(count > 0, total / np.maximum(count, 1.0), np.nan)


def _aligned(time_s: FloatArray, values: FloatArray, begin_s: float, grid: FloatArray) -> tuple[FloatArray, float]:
    """Return values on a grid of times since `begin_s`, and their mean before it."""
    first, at, last = np.searchsorted(time_s, [begin_s - BEFORE_S, begin_s, begin_s + grid[-1] + 0.1]).tolist()
    part = slice(max(at - 1, 0), last)
    known = np.isfinite(values[part])
    if not known.any() or not np.isfinite(values[first:at]).any():
        raise DataError(f"the elongation at {begin_s:.1f} s is not known", "Choose steps inside the calibrated range.")
    return (
        np.interp(grid, time_s[part][known] - begin_s, values[part][known]),
        float(np.nanmean(values[first:at])),
    )
