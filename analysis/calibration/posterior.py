"""The posterior of a calibration, sampled with emcee.

y_i = f(x_i) + noise, sd sigma sqrt(v_i). If x was read on a grid, each position p is one latent x with the likelihood
L_p of its readings (`analysis.calibration.quantised_x`), integrated out, and the mean of its signals
    y_p = f(x_p) + noise,  variance  tau^2 + sigma_w^2 / n_p,
sigma_w the scatter within positions, tau the further scatter about the curve. Priors: flat in the coefficients, 1 /
(tau + t) for the noise, t = sigma_w / sqrt(n_p), or s_x times the rms slope if no position was read twice. A chain
shorter than 50 autocorrelation times is called not converged. Sources: Foreman-Mackey et al., PASP 125 (2013) 306;
Goodman and Weare, CAMCoS 5 (2010) 65; Carroll et al., Measurement Error in Nonlinear Models (2006), 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import special

from analysis.calibration.fit import Calibration, fit_calibration
from analysis.fidelity import fidelity
from analysis.json_object import json_object
from analysis.progress import Progress
from analysis.statistics import limit_error
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

WALKERS, ENOUGH_SAMPLES = fidelity().walkers, fidelity().posterior_samples
_CHUNK = 200
MAX_STEPS = 10_000
REQUIRED_TAUS = 50.0
PROPOSAL_DOF = 5.0
SIGMA_FLOOR = 1e-6  # of the residual sd: where the noise could be zero its logarithm has no lower end
MONOTONE_POINTS = 41
_BAND_POINTS = 31  # where the error of a band is looked for
KEPT_SAMPLES = 8000
WIDEST_NOISE = 3.0  # sd of the logarithm of the noise at the start: its prior ends at 10
MISREAD, MISREAD_GRIDS = 1e-5, 2.0  # chance that a position is off its cell altogether, and by how many marks (sd)


@dataclass(frozen=True, slots=True, repr=False)
class Posterior:
    """Draws from the posterior, and the figures of the sampler."""

    calibration: Calibration
    basis_samples: FloatArray  # [draws, degree + 1] coefficients in the scaled basis
    sigma_samples: FloatArray  # [draws] noise sd
    mean: FloatArray  # [degree + 1] of the monomial coefficients
    sd: FloatArray
    sigma: float
    reading_sd: float
    tau: float  # longest integrated autocorrelation time of all parameters, steps
    n_eff: float
    acceptance: float
    steps: int
    converged: bool  # steps >= 50 tau and an acceptance between 0.1 and 0.9
    walkers: int = 1

    def __repr__(self) -> str:
        terms = ", ".join(
            f"b{i} = {b:.6g} ± {2 * u:.2g}" for i, (b, u) in enumerate(zip(self.mean, self.sd, strict=True))
        )
        state = "converged" if self.converged else "NOT converged"
        return f"<Posterior: {terms} (k = 2), sigma {self.sigma:.3g}, {self.n_eff:.0f} effective draws, {state}>"

    def chains(self) -> dict[str, FloatArray]:
        """Return the kept draws by parameter, [chain, draw], as `arviz.summary` takes them."""
        change = np.asarray(self.calibration.fit.basis.to_monomials(), dtype=np.float64)
        columns = dict(zip((f"b{i}" for i in range(self.mean.size)), (self.basis_samples @ change.T).T, strict=True))
        columns["sigma"] = self.sigma_samples
        return {name: np.ascontiguousarray(values.reshape(-1, self.walkers).T) for name, values in columns.items()}

    def curves(self, x: npt.ArrayLike) -> FloatArray:
        return self.basis_samples @ self.calibration.fit.basis.design(np.atleast_1d(np.asarray(x, dtype=float))).T

    def curve_band(self, x: npt.ArrayLike, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the equal-tailed credible band of the curve."""
        return _equal_tails(self.curves(x), level)

    def new_reading_band(self, x: npt.ArrayLike, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper limit of the predictive band of one new signal at known x, [points]."""
        noise = np.random.default_rng(0).standard_normal((self.sigma_samples.size, 1))
        return _equal_tails(self.curves(x) + self.sigma_samples[:, None] * noise, level)

    def band_error(self) -> float:
        """Return the Monte-Carlo error (k = 2) of the worst limit of the curve's 95 % band, in the unit of y."""
        return limit_error(self.curves(np.linspace(*self.calibration.x_range, _BAND_POINTS)))

    def as_json(self) -> dict[str, Any]:
        """Return the posterior as `analyze --json` reports it."""
        return {
            "coefficients": json_object(self, "mean", "sd"),
            **json_object(self, "sigma_mv=sigma", "reading_sd_mm=reading_sd", "tau", "n_eff", "acceptance", "steps"),
            "converged": self.converged,
            "notes": [warning.text for warning in self.warnings if warning.code is WarningCode.UNCHECKED_CURVE],
            **json_object(self, "warnings"),
        }

    @property
    def warnings(self) -> tuple[Warning, ...]:
        """What the band alone does not show."""
        positions, calibration = self.calibration.reading, self.calibration
        found = []
        if positions is not None and positions.n <= calibration.degree + 1:
            text = (
                f"{calibration.n} readings of {positions.n} positions leave no position to check the curve by: the "
                "band contains the reading error alone"
            )
            found.append(Warning(WarningCode.UNCHECKED_CURVE, "", text))
        if not self.converged:
            text = f"the posterior is not converged: {self.steps} steps, autocorrelation time {self.tau:.0f}"
            found.append(Warning(WarningCode.NOT_CONVERGED, "", text))
        return tuple(found)


def _equal_tails(draws: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    low, high = np.percentile(draws, [50 - 50 * level, 50 + 50 * level], axis=0)
    return low, high


def sample_posterior(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    degree: int = 3,
    *,
    reading_sd: float = 0.0,
    positions: npt.ArrayLike | None = None,
    standard_uncertainty: npt.ArrayLike | None = None,
    monotone: bool = False,
    seed: int = 0,
    walkers: int = WALKERS,
    max_steps: int = MAX_STEPS,
    samples: int = ENOUGH_SAMPLES,
    start_sd: float = 1.0,
    progress: Progress | None = None,
) -> Posterior:
    """Sample the posterior of a polynomial calibration. DataError: as `fit_calibration`, n <= degree + 1, no residuals.

    Parameters
    ----------
    reading_sd : sd of the reading error in x: the grid / sqrt(12) for a reading to the nearest mark.
    positions : [n] labels; readings of one position share their rounding error. None: each its own, unless the signals
        refute it (`analysis.calibration.quantised_x`).
    standard_uncertainty : [n] u of y if the noise is unequal; only the ratios matter, their scale is sampled.
    monotone : leave out curves that turn inside the range.
    samples : sufficient effective number; more than `KEPT_SAMPLES` are all kept.
    start_sd : radius of the starting ball, standard errors.
    """
    import emcee

    with np.errstate(divide="ignore"):
        weights = (
            None if standard_uncertainty is None else 1.0 / np.asarray(standard_uncertainty, dtype=np.float64) ** 2
        )
    calibration = fit_calibration(x, y, degree, weights=weights)
    if reading_sd > 0:
        calibration = calibration.with_reading(reading_sd, positions)
    target = _Target.of(calibration, reading_sd, monotone)
    rng = np.random.default_rng(seed)
    start = target.start(rng, walkers, start_sd)
    moves = [(_student_move(), 0.8), (emcee.moves.DEMove(), 0.2)]
    sampler = emcee.EnsembleSampler(walkers, start.shape[1], target.log_probability, vectorize=True, moves=moves)
    state = emcee.State(start, random_state=np.random.RandomState(seed % 2**32).get_state())
    steps, burn, tau = 0, 0, float("inf")
    while steps < max_steps:
        count = min(_CHUNK, max_steps - steps)
        state = sampler.run_mcmc(state, count, skip_initial_state_check=True)
        steps += count
        burn = steps // 5
        with np.errstate(invalid="ignore"):  # a walker that has not moved yet has no autocorrelation
            tau = float(np.max(sampler.get_autocorr_time(discard=burn, tol=0)))
        tau = tau if np.isfinite(tau) else float("inf")
        needed = 1.25 * tau * max(1.2 * REQUIRED_TAUS, samples / walkers)  # of which a fifth is burn-in
        if progress is not None:
            progress(steps, min(max(needed, steps), max_steps))
        if steps >= needed:
            break
    return _summary(target, sampler, burn, tau, max(KEPT_SAMPLES, samples))


def sample_calibration(
    calibration: Calibration, positions: npt.ArrayLike | None, branch: npt.ArrayLike | None, **options: Any
) -> Posterior:
    """Sample the posterior of a calibration by branch about its loop, as the joint fit does; see `sample_posterior`."""
    joint, x = calibration.joint, calibration.x
    loop = 0.0 if joint is None else 0.5 * np.asarray(branch, dtype=np.float64) * joint.loop_width(x)
    return sample_posterior(x, calibration.y - loop, calibration.degree, positions=positions, **options)


def _student_move() -> Any:
    """Return a move of the ensemble by Student's t; emcee, with h5py behind it, is imported when it samples."""
    import emcee

    class StudentMove(emcee.moves.RedBlueMove):  # type: ignore[misc]  # emcee comes without types
        """Propose from Student's t with the mean and covariance of the other half of the ensemble, whatever the place.

        In whitened coordinates the posterior is nearly normal, so most such steps are taken: a fifth of the
        autocorrelation time of the stretch move.
        """

        def get_proposal(
            self, sample: FloatArray, complement: list[FloatArray], rng: Any
        ) -> tuple[FloatArray, FloatArray]:
            """Return the new places [walkers, dim] and the log ratio of proposing back to proposing [walkers]."""
            others = np.concatenate(complement)
            size = others.shape[1]
            root = np.linalg.cholesky(np.cov(others.T) + 1e-12 * np.eye(size))
            stretch = np.sqrt(PROPOSAL_DOF / rng.chisquare(PROPOSAL_DOF, sample.shape[0]))
            step = rng.standard_normal(sample.shape) * stretch[:, None]
            back = np.linalg.solve(root, (sample - others.mean(axis=0)).T).T
            new, old = (np.log1p((z**2).sum(axis=1) / PROPOSAL_DOF) for z in (step, back))
            return others.mean(axis=0) + step @ root.T, 0.5 * (PROPOSAL_DOF + size) * (new - old)

    return StudentMove()


@dataclass(frozen=True, slots=True)
class _Target:
    """The log-probability in whitened z: basis coefficients = best + root z[:-1], tau = residual sd * exp(z[-1]).

    `root` is that of the least-squares covariance with the reading of x. `design` [points, degree + 1] is at the
    points, or [positions * edges, degree + 1] at the ends of the positions' cells.
    """

    calibration: Calibration
    root: FloatArray
    design: FloatArray
    y: FloatArray
    relative_variance: FloatArray
    known_variance: FloatArray
    reading_sd: float
    prior_sd: float
    monotone_slopes: FloatArray | None
    centres: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, calibration: Calibration, reading_sd: float, monotone: bool) -> _Target:
        if calibration.dof < 1:
            raise DataError(
                f"{calibration.n} points leave no degree of freedom for the noise of a degree-{calibration.degree} fit",
                "Measure more points.",
            )
        if not calibration.residual_sd > 0 or calibration.residual_sd < 1e-12 * np.abs(calibration.y).max():
            raise DataError("the points lie on the curve exactly: there is no noise to sample", "Skip the sampling.")
        basis, positions = calibration.fit.basis, calibration.reading
        grid = np.linspace(*calibration.x_range, MONOTONE_POINTS)
        constraint = basis.slope_design(grid) * (1.0 if calibration.rises else -1.0) if monotone else None
        if positions is None:
            none = np.empty(0)
            return cls(
                calibration, calibration.residual_sd * calibration.fit.basis_factor,
                basis.design(calibration.x), calibration.y, 1.0 / calibration.fit.weights,
                np.zeros(calibration.n), 0.0, 0.0, constraint, none, none,
            )  # fmt: skip
        by_reading = reading_sd * np.sqrt(np.mean(calibration.slope(positions.x) ** 2))
        by_scatter = np.sqrt(np.mean(positions.mean_variance))
        return cls(
            calibration, np.asarray(np.linalg.cholesky(calibration.basis_covariance), dtype=np.float64),
            basis.design(positions.edges.ravel()), positions.y, positions.relative_variance,
            positions.mean_variance, reading_sd, float(by_scatter or by_reading) / calibration.residual_sd, constraint,
            basis.design(positions.x), basis.slope_design(positions.x),
        )  # fmt: skip

    def coefficients(self, z: FloatArray) -> FloatArray:
        fit = self.calibration.fit
        return fit.basis_coefficients + z[..., :-1] @ self.root.T

    def sigma(self, z: FloatArray) -> FloatArray:
        """Return the sd of one new signal about the curve: tau, and the scatter within positions."""
        within = self.calibration.reading.noise_sd if self.calibration.reading is not None else 0.0
        return np.asarray(np.hypot(within, self.calibration.residual_sd * np.exp(z[..., -1])), dtype=np.float64)

    def log_probability(self, z: FloatArray) -> FloatArray:
        """Return the log posterior density of every walker, z [walkers, degree + 2] -> [walkers]."""
        beta = self.coefficients(z)
        variance = np.exp(2.0 * z[:, -1])[:, None] * self.calibration.residual_sd**2 * self.relative_variance
        variance = variance + self.known_variance
        if self.reading_sd > 0:
            log_p = self._of_positions(beta, variance)
        else:
            log_p = -0.5 * ((self.y - beta @ self.design.T) ** 2 / variance + np.log(variance)).sum(axis=1)
        if self.prior_sd > 0:  # the prior 1 / (tau + t) in ln tau; without reading error it is constant
            log_p = log_p - np.log1p(self.prior_sd * np.exp(-z[:, -1]))
        allowed = (z[:, -1] > np.log(SIGMA_FLOOR)) & (z[:, -1] < 10.0)
        if self.monotone_slopes is not None:
            allowed &= (beta @ self.monotone_slopes.T > 0).all(axis=1)
        return np.where(allowed, log_p, -np.inf)

    def _of_positions(self, beta: FloatArray, variance: FloatArray) -> FloatArray:
        """Return ln of the product over positions of the integral of N(y_p; f(x), variance) L_p(x) dx, [walkers]."""
        positions = self.calibration.reading
        assert positions is not None
        curve = (beta @ self.design.T).reshape(beta.shape[0], *positions.edges.shape)
        sd = np.sqrt(variance)
        away = (curve - self.y[:, None]) / sd[..., None]
        widths = np.diff(away)
        flat = np.abs(widths) < 1e-5  # a chord so flat has the normal density itself
        middle = 0.5 * (away[..., 1:] + away[..., :-1])
        inside = np.diff(special.ndtr(away)) / np.where(flat, 1.0, widths)
        if flat.any():
            inside[flat] = np.exp(-0.5 * middle[flat] ** 2) / np.sqrt(2.0 * np.pi)
        within = (inside * positions.shares).sum(axis=-1) / sd
        wide = variance + (MISREAD_GRIDS * positions.grid * (beta @ self.slopes.T)) ** 2
        misread = np.exp(-0.5 * (self.y - beta @ self.centres.T) ** 2 / wide) / np.sqrt(2.0 * np.pi * wide)
        total = (1.0 - MISREAD) * within + MISREAD * misread
        return np.asarray(np.log(np.maximum(total, 1e-300)).sum(axis=1), dtype=np.float64)

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
        cause = "hardly any curve that the data allow is monotone over the range"
        raise DataError(cause, "Fit without the constraint, or over a shorter range.")


def _summary(target: _Target, sampler: Any, burn: int, tau: float, most: int) -> Posterior:
    chain = sampler.get_chain(discard=burn)
    steps = chain.shape[0]
    flat = chain.reshape(-1, chain.shape[-1])
    beta, sigma = target.coefficients(flat), target.sigma(flat)
    change = np.asarray(target.calibration.fit.basis.to_monomials(), dtype=float)
    monomials = beta @ change.T
    thin = max(1, flat.shape[0] // most)
    kept = np.arange(flat.shape[0]).reshape(steps, -1)[::thin].ravel()  # steps, not walkers: neighbours are alike
    acceptance = float(np.mean(sampler.acceptance_fraction))
    return Posterior(
        target.calibration, beta[kept], sigma[kept], monomials.mean(axis=0), monomials.std(axis=0, ddof=1),
        float(sigma.mean()), target.reading_sd, tau, flat.shape[0] / tau, acceptance, steps,
        bool(steps >= REQUIRED_TAUS * tau and 0.1 < acceptance < 0.9), chain.shape[1],
    )  # fmt: skip
