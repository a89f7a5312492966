"""What is poor about a calibration: the figures that miss a bound, with the bound and where it comes from.

Strategy: the bounds are those of the published sensors of this design. A figure misses its bound where it lies beyond
it together with its 95 % interval, so that nothing is called poor that the run could not tell.

Rules: a bound is no refusal; whoever looks may accept what is poor, knowing what it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analysis.calibration.fit import Calibration
    from analysis.figures.sensor_analysis import SensorAnalysis

PUBLISHED_R2 = 0.99971  # the lower of the two
LEAST_R2 = 1.0 - 2.0**2 * (1.0 - PUBLISHED_R2)
READINGS_MAY = 2.0  # times the variance that the grid alone makes: 99 % of a chi-square over some 16 positions


@dataclass(frozen=True, slots=True)
class Bound:
    """A figure's bound: its name in the figures, its words, the bound, at least or at most, and where from."""

    name: str
    words: str
    bound: float
    unit: str
    source: str
    least: bool = False


BOUNDS = (
    Bound("sensor_hysteresis_percent_fso", "sensor hysteresis", 5.0, "% FSO", "published, less than 5 % FSO"),
    Bound("system_hysteresis_percent_fso", "system hysteresis", 5.0, "% FSO", "published, less than 5 % FSO"),
    Bound("combined_error_percent_fso", "combined error", 24.2, "% FSO", "twice that of the published sensor 1"),
    Bound("snr_db", "SNR", 38.7, "dB", "twice the published noise", least=True),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Shortfall:
    """A figure that misses its bound."""

    words: str
    value: float
    bound: float
    unit: str
    source: str
    least: bool
    decimals: int = 1

    def __str__(self) -> str:
        """Return figure and bound, e.g. `R² 0.7512 (at least 0.9988)`."""
        value, bound = (f"{v:.{self.decimals}f}" for v in (self.value, self.bound))
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.words} {value}{unit} (at {'least' if self.least else 'most'} {bound})"


def shortfalls(sensor: SensorAnalysis, reading_sd_mm: float) -> tuple[Shortfall, ...]:
    """Return what is poor about a sensor's calibration; nothing where it has none.

    Parameters
    ----------
    reading_sd_mm : of a reading of x within its grid; it lowers the bound of R² by what the grid alone can make.
    """
    if sensor.calibration is None:
        return ()
    least_r2 = _least_r2(sensor.calibration, reading_sd_mm)
    found = []
    if sensor.calibration.r2 < least_r2:
        grid = f" and what a grid of {np.sqrt(12.0) * reading_sd_mm:.2g} mm makes" if reading_sd_mm > 0 else ""
        source = f"twice the published residuals{grid}"
        found.append(Shortfall("R\u00b2", sensor.calibration.r2, least_r2, "", source, True, 4))
    for bound in BOUNDS:
        figure = sensor.figures.get(bound.name)
        if figure is None or not np.isfinite(figure.value):
            continue
        ends = [end for end in (figure.low, figure.value, figure.high) if np.isfinite(end)]
        if (max(ends) < bound.bound) if bound.least else (min(ends) > bound.bound):
            found.append(Shortfall(bound.words, figure.value, bound.bound, bound.unit, bound.source, bound.least))
    return tuple(found)


def _least_r2(calibration: Calibration, reading_sd_mm: float) -> float:
    low, high = calibration.x_range
    variance = float(np.var(calibration.y))
    if not variance > 0:
        return LEAST_R2
    by_reading = (reading_sd_mm * calibration.full_scale / (high - low)) ** 2
    return LEAST_R2 - READINGS_MAY * by_reading / variance
