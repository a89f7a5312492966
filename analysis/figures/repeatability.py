"""What a hundred cycles say: each figure per cycle, warm-up cycles, and a verdict against limits.

Strategy: everything is read from the loops. A cycle is warm-up while the mean displacement of its levels from the
second half of the run is beyond three robust standard deviations of that half, from the first cycle on without a break.

Rules: the warm-up is named, not removed; a verdict is given only against limits that the user set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import RequestError
from analysis.figures import sensor_figures as metrics
from analysis.figures.figure import SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.segmentation.loops import branch_mean, loop_width
from analysis.statistics import robust_sd

WARM_UP_SIGMA = 3.0
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
class PerCycle:
    """Figures of one sensor cycle by cycle, [cycles]: hysteresis % FSO, span mV, SNR dB, displacement % FSO."""

    numbers: tuple[int, ...]
    hysteresis_percent_fso: FloatArray
    span_mv: FloatArray
    snr_db: FloatArray
    displacement_percent_fso: FloatArray
    warm_up: int


@dataclass(frozen=True, slots=True)
class Verdict:
    """One limit: name, sensor, value, limit, and whether it is kept; None where the figure is void."""

    name: str
    sensor: str
    value: float
    limit: float
    unit: str
    kept: bool | None


def per_cycle(analysis: Analysis, sensor: int) -> PerCycle:
    """Return the figures of one sensor cycle by cycle."""
    loops, figures = analysis.loops, analysis.sensors[sensor].figures
    fso = figures["fso_mv"].value
    cycles = loops.n_cycles
    width = loop_width(loops.pressure_kpa, loops.signal_mv[sensor], np.ones((1, cycles)))
    levels = branch_mean(loops.signal_mv[sensor])
    whole = np.isfinite(levels).all(axis=0) if cycles else np.zeros(0, bool)
    common = levels[:, whole].mean(axis=1) if whole.any() else np.full(cycles, np.nan)
    span = np.abs(levels[:, whole][:, -1] - levels[:, whole][:, 0]) if whole.sum() > 1 else np.full(cycles, np.nan)
    later = common[cycles // 2 :]
    centre = float(np.median(later)) if later.size else float("nan")
    away = np.abs(common - centre) > WARM_UP_SIGMA * robust_sd(later)
    warm = int(np.argmin(away)) if away.size and not away.all() else 0
    scale = 100.0 / fso if fso > 0 else float("nan")
    return PerCycle(
        loops.numbers, scale * width.per_cycle, span, _snr(analysis, sensor, span), scale * (common - centre), warm
    )


def sensitivity_per_cycle(analysis: Analysis, sensor: int) -> tuple[FloatArray, str]:
    """Return the end-to-end sensitivity of each cycle, [cycles], and its unit.

    Span of the signal between the outermost levels that every cycle has, over the span of the elongation there (mV/mm)
    where it was read in every cycle; else over that of the pressure (mV/kPa), as in a continuous run.
    """
    loops = analysis.loops
    x, unit = loops.elongation_mm, "mV/mm"
    if x is None or not (np.isfinite(branch_mean(x)).sum(axis=1) > 1).all():
        x, unit = loops.pressure_kpa, "mV/kPa"
    abscissa, signal = branch_mean(x), branch_mean(loops.signal_mv[sensor])
    whole = np.flatnonzero((np.isfinite(abscissa) & np.isfinite(signal)).all(axis=0))
    if not loops.n_cycles or whole.size < 2:
        return np.full(loops.n_cycles, np.nan), unit
    first, last = whole[0], whole[-1]
    across = np.abs(abscissa[:, last] - abscissa[:, first])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(across > 0, np.abs(signal[:, last] - signal[:, first]) / across, np.nan), unit


def judge(analysis: Analysis, limits: Mapping[str, float]) -> list[Verdict]:
    """Compare the figures of every sensor with limits.

    Raises
    ------
    RequestError : a limit for something that has none.
    """
    verdicts = []
    for name, limit in limits.items():
        if name not in LIMITS:
            raise RequestError(f"there is no limit called {name!r}", f"Known: {', '.join(LIMITS)}.")
        key, is_lower = LIMITS[name], name in LOWER_LIMITS
        for sensor in analysis.sensors:
            value = sensor.figures[key].value if key in sensor.figures else float("nan")
            value = value if is_lower else abs(value)
            kept = None if not np.isfinite(value) else bool(value >= limit if is_lower else value <= limit)
            verdicts.append(Verdict(name, sensor.name, float(value), limit, SENSOR_FIGURES[key].unit, kept))
    return verdicts


def _snr(analysis: Analysis, sensor: int, span: FloatArray) -> FloatArray:
    if analysis.plateaus:
        squares, dof, of = metrics.staircase_noise(analysis.plateaus, sensor)
    else:
        squares, dof, of = metrics.continuous_noise(analysis.recording, analysis.cycles, sensor)
    found = np.full(len(analysis.loops.numbers), np.nan)
    for k, number in enumerate(analysis.loops.numbers):
        inside = of == number
        if dof[inside].sum() > 0 and squares[inside].sum() > 0:
            noise = np.sqrt(squares[inside].sum() / dof[inside].sum())
            found[k] = 20.0 * np.log10(span[k] / noise) if span[k] > 0 else np.nan
    return found
