"""When a run ends by its uncertainty: its value after each cycle, the cycles still needed, and the plateaus to hold.

The run is analysed again after every cycle. The square of a `StopCriterion` falls to that of its least value as a power
of the cycles; from that follow the cycles still needed. A calibration has one: U of one reading of all sensors, in the
middle of the range; its curve falls as one over the cycles; noise, loop, drift and repeatability do not. A
repeatability run has two, for its worse sensor: half widths of drift per 100 cycles (power 3) and repeatability (1).

The next cycles hold the ends, then the plateau whose reading lowers the largest variance of the curve most
(G-optimality), until U is expected to suffice. The others are passed in order, so that the loop's history stays.

A run must not end by chance: the effect of cycles is taken at its upper limit, and one cycle shows no repeatability, so
that no run ends before its second.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.calibration.fit import Calibration
from analysis.calibration.quantised_x import Positions, common_variance
from analysis.calibration_export.run_record import elongation_reader
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import AnalysedRun, Options, SensorAnalysis
from analysis.figures.uncertainty import Budget
from analysis.segmentation.cycle_effect import CycleEffect
from analysis.stopping.requirement import FEWEST_REPEATS
from protocol.base.arrays import FloatArray
from protocol.base.units import COVERAGE_FACTOR

FEWEST_CYCLES = 2
_CONFIDENCE = 0.9  # one-sided, of the limit of what the cycles may differ by in U that ends a run: by its coverage
DRIFT, SPREAD = "drift_percent_fso_per_100_cycles", "repeatability_percent_fso"
HELD_SHARE = 0.45
"""Of a branch's plateaus, held at least: one much faster than the others is taken for the way to the vented state."""
_POINTS = 41
_BRANCHES = ("unloading", "loading")


@dataclass(frozen=True, slots=True)
class StopCriterion:
    """A value that is to fall; its square falls to that of `least` as the cycles to minus `power`."""

    name: str
    unit: str
    now: float
    asked: float
    least: float = 0.0
    power: float = 1.0

    def after(self, cycles: int, more: int) -> float:
        """Return the value expected after `more` cycles than `cycles`."""
        falling = self.now**2 - self.least**2
        return math.sqrt(self.least**2 + falling * (cycles / (cycles + more)) ** self.power)

    def more_cycles(self, cycles: int) -> int | None:
        """Return the cycles that the value asked for takes beyond `cycles`, 0 if it is reached; None if none do."""
        if self.now <= self.asked:
            return 0
        rest = self.asked**2 - self.least**2
        if not (rest > 0.0 and self.asked > 0.0):
            return None
        needed = float(cycles * ((self.now**2 - self.least**2) / rest) ** (1.0 / self.power))
        return max(1, math.ceil(needed) - cycles)


@dataclass(frozen=True, slots=True)
class StopAssessment:
    """The state of a run after its cycles; `fewest` is the number before which it does not end.

    `criteria` are all to be met, none where `void` gives the reason; `hold` is branch and pressure, kPa, of the
    plateaus that the next cycles hold, None for all.
    """

    cycles: int
    planned: int
    fewest: int
    criteria: tuple[StopCriterion, ...]
    hold: tuple[tuple[str, float], ...] | None = None
    void: str = ""

    @property
    def more_cycles(self) -> int | None:
        """Further cycles until all is reached, 0 where it is; None if cycles do not lead to it."""
        each = [criterion.more_cycles(self.cycles) for criterion in self.criteria]
        known = [more for more in each if more is not None]
        return max(0, self.fewest - self.cycles, *known) if known and len(known) == len(each) else None

    @property
    def reached(self) -> bool:
        """Return whether the run may end."""
        return self.more_cycles == 0

    @property
    def at_least(self) -> str:
        """Return the rule that alone keeps the run from its end, its values being what was asked for; "" if none."""
        small = bool(self.criteria) and all(criterion.now <= criterion.asked for criterion in self.criteria)
        return f"{_cycles(self.fewest)} at least" if small and self.cycles < self.fewest else ""

    @property
    def now(self) -> str:
        """Return the values now and those asked for, in short."""
        return f"{self._values(0)} {self._unit} of {self._asked} {self._unit} asked"

    @property
    def best(self) -> str:
        """Return the values that the cycles of the plan lead to; "" where these suffice, or nothing is known."""
        more = self.more_cycles
        if not self.criteria or self.at_least or (more is not None and self.cycles + more <= self.planned):
            return ""
        lead = "leads" if self.planned == 1 else "lead"
        values = self._values(max(self.planned - self.cycles, 0))
        return f"the {_cycles(self.planned)} of the plan {lead} to {values} {self._unit}"

    @property
    def _asked(self) -> str:
        return f"{self.criteria[0].asked:g}"

    @property
    def _unit(self) -> str:
        return self.criteria[0].unit

    def _values(self, more: int) -> str:
        return ", ".join(f"{c.name}{_shown(c.after(self.cycles, more), c.asked)}" for c in self.criteria)

    @property
    def _measured(self) -> str:
        return f"{self._values(0)} {self._unit} after {_cycles(self.cycles)}, {self._asked} {self._unit} asked"

    @property
    def text(self) -> str:
        """Return the values now, those asked for, and what is still to do."""
        if self.void:
            return f"the uncertainty is not known after {_cycles(self.cycles)}: {self.void}"
        more, now = self.more_cycles, self._measured
        if more == 0:
            return f"{now}: reached"
        if self.at_least:
            return f"{now}: {_cycles(more or 0)} more, {self.at_least}"
        if self.best:
            return f"{now}: {'not reached' if more is None else f'{_cycles(more)} more'}, {self.best}"
        held = "" if self.hold is None else f", {len(self.hold)} plateaus each"
        return f"{now}: {_cycles(more or 0)} more{held}"

    @property
    def end(self) -> str:
        """Return the values at the end of a run, those asked for, and what these would have taken."""
        if self.void:
            return self.text
        if self.reached and self.cycles < self.planned:
            return f"ended after cycle {self.cycles}: {self.now}"
        return f"{self.now} after {self._of_planned}: {self._lacking}"

    @property
    def _of_planned(self) -> str:
        if self.cycles < self.planned:
            return f"{self.cycles} of {_cycles(self.planned)}"
        return f"all {_cycles(self.cycles)}" if self.cycles > 1 else _cycles(self.cycles)

    @property
    def _lacking(self) -> str:
        more = self.more_cycles
        if more is None:
            return "not reached, no number of cycles leads to it"
        if self.at_least or not more:
            return self.at_least or "reached"
        return f"not reached, about {more} more cycle{'s' if more > 1 else ''} needed"

    def as_json(self) -> dict[str, Any]:
        return asdict(self) | {"reached": self.reached, "more_cycles": self.more_cycles}


def _shown(value: float, asked: float) -> str:
    """Return a value with two digits, or as many more as show on which side of the one asked for it is."""
    texts = [f"{value:.{digits}g}" for digits in range(2, 7)]
    return next((text for text in texts if (float(text) <= asked) == (value <= asked)), texts[-1])


def _cycles(count: int) -> str:
    return f"{count} cycle" if count == 1 else f"{count} cycles"


def assess_calibration(analysis: Analysis, asked_mm: float, planned: int) -> StopAssessment:
    """Return the state of a calibration run for `asked_mm`, the U asked for (k = 2)."""
    cycles, budgets = len(analysis.cycles.used), analysis.budgets
    if budgets is None or budgets.void or not budgets.budgets:
        void = "no plateau was read" if budgets is None else budgets.void
        return StopAssessment(cycles, planned, FEWEST_CYCLES, (), void=void)
    if all(budget.void for budget in budgets.budgets):
        return StopAssessment(cycles, planned, FEWEST_CYCLES, (), void=budgets.budgets[0].void)
    worst = int(np.nanargmax([budget.u for budget in budgets.budgets]))
    u_mm = fused_u_mm(analysis, budgets.x_mm)
    calibration = analysis.sensors[worst].calibration
    assert calibration is not None
    least_mm = u_mm * math.sqrt(max(1.0 - _falling_share(budgets.budgets[worst], calibration.reading, cycles), 0.0))
    per_mv = 1.0 / abs(float(calibration.slope(budgets.x_mm)))
    now_mm = u_at_most(u_mm, CycleEffect.of(analysis.loops, worst), per_mv)
    criterion = StopCriterion("U ", "mm", now_mm, asked_mm, least_mm)
    hold = None
    if cycles >= FEWEST_CYCLES and criterion.now > asked_mm:
        hold = held_plateaus(analysis, calibration, criterion, budgets.x_mm)
    return StopAssessment(cycles, planned, FEWEST_CYCLES, (criterion,), hold)


def u_at_most(u_mm: float, effect: CycleEffect, mm_per_mv: float) -> float:
    """Return U with the effect of cycles at its upper limit.

    An estimate of few degrees of freedom is small by chance in some runs, and a rule that ends a run at a small U
    selects these, so that its U would cover less (Y. S. Chow, H. Robbins, Ann. Math. Statist. 36, 1965, 457).
    """
    wider = max(effect.upper_mv(_CONFIDENCE) ** 2 - effect.mean_variance, 0.0)
    return math.hypot(u_mm, COVERAGE_FACTOR * mm_per_mv * math.sqrt(wider))


def fused_u_mm(analysis: AnalysedRun, x_mm: float) -> float:
    """Return U (k = 2) of one fused reading at an elongation, as displayed live. DataError: a sensor has no inverse."""
    signals = [float(s.calibration.predict(x_mm)) for s in analysis.sensors if s.calibration is not None]
    return COVERAGE_FACTOR * float(elongation_reader(analysis).evaluate(signals).standard_uncertainty_mm)


def _falling_share(budget: Budget, reading: Positions | None, cycles: int) -> float:
    """Return the share of variance that falls with cycles: curve and reader's scatter, not the rounding to the grid."""
    shares = budget.shares()
    falling = shares.get("fit", 0.0)
    if reading is None:
        return falling
    shared = common_variance(reading.reader_sd, reading.grid)
    own = max(reading.reader_sd**2 + reading.grid**2 / 12.0 - shared, 0.0) / cycles
    return falling + shares.get("reading", 0.0) * (own / (own + shared) if own > 0.0 else 0.0)


def held_plateaus(
    analysis: AnalysedRun, calibration: Calibration, criterion: StopCriterion, x_mm: float
) -> tuple[tuple[str, float], ...] | None:
    """Return branch and pressure, kPa, of the plateaus to hold next: the fewest that lead to U at `x_mm`; None for all.

    All are held if one full cycle does not lead to U, or for a spline. A reading at x, of the variance s^2 of one
    point, updates the covariance by Sherman and Morrison's formula: C - C g g' C / (s^2 + g' C g), g the basis at x
    (Fedorov, Theory of optimal experiments, 1972).
    """
    loops = analysis.loops
    if calibration.spline is not None or loops.elongation_mm is None:
        return None
    with np.errstate(invalid="ignore"):
        x = np.asarray([[np.nanmean(one) if np.isfinite(one).any() else np.nan for one in branch.T]
                        for branch in loops.elongation_mm])  # fmt: skip
    last = x.shape[1] - 1
    left = [(b, g) for b in (0, 1) for g in range(last + 1) if np.isfinite(x[b, g])]
    basis, covariance = calibration.fit.basis, np.asarray(calibration.basis_covariance)
    grid, middle = basis.design(np.linspace(*calibration.x_range, _POINTS)), basis.design(np.array([x_mm]))[0]
    before, s2 = float(middle @ covariance @ middle), calibration.residual_sd**2
    held = [place for place in ((0, 0), (1, last)) if place in left]  # both ends close a branch
    for place in held:
        covariance = _read_at(covariance, basis.design(np.array([x[place]]))[0], s2)
    left = [place for place in left if 0 < place[1] < last]
    while True:
        share = float(middle @ covariance @ middle) / before if before > 0.0 else 1.0
        u2 = criterion.least**2 + (criterion.now**2 - criterion.least**2) * share
        short = [b for b in (0, 1) if sum(place[0] == b for place in held) < HELD_SHARE * last]
        if u2 <= criterion.asked**2 and not short:
            return tuple((_BRANCHES[b], float(loops.level_kpa[g])) for b, g in sorted(held))
        if not left:
            return None
        after = [_read_at(covariance, basis.design(np.array([x[place]]))[0], s2) for place in left]
        largest = np.asarray([np.max(np.einsum("ij,jk,ik->i", grid, each, grid)) for each in after])
        if u2 <= criterion.asked**2:
            largest[[place[0] not in short for place in left]] = np.inf
        best = int(np.argmin(largest))
        covariance = after[best]
        held.append(left.pop(best))


def _read_at(covariance: FloatArray, g: FloatArray, variance: float) -> FloatArray:
    """Return the covariance after one more reading."""
    shift = covariance @ g
    return np.asarray(covariance - np.outer(shift, shift) / (variance + float(g @ shift)))


def half_width(sensors: Sequence[SensorAnalysis], key: str) -> tuple[float, str]:
    """Return half the 95 % interval of `DRIFT` or `SPREAD`, % FSO, for the worse sensor; NaN and why if unknown."""
    figures = [sensor.figures[key] for sensor in sensors]
    void = next((figure.void for figure in figures if figure.void), "")
    half = max((figure.high - figure.low for figure in figures), default=math.nan) / 2.0
    return (half, "") if not void and math.isfinite(half) else (math.nan, void or "too few cycles for an interval")


def assess_repeats(analysis: Analysis, asked_percent: float, planned: int) -> StopAssessment:
    """Return the state of a repeatability run; `asked_percent` is the half width of both intervals, % FSO."""
    cycles, criteria = len(analysis.cycles.used), []
    for key, name, power in ((DRIFT, "drift ±", 3.0), (SPREAD, "repeatability ±", 1.0)):
        half, void = half_width(analysis.sensors, key)
        if void:
            return StopAssessment(cycles, planned, FEWEST_REPEATS, (), void=void)
        criteria.append(StopCriterion(name, "% FSO", half, asked_percent, power=power))
    return StopAssessment(cycles, planned, FEWEST_REPEATS, tuple(criteria))


def assess_run(file: str | Path, asked: float, planned: int, *, repeats: bool = False) -> StopAssessment:
    """Analyse a run as recorded so far, and return its state; `asked` is in mm, or % FSO if `repeats`."""
    if repeats:
        return assess_repeats(analyse(file, options=Options(mcmc=False)), asked, planned)
    return assess_calibration(analyse(file, options=Options(mcmc=False, fidelity="draft")), asked, planned)
