"""Small statistics that every figure shares: standard errors, robust scale, intervals. Generators are passed in."""

from __future__ import annotations

import numpy as np
from scipy import stats

from protocol.base.arrays import FloatArray

_MAD_TO_SD = 1.482602218505602  # 1 / Phi^-1(3/4): median absolute deviation of a normal variable to its sd
_BETWEEN = 21  # points between two levels
_ALIKE = 0.02  # of the range of levels: nearer ones are one
BATCHES = 16  # of draws; the sd over so many is known to 18 %
PERCENTILES = (2.5, 97.5)  # of the resamples, which a 95 % interval rests on


def effective_count(values: FloatArray) -> float:
    """Return how many independent samples a stationary series is worth, n / (1 + 2 sum rho_k), within 1..n.

    The sum is Geyer's initial positive sequence (pairs of lags while positive), which needs no window. Source: C. J.
    Geyer, Practical Markov chain Monte Carlo, Statistical Science 7 (1992) 473-483, section 3.3.
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
    return float(_MAD_TO_SD * np.median(np.abs(values - np.median(values))))


def white_noise_sd(values: FloatArray) -> float:
    """Return the sd of white noise on a slow signal, from second differences (their variance is 6 sigma^2)."""
    if values.size < 4:
        return 0.0
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return float(robust_sd(second) / np.sqrt(6.0))


def resampling_weights(n: int, rng: np.random.Generator, resamples: int) -> FloatArray:
    """Return how often each of `n` items is drawn in each bootstrap resample, [resamples, n]."""
    return rng.multinomial(n, np.full(n, 1.0 / n), size=resamples).astype(np.float64)


def bootstrap_interval(
    estimate: float, replicates: FloatArray, n: int, *, positive: bool = False
) -> tuple[float, float]:
    """Return the 95 % expanded percentile interval of `replicates` [resamples] of a bootstrap over `n` items, or NaN.

    The percentile interval is too short for few items by sqrt((n-1)/n) z/t, so it is widened about the estimate, with
    `positive` on a log scale if both limits allow it. Source: T. C. Hesterberg, Am. Stat. 69 (2015) 371-386.
    """
    finite = replicates[np.isfinite(replicates)]
    if n < 2 or finite.size < 0.9 * replicates.size or not np.isfinite(estimate):
        return float("nan"), float("nan")
    low, high = np.percentile(finite, PERCENTILES)
    widen = stats.t.ppf(0.975, n - 1) / stats.norm.ppf(0.975) * np.sqrt(n / (n - 1.0))
    # a statistic with an upward bias (a maximum) can have its estimate outside: the interval then starts at it
    if positive and estimate > 0 and low > 0:
        down, up = np.log(estimate / low), np.log(high / estimate)
        low, high = estimate * np.exp(-widen * max(down, 0.0)), estimate * np.exp(widen * max(up, 0.0))
    else:
        low, high = estimate - widen * max(estimate - low, 0.0), estimate + widen * max(high - estimate, 0.0)
    return float(low), float(high)


def limit_error(draws: FloatArray) -> float:
    """Return the Monte-Carlo error (k = 2) of the worst limit of 95 % intervals of [draws, places] in order.

    Limits of a batch vary sqrt(batches) times as much as those of all draws, even autocorrelated, if a batch is much
    longer than their correlation. Source: J. M. Flegal, G. L. Jones, Ann. Statist. 38 (2010) 1034-1070.
    """
    length = len(draws) // BATCHES
    batches = draws[: BATCHES * length].reshape(BATCHES, length, -1)
    limits = np.percentile(batches, [2.5, 97.5], axis=1)
    return float(2.0 * (limits.std(axis=1, ddof=1) / np.sqrt(BATCHES)).max())


def theil_sen(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Return the Theil-Sen slope and its 95 % interval (Sen 1968); NaN below three points or without spread in x."""
    if x.size < 3 or np.ptp(x) == 0:
        return float("nan"), float("nan"), float("nan")
    slope, _, low, high = stats.theilslopes(y, x, alpha=0.95)
    return float(slope), float(low), float(high)


def interpolate(grid: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Interpolate linearly on `grid`, NaN outside the span of x; x in any order, equal x are averaged."""
    order = np.argsort(x, kind="stable")
    knots, first, count = np.unique(x[order], return_index=True, return_counts=True)
    means = np.add.reduceat(y[order], first) / count
    return np.interp(grid, knots, means, left=np.nan, right=np.nan)


def bound_between(level: FloatArray, apart: FloatArray) -> float:
    """Return how far branches that are `apart` by this at levels may lie apart between these, [levels].

    A loop is taken as concave: between two levels it lies below the lines through their other neighbours.
    """
    known = np.isfinite(apart)
    order = np.argsort(level[known], kind="stable")
    x, y = level[known][order], apart[known][order]
    if x.size:
        alike = np.concatenate([[0], np.cumsum(np.diff(x) > _ALIKE * np.ptp(x))])
        x, y = (np.bincount(alike, each) / np.bincount(alike) for each in (x, y))
    if x.size < 3:
        return float(np.abs(y).max(initial=0.0))
    y = y if y[np.argmax(np.abs(y))] > 0 else -y
    slopes = np.diff(y) / np.diff(x)
    bound = float(y.max())
    for g in range(x.size - 1):
        before = slopes[g - 1] if g > 0 else np.inf
        after = slopes[g + 1] if g + 2 < x.size else -np.inf
        width = x[g + 1] - x[g]
        share = np.linspace(0.0, 1.0, _BETWEEN) * width
        left = y[g] + before * share[1:-1] if np.isfinite(before) else np.full(_BETWEEN - 2, np.inf)
        right = y[g + 1] - after * (width - share[1:-1]) if np.isfinite(after) else np.full(_BETWEEN - 2, np.inf)
        bound = max(bound, float(np.minimum(left, right).max()))
    return bound
