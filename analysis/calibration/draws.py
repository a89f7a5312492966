"""What finite draws leave uncertain: means and quantiles as another set of as many draws would give them.

Strategy: `OTHERS` other sets are simulated, not drawn. A mean errs by a normal number of standard errors. A quantile
lies at a probability that has a beta distribution; the tail about it is taken as normal, with the mean of the draws
beyond `WIDER` tails, which is better known than the distances of the few draws beside the quantile. Draws that repeat,
as resamples of few cycles do, are jumps, and what lies at that probability is taken. Draws that are rows of one table
share their error: it is made of the rows' marks, in batches, with the same weights for all, so that what rests on the
same rows errs together.
Source of the beta distribution: H. A. David, H. N. Nagaraja, Order Statistics, 2003, 2.1.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from protocol.base.arrays import FloatArray

OTHERS, BATCHES = 1_000, 256
COVERAGE = 0.9545
"""Of a stated error: that of k = 2."""
WIDER = 3.0
"""Times the tail of a quantile: the draws from which its scale is found."""
REPEATED = 0.8
"""Part of the draws in the tail that differ from one another: where they are fewer, they are jumps."""
_SEED, _NORMALS = 115, np.linspace(-6.0, 6.0, 241)


def errors_by_chance(marks: FloatArray) -> FloatArray:
    """Return by how many standard errors the mean of the marks of other rows may be off, [OTHERS].

    Parameters
    ----------
    marks : [rows] of which the mean is taken; the same rows of another table err alike.
    """
    batch = np.arange(marks.size) % BATCHES
    away = np.bincount(batch, marks) - np.bincount(batch) * marks.mean()
    length = float(np.linalg.norm(away))
    return _weights()[:, : away.size] @ away / length if length > 0.0 else np.zeros(OTHERS)


def means_by_chance(values: FloatArray) -> FloatArray:
    """Return means as other draws would give them, [OTHERS]; `values` are [rows]."""
    return np.asarray(values.mean() + values.std() / np.sqrt(values.size) * errors_by_chance(values))


def lower_quantiles_by_chance(values: FloatArray, tail: float) -> FloatArray:
    """Return lower quantiles as other draws would give them, [OTHERS]; of upper ones both signs are turned.

    Parameters
    ----------
    values : [rows]. tail : share of them that is below the quantile.
    """
    ordered = np.sort(values)
    quantile = float(np.interp(tail * (values.size - 1), np.arange(values.size), ordered))
    errors = errors_by_chance((values <= quantile).astype(np.float64))
    probabilities = probabilities_by_chance(values.size, tail, -errors)
    beyond = ordered[: max(round(WIDER * tail * values.size), 2)]
    if np.unique(beyond).size < REPEATED * beyond.size:
        at = np.clip(np.rint(probabilities * (values.size + 1)).astype(int) - 1, 0, values.size - 1)
        return np.asarray(ordered[at] + quantile - ordered[round(tail * (values.size - 1))])
    return np.asarray(quantile + distances_in_tail(beyond, tail, WIDER * tail, probabilities))


def distances_in_tail(beyond: FloatArray, tail: float, share: float, probabilities: FloatArray) -> FloatArray:
    """Return how far quantiles at some probabilities are from the one at `tail`, in a normal tail.

    Parameters
    ----------
    beyond : the lowest draws in order, [draws, ...], the scale is from their mean.
    probabilities : [others, ...].
    """
    from scipy import special

    excess = (beyond[-1] - beyond.mean(axis=0)) * len(beyond) / (len(beyond) - 1)
    edge = special.ndtri(share)
    of_normal = np.exp(-0.5 * edge**2) / np.sqrt(2.0 * np.pi) / share + edge
    return np.asarray(excess / of_normal * (special.ndtri(probabilities) - special.ndtri(tail)))


def probabilities_by_chance(size: int, tail: float, normals: FloatArray) -> FloatArray:
    """Return the probabilities at which the lower quantile of other draws lies.

    Parameters
    ----------
    tail : share of them below the quantile. normals : numbers of standard errors, any shape.
    """
    return np.asarray(np.interp(normals, _NORMALS, _probabilities(size, tail)))


def quantiles_by_chance(values: FloatArray, tail: float) -> FloatArray:
    """Return the limits with a share `tail` of the values [rows] beyond each, by other draws, [2, OTHERS]."""
    return np.stack([lower_quantiles_by_chance(values, tail), -lower_quantiles_by_chance(-values, tail)])


def greatest_error(away: FloatArray) -> float:
    """Return the error (k = 2) of the worst of some numbers by their distances in other draws, [numbers, OTHERS]."""
    return float(np.quantile(np.abs(away).max(axis=0), COVERAGE))


@cache
def _weights() -> FloatArray:
    return np.random.default_rng(_SEED).standard_normal((OTHERS, BATCHES))


@cache
def _probabilities(size: int, tail: float) -> FloatArray:
    """Return the probability below the quantile of so many draws, at a normal number of its errors."""
    from scipy import special

    rank = tail * (size - 1) + 1.0
    return np.asarray(special.betaincinv(rank, size + 1.0 - rank, special.ndtr(_NORMALS)))
