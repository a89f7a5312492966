"""Is the actuator degraded? Six figures of each cycle against the nominal actuator, and alarms from a sequential test.

Each figure (METHODS.md) is compared with its own healthy history: a unit's constant deviation is no fault. One fault
moves several figures; an alarm names the faults that it may follow from. Time in s, pressure in kPa, elongations in mm;
NaN where a value is unknown: without holds no fade, of one sensor no difference, in the run-in no loss.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Literal

import numpy as np

from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.monitoring.cusum import SelfStartingCusum, cycles_between_alarms, smallest_shift, threshold_for
from analysis.shadow.monitoring.leak import LeakWatch, second_branch
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, DataError

ActuatorFault = Literal["leak", "softening", "stiffening", "drift", "sensor disagreement"]
HEALTHY_CYCLES_BETWEEN_ALARMS = 1000.0
RUN_IN_CYCLES = 2
STEADY_KPA, SHORTEST_HOLD_S, _SETTLING_S, LEAST_PRESSURE_KPA = 0.75, 2.0, 0.7, 15.0
"""A hold: pressure slower than this (kPa/s) for so long; its beginning and low pressures are left out."""
PRESSURE_STEPS, FEWEST_STEPS = 24, 6
"""Gain, offset and differences are fitted through means over so many steps of pressure a branch; fewer give NaN."""

_CHANNELS: tuple[tuple[str, float, str, ActuatorFault | None, ActuatorFault | None], ...] = (
    ("loss", 0.3, "%/min", "leak", None),
    ("fade", 0.1, "%/min", "leak", None),
    ("gain", 0.002, "", "softening", "stiffening"),
    ("offset", 0.02, "mm", "drift", "drift"),
    ("difference", 0.02, "mm", "sensor disagreement", "sensor disagreement"),
    ("difference slope", 0.005, "mm/mm", "sensor disagreement", "sensor disagreement"),
)
"""Figure, floor of its spread (its least relevant change), unit, and what a rise or a fall of it means."""
_BRINGS: dict[ActuatorFault, tuple[ActuatorFault, ...]] = {
    "leak": ("drift", "stiffening"),
    "stiffening": ("leak",),
    "sensor disagreement": ("softening", "stiffening", "drift", "leak"),
}
"""The other faults whose figures a fault moves too."""
LIKELY = 0.5  # a fault whose sum is above this share of the threshold is named as a possible cause of another alarm

NOT_INDEPENDENT = "more often if cycles are correlated; the preceding ones are, or are too few to decide"


@dataclass(frozen=True, slots=True)
class CycleFigures:
    """One cycle in six figures; NaN where the cycle does not determine it. Units as in the module's table."""

    loss_percent_per_min: float
    fade_percent_per_min: float
    gain: float
    offset_mm: float
    difference_mm: float
    difference_slope: float


@dataclass(frozen=True, slots=True)
class Alarm:
    """One alarm. `may_follow_from`: other faults, active or halfway to an alarm, that would also move this figure."""

    fault: ActuatorFault
    figure: str
    unit: str
    shift: float  # how far the figure has moved from its healthy history, in `unit`
    since_cycle: int  # with cycle: first cycle of the change, and the cycle in which it was found (from 1)
    cycle: int
    healthy_cycles: float  # a healthy actuator shows this once in so many cycles
    may_follow_from: tuple[ActuatorFault, ...] = ()
    independent: bool = True  # whether the cycles before are independent, as `healthy_cycles` requires

    @property
    def sentence(self) -> str:
        """Return the alarm in words."""
        size = f"{100 * self.shift:+z.1f} %" if self.unit == "" else f"{self.shift:+.3g} {self.unit}"
        cause = f" (may follow from {' and '.join(self.may_follow_from)})" if self.may_follow_from else ""
        qualified = "" if self.independent else f"; {NOT_INDEPENDENT}"
        return (
            f"{self.fault} since cycle {self.since_cycle}{cause}: {self.figure} {size} from its history; "
            f"a healthy actuator shows this once in {min(self.healthy_cycles, 1e9):,.0f} cycles{qualified}"
        )


def deviation_mm(table: ReducedModel, pressure_kpa: FloatArray, elongation_mm: FloatArray) -> FloatArray:
    """Return measured minus nominal elongation, mm; NaN where either is unknown."""
    return np.asarray(elongation_mm) - table.nominal_elongation(pressure_kpa)[0]


def pressure_residual_kpa(table: ReducedModel, pressure_kpa: FloatArray, elongation_mm: FloatArray) -> FloatArray:
    """Return measured pressure minus the nominal pressure of the elongation, kPa; NaN where unknown."""
    return np.asarray(pressure_kpa) - table.nominal_pressure(elongation_mm)


def as_columns(
    time_s: FloatArray, pressure_kpa: FloatArray, elongations_mm: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times and pressures of shape (n,) and elongations of shape (n, sensors), of (n,) or (n, sensors)."""
    t, p, x = (np.asarray(values, dtype=float) for values in (time_s, pressure_kpa, elongations_mm))
    if not len(t) == len(p) == len(x):
        cause = f"{len(t)} times, {len(p)} pressures and {len(x)} elongations differ in number"
        raise DataError(cause, "give one of each for every sample")
    return t, p, x[:, None] if x.ndim == 1 else x


def mean_over_sensors(elongations_mm: FloatArray) -> FloatArray:
    """Return the mean of the sensors that have one, shape (n,), of (n, sensors); NaN where none has."""
    known = np.isfinite(elongations_mm)
    total = np.where(known, elongations_mm, 0.0).sum(axis=1)
    return np.where(known.any(axis=1), total / np.maximum(known.sum(axis=1), 1), np.nan)


def find_holds(time_s: FloatArray, pressure_kpa: FloatArray) -> list[slice]:
    """Return the stretches of steady pressure, without the settling at their beginning."""
    slow = np.abs(np.gradient(moving_mean(pressure_kpa, time_s, 0.5), time_s)) < STEADY_KPA
    slow &= np.isfinite(pressure_kpa) & (np.abs(pressure_kpa) >= LEAST_PRESSURE_KPA)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]]).astype(int)))
    holds = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        begin = int(np.searchsorted(time_s, time_s[first] + _SETTLING_S))
        if last - begin >= 3 and time_s[last - 1] - time_s[begin] >= SHORTEST_HOLD_S:
            holds.append(slice(begin, int(last)))
    return holds


def moving_mean(values: FloatArray, time_s: FloatArray, width_s: float) -> FloatArray:
    """Return the centred mean over a width in time, on the samples' own grid; NaN stays NaN."""
    known = np.isfinite(values)
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    half = max(1, round(width_s / max(step, 1e-9) / 2.0))
    kernel = np.ones(min(2 * half + 1, len(values)))
    total = np.convolve(np.where(known, values, 0.0), kernel, mode="same")
    weight = np.convolve(known.astype(float), kernel, mode="same")
    return np.where(known, total / np.maximum(weight, 1.0), np.nan)


def fade_percent_per_min(time_s: FloatArray, pressure_kpa: FloatArray) -> float:
    """Return the fall of the gauge in holds, % of the pressure a minute, by their variances; NaN without holds."""
    total, weights = 0.0, 0.0
    for hold in find_holds(time_s, pressure_kpa):
        t, p = time_s[hold], pressure_kpa[hold]
        lever = (t - t.mean()) * float(np.median(p))
        strength = float(lever @ lever)
        rate = -float(lever @ p) / strength
        rest = p - p.mean() + rate * lever
        variance = max(float(rest @ rest) / (len(p) - 2), 1e-12) / strength
        total, weights = total + rate / variance, weights + 1.0 / variance
    return 6000.0 * total / weights if weights > 0.0 else np.nan


def branch_means(pressure_kpa: FloatArray, *columns: FloatArray) -> list[FloatArray]:
    """Average columns over equal steps of pressure on each branch of a cycle: the length of holds has no weight.

    The branches part at the extreme at which the cycle does not begin; rows with a NaN in any column are left out.
    """
    known = np.isfinite(pressure_kpa) & np.isfinite(np.stack(columns)).all(axis=0)
    p = pressure_kpa[known]
    if not len(p) or np.ptp(p) == 0.0:
        return [np.empty(0) for _ in columns]
    step = np.minimum(((p - p.min()) / np.ptp(p) * PRESSURE_STEPS).astype(int), PRESSURE_STEPS - 1)
    place = step + PRESSURE_STEPS * second_branch(p)
    count = np.bincount(place, minlength=2 * PRESSURE_STEPS)
    return [np.bincount(place, c[known], 2 * PRESSURE_STEPS)[count > 0] / count[count > 0] for c in columns]


def line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return the value at x = 0 and the slope of a straight line; NaN where there are not enough different x."""
    known = np.isfinite(x) & np.isfinite(y)
    if known.sum() < FEWEST_STEPS or np.ptp(x[known]) < 0.5:
        return np.nan, np.nan
    slope, value = np.polyfit(x[known], y[known], 1)
    return float(value), float(slope)


def cycle_figures(
    table: ReducedModel,
    time_s: FloatArray,
    pressure_kpa: FloatArray,
    elongations_mm: FloatArray,
    leak: LeakWatch | None = None,
) -> CycleFigures:
    """Return one whole cycle's figures.

    Without `leak`, which has the cycles before, the loss is NaN: one cycle cannot separate a leak from hysteresis.
    """
    t, p, x = as_columns(time_s, pressure_kpa, elongations_mm)
    if len(t) < 10 or not (np.diff(t) > 0).all():
        raise DataError("a cycle needs ten samples or more, in rising time", "give whole cycles, in order")
    if not np.isfinite(x).any():
        raise DataError("no elongation is known in this cycle", "check the calibration's range: it gives NaN outside")
    mean = mean_over_sensors(x)
    offset, gain = line(*branch_means(p, table.nominal_elongation(p)[0], mean))
    apart = line(*branch_means(p, mean, x[:, 0] - x[:, 1])) if x.shape[1] > 1 else (np.nan, np.nan)
    loss = leak.take(t, p, p - table.nominal_pressure(mean)) if leak is not None else np.nan
    return CycleFigures(loss, fade_percent_per_min(t, p), gain, offset, *apart)


class Monitor:
    """Follows cycle after cycle and raises alarms."""

    def __init__(self, table: ReducedModel, healthy_cycles: float = HEALTHY_CYCLES_BETWEEN_ALARMS) -> None:
        if not healthy_cycles >= 10.0:
            raise ChoiceError(f"one false alarm in {healthy_cycles:g} cycles is too many", "allow one in 10 or fewer")
        self.table = table
        self.watched = np.array([[rise is not None, fall is not None] for _, _, _, rise, fall in _CHANNELS])
        self.threshold = threshold_for(healthy_cycles, int(self.watched.sum()))
        self.cycles = 0
        self._cusum = SelfStartingCusum(np.array([floor for _, floor, _, _, _ in _CHANNELS]))
        self._open: set[tuple[int, int]] = set()
        self._leak = LeakWatch(RUN_IN_CYCLES)

    def figures(self, time_s: FloatArray, pressure_kpa: FloatArray, elongations_mm: FloatArray) -> CycleFigures:
        """Return the figures of the next whole cycle (see `cycle_figures`); once each, in order, before `take`."""
        return cycle_figures(self.table, time_s, pressure_kpa, elongations_mm, self._leak)

    def take(self, figures: CycleFigures) -> list[Alarm]:
        """Take one cycle's figures; return the alarms that it raises for the first time, causes before effects."""
        self.cycles += 1
        if self.cycles <= RUN_IN_CYCLES:
            return []
        sums = self._cusum.update(np.array(astuple(figures)))
        raised = (sums > self.threshold) & self.watched
        self._open = {key for key in self._open if sums[key] > 0.0}
        fresh = [(int(i), int(j)) for i, j in np.argwhere(raised) if (int(i), int(j)) not in self._open]
        self._open.update(fresh)
        return sorted((self._alarm(i, j) for i, j in fresh), key=lambda alarm: len(alarm.may_follow_from))

    def _fault(self, channel: int, side: int) -> ActuatorFault | None:
        rise, fall = _CHANNELS[channel][3:]
        return rise if side == 0 else fall

    def smallest_shift(self) -> dict[str, float]:
        """Return the smallest lasting shift of each figure that would raise an alarm; infinite without a history."""
        history, spread = self._cusum.count, self._cusum.spread()
        return {
            channel[0]: smallest_shift(int(n), self.threshold) * float(s)
            for channel, n, s in zip(_CHANNELS, history, spread, strict=True)
        }

    def _alarm(self, channel: int, side: int) -> Alarm:
        fault = self._fault(channel, side)
        assert fault is not None  # only sides that are watched are raised
        name, _, unit, _, _ = _CHANNELS[channel]
        sums, length, shift = (a[channel, side] for a in (self._cusum.sums, self._cusum.length, self._cusum.shift))
        once = float(cycles_between_alarms(sums)) / int(self.watched.sum())
        likely = (self._cusum.sums > LIKELY * self.threshold) & self.watched
        causes = {other for i, j in np.argwhere(likely) if (other := self._fault(int(i), int(j)))}
        causes = {other for other in causes if fault in _BRINGS.get(other, ())}
        independent = not bool(self._cusum.dependent()[channel, side])
        since = self.cycles - int(length) + 1
        return Alarm(fault, name, unit, float(shift), since, self.cycles, once, tuple(sorted(causes)), independent)
