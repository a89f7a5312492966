"""Figures against limits: those of the published sensors of this design, and those that the user set.

A figure is out of tolerance where it lies beyond a published limit together with its 95 % interval. That refuses
nothing: a calibration that is out of tolerance may be accepted by an operator who knows it. A verdict is given only
against limits that the user set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analysis import published
from analysis.errors import RequestError
from analysis.figures.figure import SENSOR_FIGURES
from analysis.warning import Warning, WarningCode

if TYPE_CHECKING:
    from analysis.calibration.fit import Calibration
    from analysis.figures.sensor_analysis import SensorAnalysis

LEAST_R2 = 1.0 - 2.0**2 * (1.0 - min(sensor.r2 for sensor in published.SENSORS))
READING_ALLOWANCE = 2.0  # times the variance that the grid alone makes: 99 % of a chi-square over some 16 positions


@dataclass(frozen=True, slots=True)
class Tolerance:
    """The limit of a figure: its key, the limit, where it comes from, and whether it is a lower one."""

    key: str
    limit: float
    source: str
    is_lower: bool = False


TOLERANCES = (
    Tolerance("sensor_hysteresis_percent_fso", 5.0, "published, less than 5 % FSO"),
    Tolerance("system_hysteresis_percent_fso", 5.0, "published, less than 5 % FSO"),
    Tolerance("combined_error_percent_fso", 24.2, "twice that of the published sensor 1"),
    Tolerance("snr_db", 38.7, "twice the published noise", is_lower=True),
)


def out_of_tolerance(sensor: SensorAnalysis, reading_sd_mm: float) -> tuple[Warning, ...]:
    """Return a warning for each figure of a sensor's calibration that is out of tolerance; its subject is the figure.

    Parameters
    ----------
    sensor : analysed; without a calibration nothing is judged.
    reading_sd_mm : of a reading of x within its grid; it lowers the limit of R² by what the grid alone can make.
    """
    if sensor.calibration is None:
        return ()
    found = []
    least_r2, r2 = _least_r2(sensor.calibration, reading_sd_mm), sensor.calibration.r2
    if r2 < least_r2:
        grid = f" and what a grid of {np.sqrt(12.0) * reading_sd_mm:.2g} mm makes" if reading_sd_mm > 0 else ""
        text = f"R² {r2:.4f} is below {least_r2:.4f} (twice the published residuals{grid})"
        found.append(Warning(WarningCode.OUT_OF_TOLERANCE, "r2", text))
    for tolerance in TOLERANCES:
        figure, definition = sensor.figures.get(tolerance.key), SENSOR_FIGURES[tolerance.key]
        if figure is None or not np.isfinite(figure.value):
            continue
        ends = [end for end in (figure.low, figure.value, figure.high) if np.isfinite(end)]
        if (max(ends) < tolerance.limit) if tolerance.is_lower else (min(ends) > tolerance.limit):
            side = "below" if tolerance.is_lower else "above"
            value = f"{definition.phrase} {figure.value:.1f} {definition.unit}"
            text = f"{value} is {side} {tolerance.limit:.1f} ({tolerance.source})"
            found.append(Warning(WarningCode.OUT_OF_TOLERANCE, tolerance.key, text))
    return tuple(found)


def _least_r2(calibration: Calibration, reading_sd_mm: float) -> float:
    low, high = calibration.x_range
    variance = float(np.var(calibration.y))
    if not variance > 0:
        return LEAST_R2
    by_reading = (reading_sd_mm * calibration.full_scale / (high - low)) ** 2
    return LEAST_R2 - READING_ALLOWANCE * by_reading / variance


LIMITS = {  # name -> the figure that it limits
    "hysteresis": "system_hysteresis_percent_fso",
    "sensor_hysteresis": "sensor_hysteresis_percent_fso",
    "repeatability": "repeatability_worst_percent_fso",
    "drift": "drift_percent_fso_per_100_cycles",
    "nonlinearity": "nonlinearity_percent_fso",
    "snr": "snr_db",
    "sensitivity": "sensitivity_mv_per_mm",
}
LOWER_LIMITS = ("snr", "sensitivity")  # the others are upper limits


@dataclass(frozen=True, slots=True)
class Verdict:
    """One limit: name, sensor, value, limit, and whether it is kept; None where the figure is void."""

    name: str
    sensor: str
    value: float
    limit: float
    unit: str
    kept: bool | None


def judge(sensors: Sequence[SensorAnalysis], limits: Mapping[str, float]) -> list[Verdict]:
    """Compare the figures of every sensor with limits that the user set.

    Raises
    ------
    RequestError : a limit for something that has none.
    """
    verdicts = []
    for name, limit in limits.items():
        if name not in LIMITS:
            raise RequestError(f"there is no limit called {name!r}", f"Known: {', '.join(LIMITS)}.")
        key, is_lower = LIMITS[name], name in LOWER_LIMITS
        for sensor in sensors:
            value = sensor.figures[key].value if key in sensor.figures else float("nan")
            value = value if is_lower else abs(value)
            kept = None if not np.isfinite(value) else bool(value >= limit if is_lower else value <= limit)
            verdicts.append(Verdict(name, sensor.name, float(value), limit, SENSOR_FIGURES[key].unit, kept))
    return verdicts
