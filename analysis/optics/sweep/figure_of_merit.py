"""From the detected rays of 15 states to one figure: aNDR, Delta, n_sign, RMSE, P, with their uncertainty.

Rules: all functions take arrays whose last axis is the states, from the most compressed to the most elongated, for any
number of designs. P is computed as printed in the paper and repaired; the two differ only where the printed one is
undefined or dominated by noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import DataError

DEGREE = 3
_DRAWS = 500
_RANKED = 50
_TIE = 0.025
_LARGE = 1e3  # noncentral chi-square above which its root is normal with sd 1, to 0.015 on the safe side

FLOOR = 1.0 / math.sqrt(12.0)
"""RMSE below what the paper's 250 rays resolve counts as this where designs are compared at any number of rays."""
PARTING = (
    "Printed and repaired P are the same number wherever NDR rises at least once and its scatter about aNDR is above "
    "the resolution of the ray count. They part for monotone designs (n_sign = 0), where the printed P divides by zero "
    "although such a design is what is wanted: the repaired one counts n_sign as 1 and marks it; and where RMSE falls "
    "below the resolution, which is then used instead, so that chance agreement with a cubic wins nothing."
)


@dataclass(frozen=True, slots=True)
class Merit:
    """Figures of any number of designs, (n,) unless stated otherwise."""

    andr: FloatArray  # (n, states) the cubic through NDR, evaluated at the states
    delta: FloatArray  # aNDR at maximum compression less aNDR at maximum elongation
    n_sign: FloatArray  # steps in which NDR rises from compression to elongation
    rmse: FloatArray  # root mean square of NDR - aNDR over the states
    p_printed: FloatArray  # Delta / (n_sign RMSE) as in the paper; NaN where it is undefined
    p: FloatArray  # the same with max(n_sign, 1) and RMSE no smaller than the resolution
    monotone: FloatArray  # n_sign = 0
    floored: FloatArray  # RMSE was below the resolution

    @property
    def p_normalised(self) -> FloatArray:
        """Return P over its maximum, as in the paper's figure 3D."""
        return self.p / np.max(self.p)


def cubic_projector(states: int) -> FloatArray:
    """Return the matrix (states, states) from NDR to aNDR: least squares on orthonormal cubics in the state's number.

    Raises DataError: 4 states or fewer leave no residuals of a cubic.
    """
    if states <= DEGREE + 1:
        raise DataError(f"{states} states are too few for a cubic and its residuals", "give the curves of 15 states")
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, states), DEGREE))
    return np.asarray(basis @ basis.T)


def resolution(rays: int) -> float:
    """Return the RMSE of rounding to whole rays alone: one ray's step, scaled to 250, over sqrt(12)."""
    return 250.0 / rays / math.sqrt(12.0)


def merit(ndr: FloatArray, floor: float) -> Merit:
    """Return the figures of merit of NDR.

    `ndr`: (..., states), rays scaled to 250. `floor`: smallest significant RMSE, from `resolution`.

    P = Delta / (n_sign RMSE), the paper's section "Optical simulation".
    """
    andr = ndr @ cubic_projector(ndr.shape[-1])
    delta = andr[..., 0] - andr[..., -1]
    n_sign = np.sum(np.diff(ndr, axis=-1) > 0, axis=-1).astype(float)
    rmse = np.sqrt(np.mean((ndr - andr) ** 2, axis=-1))
    below = n_sign * rmse
    printed = np.divide(delta, below, out=np.full_like(delta, np.nan), where=below > 0)
    repaired = delta / (np.maximum(n_sign, 1.0) * np.maximum(rmse, floor))
    return Merit(andr, delta, n_sign, rmse, printed, repaired, n_sign == 0, rmse < floor)


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainty of P by the finite number of rays."""

    p_ci: FloatArray  # (n, 2) 95 % interval of each design's P
    tied: FloatArray  # (n,) whether a design equals the best within noise
    # 1 - Spearman's correlation of P with itself traced again with as many rays, the median of the draws
    rank_error: float


def uncertainty(ndr: FloatArray, sd: FloatArray, floor: float, *, draws: int = _DRAWS, seed: int = 0) -> Uncertainty:
    """Return the uncertainty of P from draws of NDR about its value with its standard deviation.

    `ndr`, `sd`: (n, states), rays scaled to 250.

    The interval is the central 95 % of the draws, widened to contain P itself: scatter can only add rises, so that the
    draws lie below the P of a design that owes its rank to luck. A design is tied with the best if it is at least as
    good in 2.5 % of the draws. Both take the states as independent.
    """
    from scipy import stats  # here: the window takes a `Merit` from its helper without SciPy

    rng = np.random.default_rng(seed)
    p = merit(ndr, floor).p
    drawn = np.empty((draws, len(ndr)))
    for i in range(draws):
        drawn[i] = merit(ndr + sd * rng.standard_normal(ndr.shape), floor).p
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    best = int(np.argmax(p))
    tied = np.mean(drawn >= drawn[:, best : best + 1], axis=0) >= _TIE
    ranks, again = stats.rankdata(p), stats.rankdata(drawn[:: max(1, draws // _RANKED)], axis=1)
    alike = [np.corrcoef(ranks, one)[0, 1] for one in again] if np.ptp(ranks) > 0 else [np.nan]
    rank_error = 1.0 - float(np.nanmedian(alike)) if np.isfinite(alike).any() else 0.0
    return Uncertainty(np.stack([np.minimum(low, p), np.maximum(high, p)], axis=1), tied, rank_error)


def p_bounds(
    ndr: FloatArray, sd: FloatArray, floor: float, *, low_error: float, high_error: float
) -> tuple[FloatArray, FloatArray]:
    """Return a lower and an upper bound (n,) of the P that infinitely many rays would give.

    `ndr`, `sd`: (n, states), rays scaled to 250.

    P is bounded by bounds of its three parts, each with a third of the error probability: Delta is normal; a step
    counts as a rise, or as none, only where it is significant among all steps; the sum of squares about aNDR is a
    multiple of noncentral chi-square, so that what noise adds to RMSE is taken out. Where the states' errors are equal
    it has states - 4 degrees of freedom; else multiple and degrees of freedom keep mean and variance, those that the
    residuals add among them (as Satterthwaite, Biometrics Bull. 2, 1946, 110).
    """
    (low, _), (_, high) = (_bounds_at(ndr, sd, floor, error) for error in (low_error, high_error))
    return low, high


def _bounds_at(ndr: FloatArray, sd: FloatArray, floor: float, error: float) -> tuple[FloatArray, FloatArray]:
    from scipy import stats

    projector, states = cubic_projector(ndr.shape[-1]), ndr.shape[-1]
    wide = stats.norm.isf(error / 3)
    delta, spread = (ndr @ (projector[0] - projector[-1]), np.sqrt(sd**2 @ (projector[0] - projector[-1]) ** 2))
    step = stats.norm.isf(error / 3 / (states - 1)) * np.hypot(sd[..., 1:], sd[..., :-1])
    rises = [np.maximum(np.sum(np.diff(ndr, axis=-1) > limit, axis=-1), 1.0) for limit in (step, -step)]
    rmse = [np.maximum(each, floor) for each in _rmse_bounds(ndr - ndr @ projector, sd, projector, error / 3)]
    least, most = rises[0] * rmse[0], rises[1] * rmse[1]
    low, high = delta - wide * spread, delta + wide * spread
    return low / np.where(low > 0, most, least), high / np.where(high > 0, least, most)


def _rmse_bounds(
    residual: FloatArray, sd: FloatArray, projector: FloatArray, error: float
) -> tuple[FloatArray, FloatArray]:
    """Return bounds (n,) of the RMSE without noise from residuals (n, states) with it, each wrong with `error`."""
    states, free = residual.shape[-1], np.eye(residual.shape[-1]) - projector
    total = np.sum(residual**2, axis=-1)
    noise = sd**2 @ np.diag(free)
    spread = np.sum((free * sd[..., None, :] ** 2 @ free) ** 2, axis=(-2, -1))
    along = np.maximum(np.sum((sd * residual) ** 2, axis=-1) - spread, 0.0)
    own = (spread + 2.0 * along) / np.where(noise > 0, noise + 2.0 * np.maximum(total - noise, 0.0), 1.0)
    variance = np.where(noise > 0, own, 1.0)
    dof, x = noise / variance, total / variance
    from scipy import special, stats

    root, wide = np.sqrt(x), stats.norm.isf(error)
    bounds = []
    for part, sign in ((1.0 - error, -1.0), (error, 1.0)):
        exact = np.where(special.chndtr(x, dof, 0.0) > part, special.chndtrinc(np.minimum(x, _LARGE), dof, part), 0.0)
        normal = np.maximum(np.maximum(root + sign * wide, 0.0) ** 2 - (dof - 1), 0.0)
        centre = np.where(x < _LARGE, exact, normal)
        bounds.append(np.sqrt(np.where(noise > 0, centre * variance, total) / states))
    return bounds[0], bounds[1]


def ranks_within(p: FloatArray, group: BoolArray) -> IntArray:
    """Return the rank of each design (..., n) in a group (n,), 1 the best; equal P share the better rank."""
    return np.asarray(1 + np.sum(p[..., None, group] > p[..., :, None], axis=-1))


def pareto(delta: FloatArray, rmse: FloatArray, n_sign: FloatArray) -> FloatArray:
    """Return (n,) where no other design is as good in Delta, RMSE and n_sign and better in one of them.

    `delta`, `rmse`, `n_sign`: (n,) of `Merit`.
    """
    cost = np.stack([-delta, rmse, n_sign], axis=1)
    no_worse = np.all(cost[None] <= cost[:, None], axis=2)
    better = np.any(cost[None] < cost[:, None], axis=2)
    return np.asarray(~np.any(no_worse & better, axis=1))
