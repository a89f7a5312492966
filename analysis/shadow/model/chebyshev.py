"""Polynomials through Chebyshev points (Gauss points of the first kind) of an interval or a rectangle."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from protocol.base.arrays import FloatArray


def points(ends: FloatArray, count: int) -> FloatArray:
    """Return the Chebyshev points between two ends, increasing, shape (count,)."""
    low, high = ends
    return np.asarray((low + high) / 2.0 + (high - low) / 2.0 * chebyshev.chebpts1(count))


def basis(values: FloatArray, ends: FloatArray, count: int) -> FloatArray:
    """Return T_0 .. T_(count-1) of the interval at each value, shape (n, count)."""
    low, high = ends
    return np.asarray(chebyshev.chebvander((2.0 * values - low - high) / (high - low), count - 1))


def coefficients(values: FloatArray) -> FloatArray:
    """Return the coefficients of the polynomial through values at Chebyshev points.

    `values`: shape (count, ...), the first axis runs over the points.
    """
    count = len(values)
    vander = chebyshev.chebvander(chebyshev.chebpts1(count), count - 1)
    weights = np.full(count, 2.0 / count)
    weights[0] = 1.0 / count
    return np.tensordot(vander * weights, values, axes=(0, 0))


def tensor_coefficients(values: FloatArray) -> FloatArray:
    """Return the coefficients over a rectangle; the first two axes of `values` run over the points of each side."""
    return np.swapaxes(coefficients(np.swapaxes(coefficients(values), 0, 1)), 0, 1)
