"""The banded Cholesky factorisation against LAPACK and numpy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import cholesky_banded

from analysis.shadow.fem.band import PAD, backward, empty_band, factorise, forward
from tests.analysis.shadow.solids import dense


def random_band(size: int, bandwidth: int, seed: int) -> np.ndarray:
    """A diagonally dominant band."""
    band, rng = empty_band(size, bandwidth), np.random.default_rng(seed)
    for j in range(size):
        below = min(bandwidth, size - 1 - j)
        band[j, 1 : below + 1] = rng.uniform(-1.0, 1.0, below)
    band[:, 0] = 2.0 * bandwidth + 1.0 + rng.random(size)
    return band


@given(st.integers(1, 40), st.integers(0, 12), st.integers(0, 99))
def test_factor_and_solution(size: int, bandwidth: int, seed: int) -> None:
    """The factor is LAPACK's, the solution numpy's, whatever the size is a multiple of."""
    band = random_band(size, min(bandwidth, size - 1), seed)
    full, right = dense(band), np.random.default_rng(seed + 1).standard_normal(size)
    factor = band.copy()
    assert factorise(factor) == size
    lapack = cholesky_banded(band[:, : band.shape[1] - PAD].T, lower=True)
    np.testing.assert_allclose(np.tril(dense(factor)), np.tril(dense(np.pad(lapack.T, ((0, 0), (0, PAD))))), atol=1e-12)
    np.testing.assert_allclose(backward(factor, forward(factor, right)), np.linalg.solve(full, right), atol=1e-12)


@given(st.integers(1, 30), st.integers(0, 6), st.data())
def test_factorisation_stops_where_definiteness_ends(size: int, bandwidth: int, data: st.DataObject) -> None:
    """The count returned is the size of the greatest leading block that is positive definite."""
    band = random_band(size, min(bandwidth, size - 1), 0)
    at = data.draw(st.integers(0, size - 1))
    band[at, 0] = -1.0
    assert factorise(band) == at


def test_nan_is_not_positive_definite() -> None:
    """A NaN ends the factorisation like a pivot that is not positive."""
    band = random_band(9, 2, 0)
    band[4, 0] = np.nan
    assert factorise(band) == 4
