"""The report's section on the digital shadow: the measured elongation beside that of the ideal actuator.

Rules: nothing is computed here but a thinning; the band is that of the modulus, two standard uncertainties.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from analysis import figure_style as style
from analysis.figures.against_shadow import AgainstShadow
from analysis.numbers import rounded
from analysis.reports.document import ReportDrawing, ReportTable, Section, SectionPart
from analysis.reports.drawings import TRACE_POINTS, envelope, over_cycles

if TYPE_CHECKING:
    from analysis.shadow.monitoring.replay import Replay

_TITLE = "Comparison with the digital shadow"


def shadow_section(compared: AgainstShadow) -> Section:
    """Deviation with its band over time and over cycles, pressure residual, alarms."""
    result = compared.result
    if result is None:
        return Section(_TITLE, (f"Not compared: {compared.void}.",))
    draws = [partial(_deviation, result), *([partial(_levels, compared)] if len(compared.numbers) > 1 else [])]
    caption = f"The band is that of the modulus, k = 2. Drift of the deviation: {result.trend}."
    alarms = tuple((str(alarm.cycle), alarm.sentence) for alarm in result.alarms)
    none = "No alarm: neither leak, softening, stiffening, drift nor disagreement of the sensors was found."
    parts: list[SectionPart] = [
        _summary(result),
        ReportTable(("Alarm in cycle", "Text"), alarms, numeric=False) if alarms else none,
        ReportDrawing(tuple(draws), caption, 2.2),
    ]
    parts += [f"Left out of the alarms: {'; '.join(result.left_out)}."] if result.left_out else []
    return Section(_TITLE, tuple(parts))


def _summary(result: Replay) -> str:
    found = result.summary()
    mean, rms = (rounded(float(found[f"deviation_{name}_mm"]), 0.05) for name in ("mean", "rms"))
    worst = rounded(abs(float(found["deviation_worst_mm"])), 0.05)
    return (
        f"The measured elongation deviates from the nominal one by {mean} mm on average ({rms} mm rms, at most {worst} "
        f"mm, {found['compared']} samples); the nominal one is uncertain by ± "
        f"{rounded(2.0 * float(np.nanmean(result.band_mm)), 0.05)} mm (k = 2) from the modulus."
    )


def _deviation(result: Replay, ax: Axes) -> None:
    time, low, high = envelope(result.time_s, result.deviation_mm, TRACE_POINTS // 2)
    step = max(1, result.time_s.size // TRACE_POINTS)
    band = 2.0 * result.band_mm[::step]
    ax.fill_between(result.time_s[::step], -band, band, color=style.ELONGATION_COLOUR, alpha=0.25, lw=0, label="band")
    ax.fill_between(
        time, low, high, color=style.SENSOR_COLOURS[0], lw=0.6, edgecolor=style.SENSOR_COLOURS[0], label="deviation"
    )
    ax.axhline(0.0, color=style.SOFT, linewidth=0.7)
    for alarm in result.alarms:
        ax.axvline(float(result.cycle_start_s[alarm.cycle - 1]), color=style.WARNING, lw=0.9)
    ax.set(xlabel="time, s", ylabel="deviation, mm", title="Measured less nominal elongation")
    ax.margins(x=0)
    ax.legend(ncols=2, loc="upper right")


def _levels(compared: AgainstShadow, ax: Axes) -> None:
    band = 2.0 * compared.band_mm
    numbers = compared.numbers
    ax.fill_between(numbers, -band, band, color=style.ELONGATION_COLOUR, alpha=0.25, lw=0)
    ax.plot(numbers, compared.level_mm, "o-", color=style.SENSOR_COLOURS[0], markersize=2.5, lw=0.8)
    ax.axhline(0.0, color=style.SOFT, linewidth=0.7)
    over_cycles(ax, "mean deviation, mm", "Deviation per cycle")
