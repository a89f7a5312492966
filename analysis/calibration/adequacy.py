"""Whether a curve is adequate: lack of fit, curves of other families, and the expanded uncertainty it keeps.

The position means are tested against scatter and reading. Polynomials of degree 1 to 6 and a monotone spline are
compared by the error of predicting each inner position from the others; the simplest within one standard error of the
best is preferred. For a suspect curve, the Akaike-weighted average of it and all richer ones gives a known deviation
d(x); U is widened until it holds the truth as often as 2 u does without. Sources: Draper and Smith, Applied Regression
Analysis (1998), 2.1; Hastie, Tibshirani, Friedman, The Elements of Statistical Learning (2009), 7.10; Buckland,
Burnham, Augustin, Biometrics 53 (1997) 603 (weights); Phillips et al., J. Res. NIST 102 (1997) 577 (uncorrected bias);
GUM F.2.4.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import optimize, special, stats

from analysis.calibration.curve_choice import DEGREES, SPLINE, curve_name
from analysis.calibration.joint_fit import (
    SUSPECTED,
    CurveBasis,
    JointFit,
    MonotoneSplineBasis,
    PolynomialBasis,
    joint_fit,
    loop_is_represented,
)
from analysis.json_object import json_object
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError
from protocol.base.units import COVERAGE_FACTOR

DOUBTFUL, INADEQUATE = 0.01, 0.001  # chances of such a lack of fit for the right curve
NOTICED_PERCENT = 0.25  # of full scale: a smaller remainder leaves a curve doubtful, however certain it is
REFUSED_PERCENT = 5.0  # of full scale: the bound of the published hysteresis; above it no elongation is given
_CURVE_POINTS = 101
_BISECTIONS = 60
FINE_POINTS, SAME = 2001, 1e-6  # of the full scale: signals that differ by less are one


class CurveVerdict(StrEnum):
    """Of the curve against the readings."""

    ADEQUATE = "adequate"
    DOUBTFUL = "doubtful"
    INADEQUATE = "inadequate"


@dataclass(frozen=True, slots=True)
class Candidate:
    """A family of curves: its name (degree, or spline), its fit, the squared errors of prediction [inner positions]."""

    name: str
    fit: JointFit
    squares: FloatArray

    @property
    def prediction_rms(self) -> float:
        """Rms of the errors of prediction, in the unit of y."""
        return float(np.sqrt(np.mean(self.fit.prediction_errors() ** 2)))


@dataclass(frozen=True, slots=True)
class Adequacy:
    """The verdict on a curve; `p_value` is NaN if nothing was left to test it by.

    `preferred` predicts best, or is its simpler equal; `averaged` holds (weight, curve) of the reference, the chosen
    curve alone without a suspicion; `remainder` is the rms deviation of the chosen curve, in the unit of y: of an
    adequate curve what the test cannot exclude, with `limits_percent` (95 %); NaN without a test.
    """

    verdict: CurveVerdict
    p_value: float
    chosen: JointFit
    preferred: Candidate
    candidates: tuple[Candidate, ...]
    averaged: tuple[tuple[float, JointFit], ...]
    remainder: float
    remainder_percent: float
    limits_percent: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def refused(self) -> bool:
        """Whether the remainder is so large that the curve gives no elongation."""
        return self.verdict is CurveVerdict.INADEQUATE and self.remainder_percent > REFUSED_PERCENT

    @property
    def reference(self) -> JointFit:
        """The fit whose figures the curve's are held against: the preferred where one is suspected, else itself."""
        richer = self.preferred.fit.basis.complexity > self.chosen.basis.complexity
        return self.preferred.fit if richer and self.p_value < SUSPECTED else self.chosen

    @property
    def sentence(self) -> str:
        """Why, as a sentence without its end."""
        chance = (
            "p not known"
            if np.isnan(self.p_value)
            else f"p {'< 0.001' if self.p_value < 0.001 else f'= {self.p_value:.2g}'}"
        )
        if self.verdict is CurveVerdict.ADEQUATE:
            most = self.limits_percent[1]
            bound = f"; a lack of fit is at most {most:.2g} % FSO" if np.isfinite(most) else ""
            return f"the position means deviate from the curve no more than scatter and reading allow ({chance}){bound}"
        better = f"; {curve_name(self.preferred.name)} predicts better" if self.reference is not self.chosen else ""
        size = f"{self.remainder:.2g} mV rms, {self.remainder_percent:.2g} % FSO"
        return f"the curve misses the position means by {size} beyond their scatter ({chance}){better}"

    def average(self, x: npt.ArrayLike) -> FloatArray:
        return np.asarray(sum(weight * fit.predict(x) for weight, fit in self.averaged), dtype=np.float64)

    def deviation(self, x: npt.ArrayLike) -> FloatArray:
        """Return the chosen curve less the average; zeros where they are one."""
        return self.chosen.predict(x) - self.average(x)

    def deviation_in_x(self, x: npt.ArrayLike) -> FloatArray:
        """Return the distance of an x read from the chosen curve to the farthest x of that signal on the average."""
        at = np.asarray(x, dtype=np.float64)
        if len(self.averaged) == 1:
            return np.zeros(at.shape)
        low, high = self.chosen.ends
        grid = np.linspace(low, high, FINE_POINTS)
        curve = self.average(grid)
        sign = 1.0 if curve[-1] >= curve[0] else -1.0
        signal, same = sign * self.chosen.predict(at), SAME * abs(float(curve[-1] - curve[0]))
        never_falls = np.maximum.accumulate(sign * curve)
        never_rises_back = np.minimum.accumulate((sign * curve)[::-1])[::-1]
        first = grid[np.minimum(np.searchsorted(never_falls, signal - same), grid.size - 1)]
        last = grid[np.maximum(np.searchsorted(never_rises_back, signal + same, side="right") - 1, 0)]
        return np.maximum(np.abs(at - first), np.abs(at - last))

    def average_u(self, x: npt.ArrayLike) -> FloatArray:
        """Return the standard uncertainty of the average: of its curves, and what they differ by."""
        if len(self.averaged) == 1:
            return self.chosen.u(x)
        middle, variance = self.average(x), np.zeros(np.shape(x))
        for weight, fit in self.averaged:
            between = fit.between_positions_sd() if fit.misfit_sd == 0.0 or fit is not self.chosen else 0.0
            variance = variance + weight * (fit.u(x) ** 2 + between**2 + (fit.predict(x) - middle) ** 2)
        return np.asarray(np.sqrt(variance), dtype=np.float64)

    def as_json(self) -> dict[str, Any]:
        """Return the object of `analyze --json`."""
        return {
            **json_object(self, "verdict", "p_value", "remainder_mv=remainder"),
            "remainder_percent_fso": self.remainder_percent,
            "degree_preferred": self.preferred.name if self.preferred.name == SPLINE else int(self.preferred.name),
            "refused": self.refused,
            "curves": [json_object(one, "curve=name", "prediction_rms_mv=prediction_rms") for one in self.candidates],
        }


def curve_candidates(chosen: JointFit) -> tuple[Candidate, ...]:
    """Fit every family that the positions of a fit carry, the chosen one among them, simplest first."""
    means = chosen.means
    fits: list[tuple[str, JointFit]] = []
    families: list[tuple[str, CurveBasis]] = [(str(degree), PolynomialBasis(degree)) for degree in DEGREES]
    spline = MonotoneSplineBasis.through(
        chosen.scaled(means.x), chosen.predict(means.ends)[1] < chosen.predict(means.ends)[0]
    )
    for name, basis in [*families, (SPLINE, spline)]:
        if basis == chosen.basis:
            fits.append((name, chosen))
        elif basis.complexity + chosen.loop.size < means.x.size:
            try:
                fits.append((name, joint_fit(means, basis, chosen.loop.size)))
            except DataError:
                continue
    if not any(fit is chosen for _, fit in fits):
        own = SPLINE if isinstance(chosen.basis, MonotoneSplineBasis) else str(chosen.basis.complexity - 1)
        fits.append((own, chosen))
    weights = _common_weights(fits)
    return tuple(Candidate(name, fit, fit.prediction_errors() ** 2 * weights) for name, fit in fits)


def _common_weights(fits: Sequence[tuple[str, JointFit]]) -> FloatArray:
    """[inner positions] 1 / variance of the fit that predicts best without weights, and its misfit."""
    best = min((fit for _, fit in fits), key=lambda fit: float(np.sum(fit.prediction_errors() ** 2)))
    return np.asarray(1.0 / best.variance[best.means.inside])


def preferred_candidate(candidates: Sequence[Candidate]) -> Candidate:
    """Return the simplest that predicts as well as the best within one standard error of the difference."""
    best = min(candidates, key=lambda candidate: float(candidate.squares.sum()))
    for candidate in candidates:
        worse = candidate.squares - best.squares
        if worse.sum() <= np.sqrt(worse.size) * worse.std():
            return candidate
    return best


def judge_curve(chosen: JointFit) -> Adequacy:
    """Judge a curve by the position means that it was fitted to."""
    candidates = curve_candidates(chosen)
    preferred = preferred_candidate(candidates)
    richer = preferred.fit.basis.complexity > chosen.basis.complexity
    richest = max((c.fit for c in candidates if c.name != SPLINE), key=lambda fit: fit.basis.complexity)
    tested = lack_of_fit_test(chosen, preferred.fit if richer else richest)
    p_value, limits = tested.p_value, (float("nan"), float("nan"))
    low, high = chosen.ends
    at = np.linspace(low, high, _CURVE_POINTS)
    apart = chosen.predict(at) - preferred.fit.predict(at)
    remainder = float(np.sqrt(np.mean(apart**2))) if richer else tested.rms
    full_scale = abs(float(preferred.fit.predict(high) - preferred.fit.predict(low)))
    per_mv = 100.0 / full_scale if full_scale > 0 else 0.0
    if not p_value < DOUBTFUL:  # also where nothing was left to test by
        verdict, remainder, limits = CurveVerdict.ADEQUATE, tested.rms, tested.limits()
    elif richer and p_value < INADEQUATE and remainder * per_mv > NOTICED_PERCENT:
        verdict = CurveVerdict.INADEQUATE
    else:
        verdict = CurveVerdict.DOUBTFUL
    averaged = _averaged(chosen, candidates) if p_value < SUSPECTED else ((1.0, chosen),)
    percent, ends = remainder * per_mv, (limits[0] * per_mv, limits[1] * per_mv)
    return Adequacy(verdict, p_value, chosen, preferred, candidates, averaged, remainder, percent, ends)


def _averaged(chosen: JointFit, candidates: Sequence[Candidate]) -> tuple[tuple[float, JointFit], ...]:
    """Return the chosen curve and those richer than it, with Akaike's weights: exp(-chi^2 / 2 - coefficients)."""
    among = [c for c in candidates if c.fit is chosen or c.fit.basis.complexity > chosen.basis.complexity]
    variance = min(among, key=lambda candidate: float(candidate.squares.sum())).fit.variance
    half = np.asarray([0.5 * float((c.fit.residuals**2 / variance).sum()) - c.fit.dof for c in among])
    weights = np.exp(half.min() - half)
    return tuple((float(w), c.fit) for w, c in zip(weights / weights.sum(), among, strict=True))


@dataclass(frozen=True, slots=True)
class LackOfFitTest:
    """An F test of a lack of fit of `dof` and `within` degrees of freedom; `unit` is the rms of y that makes F 1.

    NaN if nothing is left to test by.
    """

    p_value: float = float("nan")
    ratio: float = float("nan")
    dof: int = 0
    within: int = 0
    unit: float = float("nan")

    @property
    def rms(self) -> float:
        """What this F shows beyond chance, as the mean of the noncentral F distribution."""
        shift = self.dof * (self.ratio * max(self.within - 2, 1) / max(self.within, 1) - 1.0)
        return self.unit * float(np.sqrt(max(shift, 0.0) / self.dof)) if self.dof else float("nan")

    def limits(self) -> tuple[float, float]:
        """Return the 95 % limits of the rms; of an F that may be chance, as others exceed what can be computed."""
        if not self.dof:
            return float("nan"), float("nan")
        low, high = (self._shift_at(*given) for given in ((self.ratio, 0.975), (max(self.ratio, 1.0), 0.025)))
        low, high = (self.unit * float(np.sqrt(shift / self.dof)) for shift in (low, high))
        return min(low, self.rms), max(high, self.rms)  # an F below 1 shows no less than one of 1

    def _shift_at(self, ratio: float, chance: float) -> float:
        """Return the noncentrality by which F is below `ratio` with such a chance; 0 where it is less without one."""
        if stats.f.cdf(ratio, self.dof, self.within) <= chance:
            return 0.0
        most = self.dof * (1.0 + ratio)
        while stats.ncf.cdf(ratio, self.dof, self.within, most) > chance:
            most *= 2.0

        def beyond(shift: float) -> float:
            return float(stats.ncf.cdf(ratio, self.dof, self.within, shift)) - chance

        return float(optimize.brentq(beyond, 1e-9 * most, most))  # scipy gives NaN at zero


def lack_of_fit_test(chosen: JointFit, richer: JointFit) -> LackOfFitTest:
    """Test the position means by their scatter and reading, together and by the gain of a `richer` curve.

    Of the two p the lesser counts (Sidak; twice it would be 1 for many sound runs). If hardly one was read twice, or
    the loop has another shape: the gain against what is left.
    """
    if chosen.dof < 1:
        return LackOfFitTest()
    means, known = chosen.means, bool(chosen.known_variance.min() > 0)
    gained = chosen.dof - richer.dof
    tested = known and means.dof >= max(richer.dof, 1)
    if tested and (not chosen.loop.size or loop_is_represented(richer)):
        weights = 1.0 / chosen.known_variance
        whole = _tested(chosen.chi_squared, chosen.dof, means.dof, weights, 1.0)
        if gained < 1 or not means.independent:
            return whole
        gain = float((chosen.residuals**2 - richer.residuals**2) @ weights)
        least = min(whole, _tested(gain, gained, means.dof, weights, 1.0), key=lambda one: one.p_value)
        return replace(least, p_value=1.0 - (1.0 - least.p_value) ** 2)
    weights = 1.0 / richer.variance if known else np.ones_like(richer.residuals)
    before, left = (float(weights @ fit.residuals**2) for fit in (chosen, richer))
    if gained < 1 or richer.dof < 1 or not left > 0:
        return LackOfFitTest()
    return _tested(before - left, gained, richer.dof, weights, left / richer.dof)


def _tested(squares: float, dof: int, within: int, weights: FloatArray, variance: float) -> LackOfFitTest:
    """Return the test of a sum of weighted squares, whose terms have such a variance."""
    ratio = max(squares, 0.0) / dof / variance
    unit = float(np.sqrt(variance * dof / weights.sum()))
    return LackOfFitTest(float(stats.f.sf(ratio, dof, within)), ratio, dof, within, unit)


def expanded(
    deviation: npt.ArrayLike, u: npt.ArrayLike, factor: float = COVERAGE_FACTOR, *, half_loop: npt.ArrayLike = 0.0
) -> FloatArray:
    """Return U that covers a normal error about a known deviation as often as `factor` u does without one.

    `half_loop` is half the distance of two equally likely branches about the deviation.
    """
    given = (np.asarray(one, dtype=np.float64) for one in (deviation, half_loop, u))
    away, half, spread = np.broadcast_arrays(*given)
    away, half = np.abs(away), np.abs(half)
    if not (away.any() or half.any()):
        return np.asarray(factor * spread)
    share, farthest = 2.0 * float(special.ndtr(factor)) - 1.0, away + half
    safe = np.where(spread > 0, spread, 1.0)
    branches = np.stack([away - half, farthest]) / safe
    low, high = np.full(away.shape, factor), branches[1] + factor  # in units of u
    found = np.sqrt(factor**2 + branches[1] ** 2)
    for _ in range(_BISECTIONS):  # Newton's, or half the bracket where that leaves it
        ends = np.stack([found - branches, -found - branches])
        inside = special.ndtr(ends)
        excess = 0.5 * (inside[0] - inside[1]).sum(axis=0) - share
        slope = 0.5 * np.exp(-0.5 * ends**2).sum(axis=(0, 1)) / np.sqrt(2.0 * np.pi)
        low, high = np.where(excess < 0.0, found, low), np.where(excess < 0.0, high, found)
        before, following = found, found - excess / np.maximum(slope, np.finfo(float).tiny)
        found = np.where((following >= low) & (following <= high), following, 0.5 * (low + high))
        if np.all(np.abs(found - before) <= 1e-12 * high):
            break
    return np.asarray(np.where(spread > 0, found * safe, farthest), dtype=np.float64)
