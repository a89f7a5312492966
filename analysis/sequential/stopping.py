"""When a run knows enough: what its cycles leave uncertain, and how many more a smaller uncertainty takes.

Strategy: the budget of an elongation (`analysis.figures.uncertainty`) is made again after every cycle. What the curve
leaves open falls with the square root of the cycles; noise, loop, drift and repeatability of the unit do not. From that
follow the cycles that the U asked for takes, and the U that no number of cycles goes below.

Of a repeatability run, drift and spread are known by the intervals of their figures (95 %, bootstrap over the cycles):
the half width of the drift per 100 cycles falls with the power 3/2 of the cycles, that of the repeatability with the
root.

Rules: U is that of a reading of all sensors together, as the live display states it, in the middle of the range. A run
is never ended before its second cycle, because one cycle shows no repeatability. U is stated as it is after the last
cycle that was run, whatever rule ended the run (METHODS.md has what was measured of it).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.calibration.fit import Calibration
from analysis.errors import RequestError
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import AnalysedRun, Options
from analysis.figures.uncertainty import COVERAGE_FACTOR, Budget, elongation_reader

FEWEST_CYCLES = 2
FEWEST_REPEATS = 10
"""Cycles of a repeatability run before it may end: fewer leave the widths of the intervals themselves uncertain."""
DRIFT, SPREAD = "drift_percent_fso_per_100_cycles", "repeatability_percent_fso"
FALLING = ("fit",)
"""Components of the budget that fall as one over the root of the cycles."""
_POINTS = 41


@dataclass(frozen=True, slots=True)
class Enough:
    """What a run knows after its cycles.

    Parameters
    ----------
    cycles : complete ones so far.
    u_mm, asked_mm : U of an elongation (k = 2), NaN where it is not known; and the U asked for.
    least_mm : U after any number of further cycles.
    more_cycles : further cycles that the U asked for takes, 0 if it is reached; None if cycles do not lead to it.
    next_kpa : plateau at which a further reading would lower the largest uncertainty of the curve most; NaN if unknown.
    void : why U is not known, or "".
    """

    cycles: int
    u_mm: float
    asked_mm: float
    least_mm: float
    more_cycles: int | None
    next_kpa: float = math.nan
    void: str = ""

    @property
    def reached(self) -> bool:
        """Return whether the run may end."""
        return self.more_cycles == 0

    @property
    def now(self) -> str:
        """Return U now and U asked."""
        return f"U {self.u_mm:.3f} mm, {self.asked_mm:g} mm asked"

    @property
    def text(self) -> str:
        """Return U now, U asked, and what is still to do."""
        if self.void:
            return f"U is not known after {_cycles(self.cycles)}: {self.void}"
        now = f"U {self.u_mm:.3f} mm after {_cycles(self.cycles)}, {self.asked_mm:g} mm asked"
        if self.reached:
            return f"{now}: reached"
        if self.more_cycles is None:
            return f"{now}: not reached by more cycles, which lead to {self.least_mm:.3f} mm at best"
        return f"{now}: {_cycles(self.more_cycles)} more"

    def as_json(self) -> dict[str, Any]:
        """Return it as a dictionary."""
        return asdict(self) | {"reached": self.reached}


def _cycles(count: int) -> str:
    return f"{count} cycle" if count == 1 else f"{count} cycles"


@dataclass(frozen=True, slots=True)
class EnoughRepeats:
    """What a repeatability run knows after its cycles, of the worse sensor.

    Parameters
    ----------
    cycles : complete ones so far.
    drift_percent, spread_percent : half widths of the 95 % intervals of drift per 100 cycles and repeatability, % FSO.
    asked_percent : both half widths that are asked for.
    more_cycles : further cycles that they take, 0 if they are reached.
    void : why they are not known, or "".
    """

    cycles: int
    drift_percent: float
    spread_percent: float
    asked_percent: float
    more_cycles: int | None
    void: str = ""

    @property
    def reached(self) -> bool:
        """Return whether the run may end."""
        return self.more_cycles == 0

    @property
    def now(self) -> str:
        """Return what is known now and what is asked."""
        return f"drift ±{self.drift_percent:.2g}, spread ±{self.spread_percent:.2g} % FSO, {self.asked_percent:g} asked"

    @property
    def text(self) -> str:
        """Return what is known now, what is asked, and what is still to do."""
        if self.void:
            return f"drift and spread are not known after {_cycles(self.cycles)}: {self.void}"
        now = (
            f"drift known to {self.drift_percent:.2g} and repeatability to {self.spread_percent:.2g} % FSO after "
            f"{_cycles(self.cycles)}, {self.asked_percent:g} asked"
        )
        return f"{now}: reached" if self.reached else f"{now}: about {_cycles(self.more_cycles or 0)} more"

    def as_json(self) -> dict[str, Any]:
        """Return it as a dictionary."""
        return asdict(self) | {"reached": self.reached}


def check_asked(asked: float, unit: str) -> None:
    """Reject an uncertainty that is no number above 0; `unit` is mm or % FSO.

    Raises
    ------
    RequestError : it is none.
    """
    if not 0.0 < asked < math.inf:
        raise RequestError(f"an uncertainty of {asked:g} {unit}", f"give a number of {unit} above 0, as 0.08")


def enough(analysis: Analysis, asked_mm: float) -> Enough:
    """Return what a run knows.

    Parameters
    ----------
    analysis : of the run so far. asked_mm : U of an elongation that is asked for (k = 2).
    """
    cycles, budgets = len(analysis.cycles.used), analysis.budgets
    if budgets is None or budgets.void or not budgets.budgets:
        void = "no plateau was read" if budgets is None else budgets.void
        return Enough(cycles, math.nan, asked_mm, math.nan, None, void=void)
    u_mm = fused_u_mm(analysis, budgets.x_mm)
    worst = int(np.argmax([budget.u for budget in budgets.budgets]))
    falling = _falling_share(budgets.budgets[worst]) * u_mm**2
    least = math.sqrt(max(u_mm**2 - falling, 0.0))
    calibration = analysis.sensors[worst].calibration
    level = math.nan if calibration is None else next_level_kpa(analysis, calibration)
    return Enough(cycles, u_mm, asked_mm, least, more_cycles(u_mm, falling, cycles, asked_mm), level)


def fused_u_mm(analysis: AnalysedRun, x_mm: float) -> float:
    """Return U (k = 2) of one reading of all sensors together at an elongation, as the live display states it.

    Raises
    ------
    DataError : a sensor has no inverse.
    """
    signals = [float(s.calibration.predict(x_mm)) for s in analysis.sensors if s.calibration is not None]
    return COVERAGE_FACTOR * float(elongation_reader(analysis).evaluate(signals).standard_uncertainty_mm)


def _falling_share(budget: Budget) -> float:
    """Return the share of the variance that falls with the cycles."""
    return sum(share for name, share in budget.shares().items() if name in FALLING)


def more_cycles(u_mm: float, falling_mm2: float, cycles: int, asked_mm: float) -> int | None:
    """Return the further cycles after which U is the asked one, 0 if it is; None where it never is.

    Parameters
    ----------
    u_mm : U after some `cycles`. falling_mm2 : the part of its square that falls as one over the cycles.
    asked_mm : U asked for.
    """
    rest = asked_mm**2 - (u_mm**2 - falling_mm2)
    if u_mm <= asked_mm:
        return max(0, FEWEST_CYCLES - cycles)
    return max(1, FEWEST_CYCLES - cycles, math.ceil(falling_mm2 * cycles / rest) - cycles) if rest > 0.0 else None


def enough_repeats(analysis: Analysis, asked_percent: float) -> EnoughRepeats:
    """Return what a repeatability run knows.

    Parameters
    ----------
    analysis : of the run so far. asked_percent : half width of both intervals that is asked for, % FSO.
    """
    cycles = len(analysis.cycles.used)
    halves = {}
    for name in (DRIFT, SPREAD):
        figures = [sensor.figures[name] for sensor in analysis.sensors]
        void = next((figure.void for figure in figures if figure.void), "")
        half = max((figure.high - figure.low for figure in figures), default=math.nan) / 2.0
        if void or not math.isfinite(half):
            why = void or "too few cycles for an interval"
            return EnoughRepeats(cycles, math.nan, math.nan, asked_percent, None, why)
        halves[name] = half
    needed = max(
        cycles * (halves[DRIFT] / asked_percent) ** (2 / 3), cycles * (halves[SPREAD] / asked_percent) ** 2,
        float(FEWEST_REPEATS),
    )  # fmt: skip
    more = max(0, math.ceil(needed) - cycles)
    return EnoughRepeats(cycles, halves[DRIFT], halves[SPREAD], asked_percent, more)


def next_level_kpa(analysis: Analysis, calibration: Calibration) -> float:
    """Return the plateau where one more reading lowers the curve's largest uncertainty most (G-optimality), kPa.

    Parameters
    ----------
    analysis : of the run. calibration : of one of its sensors, a polynomial; NaN for a spline.

    Notes
    -----
    A reading at x, of the variance s^2 of one point, updates the covariance by Sherman and Morrison's formula:
    C - C g g' C / (s^2 + g' C g), g the basis at x (Fedorov, Theory of optimal experiments, 1972).
    """
    loops = analysis.loops
    if calibration.spline is not None or loops.elongation_mm is None:
        return math.nan
    basis, covariance = calibration.fit.basis, calibration.basis_covariance
    grid, largest = basis.design(np.linspace(*calibration.x_range, _POINTS)), []
    for x in np.nanmean(loops.elongation_mm, axis=(0, 1)):
        g = basis.design(np.array([x]))[0]
        shift = covariance @ g
        after = covariance - np.outer(shift, shift) / (calibration.residual_sd**2 + float(g @ shift))
        largest.append(float(np.max(np.einsum("ij,jk,ik->i", grid, after, grid))))
    return float(loops.level_kpa[int(np.argmin(largest))])


def assess_run(file: str | Path, asked: float, *, repeats: bool = False) -> Enough | EnoughRepeats:
    """Analyse a run as far as it is recorded, and return what it knows.

    Parameters
    ----------
    file : the recording. asked : as in `enough`, or in `enough_repeats` where `repeats`.

    Raises
    ------
    FileError, DataError : as `analyse`.
    """
    if repeats:
        return enough_repeats(analyse(file, options=Options(mcmc=False)), asked)
    return enough(analyse(file, options=Options(mcmc=False, fidelity="draft")), asked)
