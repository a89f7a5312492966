"""A run beside the signals that the chain predicts: measured, predicted, their difference, and what disagrees.

Rules: a straight line and a parabola in elongation stand beside the chain, and all three predict each cycle from the
others. What disagrees is decided by the calibration; the chain, the model's light, takes no part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from analysis.calibration.inverse import Fusion, signal_at
from analysis.data.recording import Recording
from analysis.elongation_control.hysteresis import HysteresisModel
from analysis.json_object import json_object
from analysis.published import RANGE_MM, SENSORS
from analysis.signal_prediction.light_table import LightTable
from analysis.signal_prediction.predicted_signal import Disagreement, PredictedSignal, fit_signal_model, what_disagrees
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import DataError

AVERAGE_S = 1.0  # over which a disagreement is looked for
EXPECTED_U_MM = 0.05  # of the elongation that the hysteresis gives for a pressure: creep, and the memory before the run


@dataclass(frozen=True, slots=True)
class Baseline:
    """A polynomial in elongation, fitted to the readings of one sensor."""

    r2: float
    rms_percent_fso: float
    held_out_rms_mv: float  # of readings in cycles that the fit leaves out one by one


@dataclass(frozen=True, slots=True)
class SensorPrediction:
    """One sensor: the chain with gain and offset alone, and with the guide's loss too, beside polynomials."""

    before: PredictedSignal
    after: PredictedSignal
    line: Baseline
    parabola: Baseline
    held_out_rms_mv: float  # of the chain with loss, as that of a baseline

    @property
    def beats_parabola(self) -> bool:
        """Return whether the chain predicts cycles that it was not fitted to better than a parabola."""
        return self.held_out_rms_mv < self.parabola.held_out_rms_mv

    def as_json(self) -> dict[str, Any]:
        return json_object(self, "before", "after", "line", "parabola", "held_out_rms_mv", "beats_parabola")


@dataclass(frozen=True, slots=True)
class RunPrediction:
    """A run beside the chain."""

    sensors: tuple[SensorPrediction, ...]
    frame: pd.DataFrame  # a row a sample, columns named with their units
    words: Mapping[str, float]  # what disagrees, with the share of the run's seconds in percent


def predict_sensors(
    points: Sequence[tuple[FloatArray, FloatArray]], light: LightTable | None = None, *, cycles: int = 0
) -> tuple[SensorPrediction, ...]:
    """Return the forward models of sensors from their readings, (elongation mm [n], signal mV [n]) of each.

    `cycles`: how many the readings are of; without any, every fifth reading is left out.
    """
    return tuple(
        _predict_sensor(x, y, light, np.arange(len(x)) * cycles // len(x) if cycles > 1 else np.arange(len(x)) % 5)
        for x, y in points
    )


def _predict_sensor(x: FloatArray, y: FloatArray, light: LightTable | None, cycle: IntArray) -> SensorPrediction:
    def polynomial(degree: int) -> Baseline:
        def fit(x: FloatArray, y: FloatArray) -> Callable[[FloatArray], FloatArray]:
            return np.polynomial.Polynomial.fit(x, y, degree)

        rms = float(np.sqrt(np.mean((y - fit(x, y)(x)) ** 2)))
        return Baseline(
            1.0 - rms**2 / float(np.var(y)), 100.0 * rms / float(np.ptp(y)), _held_out_rms_mv(x, y, cycle, fit)
        )

    def chain(x: FloatArray, y: FloatArray) -> PredictedSignal:
        return fit_signal_model(x, y, light)

    before, after = fit_signal_model(x, y, light, fit_loss=False), chain(x, y)
    known = np.isfinite(x) & np.isfinite(y)
    x, y, cycle = x[known], y[known], cycle[known]
    return SensorPrediction(before, after, polynomial(1), polynomial(2), _held_out_rms_mv(x, y, cycle, chain))


def _held_out_rms_mv(
    x: FloatArray, y: FloatArray, cycle: IntArray,
    fit: Callable[[FloatArray, FloatArray], Callable[[FloatArray], FloatArray]],
) -> float:  # fmt: skip
    """Return the rms error of readings in cycles that the fit leaves out one by one; NaN where none can be."""
    away = np.full(len(x), np.nan)
    for one in np.unique(cycle):
        out = cycle == one
        try:
            away[out] = y[out] - fit(x[~out], y[~out])(x[out])
        except DataError:
            continue  # too few readings are left
    known = away[np.isfinite(away)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


def published_prediction() -> tuple[SensorPrediction, ...]:
    """Return how well the chain predicts the paper's published cubics, at 60 elongations of their range."""
    x = np.linspace(*RANGE_MM, 60)
    polyval = np.polynomial.polynomial.polyval
    curves = [np.asarray(polyval(x, sensor.coefficients), dtype=np.float64) for sensor in SENSORS]
    return predict_sensors([(x, curve) for curve in curves])


def predict_run(
    recording: Recording, model: HysteresisModel, fusion: Fusion, sensors: tuple[SensorPrediction, ...]
) -> RunPrediction:
    """Return a run beside the chain: pressure, elongation by the hysteresis, light, signals."""
    if recording.n_sensors != len(sensors):
        cause = f"the run has {recording.n_sensors} sensors, the calibration {len(sensors)}"
        raise DataError(cause, "Choose a run of this unit.")
    pressure = np.where(recording.pressure_usable, recording.pressure_kpa, np.nan)
    known = np.isfinite(pressure)
    expected = np.full(len(pressure), np.nan)
    expected[known] = model.series(pressure[known], model.rest(float(pressure[known][0]), 0.0)) if known.any() else 0.0
    columns: dict[str, Any] = {"time_s": recording.time_s, "pressure_kpa": pressure, "expected_mm": expected}
    for i, sensor in enumerate(sensors):
        predicted, noise = sensor.after(expected), noise_mv(fusion, i)
        name, measured = recording.sensor_names[i], recording.signal_mv[:, i]
        columns |= {f"{name}_mv": measured, f"{name}_predicted_mv": predicted}
        columns |= {f"{name}_band_mv": sensor.after.band_mv(noise), f"{name}_difference_mv": measured - predicted}
    words = second_by_second(recording.time_s, recording.signal_mv, expected, fusion)
    columns["disagreement"] = words
    counts = pd.Series(words).value_counts(normalize=True) * 100.0
    return RunPrediction(sensors, pd.DataFrame(columns), {str(k): float(v) for k, v in counts.items()})


@dataclass(frozen=True, slots=True)
class LivePrediction:
    """The signals that the chain predicts for a pressure, read from a table: hysteresis is in the band."""

    pressure_kpa: FloatArray  # with elongation_mm: [nodes] of the table, by the mean of both branches
    elongation_mm: FloatArray
    signal_mv: FloatArray  # with half_mv: [nodes, sensors] predicted, and half the width of its 95 % band
    half_mv: FloatArray
    loop_mm: float  # half the width of the actuator's hysteresis loop
    fusion: Fusion

    def __call__(self, pressure_kpa: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return predicted signals and half the width of their band, both [n, sensors]; NaN beyond the table."""
        found = [
            np.stack(
                [np.interp(pressure_kpa, self.pressure_kpa, c, left=np.nan, right=np.nan) for c in table.T], axis=1
            )
            for table in (self.signal_mv, self.half_mv)
        ]
        return found[0], found[1]

    def disagreement(self, signal_mv: FloatArray, pressure_kpa: float, samples: int) -> Disagreement:
        """Return what disagrees in the mean signals [sensors] of some samples at a mean pressure."""
        low, high = self.pressure_kpa[[0, -1]]
        if not low <= pressure_kpa <= high:
            return Disagreement.NONE
        expected = float(np.interp(pressure_kpa, self.pressure_kpa, self.elongation_mm))
        return disagreement(signal_mv, expected, samples, self.fusion, u_mm=self.loop_mm / 2.0 + EXPECTED_U_MM)


def live_prediction(model: HysteresisModel, fusion: Fusion, sensors: tuple[SensorPrediction, ...]) -> LivePrediction:
    """Return the table that live frames are predicted from. `model`, `fusion`, `sensors`: those of the unit."""
    (low, high), nodes = model.pressure_range_kpa, 2049
    pressure = np.linspace(low, high, nodes)
    swing = model.series(np.concatenate([np.linspace(high, low, nodes), pressure]), model.rest(high, -np.inf))
    falling, rising = swing[:nodes][::-1], swing[nodes:]
    mean = 0.5 * (falling + rising)
    loop = 0.5 * float(np.abs(falling - rising).max())
    signal = np.stack([one.after(mean) for one in sensors], axis=1)
    slope = np.abs(np.gradient(signal, mean, axis=0))
    misfit = [one.after.band_mv(noise_mv(fusion, i)) for i, one in enumerate(sensors)]
    return LivePrediction(pressure, mean, signal, np.hypot(misfit, slope * loop), loop, fusion)


def second_by_second(time_s: FloatArray, signal_mv: FloatArray, expected_mm: FloatArray, fusion: Fusion) -> list[str]:
    """Return for every sample what disagrees over the second around it."""
    blocks = np.floor(time_s / AVERAGE_S).astype(np.int64)
    edges = np.flatnonzero(np.diff(blocks, prepend=blocks[:1] - 1))
    words: list[str] = []
    for first, last in zip(edges, [*edges[1:], len(time_s)], strict=True):
        signal = np.asarray([_mean(column) for column in signal_mv[first:last].T])
        word = disagreement(signal, _mean(expected_mm[first:last]), int(last - first), fusion)
        words += [word.value] * int(last - first)
    return words


def _mean(values: FloatArray) -> float:
    """Return the mean of the known values; NaN where there is none."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def disagreement(
    signal_mv: FloatArray, expected_mm: float, samples: int, fusion: Fusion, *, u_mm: float = EXPECTED_U_MM
) -> Disagreement:
    """Return what disagrees in the mean of some samples; `u_mm` has the hysteresis in it."""
    residual, slope, u = (np.full(len(fusion.inverses), np.nan) for _ in range(3))
    for i, inverse in enumerate(fusion.inverses):
        low, high = inverse.x_range
        at = min(max(expected_mm, low), high)
        half = 0.5 * (high - low)
        scaled = np.clip(np.asarray([at - 1e-3, at + 1e-3]) - low - half, -half, half) / half
        values = signal_at(scaled, inverse.starts, inverse.powers)
        slope[i] = (values[1] - values[0]) / max((scaled[1] - scaled[0]) * half, 1e-9)
        residual[i] = signal_mv[i] - values.mean()
        noise, shared = (float(part[0]) for part in inverse.parts([at]))
        u[i] = abs(slope[i]) * float(np.hypot(noise / np.sqrt(max(samples, 1)), shared))
    return what_disagrees(residual, slope, np.maximum(u, 1e-3), u_mm)


def noise_mv(fusion: Fusion, sensor: int) -> float:
    """Return the noise of one sample of a sensor, mV, at the middle of its range."""
    inverse = fusion.inverses[sensor]
    slope = abs(float(inverse.nodes[-1] - inverse.nodes[0])) / (inverse.x_range[1] - inverse.x_range[0])
    return float(np.median(inverse.noise_mm)) * slope
