"""Makes `analysis/tradeoff/references/posterior.json`: a posterior with reading error, by importance sampling.

Run as `python tests/tradeoff/make_posterior_reference.py`; about a minute. Nothing is shared with the sampler: the
reading error is integrated in each point's likelihood (Gauss-Hermite quadrature about its most probable value) instead
of becoming a variance, the draws are quasi-random from Student's t, weighted, and the coefficients are those of plain
powers of x. The prior is the program's: flat in the coefficients, 1 / (sigma + t) with t = reading sd times the rms
slope of the least-squares cubic.
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

from analysis.tradeoff.posterior import NOISE_MV, READING_MM, readings

DRAWS, NODES, DOF, ROUNDS = 2**17, 7, 5.0, 6
CHUNK = 1024


def log_density(state: np.ndarray, x: np.ndarray, y: np.ndarray, t: float) -> np.ndarray:
    """Return the log posterior density of states (m, 5): b0..b3 and ln sigma."""
    b, sigma = state[:, :4, None], np.exp(state[:, 4, None])
    nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)

    def curve(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value = ((b[:, 3] * at + b[:, 2]) * at + b[:, 1]) * at + b[:, 0]
        return value, (3 * b[:, 3] * at + 2 * b[:, 2]) * at + b[:, 1]

    error = np.zeros((len(state), x.size))
    for _ in range(4):  # Gauss-Newton to the most probable reading error of each point
        value, slope = curve(x + error)
        error = READING_MM**2 * slope * (y - value + slope * error) / (sigma**2 + (READING_MM * slope) ** 2)
    slope = curve(x + error)[1]
    width = 1.0 / np.sqrt(READING_MM**-2 + (slope / sigma) ** 2)
    terms = []
    for node, weight in zip(nodes, weights, strict=True):
        at = error + width * node
        away = (y - curve(x + at)[0]) / sigma
        terms.append(np.log(weight) + 0.5 * node**2 - 0.5 * away**2 - 0.5 * (at / READING_MM) ** 2)
    one = special.logsumexp(np.array(terms), axis=0) + np.log(width) - state[:, 4:]
    return np.asarray(one.sum(axis=1) + state[:, 4] - np.log(sigma[:, 0] + t))


def made(draws: int = DRAWS) -> dict[str, object]:
    """Return the table: means and covariance of b0..b3, and how many draws the weights leave."""
    x, y = readings()
    least = polynomial.polyfit(x, y, 3)
    slope = polynomial.polyval(x, polynomial.polyder(least))
    t = READING_MM * float(np.sqrt(np.mean(slope**2)))
    design = np.vander(x, 4, increasing=True)
    variance = NOISE_MV**2 + (READING_MM * slope) ** 2
    root = np.zeros((5, 5))
    root[:4, :4] = np.linalg.cholesky(np.linalg.inv(design.T @ (design / variance[:, None])))
    root[4, 4] = 0.7
    mean = np.append(least, np.log(NOISE_MV))
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
    return {
        "method": "importance sampling of the likelihood that Gauss-Hermite quadrature integrates over the reading",
        "made": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        "draws": draws,
        "effective_draws": round(float(1.0 / (w**2).sum())),
        "mean": mean[:4].tolist(),
        "covariance": covariance[:4, :4].tolist(),
    }


if __name__ == "__main__":
    target = Path(sys.argv[1] if len(sys.argv) > 1 else "analysis/tradeoff/references/posterior.json")
    target.write_text(json.dumps(made()) + "\n", encoding="utf-8")
