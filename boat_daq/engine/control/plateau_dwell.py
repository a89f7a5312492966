"""One step of a run, watched sample by sample: has the pressure arrived, settled, and is the plateau steady?

Arrival is judged by the measured pressure alone, so that a board that never reports HOLDING works as well. The outcome
depends on the samples and their board time only, not on how they were cut into blocks, so that a run at 100 times real
time takes the same decisions at the same samples.

- *arrived*: the first sample of the present stay within `tolerance_kpa` of the target. Leaving ends the stay.
- *settled*: `settling_s` later, still within.
- a *plateau* ends once `min_dwell_s` is over and the later half of its settled part (at least `window_s`, at most four
  times that) shows no credible drift of pressure or signals (`drift`); or at `max_dwell_s`, marked not steady.
- a *turning point* ends after `min_dwell_s`; a plateau that is *passed* ends with its arrival.
- the step times out when the pressure is not within tolerance `arrival_timeout_s` after the ramp should have brought
  it there, or after it left.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.plan import Plan, PlannedStep
from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.snapshot import Phase
from protocol.base.units import COVERAGE_FACTOR

_MIN_SAMPLES = 8
MIN_EFFECTIVE = 3.0


@dataclass(frozen=True, slots=True)
class Drift:
    """Slope of a channel over a window."""

    slope: float  # unit per second
    std_error: float
    scatter: float  # rms of the residuals, in the channel's unit
    n_eff: float

    def within(self, tolerance: float) -> bool:
        """Whether no drift faster than `tolerance` (unit per second) is credible."""
        return abs(self.slope) + COVERAGE_FACTOR * self.std_error <= tolerance


def drift(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> Drift:
    """Return the drift of `values` [n] over `time_s` [n].

    Too few samples, or samples of one instant, give an infinite standard error, so that nothing follows from them.
    """
    n = len(values)
    t = time_s - time_s.mean() if n else time_s
    s_tt = float(t @ t)
    if n < _MIN_SAMPLES or s_tt == 0 or not np.isfinite(values).all():
        return Drift(0.0, math.inf, math.inf, 0.0)
    slope = float(t @ (values - values.mean()) / s_tt)
    residuals = values - values.mean() - slope * t
    energy = float(residuals @ residuals)
    if energy <= 1e-24 * max(1.0, float(values @ values)):  # a straight line within rounding
        return Drift(slope, 0.0, 0.0, float(n))
    r = min(max(float(residuals[1:] @ residuals[:-1]) / energy, 0.0), 0.999)
    n_eff = n * (1 - r) / (1 + r)
    if n_eff < MIN_EFFECTIVE:
        return Drift(slope, math.inf, math.sqrt(energy / n), n_eff)
    variance = energy / n * n_eff / (n_eff - 2)
    return Drift(slope, math.sqrt(variance / s_tt * n / n_eff), math.sqrt(energy / n), n_eff)


_LONGEST_WINDOW = 4.0  # times window_s


def _us(seconds: float) -> int:
    return round(seconds * 1e6)


class StepWatch:
    """Watches one step; `outcome` becomes "reached" or "timeout" at `ended_us`."""

    def __init__(self, plan: Plan, step: PlannedStep, *, started_us: int, wait_for_reading: bool = False) -> None:
        self._plan, self._step = plan, step
        self._started_us = started_us
        self._deadline_us: int | None = None
        self._steady_since_us: int | None = None  # the plateau could end here, were it not for its reading
        self._next_check_us = 0
        self._kept: list[Columns] = []  # the present stay, its latest part
        self._first_arrival_us: int | None = None
        self._extremes = (math.inf, -math.inf)
        self._excursions = 0
        self._drifts: dict[str, Drift] = {}
        self._steady = False
        self.reading_awaited = wait_for_reading and step.plateau
        self.reading_timed_out = False
        self.arrived_us: int | None = None
        self.settled_us: int | None = None
        self.ended_us: int | None = None
        self.outcome: str | None = None

    def commanded(self, time_us: int, from_kpa: float) -> None:
        """Begin the time allowed. The board has acknowledged the command at `time_us`, at `from_kpa`."""
        ramp_s = abs(self._step.target_kpa - from_kpa) / self._plan.ramp_kpa_per_s
        self._deadline_us = time_us + _us(ramp_s + self._plan.arrival_timeout_s)

    @property
    def phase(self) -> Phase:
        if self.arrived_us is None:
            return Phase.RAMPING
        if self._steady_since_us is not None and self.outcome is None:
            return Phase.WAITING_FOR_READING
        return Phase.SETTLING if self.settled_us is None else Phase.DWELLING

    def waited_s(self, now_us: int) -> float:
        """Return how long the plateau has waited for its reading by `now_us`, seconds. 0 where it did not."""
        if self._steady_since_us is None:
            return 0.0
        return ((self.ended_us or now_us) - self._steady_since_us) / 1e6

    def feed(self, block: Columns) -> None:
        known = block.pressure_known
        if not known.all():
            block = block.part(known)
        if not len(block) or self.outcome is not None:
            return
        inside = np.abs(block.pressure_kpa - self._step.target_kpa) <= self._plan.tolerance_kpa
        low, high = self._extremes
        self._extremes = min(low, float(block.pressure_kpa.min())), max(high, float(block.pressure_kpa.max()))
        i = 0
        while i < len(block) and self.outcome is None:
            i = self._seek(block, inside, i) if self.arrived_us is None else self._hold(block, inside, i)

    def _seek(self, block: Columns, inside: np.ndarray[Any, np.dtype[np.bool_]], i: int) -> int:
        """Search for the arrival from sample `i` on; return the next sample to look at."""
        n = len(block)
        arrival = i + int(np.argmax(inside[i:])) if inside[i:].any() else n
        late = n if self._deadline_us is None else int(np.searchsorted(block.time_us, self._deadline_us))
        if max(late, i) < arrival:
            self.outcome, self.ended_us = "timeout", int(block.time_us[max(late, i)])
            return n
        if arrival == n:
            return n
        self.arrived_us = int(block.time_us[arrival])
        self._first_arrival_us = self._first_arrival_us or self.arrived_us
        hold_s = 0.0 if self._step.passed else self._plan.min_dwell_s
        if self._step.plateau:
            hold_s = max(hold_s, self._plan.settling_s + self._plan.window_s)
        self._next_check_us = self.arrived_us + _us(hold_s)
        return arrival

    def _hold(self, block: Columns, inside: np.ndarray[Any, np.dtype[np.bool_]], i: int) -> int:
        """Follow the stay within tolerance from sample `i` up to the next check. Return the next sample to look at."""
        assert self.arrived_us is not None
        n = len(block)
        left = n if inside[i:].all() else i + int(np.argmin(inside[i:]))
        check = max(i, int(np.searchsorted(block.time_us, self._next_check_us)))
        self._kept.append(block.part(slice(i, min(left, check + 1, n))))
        settled_us = self.arrived_us + _us(self._plan.settling_s)
        if self.settled_us is None and block.time_us[min(left, check + 1, n) - 1] >= settled_us and left > i:
            self.settled_us = settled_us
        if check < left:
            self._check(int(block.time_us[check]))
            return check + 1
        if left < n:
            self._leave(int(block.time_us[left]))
        return left

    def _leave(self, time_us: int) -> None:
        """Discard what was held: the pressure left its target."""
        self._excursions += 1
        self._kept.clear()
        self.arrived_us = self.settled_us = None
        self._deadline_us = time_us + _us(self._plan.arrival_timeout_s)

    def _check(self, time_us: int) -> None:
        """End the step here if it may end."""
        assert self._first_arrival_us is not None
        self._next_check_us = time_us + max(_us(self._plan.window_s / 10), 10_000)
        if self._step.plateau:
            self._measure(time_us)
        enough = time_us - self._first_arrival_us >= _us(self._plan.max_dwell_s)
        if self._steady_since_us is None and not (self._steady or enough or not self._step.plateau):
            return
        if self.reading_awaited:
            self._steady_since_us = self._steady_since_us or time_us
            if time_us < self._steady_since_us + _us(self._plan.reading_timeout_s):
                return
            self.reading_timed_out = True
        self.outcome, self.ended_us = "reached", time_us

    def _measure(self, time_us: int) -> None:
        """Test the later part of the settled plateau for drift."""
        assert self.settled_us is not None
        window_us = _us(self._plan.window_s)
        length = min(max((time_us - self.settled_us) // 2, window_us), round(_LONGEST_WINDOW * window_us))
        self._kept = [part for part in self._kept if len(part) and part.time_us[-1] >= time_us - length]
        since = max(time_us - length, self.settled_us)
        usable = [part.usable & (part.time_us >= since) for part in self._kept]
        time_s = np.concatenate([part.time_us[use] for part, use in zip(self._kept, usable, strict=True)]) / 1e6
        pressure = np.concatenate([part.pressure_kpa[use] for part, use in zip(self._kept, usable, strict=True)])
        signals = np.concatenate([part.signal_mv[use] for part, use in zip(self._kept, usable, strict=True)])
        self._drifts = {"pressure_kpa": drift(time_s, pressure)} | {
            f"s{k + 1}_mv": drift(time_s, signals[:, k]) for k in range(signals.shape[1])
        }
        pressure_drift, *signal_drifts = self._drifts.values()
        self._steady = pressure_drift.within(self._plan.pressure_drift_kpa_per_s) and all(
            signal.within(self._plan.signal_drift_mv_per_s) for signal in signal_drifts
        )

    def detail(self) -> dict[str, Any]:
        """Return what is kept of the step beside its times.

        Keys carry their units; `drift` holds for each channel its slope and standard error (unit per second), its
        scatter (rms) and the effective number of samples.
        """
        found: dict[str, Any] = {"excursions": self._excursions}
        if math.isfinite(self._extremes[0]):
            found |= {"pressure_min_kpa": self._extremes[0], "pressure_max_kpa": self._extremes[1]}
        if self.settled_us is not None:
            found["settling_time_s"] = (self.settled_us - self._started_us) / 1e6
        if self._step.plateau and self._drifts:
            found["steady"] = self._steady
            found["drift"] = {name: asdict(d) for name, d in self._drifts.items() if math.isfinite(d.std_error)}
        if self.reading_timed_out:
            found["reading_timed_out"] = True
        if self._step.passed:
            found["passed"] = True
        return found
