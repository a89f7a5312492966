"""Makes `references/posterior.json`: a posterior with reading error, by importance sampling.

Run as `python make_posterior_reference.py`; half a minute. Nothing is shared with the sampler:
the draws are quasi-random from Student's t, weighted, the coefficients are those of plain powers of x, and each point's
error, anywhere in the grid's cell, is integrated in twelve parts of the cell. The prior is the program's: flat in the
coefficients, 1 / (sigma + t) with t = reading sd times the rms slope of the least-squares cubic.
"""

from __future__ import annotations

import datetime
import json
import sys
from pathlib import Path

import numpy as np
from numpy.polynomial import polynomial
from scipy import special
from scipy.stats import qmc

from analysis.studies.failure_maps.fit import SENSOR_NOISE_MV
from analysis.studies.tradeoff.posterior import AT_MM, GRID_U_MM, readings

DRAWS, PARTS, DOF, ROUNDS = 2**17, 12, 5.0, 6
CHUNK = 256


def log_density(state: np.ndarray, x: np.ndarray, y: np.ndarray, t: float) -> np.ndarray:
    """Return the log posterior density of states (m, 5): b0..b3 and ln sigma."""
    b, sigma = state[:, :4, None, None], np.exp(state[:, 4, None, None])
    at = x[:, None] + np.sqrt(3.0) * GRID_U_MM * np.linspace(-1.0, 1.0, PARTS + 1)
    curve = ((b[:, 3] * at + b[:, 2]) * at + b[:, 1]) * at + b[:, 0]
    below = special.ndtr((curve - y[:, None]) / sigma)
    one = np.log(np.maximum((np.diff(below) / np.diff(curve)).mean(axis=-1), 1e-300))
    return np.asarray(one.sum(axis=1) - np.log1p(t / sigma[:, 0, 0]))


def weighted_percentiles(values: np.ndarray, weights: np.ndarray, at: tuple[float, ...]) -> np.ndarray:
    """Return the percentiles of each column of values [draws, columns] -> [len(at), columns]."""
    found = np.empty((len(at), values.shape[1]))
    for column, drawn in enumerate(values.T):
        order = np.argsort(drawn)
        below = np.cumsum(weights[order]) - 0.5 * weights[order]
        found[:, column] = np.interp(np.divide(at, 100.0), below, drawn[order])
    return found


def made(draws: int = DRAWS) -> dict[str, object]:
    """Return the table: means of b0..b3, the 95 % band's width along x, and how many draws the weights leave."""
    x, y = readings()
    least = polynomial.polyfit(x, y, 3)
    slope = polynomial.polyval(x, polynomial.polyder(least))
    t = GRID_U_MM * float(np.sqrt(np.mean(slope**2)))
    design = np.vander(x, 4, increasing=True)
    variance = SENSOR_NOISE_MV**2 + (GRID_U_MM * slope) ** 2
    root = np.zeros((5, 5))
    root[:4, :4] = np.linalg.cholesky(np.linalg.inv(design.T @ (design / variance[:, None])))
    root[4, 4] = 0.7
    mean = np.append(least, np.log(SENSOR_NOISE_MV))
    for number in range(ROUNDS + 1):  # each round draws from what the one before found; the last one counts
        last = number == ROUNDS
        uniform = qmc.Sobol(6, seed=number).random(draws if last else 2**12)
        normal = special.ndtri(np.clip(uniform[:, :5], 1e-12, 1 - 1e-12))
        step = normal * np.sqrt(DOF / special.chdtri(DOF, uniform[:, 5]))[:, None]
        state = mean + step @ root.T
        parts = [log_density(state[i : i + CHUNK], x, y, t) for i in range(0, len(state), CHUNK)]
        log_w = np.concatenate(parts) + 0.5 * (DOF + 5) * np.log1p((step**2).sum(axis=1) / DOF)
        w = np.exp(log_w - log_w.max())
        w /= w.sum()
        mean = w @ state
        covariance = (w[:, None] * (state - mean)).T @ (state - mean)
        root = np.linalg.cholesky(covariance)
    low, high = weighted_percentiles(state[:, :4] @ np.vander(AT_MM, 4, increasing=True).T, w, (2.5, 97.5))
    return {
        "method": "importance sampling of a likelihood that is integrated over the cell of each reading",
        "made": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        "draws": draws,
        "effective_draws": round(float(1.0 / (w**2).sum())),
        "mean": mean[:4].tolist(),
        "width_mv": (high - low).tolist(),
    }


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "analysis/studies/tradeoff/references/posterior.json")
    target.write_text(json.dumps(made()) + "\n", encoding="utf-8")
