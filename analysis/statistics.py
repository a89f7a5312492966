"""Small statistics that every figure shares: standard errors, robust scale, intervals.

Rules: nothing here depends on sensors or pressures; randomness comes from a generator that is passed in, so that the
same seed gives the same numbers.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy import stats

from analysis.arrays import FloatArray

MAD_TO_SD = 1.482602218505602  # 1 / Phi^-1(3/4): median absolute deviation of a normal variable to its sd
RESAMPLES = 2000


def effective_count(values: FloatArray) -> float:
    """Return how many independent samples a stationary series is worth, n / (1 + 2 sum rho_k).

    The sum runs over Geyer's initial positive sequence (pairs of lags while their sum is positive): it needs no
    window to be chosen. White noise gives n, to within its own scatter; the result lies in 1..n.

    Source: C. J. Geyer, Practical Markov chain Monte Carlo, Statistical Science 7 (1992) 473-483, section 3.3.
    """
    n = values.size
    if n < 4:
        return float(n)
    centred = values - values.mean()
    variance = float(centred @ centred) / n
    if variance <= 0:
        return float(n)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    rho = np.fft.irfft(spectrum * np.conj(spectrum), size)[:n] / (n * variance)
    pairs = rho[1 : n - 1 : 2] + rho[2:n:2][: rho[1 : n - 1 : 2].size]
    # each lag's own noise is about 1/sqrt(n): pairs below it are no evidence of correlation
    stop = np.flatnonzero(pairs < 2.0 / np.sqrt(n))
    total = float(pairs[: stop[0]].sum()) if stop.size else float(pairs.sum())
    return float(np.clip(n / (1.0 + 2.0 * total), 1.0, n))


def standard_error(values: FloatArray) -> float:
    """Return the standard error of the mean, corrected for autocorrelation; NaN below two samples."""
    if values.size < 2:
        return float("nan")
    return float(values.std(ddof=1) / np.sqrt(effective_count(values)))


def mean(values: FloatArray) -> float:
    """Return the mean; NaN for no values."""
    return float(values.mean()) if values.size else float("nan")


def robust_sd(values: FloatArray) -> float:
    """Return the standard deviation from the median absolute deviation; NaN for no values."""
    if not values.size:
        return float("nan")
    return float(MAD_TO_SD * np.median(np.abs(values - np.median(values))))


def white_noise_sd(values: FloatArray) -> float:
    """Return the sd of white noise on a slow signal, from second differences (their variance is 6 sigma^2)."""
    if values.size < 4:
        return 0.0
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return float(robust_sd(second) / np.sqrt(6.0))


def resampling_weights(n: int, rng: np.random.Generator, resamples: int = RESAMPLES) -> FloatArray:
    """Return how often each of `n` items is drawn in each bootstrap resample, [resamples, n].

    Parameters
    ----------
    n : number of items.
    rng : generator of the draws.
    resamples : number of resamples.
    """
    return rng.multinomial(n, np.full(n, 1.0 / n), size=resamples).astype(np.float64)


@cache
def tails_within(draws: int, tail: float = 0.025) -> tuple[float, float]:
    """Return the limits (k = 2) of the probability beyond a quantile of so many draws; `tail` is that quantile's own.

    Source: A. Vehtari et al., Rank-normalization, folding, and localization, Bayesian Analysis 16 (2021) 667-718.
    """
    law = stats.beta(draws * tail + 1.0, draws * (1.0 - tail) + 1.0)
    low, high = (float(law.ppf(stats.norm.cdf(sides))) for sides in (-2.0, 2.0))
    return low, high


def bootstrap_interval(
    estimate: float, replicates: FloatArray, n: int, *, positive: bool = False, tail: float = 0.025
) -> tuple[float, float]:
    """Return the 95 % expanded percentile interval of a bootstrap over `n` items.

    The plain percentile interval is too short for few items by sqrt((n-1)/n) z/t; it is widened about the estimate by
    the inverse. Source: T. C. Hesterberg, What teachers should know about the bootstrap, Am. Stat. 69 (2015) 371-386.
    With `positive` it is widened on the scale of logarithms: a spread then keeps an interval above zero.

    Parameters
    ----------
    estimate : of the sample itself.
    replicates : [resamples] of the resamples.
    n : number of items drawn from.
    positive : widen on the scale of logarithms.
    tail : share of the replicates beyond each limit.
    """
    finite = replicates[np.isfinite(replicates)]
    if n < 2 or finite.size < 0.9 * replicates.size or not np.isfinite(estimate):
        return float("nan"), float("nan")
    widen = stats.t.ppf(0.975, n - 1) / stats.norm.ppf(0.975) * np.sqrt(n / (n - 1.0))
    low, high = np.percentile(finite, [100.0 * tail, 100.0 - 100.0 * tail])
    if positive and estimate > 0 and low > 0:
        return (
            float(estimate * np.exp(-widen * max(np.log(estimate / low), 0.0))),
            float(estimate * np.exp(widen * max(np.log(high / estimate), 0.0))),
        )
    # a statistic with an upward bias (a maximum) can have its estimate outside: the interval then starts at it
    return (float(estimate - widen * max(estimate - low, 0.0)), float(estimate + widen * max(high - estimate, 0.0)))


def theil_sen(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Return the Theil-Sen slope and its 95 % interval (Sen 1968); NaN below three points or without spread in x."""
    if x.size < 3 or np.ptp(x) == 0:
        return float("nan"), float("nan"), float("nan")
    slope, _, low, high = stats.theilslopes(y, x, alpha=0.95)
    return float(slope), float(low), float(high)


def interpolate(grid: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Interpolate linearly on `grid`, NaN outside the span of x; x in any order, equal x are averaged.

    Parameters
    ----------
    grid : [points] where to interpolate.
    x, y : [n] points, in any order.
    """
    order = np.argsort(x, kind="stable")
    knots, first, count = np.unique(x[order], return_index=True, return_counts=True)
    means = np.add.reduceat(y[order], first) / count
    return np.interp(grid, knots, means, left=np.nan, right=np.nan)
