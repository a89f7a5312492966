"""The posterior of a calibration, sampled with emcee.

Model: y_i = f(x_i + e_i) + noise. What was read on a grid is the centre of a cell and the truth scatters about it
(Berkson error), so e_i is independent of the reading, with sd s_x. To second order
    mean      f(x_i) + f''(x_i) s_x^2 / 2
    variance  sigma^2 v_i + f'(x_i)^2 s_x^2 + f''(x_i)^2 s_x^4 / 2
with f a polynomial, v_i relative variances where the noise is unequal. Priors: flat in the coefficients (optionally
zero where the curve is not monotone over its range), 1 / (sigma + t) for the noise, t = s_x times the rms slope of the
least-squares curve: without reading error that is the usual 1/sigma, and where the reading error explains the scatter
by itself it is flat, so that the posterior stays proper (with 1/sigma all of its mass would fall to sigma = 0).
Without reading error and constraint the coefficients then have Student's t distribution with n - degree - 1 degrees of
freedom: the closed form the tests compare with.

Rules: the sampler walks in coordinates whitened by the least-squares fit, started in a ball of one standard error; the
log-probability takes all walkers at once; a chain shorter than 50 autocorrelation times is called not converged.
Sources: Foreman-Mackey et al., PASP 125 (2013) 306; Goodman and Weare, CAMCoS 5 (2010) 65; Carroll et al., Measurement
Error in Nonlinear Models (2006), 4.6; ISO/TS 28038:2018.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import emcee
import numpy as np
import numpy.typing as npt

from analysis.calibration import Calibration, fit_calibration
from analysis.errors import DataError
from analysis.polynomial import FloatArray

Progress = Callable[[float, float], None]

WALKERS = 128
CHUNK = 250
MAX_STEPS = 10_000
REQUIRED_TAUS = 50.0
ENOUGH_SAMPLES = 12_000  # effective: a standard deviation is then known to 0.7 %
PROPOSAL_DOF = 5.0
SIGMA_FLOOR = 1e-6  # of the residual sd: where the noise could be zero its logarithm has no lower end
MONOTONE_POINTS = 41
KEPT_SAMPLES = 8000
WIDEST_NOISE = 3.0  # sd of the logarithm of the noise at the start: its prior ends at 10
TOO_NARROW = 1.5  # times: a band that may be so much too narrow is told


@dataclass(frozen=True, slots=True)
class Posterior:
    """Draws from the posterior.

    Attributes
    ----------
    calibration : the least-squares fit it started from.
    basis_samples : [draws, degree + 1] coefficients in the scaled basis.
    sigma_samples : [draws] noise sd.
    mean, sd : [degree + 1] of the monomial coefficients.
    sigma : posterior mean of the noise sd.
    reading_sd : s_x that was assumed.
    tau : integrated autocorrelation time, steps, the longest of all parameters.
    n_eff : draws / tau.
    acceptance : mean acceptance fraction.
    steps : steps kept after the burn-in.
    converged : steps >= 50 tau and an acceptance between 0.1 and 0.9.
    """

    calibration: Calibration
    basis_samples: FloatArray
    sigma_samples: FloatArray
    mean: FloatArray
    sd: FloatArray
    sigma: float
    reading_sd: float
    tau: float
    n_eff: float
    acceptance: float
    steps: int
    converged: bool

    def curves(self, x: npt.ArrayLike) -> FloatArray:
        """Return y(x) of every draw, [draws, x]."""
        return self.basis_samples @ self.calibration.fit.basis.design(np.atleast_1d(np.asarray(x, dtype=float))).T

    def curve_band(self, x: npt.ArrayLike, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the equal-tailed credible band of the curve."""
        low, high = np.percentile(self.curves(x), [50 - 50 * level, 50 + 50 * level], axis=0)
        return low, high

    def new_reading_band(
        self, x: npt.ArrayLike, level: float = 0.95, *, seed: int = 0
    ) -> tuple[FloatArray, FloatArray]:
        """Return the predictive band of one new signal at a known x."""
        noise = np.random.default_rng(seed).standard_normal((self.sigma_samples.size, 1))
        readings = self.curves(x) + self.sigma_samples[:, None] * noise
        low, high = np.percentile(readings, [50 - 50 * level, 50 + 50 * level], axis=0)
        return low, high

    def inverse_band(self, y: npt.ArrayLike, level: float = 0.95, *, seed: int = 0) -> tuple[FloatArray, FloatArray]:
        """Return the band of x for one new signal y; NaN where more than half of the draws find no x in the range.

        Each draw's curve is inverted for y less a draw of its noise, by interpolation on its monotone range.
        """
        low_x, high_x = self.calibration.x_range
        margin = 0.05 * (high_x - low_x)
        grid = np.linspace(low_x - margin, high_x + margin, 400)
        curves = self.curves(grid) * (1.0 if self.calibration.rises else -1.0)
        signals = np.atleast_1d(np.asarray(y, dtype=float)) * (1.0 if self.calibration.rises else -1.0)
        noise = np.random.default_rng(seed).standard_normal(self.sigma_samples.size) * self.sigma_samples
        found = np.empty((curves.shape[0], signals.size))
        for draw, curve in enumerate(curves):
            rising = np.maximum.accumulate(curve)
            found[draw] = np.interp(signals - noise[draw], rising, grid, left=np.nan, right=np.nan)
        inside = np.isfinite(found).mean(axis=0) > 0.5
        band = np.full((2, signals.size), np.nan)
        band[:, inside] = np.nanpercentile(found[:, inside], [50 - 50 * level, 50 + 50 * level], axis=0)
        return band[0], band[1]

    def as_json(self) -> dict[str, Any]:
        """Return the posterior as `analyze --json` reports it."""
        return {
            "coefficients": {"mean": self.mean.tolist(), "sd": self.sd.tolist()},
            "sigma_mv": self.sigma,
            "reading_sd_mm": self.reading_sd,
            "tau": self.tau,
            "n_eff": self.n_eff,
            "acceptance": self.acceptance,
            "steps": self.steps,
            "converged": self.converged,
            "notes": self.reservations,
        }

    @property
    def reservations(self) -> tuple[str, ...]:
        """What a reader of the band alone would not see, one sentence each; none where all is well.

        Equal readings are taken for independent ones. Where one position reads alike in every cycle they share one
        error, and n readings of m positions tell no more than m.
        """
        calibration = self.calibration
        positions = np.unique(np.round(calibration.x, 6)).size
        by_reading = float(np.mean(calibration.slope(calibration.x) ** 2)) * self.reading_sd**2
        alone = self.sigma**2 + by_reading
        narrow = np.sqrt((self.sigma**2 + by_reading * calibration.n / positions) / alone) if alone > 0 else 1.0
        if narrow < TOO_NARROW:
            return ()
        return (
            f"{calibration.n} readings of {positions} positions are taken for independent: if a position reads alike "
            f"in every cycle, the band is up to {narrow:.1f} times too narrow",
        )


def sample_posterior(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    degree: int = 3,
    *,
    reading_sd: float = 0.0,
    standard_uncertainty: npt.ArrayLike | None = None,
    monotone: bool = False,
    seed: int = 0,
    walkers: int = WALKERS,
    max_steps: int = MAX_STEPS,
    start_sd: float = 1.0,
    progress: Progress | None = None,
) -> Posterior:
    """Sample the posterior of a polynomial calibration.

    Parameters
    ----------
    x, y : [n].
    degree : 0 to 10.
    reading_sd : sd of the reading error in x, the grid's resolution / sqrt(12) for a reading to the nearest mark.
    standard_uncertainty : [n] of y where the noise is unequal; only the ratios matter, their scale is sampled.
    monotone : leave out curves that turn inside the range.
    seed : same seed, same draws.
    walkers, max_steps : of the ensemble; it stops before where it has converged.
    start_sd : size of the ball that it starts in, standard errors.
    progress : called as progress(done, total); raising from it cancels.

    Raises
    ------
    DataError : as `fit_calibration`; and where n <= degree + 1, since the noise is then unknown, or where the
        residuals are zero.
    """
    calibration = fit_calibration(x, y, degree, standard_uncertainty=standard_uncertainty)
    target = _Target.of(calibration, reading_sd, standard_uncertainty, monotone)
    rng = np.random.default_rng(seed)
    start = target.start(rng, walkers, start_sd)
    moves = [(_StudentMove(), 0.8), (emcee.moves.DEMove(), 0.2)]
    sampler = emcee.EnsembleSampler(walkers, start.shape[1], target.log_probability, vectorize=True, moves=moves)
    state = emcee.State(start, random_state=np.random.RandomState(seed % 2**32).get_state())
    steps, burn, tau = 0, 0, float("inf")
    while steps < max_steps:
        count = min(CHUNK, max_steps - steps)
        state = sampler.run_mcmc(state, count, skip_initial_state_check=True)
        steps += count
        if progress is not None:
            progress(steps, max_steps)
        burn = steps // 5
        tau = float(np.max(sampler.get_autocorr_time(discard=burn, tol=0)))
        if steps - burn >= 1.2 * REQUIRED_TAUS * tau and (steps - burn) * walkers / tau >= ENOUGH_SAMPLES:
            break
    return _summary(target, sampler, burn, tau)


class _StudentMove(emcee.moves.RedBlueMove):  # type: ignore[misc]  # emcee comes without types
    """Proposes from Student's t with the mean and covariance of the other half of the ensemble, whatever the place.

    In whitened coordinates the posterior is nearly normal, so most such steps are taken and neighbours in the chain
    are hardly related: a fifth of the autocorrelation time of the stretch move.
    """

    def get_proposal(self, sample: FloatArray, complement: list[FloatArray], rng: Any) -> tuple[FloatArray, FloatArray]:
        """Return the new places [walkers, dim] and the log ratio of proposing back to proposing [walkers]."""
        others = np.concatenate(complement)
        size = others.shape[1]
        root = np.linalg.cholesky(np.cov(others.T) + 1e-12 * np.eye(size))
        stretch = np.sqrt(PROPOSAL_DOF / rng.chisquare(PROPOSAL_DOF, sample.shape[0]))
        step = rng.standard_normal(sample.shape) * stretch[:, None]
        back = np.linalg.solve(root, (sample - others.mean(axis=0)).T).T
        new, old = (np.log1p((z**2).sum(axis=1) / PROPOSAL_DOF) for z in (step, back))
        return others.mean(axis=0) + step @ root.T, 0.5 * (PROPOSAL_DOF + size) * (new - old)


@dataclass(frozen=True, slots=True)
class _Target:
    """The log-probability in whitened z: basis coefficients = best + sd * R^-1 z[:-1], sigma = sd * exp(z[-1])."""

    calibration: Calibration
    design: FloatArray
    slopes: FloatArray
    curvatures: FloatArray
    relative_variance: FloatArray
    reading_sd: float
    reading_noise: float
    monotone_slopes: FloatArray | None

    @classmethod
    def of(
        cls, calibration: Calibration, reading_sd: float, uncertainty: npt.ArrayLike | None, monotone: bool
    ) -> _Target:
        if calibration.dof < 1:
            raise DataError(
                f"{calibration.n} points leave no degree of freedom for the noise of a degree-{calibration.degree} fit",
                "Measure more points.",
            )
        if not calibration.residual_sd > 0 or calibration.residual_sd < 1e-12 * np.abs(calibration.y).max():
            raise DataError("the points lie on the curve exactly: there is no noise to sample", "Skip the sampling.")
        basis = calibration.fit.basis
        relative = np.ones(calibration.n)
        if uncertainty is not None:
            u = np.asarray(uncertainty, dtype=float).ravel()
            relative = (u / u.min()) ** 2
        step = 1e-3 * basis.half_width
        # the second derivative of a polynomial basis, from its exact slopes: central differences of a smooth slope
        curvature = (basis.slope_design(calibration.x + step) - basis.slope_design(calibration.x - step)) / (2 * step)
        grid = np.linspace(*calibration.x_range, MONOTONE_POINTS)
        constraint = basis.slope_design(grid) * (1.0 if calibration.rises else -1.0) if monotone else None
        slopes = basis.slope_design(calibration.x)
        by_reading = reading_sd * np.sqrt(np.mean((slopes @ calibration.fit.basis_coefficients) ** 2 / relative))
        return cls(
            calibration, basis.design(calibration.x), slopes, curvature, relative, float(reading_sd),
            float(by_reading) / calibration.residual_sd, constraint,
        )  # fmt: skip

    def coefficients(self, z: FloatArray) -> FloatArray:
        fit = self.calibration.fit
        return fit.basis_coefficients + self.calibration.residual_sd * z[..., :-1] @ fit.basis_factor.T

    def sigma(self, z: FloatArray) -> FloatArray:
        return np.asarray(self.calibration.residual_sd * np.exp(z[..., -1]), dtype=np.float64)

    def log_probability(self, z: FloatArray) -> FloatArray:
        """Return the log posterior density of every walker, z [walkers, degree + 2] -> [walkers]."""
        beta = self.coefficients(z)
        variance = np.exp(2.0 * z[:, -1])[:, None] * self.calibration.residual_sd**2 * self.relative_variance
        mean = beta @ self.design.T
        if self.reading_sd > 0:
            square = self.reading_sd**2
            bend = beta @ self.curvatures.T
            mean = mean + 0.5 * square * bend
            variance = variance + (beta @ self.slopes.T) ** 2 * square + 0.5 * (bend * square) ** 2
        log_p = -0.5 * (((self.calibration.y - mean) ** 2) / variance + np.log(variance)).sum(axis=1)
        if self.reading_noise > 0:  # the prior 1 / (sigma + t) in ln sigma; without reading error it is constant
            log_p = log_p - np.log1p(self.reading_noise * np.exp(-z[:, -1]))
        allowed = (z[:, -1] > np.log(SIGMA_FLOOR)) & (z[:, -1] < 10.0)
        if self.monotone_slopes is not None:
            allowed &= (beta @ self.monotone_slopes.T > 0).all(axis=1)
        return np.where(allowed, log_p, -np.inf)

    def start(self, rng: np.random.Generator, walkers: int = WALKERS, start_sd: float = 1.0) -> FloatArray:
        """Walkers in a ball of `start_sd` standard errors, drawn again where the constraint does not hold."""
        size = self.calibration.degree + 2
        spread = np.full(size, start_sd)
        spread[-1] = min(start_sd / np.sqrt(2.0 * self.calibration.dof), WIDEST_NOISE)
        start: FloatArray = rng.standard_normal((walkers, size)) * spread
        for _ in range(200):
            bad = ~np.isfinite(self.log_probability(start))
            if not bad.any():
                return start
            start[bad] = rng.standard_normal((int(bad.sum()), size)) * spread
        raise DataError(
            "hardly any curve that the data allow is monotone over the range",
            "Fit without the constraint, or over a shorter range.",
        )


def _summary(target: _Target, sampler: Any, burn: int, tau: float) -> Posterior:
    chain = sampler.get_chain(discard=burn)
    steps = chain.shape[0]
    flat = chain.reshape(-1, chain.shape[-1])
    beta, sigma = target.coefficients(flat), target.sigma(flat)
    change = np.asarray(target.calibration.fit.basis.to_monomials(), dtype=float)
    monomials = beta @ change.T
    thin = max(1, flat.shape[0] // KEPT_SAMPLES)
    acceptance = float(np.mean(sampler.acceptance_fraction))
    return Posterior(
        target.calibration, beta[::thin], sigma[::thin], monomials.mean(axis=0), monomials.std(axis=0, ddof=1),
        float(sigma.mean()), target.reading_sd, tau, flat.shape[0] / tau, acceptance, steps,
        bool(steps >= REQUIRED_TAUS * tau and 0.1 < acceptance < 0.9),
    )  # fmt: skip
