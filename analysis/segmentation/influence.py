"""Influence quantities: how a sensor's signal follows what was measured beside it, such as the temperature.

The difference of each value of the signal from the mean of its position (pressure and branch) is regressed on the same
difference of the channel: neither curve nor hysteresis nor readings enter. A continuous run gives one value a cycle.
The uncertainty is that of leaving out one cycle after the other (jackknife), at least that of independent values; the
degrees of freedom are those of the cycles, each counted by how much the channel differs in it. A channel that rises or
falls with time cannot be distinguished from drift, and is named so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import stats

from analysis.data.recording import Recording
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.loops import Loops, cluster_levels
from analysis.segmentation.plateaus import Plateau
from protocol.base.arrays import FloatArray, IntArray

CYCLES_LEAST = 3
ALIKE = 0.9  # correlation with time from which the effect of a channel cannot be distinguished from drift
_CONFIDENCE = 0.95
LEAST_PERCENT = 0.5  # of the full-scale output, over the channel's range: less is within what repeats


@dataclass(frozen=True, slots=True)
class ChannelInfluence:
    """What one channel, in the unit it was recorded in, explains of one sensor, or `void`.

    `correlation` is between the differences of signal and channel from the means of their positions; the coefficients
    are for one unit, mV with its U (95 %) and as elongation; `effect_percent_fso` is over the channel's range, `low` to
    `high`.
    """

    name: str
    unit: str
    column: str
    low: float
    high: float
    correlation: float = float("nan")
    correlation_with_time: float = float("nan")
    coefficient_mv: float = float("nan")
    expanded_mv: float = float("nan")
    coefficient_mm: float = float("nan")
    effect_percent_fso: float = float("nan")
    void: str = ""

    @property
    def significant(self) -> bool:
        """Whether the coefficient differs from zero by more than its uncertainty."""
        return abs(self.coefficient_mv) > self.expanded_mv

    @property
    def matters(self) -> bool:
        """Whether it is significant and moves the signal by a share of its full scale that is worth a warning."""
        return self.significant and not self.effect_percent_fso < LEAST_PERCENT

    @property
    def like_drift(self) -> bool:
        """Whether the channel changed with time so evenly that its effect may be drift."""
        return abs(self.correlation_with_time) > ALIKE

    def as_json(self) -> dict[str, Any]:
        """Return the object of `analyze --json`."""
        return {**asdict(self), "significant": self.significant, "like_drift": self.like_drift}


def influences(
    recording: Recording,
    cycles: Cycles,
    plateaus: Sequence[Plateau],
    loops: Loops,
    sensor: int,
    *,
    fso_mv: float,
    sensitivity_mv_per_mm: float,
) -> tuple[ChannelInfluence, ...]:
    """Return what each extra channel with values explains of one sensor; `fso_mv` and the sensitivity may be NaN."""
    if recording.channel is None:
        return ()
    holds = [p for p in plateaus if p.cycle in loops.numbers and p.branch in ("loading", "unloading") and not p.void]
    if plateaus:
        windows = [slice(p.settled_first, p.last + 1) for p in holds]
        cycle = np.asarray([p.cycle for p in holds], dtype=np.int64)
        signal = np.asarray([p.signal_mv[sensor] for p in holds])
        _, level = cluster_levels(np.asarray([p.pressure_kpa for p in holds]))
        position = np.asarray([2 * g + (p.branch == "loading") for g, p in zip(level, holds, strict=True)])
    else:
        used = [c for c in cycles.used if c.number in loops.numbers]
        windows = [c.rows for c in used]
        cycle = np.asarray([c.number for c in used], dtype=np.int64)
        signal, position = _of_cycles(loops.signal_mv[sensor]), np.zeros(len(used), np.int64)
    time_s = np.asarray([float(np.mean(recording.time_s[rows])) for rows in windows])
    found = []
    for i, channel in enumerate(recording.channels):
        values = recording.channel[:, i]
        if not np.isfinite(values).any() or channel.column == recording.meta.get("elongation_channel"):
            continue
        means = np.asarray([_mean(values[rows]) for rows in windows])
        parts = [values[rows] for rows in windows] or [values]
        inside = np.concatenate(parts)
        inside = inside[np.isfinite(inside)] if np.isfinite(inside).any() else values[np.isfinite(values)]
        head = (channel.name, channel.unit, channel.column, float(inside.min()), float(inside.max()))
        found.append(_influence(head, (signal, means, time_s), position, cycle, fso_mv, sensitivity_mv_per_mm))
    return tuple(found)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def _of_cycles(signal_mv: FloatArray) -> FloatArray:
    """Return the signal of each cycle [cycles]: the mean of its differences from the mean loop [2, cycles, levels]."""
    known = np.isfinite(signal_mv).all(axis=1, keepdims=True) & np.isfinite(signal_mv)
    inside = np.where(known, signal_mv, 0.0)
    difference = inside - inside.mean(axis=1, keepdims=True)
    result: FloatArray = difference.sum(axis=(0, 2)) / np.maximum(known.sum(axis=(0, 2)), 1)
    return result


def _influence(
    head: tuple[str, str, str, float, float],
    columns: tuple[FloatArray, FloatArray, FloatArray],
    position: IntArray,
    cycle: IntArray,
    fso_mv: float,
    sensitivity_mv_per_mm: float,
) -> ChannelInfluence:
    """Return the regression of a signal on a channel; `columns` are signal, channel and time, one value a hold."""
    keep = np.isfinite(columns[0]) & np.isfinite(columns[1])
    number = np.unique(cycle[keep]).size
    if number < CYCLES_LEAST:
        return ChannelInfluence(*head, void=f"{number} cycles; a coefficient needs {CYCLES_LEAST}")
    r, z, t = (_within(column[keep], position[keep]) for column in columns)
    spread, scale = float(z @ z), max(abs(head[3]), abs(head[4]), 1e-300)
    if spread <= z.size * (1e-9 * scale) ** 2:
        return ChannelInfluence(*head, void="it is constant at each position")
    slope = float(z @ r) / spread
    rest = r - slope * z
    groups = np.unique(cycle[keep], return_inverse=True)[1]
    products, squares = np.bincount(groups, weights=z * r), np.bincount(groups, weights=z * z)
    without = (products.sum() - products) / np.maximum(spread - squares, 1e-12 * spread)
    by_cycle = (number - 1) / number * float(((without - slope) ** 2).sum())
    free = max(r.size - np.unique(position[keep]).size - 1, 1)
    se = np.sqrt(max(by_cycle, float(rest @ rest) / free / spread))
    freedom = max(float(spread**2 / (squares @ squares)) - 1.0, 1.0)  # of cycles as far as the channel differs in them
    expanded = float(stats.t.ppf(0.5 + _CONFIDENCE / 2, freedom) * se)
    return ChannelInfluence(
        *head,
        correlation=_correlation(r, z),
        correlation_with_time=_correlation(t, z),
        coefficient_mv=slope,
        expanded_mv=expanded,
        coefficient_mm=slope / sensitivity_mv_per_mm if sensitivity_mv_per_mm else float("nan"),
        effect_percent_fso=100.0 * abs(slope) * (head[4] - head[3]) / fso_mv if fso_mv > 0 else float("nan"),
    )


def _within(values: FloatArray, position: IntArray) -> FloatArray:
    """Return each value less the mean of its position."""
    at = np.unique(position, return_inverse=True)[1]
    result: FloatArray = values - (np.bincount(at, weights=values) / np.bincount(at))[at]
    return result


def _correlation(one: FloatArray, other: FloatArray) -> float:
    scale = float(np.sqrt((one @ one) * (other @ other)))
    return float(one @ other) / scale if scale > 0 else float("nan")
