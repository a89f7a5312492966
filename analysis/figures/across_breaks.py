"""Comparison of the cycles before and after each interruption of a run that was resumed.

Each complete cycle gives one level and one sensitivity for each sensor. Over a break the means are compared by a t-test
and the variances by an F-test, all tests of one break together at a family-wise level of `ALPHA` (Holm). Level: mean of
the signal over both branches and the levels that at least half of the cycles have, mV. Sensitivity: span of the
branch-mean signal between the outermost such levels, over that of the elongation (mV/mm), else of the pressure. The
step is tested beside a drift common to both parts, y = a + b i + d [after], if both have `FOR_DRIFT` cycles.

Parts that differ are never pooled; parts with too few cycles are reported as untested.
Source: NIST/SEMATECH e-Handbook 1.3.5.3 and 1.3.5.9; Holm, Scand. J. Statist. 6 (1979) 65.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy import stats

from analysis.data.recording import Recording
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.loops import Loops, branch_mean, continuous_loops
from analysis.statistics import mean
from protocol.base.arrays import BoolArray, FloatArray
from protocol.recording import breaks_of

ALPHA = 0.01
FOR_DRIFT = 4

Verdict = Literal["same", "differs", "untested"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """One quantity of one sensor over one break, after minus before; t, F and p are NaN for too few cycles."""

    sensor: str
    quantity: str
    unit: str
    n_before: int
    n_after: int
    mean_before: float
    mean_after: float
    sd_before: float
    sd_after: float
    difference: float
    difference_low: float
    difference_high: float
    drift_per_cycle: float
    t: float
    t_df: int
    t_p: float
    f: float
    f_df_before: int
    f_df_after: int
    f_p: float
    significant: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Break:
    """One break: when, why, for how long; the cycles of the parts on both sides of it, and the tests' verdict."""

    utc: str
    cause: str
    break_s: float | None
    before: tuple[int, ...]
    after: tuple[int, ...]
    verdict: Verdict
    comparisons: tuple[Comparison, ...]

    @property
    def sentence(self) -> str:
        """The break as a sentence without its end."""
        away = "" if self.break_s is None else f", for {self.break_s:.0f} s"
        where = f"after cycle {self.before[-1]}" if self.before else "before its first complete cycle"
        head = f"the run was interrupted {where} ({self.cause}{away})"
        if self.verdict == "untested":
            return f"{head}: too few complete cycles to compare the parts; their cycles are pooled untested"
        if self.verdict == "same":
            least = min(p for c in self.comparisons for p in (c.t_p, c.f_p) if np.isfinite(p))
            return f"{head}: no difference found (smallest p {least:.2g}, level {ALPHA:g}); the parts are pooled"
        found = [f"{c.sensor} {c.quantity} ({', '.join(c.significant)})" for c in self.comparisons if c.significant]
        return f"{head} and the parts differ in {'; '.join(found)}: they are not pooled"

    def as_json(self) -> dict[str, Any]:
        """Return the break as `analyze --json` gives it."""
        return {**asdict(self), "alpha": ALPHA, "pooled": self.verdict != "differs"}


def compare_breaks(recording: Recording, cycles: Cycles, loops: Loops) -> tuple[Break, ...]:
    """Compare the parts on both sides of each break; RecordingError if the entries of the breaks are damaged."""
    entries = breaks_of(dict(recording.meta))
    if not entries:
        return ()
    firsts = np.asarray([entry["first_segment"] for entry in entries])
    of_cycle = {cycle.number: int(recording.segment[cycle.first]) for cycle in cycles.complete}
    part = np.searchsorted(firsts, [of_cycle[number] for number in loops.numbers], side="right")
    names = recording.sensor_names
    # a break that another one followed before a cycle was whole separates nothing
    kept = [k for k in range(len(entries)) if k == len(entries) - 1 or (part == k + 1).any()]
    edges = [0, *(k + 1 for k in kept)]
    sides = [np.flatnonzero((part >= a) & (part < b)) for a, b in itertools.pairwise([*edges, len(entries) + 1])]
    found = tuple(_compare(entries[k], loops, sides[i], sides[i + 1], names) for i, k in enumerate(kept))
    if loops.binned or any(one.verdict != "untested" for one in found):
        return found
    # plateaus that the cycles do not share: the samples themselves can still be compared
    return compare_breaks(recording, cycles, continuous_loops(recording, cycles))


def parts_of(breaks: Sequence[Break]) -> tuple[tuple[int, ...], ...]:
    """Return the cycles' numbers in as many parts as differ; parts that do not are one."""
    parts = [breaks[0].before] if breaks else []
    for found in breaks:
        if found.verdict == "differs":
            parts.append(found.after)
        else:
            parts[-1] += found.after
    return tuple(part for part in parts if part)


def of_cycles(loops: Loops, numbers: Sequence[int]) -> Loops:
    """Return the loops of these cycles alone."""
    at = [loops.numbers.index(number) for number in numbers]
    x = loops.elongation_mm
    return replace(
        loops, pressure_kpa=loops.pressure_kpa[:, at], elongation_mm=None if x is None else x[:, at],
        signal_mv=loops.signal_mv[:, :, at], own=loops.own[:, at], numbers=tuple(numbers),
        one_branch=tuple(loops.one_branch[i] for i in at) if loops.one_branch else (),
        samples=loops.samples[:, :, at] if loops.binned else loops.samples,
    )  # fmt: skip


def _compare(
    entry: dict[str, Any], loops: Loops, before: np.ndarray[Any, Any], after: np.ndarray[Any, Any], names: Sequence[str]
) -> Break:
    tests = [
        _test(_cycle_values(loops, sensor, quantity), before, after, (name, quantity))
        for sensor, name in enumerate(names)
        for quantity in ("level", "sensitivity")
    ]
    tests = _holm(tests)
    tested = any(np.isfinite((test.t_p, test.f_p)).any() for test in tests)
    differs = any(test.significant for test in tests)
    verdict: Verdict = "differs" if differs else "same" if tested else "untested"
    left, right = (tuple(loops.numbers[i] for i in part) for part in (before, after))
    return Break(entry["utc"], entry["cause"], entry.get("break_s"), left, right, verdict, tuple(tests))


def _cycle_values(loops: Loops, sensor: int, quantity: str) -> tuple[FloatArray, str]:
    """Return one value a cycle [cycles], and its unit; NaN where the cycle lacks one of the common levels."""
    signal = branch_mean(loops.signal_mv[sensor])
    x, unit = loops.elongation_mm, "mV/mm"
    if x is None or _common(branch_mean(x)).sum() < 2:
        x, unit = loops.pressure_kpa, "mV/kPa"
    abscissa = branch_mean(x)
    if quantity == "level":
        known = _common(signal)
        return (signal[:, known].mean(axis=1) if known.any() else np.full(len(signal), np.nan)), "mV"
    ends = np.flatnonzero(_common(signal + abscissa))
    if ends.size < 2:
        return np.full(len(signal), np.nan), unit
    spans = [np.abs(values[:, ends[-1]] - values[:, ends[0]]) for values in (signal, abscissa)]
    return np.divide(spans[0], spans[1], out=np.full(len(signal), np.nan), where=spans[1] > 0), unit


def _common(values: FloatArray) -> BoolArray:
    """[levels] True for levels that at least half of the cycles have, of [cycles, levels]."""
    return np.asarray(np.isfinite(values).sum(axis=0) >= max(1.0, len(values) / 2))


def _test(
    values: tuple[FloatArray, str], before: np.ndarray[Any, Any], after: np.ndarray[Any, Any], name: tuple[str, str]
) -> Comparison:
    """Compare one quantity over the break."""
    y, unit = values
    before, after = before[np.isfinite(y[before])], after[np.isfinite(y[after])]
    with_drift = min(before.size, after.size) >= FOR_DRIFT
    (var1, df1), (var2, df2) = (_variance(part, y[part], with_drift=with_drift) for part in (before, after))
    f, f_p = _ratio(var1, df1, var2, df2)
    return Comparison(
        name[0], name[1], unit, before.size, after.size, mean(y[before]), mean(y[after]), float(np.sqrt(var1)),
        float(np.sqrt(var2)), *_step(y, before, after, with_drift=with_drift), f, df1, df2, f_p,
    )  # fmt: skip


def _ratio(var1: float, df1: int, var2: float, df2: int) -> tuple[float, float]:
    """Return F = var2 / var1 and its two-sided p; NaN where either part has no variance."""
    if df1 < 1 or df2 < 1 or var1 == var2 == 0.0:
        return float("nan"), float("nan")
    if var1 == 0.0:
        return float("inf"), 0.0
    f = var2 / var1
    return f, min(1.0, 2.0 * float(min(stats.f.sf(f, df2, df1), stats.f.cdf(f, df2, df1))))


def _variance(at: np.ndarray[Any, Any], y: FloatArray, *, with_drift: bool) -> tuple[float, int]:
    """Return the variance about the part's own line, or mean, and its degrees of freedom."""
    model = np.stack([np.ones(at.size), at - at.mean()]) if with_drift else np.ones((1, at.size))
    df = at.size - len(model)
    if df < 1:
        return float("nan"), max(df, 0)
    residual = y - np.linalg.lstsq(model.T, y, rcond=None)[0] @ model
    return float(residual @ residual / df), df


def _step(
    y: FloatArray, before: np.ndarray[Any, Any], after: np.ndarray[Any, Any], *, with_drift: bool
) -> tuple[float, float, float, float, float, int, float]:
    """Return the step over the break with its 95 % interval, the common drift per cycle, t, its df, and p."""
    nan = float("nan")
    n = before.size + after.size
    df = n - (3 if with_drift else 2)
    if not before.size or not after.size:
        return nan, nan, nan, nan, nan, 0, nan
    at = np.concatenate([before, after])
    model = np.stack([np.ones(n), np.isin(at, after).astype(float), at - at.mean()])[: 3 if with_drift else 2]
    b = np.linalg.lstsq(model.T, y[at], rcond=None)[0]
    step, drift = float(b[1]), float(b[2]) if with_drift else 0.0
    residual = y[at] - b @ model
    if df < 1:
        return step, nan, nan, drift, nan, 0, nan
    se = float(np.sqrt(residual @ residual / df * np.linalg.inv(model @ model.T)[1, 1]))
    half = float(stats.t.ppf(0.975, df)) * se
    if se == 0.0:
        return step, step, step, drift, nan if step == 0.0 else float(np.copysign(np.inf, step)), df, float(step == 0.0)
    t = step / se
    return step, step - half, step + half, drift, t, df, float(2.0 * stats.t.sf(abs(t), df))


def _holm(tests: list[Comparison]) -> list[Comparison]:
    """Mark what is significant at a family-wise level of `ALPHA`."""
    ps = [(p, i, name) for i, c in enumerate(tests) for name, p in (("t", c.t_p), ("F", c.f_p)) if np.isfinite(p)]
    found: dict[int, list[str]] = {}
    for rank, (p, i, name) in enumerate(sorted(ps)):
        if p > ALPHA / (len(ps) - rank):
            break
        found.setdefault(i, []).append(name)
    return [replace(c, significant=tuple(sorted(found.get(i, ()), reverse=True))) for i, c in enumerate(tests)]
