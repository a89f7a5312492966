"""Figures of a calibration's curve: full scale, sensitivities, non-linearity, lack of fit (ISA-S37.1).

Their intervals come from curves that the errors allow: draws of a joint fit, or refits to resamples of the cycles. A
figure that is undefined has a reason and is NaN or infinite, never an exception and never zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy import stats

from analysis.calibration.adequacy import Adequacy, CurveVerdict
from analysis.calibration.fit import Calibration
from analysis.calibration.joint_fit import JointFit
from analysis.figures.figure import Figure, Reason
from analysis.figures.intervals import NEVER_NEGATIVE, bootstrap_figure, no_full_scale
from analysis.statistics import PERCENTILES
from protocol.base.arrays import FloatArray

CURVE_POINTS = 201
REASONS = {
    CurveVerdict.ADEQUATE: Reason.NONE,
    CurveVerdict.DOUBTFUL: Reason.DOUBTFUL,
    CurveVerdict.INADEQUATE: Reason.INADEQUATE,
}


class FittedCurve(Protocol):
    """A curve that is linear in its coefficients."""

    def predict(self, x: npt.ArrayLike) -> FloatArray:
        """Return y(x)."""

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """Return dy/dx."""

    def rows(self, x: npt.ArrayLike) -> FloatArray:
        """Return the design matrix at x."""

    def slope_rows(self, x: npt.ArrayLike) -> FloatArray:
        """Return its derivative by x."""


@dataclass(frozen=True, slots=True)
class CurveDraws:
    """A curve, and the curves that its errors allow."""

    fit: FittedCurve
    x: FloatArray  # [n] readings
    x_range: tuple[float, float]
    coefficients: FloatArray  # [draws, coefficients], NaN where a resample cannot carry the degree
    ends: FloatArray  # [draws, 2] range of each
    n_cycles: int
    dof: float = float("nan")  # degrees of freedom of the errors; NaN for a bootstrap over the cycles

    def values(self, x: FloatArray) -> FloatArray:
        """Return y(x) of every draw, [draws, x]."""
        return self.coefficients @ self.fit.rows(x).T

    def slopes(self, x: FloatArray) -> FloatArray:
        """Return dy/dx of every draw, [draws, x]."""
        return self.coefficients @ self.fit.slope_rows(x).T

    def spans(self) -> FloatArray:
        """Return y(x_max) - y(x_min) of every draw over its own range, [draws]."""
        low, high = ((self.coefficients * self.fit.rows(end)).sum(axis=1) for end in self.ends.T)
        return np.asarray(high - low)

    @property
    def full_scale(self) -> float:
        """|y(x_max) - y(x_min)| of the curve."""
        low, high = self.fit.predict(np.asarray(self.x_range))
        return abs(float(high - low))

    def figure(
        self, value: float, replicates: FloatArray, unit: str, definition: str, *, either_way: bool = False
    ) -> Figure:
        """Return a figure with its interval from `replicates` [draws]; `either_way` also takes their reflection."""
        if np.isnan(self.dof):
            return bootstrap_figure(value, replicates, unit, self.n_cycles, definition)
        widen = stats.t.ppf(0.975, self.dof) / stats.norm.ppf(0.975)

        drawn = replicates[np.isfinite(replicates)]
        below, above = widen * (np.percentile(drawn, PERCENTILES) - value)
        low, high = value - above, value - below  # what the draws are above it, the truth is below
        if either_way:
            low, high = min(low, value + below), max(high, value + above)
        if unit in NEVER_NEGATIVE:
            low = max(low, 0.0)
        low, high = min(low, value), max(high, value)  # a maximum can lie outside its draws
        return Figure(float(value), unit, self.n_cycles, float(low), float(high), definition=definition)


def draw_joint(joint: JointFit, x: FloatArray, n_cycles: int, rng: np.random.Generator, count: int) -> CurveDraws:
    """Draw the curves that the errors of the position means allow."""
    coefficients, ends = joint.draws(rng, count)
    return CurveDraws(joint, x, joint.ends, coefficients, ends, n_cycles, joint.effective_dof)


def resample_fit(
    calibration: Calibration, cycle_of: FloatArray, weights: FloatArray, rng: np.random.Generator | None = None
) -> CurveDraws:
    """Refit a calibration through points to every bootstrap resample of the cycles.

    The normal equations are formed cycle by cycle in the orthogonal basis, where they are well conditioned, and added
    with the weights: all resamples are solved at once. `cycle_of`: [n] position (0, 1, ...) of the cycle of each point
    of the calibration. `weights`: [resamples, cycles] how often each cycle was drawn.
    """
    design = calibration.fit.basis.design(calibration.x)
    cycles = weights.shape[1]
    grams = np.zeros((cycles, design.shape[1], design.shape[1]))
    sides = np.zeros((cycles, design.shape[1]))
    for k in range(cycles):
        rows = design[cycle_of == k]
        grams[k] = rows.T @ rows
        sides[k] = rows.T @ calibration.y[cycle_of == k]
    total = np.einsum("bk,kij->bij", weights, grams)
    solvable = np.linalg.cond(total) < 1e12
    coefficients = np.full((weights.shape[0], design.shape[1]), np.nan)
    right = np.einsum("bk,ki->bi", weights, sides)
    coefficients[solvable] = np.linalg.solve(total[solvable], right[solvable][..., None])[..., 0]
    positions = calibration.reading
    if positions is not None and rng is not None:
        moved = np.sqrt(positions.x_variance) * rng.standard_normal((weights.shape[0], positions.n))
        by_reading = -moved[:, positions.of_point] * calibration.slope(calibration.x)
        coefficients += by_reading @ np.linalg.pinv(design).T
    own = [calibration.x[cycle_of == k] for k in range(cycles)]
    ends = np.asarray([[x.min(initial=np.inf), x.max(initial=-np.inf)] for x in own])
    drawn = weights > 0
    low, high = (np.where(drawn, sign * ends[:, side], np.inf).min(axis=1) * sign for side, sign in ((0, 1), (1, -1)))
    drawn_ends = np.stack([low, high], axis=1)  # infinite where only cycles without readings were drawn
    drawn_ends = np.where(np.isfinite(drawn_ends), drawn_ends, np.nan)
    return CurveDraws(calibration.fit, calibration.x, calibration.x_range, coefficients, drawn_ends, cycles)


def full_scale(curves: CurveDraws) -> Figure:
    """Full-scale output, mV: of the fitted curve over its range."""
    definition = "|y(x_max) - y(x_min)| of the fit"
    return curves.figure(curves.full_scale, np.abs(curves.spans()), "mV", definition)


def sensitivities(curves: CurveDraws) -> dict[str, Figure]:
    """Return the end-to-end sensitivity, the slope at rest and the least-squares slope, mV/mm."""
    low, high = curves.x_range
    with np.errstate(invalid="ignore", divide="ignore"):
        end_to_ends = np.abs(curves.spans()) / np.diff(curves.ends, axis=1)[:, 0]
    centred = curves.x - curves.x.mean()
    line, lines = (y @ centred / (centred @ centred) for y in (curves.fit.predict(curves.x), curves.values(curves.x)))
    rest = np.zeros(1)
    at_rest, at_rests = float(curves.fit.slope(rest)[0]), curves.slopes(rest)[:, 0]
    found = {
        "sensitivity_mv_per_mm": (
            curves.full_scale / (high - low), end_to_ends, "|y(x_max) - y(x_min)| / (x_max - x_min) of the fit",
        ),
        "least_squares_slope_mv_per_mm": (line, lines, "slope of the straight line through all points"),
        "slope_at_rest_mv_per_mm": (at_rest, at_rests, "dy/dx at x = 0, with its sign"),
    }  # fmt: skip
    figures = {key: curves.figure(v, each, "mV/mm", text) for key, (v, each, text) in found.items()}
    if not low <= 0.0 <= high:
        outside = Figure.nothing("mV/mm", Reason.REST_OUTSIDE_RANGE, "x = 0 is outside the calibrated range")
        figures["slope_at_rest_mv_per_mm"] = outside
    return figures


def curve_figures(curves: CurveDraws, other: CurveDraws | None = None, *, verdict: str = "") -> dict[str, Figure]:
    """Return the figures of a curve; their intervals also hold those of an `other` that it may deviate from."""
    figures = {"fso_mv": full_scale(curves), **sensitivities(curves), "nonlinearity_percent_fso": nonlinearity(curves)}
    for key, of_other in (curve_figures(other) if other is not None else {}).items():
        own = figures[key]
        if np.isfinite([own.low, own.high, of_other.low, of_other.high]).all():
            figures[key] = replace(own, low=min(own.low, of_other.low), high=max(own.high, of_other.high))
    if not verdict:
        return figures
    note = f"the curve is {verdict}: the interval also holds the preferred curve's figure"
    reason = REASONS[CurveVerdict(verdict)]
    return {
        key: figure if figure.void else replace(figure, note=note, reason=reason) for key, figure in figures.items()
    }


def nonlinearity(curves: CurveDraws) -> Figure:
    """Largest distance of the fitted curve from the best-fit straight line, % FSO (ISA-S37.1)."""
    definition = "max |y(x) - line(x)| / FSO, line by least squares through all points"
    if not curves.full_scale > 0:
        return no_full_scale("% FSO", definition)
    x, grid = curves.x, np.linspace(*curves.x_range, CURVE_POINTS)
    line = np.polynomial.Polynomial.fit(x, curves.fit.predict(x), 1)
    scale = 100.0 / curves.full_scale
    value = scale * float(np.abs(curves.fit.predict(grid) - line(grid)).max())
    # the data's own weighting of the line is kept: project each drawn curve's values at the data's x
    at_data = curves.values(x)
    if not np.isfinite(at_data).all():
        return Figure(
            value, "% FSO", x.size, note="no interval: a resample cannot carry the degree",
            definition=definition, reason=Reason.NO_INTERVAL,
        )  # fmt: skip
    lines = at_data @ np.linalg.pinv(np.vander(x, 2)).T
    apart = np.abs(curves.values(grid[1:-1]) - lines @ np.vander(grid[1:-1], 2).T).max(axis=1)
    for end in curves.ends.T:  # each draw ends where its own range does
        at_end = (curves.coefficients * curves.fit.rows(end)).sum(axis=1) - lines[:, 0] * end - lines[:, 1]
        apart = np.fmax(apart, np.abs(at_end))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = 100.0 * apart / np.abs(curves.spans())
    # the greatest distance moves between places: on 0.5 mm either half alone held 85 % of the values of true cubics
    return curves.figure(value, shares, "% FSO", definition, either_way=True)


def lack_of_fit(adequacy: Adequacy | None, n: int) -> Figure:
    """Rms by which the curve misses the position means beyond chance, % FSO, with the verdict; of `n` readings."""
    definition = "rms of the curve less the preferred curve / FSO; of an adequate curve what the F test cannot exclude"
    if adequacy is None:
        return Figure.nothing("% FSO", Reason.FEW_POSITIONS, "too few positions to test the curve", definition)
    note = f"{adequacy.verdict}: {adequacy.sentence}"
    if not np.isfinite(adequacy.remainder_percent):
        return Figure.nothing("% FSO", Reason.FEW_POSITIONS, "no position is left to test the curve by", definition)
    reason, value = REASONS[adequacy.verdict], adequacy.remainder_percent
    return Figure(value, "% FSO", n, *adequacy.limits_percent, note=note, definition=definition, reason=reason)
