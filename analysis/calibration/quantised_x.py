"""The error of readings on a grid: one latent x for each position that was read.

Readers are normal with sd s about x, and the grid of distance d rounds to its nearest mark:
    L_p(x) = product over the readings r of  Phi((r + d/2 - x) / s) - Phi((r - d/2 - x) / s).
Pooled within positions, readings scatter by S^2 = s^2 + d^2 / 12 - u_c^2(s), u_c^2 the part of the rounding error that
a position shares (B. Widrow, I. Kollar, Quantization Noise, 2008, 4); it is solved for s. A movement of the actuator
that the signal shows is subtracted first. Without labels each reading is a position of its own, unless signals of equal
readings lie closer than independent errors allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import optimize, special, stats

from analysis.polynomial import LeastSquares
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import DataError

SHARPEST_READER = 0.005  # of the grid: the resolution of a reader at the middle between two marks
FINE, TAIL = 400, 2e-3  # points that L_p is computed on, and what is cut off at either end of it
MOST_CELLS, FEWEST_CELLS, ALL_CELLS = 12, 4, 800
_SIGNIFICANT = 2.0  # standard errors: less movement of the actuator counts as none
REFUTED = 0.01  # chance of such signals at which readings of one value are not believed to err independently
CLOSE = 0.1  # of even spacing, and the chance of a smaller gap


@dataclass(frozen=True, slots=True)
class Positions:
    """The readings of a calibration by position, [positions] by default."""

    of_point: IntArray  # [n] number of the position of each point
    count: IntArray  # readings of each
    x: FloatArray  # mean reading, weighted as the fit's points are
    y: FloatArray  # mean signal
    edges: FloatArray  # [positions, cells + 1] ends of equal cells of x
    shares: FloatArray  # [positions, cells] share of L_p in each
    x_variance: FloatArray  # of L_p
    mean_variance: FloatArray  # of y by the scatter within positions, zeros if none was read twice
    relative_variance: FloatArray  # relative variance of the misfit: ones, or that of a single reading
    noise_sd: float  # scatter of the signal within positions, for a point of weight 1; 0 if unknown
    misfit_sd: float  # moment estimate of the further scatter of the means, for a relative variance of 1
    reader_sd: float  # s
    grid: float  # d, sqrt(12) times the reading sd

    @property
    def n(self) -> int:
        return self.count.size

    def covariance(self, fit: LeastSquares) -> FloatArray:
        """Return the covariance of the least-squares coefficients in the scaled basis, [degree + 1, degree + 1].

        Every position counts once: sum_p u_p^2 g_p g_p^T, g_p the influence of its mean, u_p of reading, scatter and
        misfit. Scattered readings flatten a curve (attenuation): its distance from that through the means is added.
        """
        variance = fit.slope(self.x) ** 2 * self.x_variance + self.mean_variance
        variance = variance + self.misfit_sd**2 * self.relative_variance
        return self._propagated(fit, variance)

    def beyond_fit(self, fit: LeastSquares) -> FloatArray:
        """Return what the reading adds to the fit's own covariance, [degree + 1, degree + 1].

        It is sum_p (1 - 1 / n_p) f'^2 Var(x_p) g_p g_p^T and the flattening: the fit treats points as independent.
        """
        variance = (1.0 - 1.0 / self.count) * fit.slope(self.x) ** 2 * self.x_variance
        return self._propagated(fit, variance)

    def _propagated(self, fit: LeastSquares, variance: FloatArray) -> FloatArray:
        """Return the covariance by variances of the positions' means, [degree + 1, degree + 1].

        The influence d coefficients / d y_p is that of a fit through the means; the distance of its coefficients from
        those of the fit through all points is added.
        """
        root = np.sqrt(np.bincount(self.of_point, fit.weights))
        influence = np.linalg.pinv(fit.basis.design(self.x) * root[:, None]) * root
        flattened = influence @ self.y - fit.basis_coefficients
        return np.asarray((influence * variance) @ influence.T + np.outer(flattened, flattened), dtype=np.float64)


def gather(
    fit: LeastSquares, x: FloatArray, y: FloatArray, reading_sd: float, labels: npt.ArrayLike | None = None
) -> Positions:
    """Gather the readings of a calibration by position. DataError: not one label for each point.

    `reading_sd`: sd of one reading to the nearest mark: the grid / sqrt(12). `labels`: [n] position of each point;
    None: each its own, unless equal readings share their error (`share_their_error`).
    """
    weights = fit.weights
    if labels is not None:
        named = np.asarray(labels)
    else:
        named = np.round(x, 9) if share_their_error(fit, x, y, reading_sd) else np.arange(x.size)
    if named.shape[:1] != x.shape:
        raise DataError(f"{named.shape[0]} positions for {x.size} points", "Give one for each point.")
    _, of_point = np.unique(named, axis=0, return_inverse=True)
    of_point = of_point.reshape(-1)
    count = np.bincount(of_point)
    mass = np.bincount(of_point, weights)
    mean_x, mean_y = (np.bincount(of_point, weights * v) / mass for v in (x, y))
    dx, dy = x - mean_x[of_point], y - mean_y[of_point]
    dof = x.size - count.size
    grid = float(reading_sd * np.sqrt(12.0))
    slope = fit.slope(mean_x)[of_point]
    moved, noise_variance, reader = np.zeros(x.size), 0.0, 0.0
    if dof > 0:
        moved, noise_variance = _movement(dx, dy, slope, weights, dof)
        # readings less the movement of the actuator seen in the signal: its variance is subtracted from that of the
        # readers
        by_movement = float(moved @ moved) / dof
        reader = np.sqrt(max(_reader_sd(float(dx @ dx) / dof, grid) ** 2 - by_movement, 0.0))
    reader = max(float(reader), SHARPEST_READER * grid)
    cells = int(np.clip(ALL_CELLS // count.size, FEWEST_CELLS, MOST_CELLS))
    edges, shares, variance = _likelihoods(x - moved, mean_x, of_point, count, grid, reader, cells)
    mean_variance = noise_variance / mass
    relative = np.ones(count.size) if noise_variance > 0 else 1.0 / mass  # once each: what misses the curve is noise
    residual = mean_y - fit.predict(mean_x)
    free = count.size - fit.basis.degree - 1
    known = fit.slope(mean_x) ** 2 * variance + mean_variance
    misfit = (
        max(float((residual**2 / relative).sum()) / free - float(np.mean(known / relative)), 0.0) if free > 0 else 0
    )
    return Positions(
        of_point, count, mean_x, mean_y, edges, shares, variance, mean_variance, relative,
        float(np.sqrt(noise_variance)), float(np.sqrt(misfit)), reader, grid,
    )  # fmt: skip


def share_their_error(fit: LeastSquares, x: FloatArray, y: FloatArray, reading_sd: float) -> bool:
    """Return whether readings of one x cannot have independent errors: their signals lie too close together.

    Independent errors spread the signals of one x over f' d. Two tests at 1 %: the pooled variance within equal x
    against (f' s_x)^2, chi-square; and the number of neighbours closer than a tenth of even spacing, binomial.
    """
    weights = fit.weights
    values, of_x, many = np.unique(np.round(x, 9), return_inverse=True, return_counts=True)
    dof = x.size - values.size
    if dof == 0:
        return False
    steep = np.abs(fit.slope(values)) * reading_sd
    mean_y = np.bincount(of_x, weights * y) / np.bincount(of_x, weights)
    within = y - mean_y[of_x]
    least = float((many - 1) @ steep**2) / dof
    order = np.lexsort((y, of_x))
    neighbours = np.diff(of_x[order]) == 0
    gaps = np.diff(y[order])[neighbours]
    even = (steep * np.sqrt(12.0) / (many + 1))[of_x[order][1:]][neighbours]
    close = int((gaps < CLOSE * even).sum())
    return bool(
        float(within @ within) < least * stats.chi2.ppf(REFUTED, dof)
        or close > stats.binom.ppf(1 - REFUTED, dof, CLOSE)
    )


def _movement(
    dx: FloatArray, dy: FloatArray, slope: FloatArray, weights: FloatArray, dof: int
) -> tuple[FloatArray, float]:
    """Return the actuator's movement from its mean position at each point, mm, and the noise variance of the signal.

    Signal and reading move together only if the actuator does: a significant regression of reading on signal within
    positions is movement, and all of it within its standard error.
    """
    variance = float(weights @ dy**2) / dof
    steep = np.abs(slope) > 0.05 * np.abs(slope).max(initial=0.0)
    dz = np.where(steep, dy / np.where(steep, slope, 1.0), 0.0)
    together, of_signal, of_reading = float(dz @ dx), float(dz @ dz), float(dx @ dx)
    if together < _SIGNIFICANT * np.sqrt(of_signal * of_reading / dof) or together <= 0.0:
        return np.zeros(dx.size), variance
    share = together / of_signal
    unsure = np.sqrt(max(of_reading - share * together, 0.0) / (of_signal * dof))
    share = 1.0 if share + unsure > 1.0 else share  # all of the signal's scatter may be movement
    return share * dz, max(1.0 - share, 1e-3) * variance


def common_variance(reader_sd: float, grid: float) -> float:
    """Return u_c^2, what all readings of one position share of their rounding error; grid^2 / 12 for a sharp reader."""
    k = np.arange(1, 200)
    return float((grid**2 / (2 * np.pi**2 * k**2) * np.exp(-((2 * np.pi * k * reader_sd / grid) ** 2))).sum())


def _reader_sd(scatter: float, grid: float) -> float:
    """Return s for a variance of the readings within positions."""
    if scatter <= 0.0 or grid <= 0.0:
        return 0.0

    def excess(s: float) -> float:
        return s**2 + grid**2 / 12.0 - common_variance(s, grid) - scatter

    return float(optimize.brentq(excess, 0.0, np.sqrt(scatter) + grid)) if excess(0.0) < 0.0 else 0.0


def _likelihoods(
    x: FloatArray, centre: FloatArray, of_point: IntArray, count: IntArray, grid: float, reader: float, cells: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return edges, shares and variance of L_p of every position: x [n] readings less the movement."""
    edges, shares, variance = np.empty((count.size, cells + 1)), np.empty((count.size, cells)), np.empty(count.size)
    order, ends = np.argsort(of_point, kind="stable"), np.cumsum(count)
    for p, (end, many) in enumerate(zip(ends, count, strict=True)):
        read = x[order[end - many : end]]
        at, density = _likelihood(read, grid, reader)
        mass = np.cumsum(density)
        low, high = at[np.searchsorted(mass, [TAIL, 1.0 - TAIL])]
        step = 0.5 * (at[1] - at[0])
        edges[p] = np.linspace(low - step, high + step, cells + 1)
        below = np.interp(edges[p, 1:-1], at + step, mass)
        shares[p] = np.diff(below, prepend=0.0, append=1.0)
        # a cell at an end has the mean of all that lies beyond its inner edge: a sharp end of L_p stays in its place
        moment = np.cumsum(density * at)
        inner = np.interp(edges[p, [1, -2]], at + step, moment)
        means = np.array([inner[0], moment[-1] - inner[1]]) / shares[p, [0, -1]]
        edges[p, [0, -1]] = 2.0 * means - edges[p, [1, -2]]
        middle = float(density @ at)
        variance[p] = float(density @ (at - middle) ** 2)
    return edges, shares, variance


def _likelihood(read: FloatArray, grid: float, reader: float) -> tuple[FloatArray, FloatArray]:
    """Return L_p on a grid of its own, normalised to a sum of 1."""
    low, high = float(read.min()) - 0.5 * grid - 6.0 * reader, float(read.max()) + 0.5 * grid + 6.0 * reader
    for _ in range(2):  # the second time only where it is not zero
        at = np.linspace(low, high, FINE)
        up, down = ((read + side * grid - at[:, None]) / reader for side in (0.5, -0.5))
        log = np.log(np.maximum(special.ndtr(up) - special.ndtr(down), 1e-300)).sum(axis=1)
        density = np.exp(log - log.max())
        there = np.flatnonzero(density > 1e-9)
        low, high = at[max(there[0] - 1, 0)], at[min(there[-1] + 1, FINE - 1)]
    return at, density / density.sum()
