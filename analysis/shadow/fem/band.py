"""Symmetric positive definite band matrices: Cholesky factor and solution.

Entry (i, j) of the lower triangle is at band[j, i - j], with PAD zeros after each column: four columns are eliminated
at a time. Not LAPACK, because a threaded BLAS cuts such small bands into pieces and is ten times slower on a loaded
machine. A factorisation stops at the first pivot that is not positive and returns its number: the test for stability.
"""

from __future__ import annotations

import numpy as np

from analysis.compiled import compiled_reassociating, inside
from protocol.base.arrays import FloatArray

PAD = 3


def empty_band(size: int, bandwidth: int) -> FloatArray:
    """Return a band of zeros with `bandwidth` sub-diagonals, shape (size, bandwidth + 1 + PAD)."""
    return np.zeros((size, bandwidth + 1 + PAD))


@inside
def add_to_band(band: FloatArray, row: int, column: int, value: float) -> None:
    """Add to an entry of the lower triangle; -1 is a fixed freedom, the upper triangle is ignored."""
    if column >= 0 and row >= column:
        band[column, row - column] += value


@compiled_reassociating
def factorise(band: FloatArray) -> int:
    """Overwrite a band with its Cholesky factor; return how many pivots were positive: all, or the matrix is not."""
    size, width = band.shape[0], band.shape[1] - PAD
    for first in range(0, size, 4):
        block = min(4, size - first)
        for p in range(first, first + block):
            column = band[p]
            for q in range(first, p):
                weight = band[q, p - q]
                earlier = band[q, p - q :]
                for i in range(width - (p - q)):
                    column[i] -= weight * earlier[i]
            if not column[0] > 0.0:
                return p
            column[0] = np.sqrt(column[0])
            scale = 1.0 / column[0]
            for i in range(1, width):
                column[i] *= scale
        if block == 4:
            eliminate_four(band, first)
    return int(size)


@compiled_reassociating
def eliminate_four(band: FloatArray, first: int) -> None:
    """Subtract four finished columns from all later columns that they reach."""
    size, width = band.shape[0], band.shape[1] - PAD
    for later in range(first + 4, min(first + width + 3, size)):
        away = later - first
        c0, c1 = band[first, away:], band[first + 1, away - 1 :]
        c2, c3 = band[first + 2, away - 2 :], band[first + 3, away - 3 :]
        w0, w1, w2, w3 = c0[0], c1[0], c2[0], c3[0]
        column = band[later]
        for i in range(min(width - away + 3, size - later)):
            column[i] -= w0 * c0[i] + w1 * c1[i] + w2 * c2[i] + w3 * c3[i]


@compiled_reassociating
def forward(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Return L^-1 right, shape (size,)."""
    x, size, width = right.copy(), factor.shape[0], factor.shape[1] - PAD
    for j in range(size):
        x[j] /= factor[j, 0]
        for i in range(1, min(width, size - j)):
            x[j + i] -= factor[j, i] * x[j]
    return x


@compiled_reassociating
def backward(factor: FloatArray, right: FloatArray) -> FloatArray:
    """Return L^-T right, shape (size,)."""
    x, size, width = right.copy(), factor.shape[0], factor.shape[1] - PAD
    for j in range(size - 1, -1, -1):
        total = x[j]
        for i in range(1, min(width, size - j)):
            total -= factor[j, i] * x[j + i]
        x[j] = total / factor[j, 0]
    return x
