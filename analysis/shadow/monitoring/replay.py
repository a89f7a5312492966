"""A recording against the shadow, offline: deviation, pressure residual, drift over cycles, alarms.

Each cycle passes the same monitor as live, so a replay raises the alarms that the session raised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis import figure_style as style
from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.monitoring import monitor as monitoring
from analysis.shadow.monitoring.leak import known_mean
from analysis.shadow.monitoring.monitor import Alarm, CycleFigures, Monitor
from analysis.statistics import theil_sen
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_OF_ALARM = ("since_cycle", "cycle", "figure", "shift", "unit", "healthy_cycles", "sentence")


@dataclass(frozen=True, slots=True)
class Replay:
    """A recording compared with the shadow; `smallest_shift` would have raised an alarm at its end."""

    time_s: FloatArray  # with pressure_kpa, elongation_mm: shape (n,), the recording (mean of the sensors)
    pressure_kpa: FloatArray
    elongation_mm: FloatArray
    deviation_mm: FloatArray  # with residual_kpa: shape (n,), NaN where unknown
    residual_kpa: FloatArray
    band_mm: FloatArray  # shape (n,), standard uncertainty of nominal elongation from E
    cycle_start_s: FloatArray  # shape (cycles,)
    levels_mm: FloatArray  # shape (cycles,), mean deviation of each
    figures: tuple[CycleFigures, ...]
    alarms: tuple[Alarm, ...]
    # drift_mm_per_cycle, drift_interval: Theil-Sen slope of the cycles' mean deviation with its 95 % interval
    drift_mm_per_cycle: float
    drift_interval: tuple[float, float]
    left_out: tuple[str, ...]  # cycles without figures, each with its cause
    smallest_shift: dict[str, float] = field(default_factory=dict)

    @property
    def trend(self) -> str:
        """The drift of the cycles' mean deviation in words, as in `+0.3 um a cycle [-3.0, +3.2]: none found`."""
        low, high = self.drift_interval
        if not np.isfinite(self.drift_mm_per_cycle):
            return "fewer than three cycles, not given"
        found = "none found" if low <= 0.0 <= high else "significant"
        text = f"{1000 * self.drift_mm_per_cycle:+z.1f} \u00b5m a cycle [{1000 * low:+z.1f}, {1000 * high:+z.1f}]"
        return f"{text} (Theil-Sen, 95 %): {found}"

    def summary(self) -> dict[str, Any]:
        """Return the numbers of a report, JSON-ready apart from NaN."""
        known = self.deviation_mm[np.isfinite(self.deviation_mm)]
        size = len(known)
        return {
            "samples": len(self.time_s),
            "compared": size,
            "cycles": len(self.figures),
            "deviation_mean_mm": float(known.mean()) if size else np.nan,
            "deviation_rms_mm": float(np.sqrt((known**2).mean())) if size else np.nan,
            "deviation_worst_mm": float(known[np.argmax(np.abs(known))]) if size else np.nan,
            "deviation_per_cycle_mm": self.levels_mm.tolist(),
            "residual_rms_kpa": float(np.sqrt(np.nanmean(self.residual_kpa**2))) if size else np.nan,
            "drift_mm_per_cycle": self.drift_mm_per_cycle,
            "drift_interval_mm_per_cycle": self.drift_interval,
            "alarms": [{"illness": a.fault} | {name: getattr(a, name) for name in _OF_ALARM} for a in self.alarms],
            "smallest_shift_found": self.smallest_shift,
            "left_out": self.left_out,
        }


def replay(
    table: ReducedModel,
    time_s: FloatArray,
    pressure_kpa: FloatArray,
    elongations_mm: FloatArray,
    cycles: Sequence[slice],
) -> Replay:
    """Compare a recording with the shadow."""
    t, p, x = monitoring.as_columns(time_s, pressure_kpa, elongations_mm)
    if not (np.isfinite(x).any(axis=1) & np.isfinite(p)).any():
        cause = "the recording has no sample with both pressure and elongation"
        raise DataError(cause, "give a calibration that covers its signals")
    mean = monitoring.mean_over_sensors(x)
    deviation = monitoring.deviation_mm(table, p, mean)
    monitor = Monitor(table)
    figures, alarms, used, left_out = [], [], [], []
    for number, rows in enumerate(cycles, 1):
        try:
            figures.append(monitor.figures(t[rows], p[rows], x[rows]))
        except DataError as error:
            left_out.append(f"cycle {number}: {error.cause}")
        else:
            used.append(rows)
            alarms += monitor.take(figures[-1])
    levels = np.array([known_mean(deviation[rows]) for rows in used])
    slope, low, high = drift(levels)
    return Replay(
        time_s=t,
        pressure_kpa=p,
        elongation_mm=mean,
        deviation_mm=deviation,
        residual_kpa=monitoring.pressure_residual_kpa(table, p, mean),
        band_mm=table.nominal_elongation(p)[1],
        cycle_start_s=np.array([t[rows][0] for rows in used]),
        levels_mm=levels,
        figures=tuple(figures),
        alarms=tuple(alarms),
        drift_mm_per_cycle=slope,
        drift_interval=(low, high),
        left_out=tuple(left_out),
        smallest_shift=monitor.smallest_shift(),
    )


def drift(levels_mm: FloatArray) -> tuple[float, float, float]:
    """Return the Theil-Sen slope over cycles with its 95 % interval, mm a cycle; NaN for fewer than three."""
    number = np.flatnonzero(np.isfinite(levels_mm))
    return theil_sen(number.astype(np.float64), levels_mm[number])


@style.styled
def replay_figure(result: Replay) -> Figure:
    """Draw the deviation with its band over time, and the cycles' mean deviation with the alarms."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    above, below = figure.subplots(2, height_ratios=(3, 2))
    step = max(1, len(result.time_s) // 20_000)
    time, band = result.time_s[::step], 2.0 * result.band_mm[::step]
    above.fill_between(time, -band, band, color=style.ELONGATION_COLOUR, alpha=0.25, lw=0, label="band from E, k = 2")
    above.plot(time, result.deviation_mm[::step], color=style.SENSOR_COLOURS[0], lw=0.6, label="measured minus nominal")
    above.set(xlabel="time, s", ylabel="deviation, mm")
    above.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0))
    below.xaxis.set_major_locator(MaxNLocator(integer=True))
    below.plot(
        np.arange(1, len(result.levels_mm) + 1), result.levels_mm, "o-", color=style.SENSOR_COLOURS[0], ms=3, lw=0.8
    )
    look: Any = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "color": style.SENSOR_COLOURS[1]}
    for i, alarm in enumerate(result.alarms):
        below.axvline(alarm.cycle, color=style.SENSOR_COLOURS[1], lw=0.8)
        below.annotate(alarm.fault, (alarm.cycle, 1.0 - 0.14 * (i % 6)), xytext=(3, -9), fontsize=8, **look)
    below.set(xlabel="cycle", ylabel="mean deviation, mm")
    return figure
