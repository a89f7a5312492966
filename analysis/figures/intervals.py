"""Confidence intervals of figures: the bootstrap over cycles, and what widens or joins its intervals.

One bootstrap over the cycles is shared by all figures, so that they are consistent with one another.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.figures.figure import Figure, Reason
from analysis.statistics import bootstrap_interval
from protocol.base.arrays import FloatArray

NEVER_NEGATIVE = ("mV", "% FSO")  # spans, widths and spreads; slopes and decibels have a sign


def bootstrap_figure(value: float, replicates: FloatArray, unit: str, n: int, definition: str) -> Figure:
    """Return a figure with the interval of a bootstrap over `n` cycles; `replicates` are [resamples]."""
    positive = unit in NEVER_NEGATIVE
    low, high = bootstrap_interval(value, replicates, n, positive=positive)
    figure = Figure(float(value), unit, n, low, high, definition=definition)
    if not np.isfinite([low, high]).all():
        return replace(figure, note="one cycle gives no interval", reason=Reason.ONE_CYCLE) if n < 2 else figure
    return replace(figure, low=max(low, 0.0)) if positive else figure


def at_least(figure: Figure, reach: float) -> Figure:
    """Widen an interval, where there is one, to `reach` on either side of the value."""
    if not np.isfinite([figure.low, figure.high]).all():
        return figure
    least = 0.0 if figure.unit in NEVER_NEGATIVE else -np.inf

    low = min(figure.low, max(figure.value - reach, least))
    return replace(figure, low=low, high=max(figure.high, figure.value + reach))


def with_reach(figure: Figure, reach: float) -> Figure:
    """Widen an interval, where there is one, by a further reach on either side, as of an independent part."""
    if not reach > 0 or not np.isfinite([figure.value, figure.low, figure.high]).all():
        return figure
    low = figure.value - np.hypot(figure.value - figure.low, reach)
    high = figure.value + np.hypot(figure.high - figure.value, reach)
    return replace(figure, low=float(max(low, 0.0)), high=float(high))


def with_shared_error(figure: Figure, shared: float) -> Figure:
    """Widen the interval of a distance by an error of the means at its ends, sd `shared`, that the cycles share."""
    return with_reach(figure, 1.96 * np.sqrt(2.0) * shared)


def unsettled(figure: Figure, rest: Figure, held_s: float) -> Figure:
    """Return a figure of holds that are not settled; its interval also holds that at rest."""
    ends = np.asarray([figure.low, figure.high, rest.low, rest.high])
    if figure.unit == "dB" or not np.isfinite([figure.value, rest.value]).all():
        return figure
    note = f"at {held_s:.2g} s: the holds are not settled"
    note = f"{note}; {figure.note}" if figure.note else note
    reason = figure.reason if figure.reason is not Reason.NONE else Reason.NOT_SETTLED
    if not np.isfinite(ends).all():
        return replace(figure, note=note, reason=reason)
    low, high = min(figure.low, rest.low), max(figure.high, rest.high)
    return replace(figure, low=low, high=high, note=note, reason=reason)


def with_full_scale(figure: Figure, full_scale: Figure) -> Figure:
    """Widen the interval of a figure in dB or % FSO by that of its full scale, as of independent parts."""
    ends = np.asarray([full_scale.low, full_scale.high])
    if figure.unit == "mV" or not np.isfinite([figure.value, figure.low, figure.high, *ends]).all() or not ends[0] > 0:
        return figure

    value, (smaller, larger) = figure.value, np.maximum(ends, 0.5 * ends[0]) / full_scale.value
    if figure.unit == "dB":
        down, up = np.abs(20.0 * np.log10([smaller, larger]))
    else:
        up, down = np.abs(value * (1.0 / np.array([smaller, larger]) - 1.0))
        down, up = (up, down) if value < 0 else (down, up)
    low, high = value - np.hypot(value - figure.low, down), value + np.hypot(figure.high - value, up)
    low = max(low, 0.0) if figure.unit in NEVER_NEGATIVE else low
    return replace(figure, low=float(low), high=float(high))


def combined_error(parts: list[Figure]) -> Figure:
    """Root sum of squares of non-linearity, hysteresis and repeatability, % FSO (ISA-S37.1, static error)."""
    definition = "sqrt(non-linearity^2 + hysteresis^2 + repeatability^2)"
    missing = next((p for p in parts if not np.isfinite(p.value)), None)
    if missing is not None:
        return Figure.nothing("% FSO", missing.reason, missing.void, definition)

    # each part's half-interval propagated linearly; the parts share cycles, so this is the cautious sum of squares
    value = np.sqrt(sum(p.value**2 for p in parts))
    share = 1.0 / value if value > 0 else 0.0
    down = np.sqrt(sum((p.value * (p.value - p.low)) ** 2 for p in parts)) * share
    up = np.sqrt(sum((p.value * (p.high - p.value)) ** 2 for p in parts)) * share
    n = min(p.n for p in parts)
    return Figure(float(value), "% FSO", n, float(value - down), float(value + up), definition=definition)


def no_full_scale(unit: str, definition: str = "") -> Figure:
    return Figure.nothing(unit, Reason.NO_FULL_SCALE, "the full-scale output is zero", definition)
