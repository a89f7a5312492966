"""Several runs: within-run and between-run spread kept apart (ISO 5725-2), units compared.

For each pressure level and branch the cycles of every run are one-way groups. The repeatability variance s_r^2 is the
pooled variance within runs, the between-run variance s_L^2 = (MS_between - s_r^2) / n0 (floored at zero), the
reproducibility variance s_R^2 = s_r^2 + s_L^2; n0 allows for runs of unequal length (ISO 5725-2:2019, 7.4). Spread
between runs is given for runs of one unit only; different units are compared figure by figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from analysis.figures.pipeline import Analysis
from analysis.figures.uncertainty import ElongationBudgets, middle_budgets
from analysis.history.unit_history import UnitHistory, one_signal_unit, refuse_mixture, unit_history
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, RequestError

SAME_LEVEL_KPA = 2.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Spread of one quantity over runs: standard deviations, and how many runs and values they rest on."""

    repeatability: float
    between: float
    reproducibility: float
    runs: int
    n: int


@dataclass(frozen=True, slots=True)
class SensorSpread:
    """Spread of a sensor's levels, pooled over levels and branches, mV and % FSO of the first run."""

    name: str
    pooled: Spread
    full_scale_mv: float


@dataclass(frozen=True, slots=True)
class UnitComparison:
    """Several runs of one unit; `unit` is "" for runs without a name, which are taken to be of one unit.

    `spreads` of each sensor's levels, or `spread_void`; `budgets` of the latest of two calibrations or more include the
    reproducibility.
    """

    unit: str
    runs: int
    spreads: tuple[SensorSpread, ...]
    spread_void: str
    histories: tuple[UnitHistory, ...]
    budgets: ElongationBudgets | None


@dataclass(frozen=True, slots=True)
class RunComparison:
    """Several runs, and what is known of each unit that was recorded twice or more."""

    analyses: tuple[Analysis, ...]
    units: tuple[UnitComparison, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(analysis.recording.unit for analysis in self.analyses))


def compare_runs(analyses: Sequence[Analysis]) -> RunComparison:
    """Compare runs unit by unit: spread of levels, history, budget; RequestError for simulated beside real runs."""
    refuse_mixture(analysis.recording.simulated for analysis in analyses)
    one_signal_unit(analysis.recording.signal_unit for analysis in analyses)
    by_unit: dict[str, list[Analysis]] = {}
    for analysis in analyses:
        by_unit.setdefault(analysis.recording.unit, []).append(analysis)
    units = [_compare_unit(unit, own) for unit, own in by_unit.items() if len(own) > 1]
    return RunComparison(tuple(analyses), tuple(units))


def _compare_unit(unit: str, analyses: Sequence[Analysis]) -> UnitComparison:
    sensors = range(min(len(analysis.sensors) for analysis in analyses))
    try:
        spreads, void = tuple(sensor_spread(analyses, sensor) for sensor in sensors), ""
    except BoatDaqError as error:
        spreads, void = (), error.cause
    histories = []
    for sensor in sensors:
        with suppress(BoatDaqError):
            histories.append(unit_history(analyses, sensor))
    calibrated = [analysis for analysis in analyses if analysis.kind == "calibration"]
    budgets = None
    if len(calibrated) > 1:
        budgets = middle_budgets(max(calibrated, key=lambda a: a.recording.started_utc), calibrated)
    histories = [history for history in histories if len(history.when) > 1]
    return UnitComparison(unit, len(analyses), spreads, void, tuple(histories), budgets)


def one_way(groups: Sequence[FloatArray]) -> Spread:
    """Separate within-group and between-group spread; RequestError below two groups, or without replicates."""
    known = [g[np.isfinite(g)] for g in groups]
    known = [g for g in known if g.size]
    if len(known) < 2 or max(g.size for g in known) < 2:
        cause = "spread within and between runs takes two runs or more, with two cycles or more"
        raise RequestError(cause, "Record another run.")
    sizes = np.asarray([g.size for g in known], dtype=np.float64)
    total, count = float(sizes.sum()), len(known)
    within = sum(float(((g - g.mean()) ** 2).sum()) for g in known) / (total - count)
    grand = sum(float(g.sum()) for g in known) / total
    between = sum(g.size * float((g.mean() - grand) ** 2) for g in known) / (count - 1)
    n0 = (total - float((sizes**2).sum()) / total) / (count - 1)
    s_l2 = max((between - within) / n0, 0.0)
    return Spread(float(np.sqrt(within)), float(np.sqrt(s_l2)), float(np.sqrt(within + s_l2)), count, int(total))


def sensor_spread(analyses: Sequence[Analysis], sensor: int) -> SensorSpread:
    """Return the spread of one sensor's levels over runs of one unit; RequestError without a shared level."""
    spreads = []
    for pressure in analyses[0].loops.level_kpa:
        for branch in (0, 1):
            groups = [_level(a, sensor, branch, float(pressure)) for a in analyses]
            if sum(g.size > 0 for g in groups) >= 2 and max(g.size for g in groups) >= 2:
                spreads.append(one_way(groups))
    if not spreads:
        raise RequestError("the runs share no pressure level with two cycles", "Compare runs of one plan.")
    pooled = Spread(
        _rms([s.repeatability for s in spreads]),
        _rms([s.between for s in spreads]),
        _rms([s.reproducibility for s in spreads]),
        len(analyses),
        sum(s.n for s in spreads),
    )
    fso = analyses[0].sensors[sensor].figures["fso_mv"].value
    return SensorSpread(analyses[0].sensors[sensor].name, pooled, fso)


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _level(analysis: Analysis, sensor: int, branch: int, pressure_kpa: float) -> FloatArray:
    loops = analysis.loops
    if not loops.level_kpa.size or sensor >= loops.signal_mv.shape[0]:
        return np.empty(0)
    at = int(np.argmin(np.abs(loops.level_kpa - pressure_kpa)))
    if abs(loops.level_kpa[at] - pressure_kpa) > SAME_LEVEL_KPA or not loops.own[branch, :, at].any():
        return np.empty(0)
    values = loops.signal_mv[sensor, branch, loops.own[branch, :, at], at]
    return np.asarray(values[np.isfinite(values)], dtype=np.float64)
