"""Readings of elongation that must be confirmed, corrected or left out before their calibration is accepted.

Rules: a reading is off if it lies beyond what the others allow, over the curve of any sensor; its distance is weighed
by the error of the signal and of the reading along the curve, so that a coarse grid raises no alarm. A reading that
alone determines the curve near it could be off unseen, and is named too. Which readings are sound enough to judge the
others is found from elongation over pressure, where no reading has leverage, by least absolute deviations. Source: R.
D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982, 2.2.2 (externally studentised, Bonferroni's bound).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import legendre
from scipy import stats

from analysis.calibration.checks import HIGHEST_LEVERAGE
from analysis.calibration.curve_choice import USUAL_DEGREE
from analysis.figures.figure import sensor_text
from analysis.json_object import json_object
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.units import Quantity, UnitText

if TYPE_CHECKING:
    from analysis.figures.sensor_analysis import SegmentedRun

CHANCE = 0.02  # that a sound run has a reading named as off
MOST_OFF = 4  # at most one reading in so many is set aside to judge it by the others
GROSS_SHARE = 0.15  # of the range: a reading that is off by more needs no estimate of the scatter
LEAST_SHARE = 0.01  # of the range: a reading that is off by less, or by less than the grid, is no typo
BEYOND = 0.3  # of the range of the others, within which their curve is followed
_MAD_TO_SD, _FAR, _GRID, _ROUNDS = 1.4826, 6.0, 401, 20


class ReadingFault(StrEnum):
    """Why a reading must be checked."""

    OFF = "off"
    ALONE = "alone"


@dataclass(frozen=True, slots=True)
class CheckedReading:
    """A reading to be checked, or `confirmed` with a reason.

    `plateau` counts from 0; `step` is that of its recording, None of a reading from a file; `off_mm` is the distance
    from what the others give, NaN where it alone determines the curve of `sensors`.
    """

    plateau: int
    place: str
    kpa: float
    mm: float
    fault: ReadingFault
    off_mm: float
    sensors: tuple[str, ...]
    step: int | None = None
    confirmed: str = ""

    @property
    def why(self) -> str:
        if self.fault is ReadingFault.ALONE:
            return "it alone determines the curve there"
        off = abs(self.off_mm)
        return UnitText(Quantity(off, "mm", ".1f" if off >= 0.95 else ".2f"), " from the others")

    @property
    def text(self) -> str:
        """Reading, place and fault, e.g. `+10.00 mm at +10 kPa, loading, cycle 2, 9.2 mm from the others`."""
        return UnitText(Quantity(self.mm, "mm", "+.2f"), " at ", self.place, ", ", self.why)

    @property
    def of_sensors(self) -> str:
        return ", ".join(map(sensor_text, self.sensors))

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `check`."""
        return json_object(self, "plateau", "place", "kpa", "mm", "fault", "off_mm", "sensors", "why", "confirmed")


def checked_readings(run: SegmentedRun) -> tuple[CheckedReading, ...]:
    """Return the readings of a run that must be checked, with those that were confirmed, in the order of the run."""
    if run.elongations is None:
        return ()
    degree = run.options.degree if isinstance(run.options.degree, int) else USUAL_DEGREE
    off: dict[int, float] = {}
    alone: set[int] = set()
    by: dict[int, list[str]] = {}
    count = run.recording.n_sensors
    for sensor, name in enumerate(run.recording.sensor_names):
        points = np.flatnonzero(run.calibration_points(sensor))
        if not points.size:
            continue
        found = judge_readings(
            run.elongations.elongation_mm[points],
            np.asarray([run.plateaus[i].signal_mv[sensor] for i in points]),
            np.asarray([run.plateaus[i].pressure_kpa for i in points]),
            run.branch_of(points),
            degree=degree,
            reading_sd=run.reading_sd_mm,
            chance=CHANCE / count,
        )
        for row in np.flatnonzero(found.off | found.alone):
            plateau = int(points[row])
            by.setdefault(plateau, []).append(name)
            if found.off[row]:
                off[plateau] = max(off.get(plateau, 0.0), float(found.distance_mm[row]), key=abs)
            else:
                alone.add(plateau)
    reasons = run.elongations.confirmed
    return tuple(
        CheckedReading(
            plateau,
            run.plateaus[plateau].place,
            round(run.plateaus[plateau].pressure_kpa, 3),
            float(run.elongations.elongation_mm[plateau]),
            ReadingFault.OFF if plateau in off else ReadingFault.ALONE,
            off.get(plateau, float("nan")),
            tuple(by[plateau]),
            run.plateaus[plateau].step if run.elongations.of_recording else None,
            reasons.get(plateau, ""),
        )
        for plateau in sorted(by)
    )


def without_wrong_readings(run: SegmentedRun) -> tuple[SegmentedRun, tuple[Warning, ...]]:
    """Return the run without the readings that are off, and a warning for each of them."""
    off = [one for one in checked_readings(run) if one.fault is ReadingFault.OFF and not one.confirmed]
    if run.elongations is None or not off:
        return run, ()
    x = run.elongations.elongation_mm.copy()
    x[[one.plateau for one in off]] = np.nan
    texts = (f"the reading {one.text} is left out ({one.of_sensors})" for one in off)
    warnings = tuple(Warning(WarningCode.READING_LEFT_OUT, "", text) for text in texts)
    return run.with_elongations(replace(run.elongations, elongation_mm=x)), warnings


@dataclass(frozen=True, slots=True)
class JudgedReadings:
    """[n] whether a reading is off, whether it alone determines the curve, and its distance from the others, mm."""

    off: BoolArray
    alone: BoolArray
    distance_mm: FloatArray


def judge_readings(
    x: FloatArray,
    y: FloatArray,
    pressure: FloatArray,
    branch: FloatArray,
    *,
    degree: int = USUAL_DEGREE,
    reading_sd: float = 0.0,
    chance: float = CHANCE,
) -> JudgedReadings:
    """Judge readings x [n] by the curve y(x) of the others; `branch` is 1, -1 or 0 as in `fit_by_branch`."""
    n, none = x.size, np.zeros(x.size, dtype=bool)
    if np.unique(x).size <= degree or not np.ptp(y) > 0:
        return JudgedReadings(none, none, np.full(n, np.nan))
    alone = leverages(x, degree) > HIGHEST_LEVERAGE
    over_pressure, far = _far_over_pressure(x, pressure, branch)
    kept = ~far
    if np.unique(x[kept]).size <= degree:
        kept = ~none
    off, distance = none, np.full(n, np.nan)
    for _ in range(_ROUNDS):
        curve = _Others.of(x, y, branch, kept, degree, reading_sd)
        if curve is None:
            return JudgedReadings(none, alone, np.full(n, np.nan))
        deviation, distance = curve.deviations(x, y, branch, kept)
        limit = stats.t.isf(chance / (2.0 * n), max(curve.dof - 1, 1))
        size = np.abs(distance)
        seen = size > max(LEAST_SHARE * np.ptp(x[kept]), np.sqrt(12.0) * reading_sd)
        large = size > GROSS_SHARE * np.ptp(x[kept])
        beyond = (deviation > limit) & ((over_pressure > 0.5 * size) | large)
        off = np.asarray(seen & beyond | far & large, dtype=bool)
        worst = np.argsort(np.where(off, -deviation, np.inf))[: max(n // MOST_OFF, 1)]
        after = ~none
        after[worst[off[worst]]] = False
        if np.array_equal(after, kept) or np.unique(x[after]).size <= degree:
            break
        kept = after
    return JudgedReadings(off, alone & ~off, distance)


def leverages(x: FloatArray, degree: int) -> FloatArray:
    """Return the leverage [n] of each point of a polynomial fit."""
    q, _ = np.linalg.qr(legendre.legvander(_scaled(x, float(x.min()), float(x.max())), degree))
    return np.asarray((q**2).sum(axis=1))


def _scaled(x: FloatArray, low: float, high: float) -> FloatArray:
    return np.asarray((2.0 * x - low - high) / (high - low) if high > low else np.zeros_like(x))


def _far_over_pressure(x: FloatArray, pressure: FloatArray, branch: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return how far readings are from elongation over pressure, a polynomial with a loop, and which are too far."""
    u = _scaled(pressure, float(pressure.min()), float(pressure.max()))
    levels = np.unique(np.round(u, 2)).size
    columns = [legendre.legvander(u, max(min(3, levels - 2, x.size // 3), 0))]
    if x.size >= 10 and np.unique(branch).size > 1:
        columns.append((branch * (1.0 - u**2))[:, None])
    design = np.hstack(columns)
    weights, residual = np.ones(x.size), np.zeros(x.size)
    for _ in range(50):
        root = np.sqrt(weights)
        residual = np.abs(x - design @ np.linalg.lstsq(design * root[:, None], x * root, rcond=None)[0])
        weights = 1.0 / np.maximum(residual, 1e-6 * np.ptp(x) + 1e-12)
    scale = _MAD_TO_SD * float(np.median(residual)) * np.sqrt(x.size / max(x.size - design.shape[1], 1))
    far = residual > max(_FAR * scale, 0.05 * float(np.quantile(x, 0.9) - np.quantile(x, 0.1)))
    most = max(x.size // MOST_OFF, 1)
    if far.sum() > most:
        far[np.argsort(-residual)[most:]] = False
    return np.asarray(residual), np.asarray(far, dtype=bool)


@dataclass(frozen=True, slots=True)
class _Others:
    """The curve of the readings kept, a polynomial with a loop, its inverse normal matrix and the scatter about it."""

    ends: tuple[float, float]
    degree: int
    coefficients: FloatArray
    inverse: FloatArray
    variance: float
    squares: float
    dof: int
    reading_sd: float

    @classmethod
    def of(
        cls, x: FloatArray, y: FloatArray, branch: FloatArray, kept: BoolArray, degree: int, reading_sd: float
    ) -> _Others | None:
        """Fit the kept readings twice, the second time weighed by slope times reading error; None if too few."""
        ends = float(x[kept].min()), float(x[kept].max())
        loop = np.unique(branch[kept]).size > 1 and kept.sum() > degree + 4
        found: _Others | None = None
        for _ in range(3):
            design = _design(x[kept], branch[kept], ends, degree, loop=loop)
            known = np.zeros(kept.sum()) if found is None else (found.slope(x[kept]) * reading_sd) ** 2
            total = known + (1.0 if found is None else max(found.variance, 1e-3 * float(known.mean()), 1e-18))
            weights = 1.0 / total
            normal = design.T @ (design * weights[:, None])
            if np.linalg.cond(normal) > 1e13:
                return None
            inverse: FloatArray = np.asarray(np.linalg.inv(normal), dtype=np.float64)
            coefficients = inverse @ design.T @ (weights * y[kept])
            residual = y[kept] - design @ coefficients
            dof = int(kept.sum() - design.shape[1])
            squares = float(residual @ residual)
            own = max(squares / max(dof, 1) - float(known.mean()), 0.0) if dof > 0 else 0.0
            found = cls(ends, degree, coefficients, inverse, own, squares, dof, reading_sd)
        return found

    @property
    def loop(self) -> bool:
        return self.coefficients.size > self.degree + 1

    def design(self, x: FloatArray, branch: FloatArray) -> FloatArray:
        return _design(x, branch, self.ends, self.degree, loop=self.loop)

    def slope(self, x: FloatArray) -> FloatArray:
        series = legendre.legder(self.coefficients[: self.degree + 1])
        low, high = self.ends
        return np.asarray(legendre.legval(np.clip(_scaled(x, low, high), -1.2, 1.2), series) * 2.0 / (high - low))

    def deviations(
        self, x: FloatArray, y: FloatArray, branch: FloatArray, kept: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return how far each reading is from the curve of the others, in standard deviations, and in mm of x.

        The distance is the least over the curve, with the error of the reading along x and of signal and curve along y.
        """
        low, high = self.ends
        span = high - low
        grid = np.linspace(low - BEYOND * span, high + BEYOND * span, _GRID)
        rows = self.design(x, branch)
        residual = y - rows @ self.coefficients
        weight = 1.0 / (max(self.variance, 1e-18) + (self.slope(x) * self.reading_sd) ** 2)
        leverage = np.where(kept, np.einsum("ij,jk,ik->i", rows, self.inverse, rows) * weight, 0.0)
        left = np.maximum(1.0 - leverage, 1e-9)
        without = np.where(kept, residual / left, 0.0)
        known = float(np.mean((self.slope(x[kept]) * self.reading_sd) ** 2))
        external = (self.squares - np.where(kept, residual**2 / left, 0.0)) / max(self.dof - 1, 1) - known
        own = np.where(kept & (self.dof > 1), np.maximum(external, 0.0), self.variance)
        steep = self.slope(x) ** 2 / max(float(np.mean(self.slope(x[kept]) ** 2)), 1e-18)
        own = own * np.maximum(1.0, steep)  # it may be of the signal, or of the reading
        own = np.maximum(own, (1e-9 * np.abs(y).max()) ** 2)
        along = max(self.reading_sd, 1e-3 * span) ** 2
        slopes = np.abs(self.slope(x[kept]))
        flat = (0.3 * float(np.mean(slopes)) * self.reading_sd) ** 2  # the grid where the curve is level at an end
        deviation, nearest = np.empty(x.size), np.empty(x.size)
        for side in np.unique(branch):
            at = np.flatnonzero(branch == side)
            shown = self.design(grid, np.full(grid.size, side))
            move = shown @ self.inverse @ (rows[at] * weight[at, None]).T
            curve = (shown @ self.coefficients)[:, None] - move * without[at]
            base = np.einsum("ij,jk,ik->i", shown, self.inverse, shown)[:, None]
            spread = base + np.where(kept[at], move**2 / weight[at] / left[at], 0.0)
            away = (y[at] - curve) ** 2 / (own[at] + flat + spread)
            squares = (x[at] - grid[:, None]) ** 2 / along + away
            deviation[at] = np.sqrt(squares.min(axis=0))
            close = away <= away.min(axis=0) + 1.0
            gap = np.where(close, np.abs(x[at] - grid[:, None]), np.inf)
            nearest[at] = grid[np.argmin(gap, axis=0)]
        return deviation, x - nearest


def _design(x: FloatArray, branch: FloatArray, ends: tuple[float, float], degree: int, *, loop: bool) -> FloatArray:
    u = _scaled(x, *ends)
    columns = legendre.legvander(u, degree)
    return np.column_stack([columns, branch * (1.0 - np.clip(u, -1.0, 1.0) ** 2)]) if loop else np.asarray(columns)
