"""What resampling and sampling leave uncertain in the figures of a run, and as many draws as a tolerance allows.

Strategy: intervals rest on resamples of the cycles, the posterior's band on its samples. Each figure has its limits as
other draws would give them (`Figure.by_draws`), the band likewise by its samples in batches. The error of a run is that
of the worst of all its limits, which err together. Few draws measure it; it falls as one over their root, which gives
the draws that a tolerance takes; the answer states its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from analysis.arrays import FloatArray
from analysis.calibration.draws import OTHERS, distances_in_tail, greatest_error, probabilities_by_chance
from analysis.calibration.fit import Calibration
from analysis.calibration.posterior import Posterior
from analysis.data.load import load_recording
from analysis.data.recording import Recording
from analysis.errors import RequestError
from analysis.fidelity import fidelity
from analysis.figures.pipeline import Analysis, analyse, redrawn
from analysis.figures.sensor_analysis import MOST_RESAMPLES, AnalysedRun, Options
from analysis.numbers import rounded_up
from analysis.progress import Progress

Unit = Literal["mm", "%FSO"]
BATCHES, FINE_BATCHES, LEVEL = 16, 32, 0.95
FREEDOM = 5.9
"""Degrees of freedom of the autocorrelation time by each independent limit: 2 over the variance of 2 v16 - v32."""
WIDER = 2.0
"""Times the tail of a limit: the samples from which its scale is found, where Student's t is nearly normal."""
FEWEST = 400
"""Resamples: ten beyond each limit."""
FEWEST_SAMPLES = 500
ENOUGH_TO_BELIEVE = 800
"""Draws whose error shows that all are needed."""
MOST_SAMPLES = 50_000
SPARE, LEAST_GROWTH, MOST_GROWTH = 1.1, 1.2, 4
"""Part by which draws are chosen for less than the tolerance, and the factor by which they grow from try to try."""
LEAST_SLOPE = 0.1
"""Of the steepest: near a turn of the curve an error in mm means nothing."""
POINTS = 31


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of a run's figures by its finite draws, at k = 2; NaN where there is nothing that has one.

    Parameters
    ----------
    intervals_percent_fso : of the worst limit of the intervals in % FSO.
    band_percent_fso, band_mm : of the worst limit of the posterior's band, mm by the slope of the curve.
    samples : effective, of the posterior that has fewest; 0 without one.
    """

    intervals_percent_fso: float
    band_percent_fso: float
    band_mm: float
    resamples: int
    samples: int
    percent_fso: float

    def error(self, unit: Unit) -> float:
        """Return the greatest error in a unit; NaN where nothing has one."""
        return self.band_mm if unit == "mm" else self.percent_fso

    def as_json(self) -> dict[str, Any]:
        """Return it as a dictionary."""
        return asdict(self)


def accuracy_of(analysis: AnalysedRun) -> Accuracy:
    """Return the errors that the draws of an analysis leave."""
    options, level = analysis.options, fidelity(analysis.options.fidelity)
    resamples = options.resamples or level.resamples
    limits = [
        figure.limits_away
        for sensor in analysis.sensors
        for figure in sensor.figures.values()
        if figure.unit == "% FSO" and figure.limits_away is not None
    ]
    posteriors = [sensor.posterior for sensor in analysis.sensors if sensor.posterior is not None]
    intervals, percent = np.concatenate([np.empty((0, OTHERS)), *limits]), band_errors(posteriors, "%FSO")
    samples = int(min((each.n_eff for each in posteriors), default=0))
    return Accuracy(
        _error(intervals), _error(percent), greatest_band_error(posteriors, "mm"), resamples, samples,
        _error(np.concatenate([intervals, percent])),
    )  # fmt: skip


def _error(away: FloatArray) -> float:
    """Return the error of the worst of the limits, [limits, OTHERS]; NaN without one."""
    return greatest_error(away) if len(away) else math.nan


def band_noise(posterior: Posterior, x: FloatArray, seed: int = 0) -> FloatArray:
    """Return errors that the limits of a 95 % band may have by its draws.

    Parameters
    ----------
    posterior, x : the band, at x (n,). seed : of the errors, (OTHERS, 2, n), in the unit of y.

    Notes
    -----
    The limits of other chains lie at probabilities that have beta distributions, those of independent draws of the
    effective sample size. They are drawn together, with the correlation of the shares below them, from Student's t, as
    that size is estimated from few batches. The quantiles there, of a normal tail with the scale of the draws in it,
    are limits as another chain would give them, all of one band: distances between single draws would add noise of
    their own at each place.
    """
    curves, rng, tail = posterior.curves(x), np.random.default_rng(seed), 0.5 - 0.5 * LEVEL
    curves = curves[: len(curves) // FINE_BATCHES * FINE_BATCHES]
    count, ordered = len(curves), np.sort(curves, axis=0)
    limits = [ordered[round(share * (count - 1))] for share in (tail, 1.0 - tail)]
    below = np.concatenate([curves <= limit for limit in limits], axis=1).astype(np.float64)
    size, together = _effective_size(below), np.corrcoef(below.T)
    freedom = FREEDOM * below.shape[1] ** 2 / float(np.sum(together**2))
    normal = rng.multivariate_normal(np.zeros(below.shape[1]), together, OTHERS, method="eigh")
    student = normal / np.sqrt(rng.chisquare(freedom, (OTHERS, 1)) / freedom)
    lower, upper = np.moveaxis(student.reshape(OTHERS, 2, -1), 1, 0)
    wide = WIDER * tail
    most = max(round(wide * count), 2)
    return np.stack([
        distances_in_tail(ordered[:most], tail, wide, probabilities_by_chance(size, tail, lower)),
        -distances_in_tail(-ordered[: -most - 1 : -1], tail, wide, probabilities_by_chance(size, tail, -upper)),
    ], axis=1)  # fmt: skip


def _effective_size(below: FloatArray) -> int:
    """Return the effective sample size of the shares below the limits.

    Parameters
    ----------
    below : whether a draw is below a limit, 1 or 0, [draws in order, limits].

    Notes
    -----
    One size of all limits, from the variance of their means over batches (Flegal and Jones, Ann. Statist. 38, 2010,
    1034). Batches of few autocorrelation times vary too little: batches of half their length give the correction (Vats
    and Flegal, Biometrika 109, 2022, 735).
    """

    def variance_of_means(batches: int) -> float:
        means = below.reshape(batches, -1, below.shape[1]).mean(axis=1)
        return float(np.mean(means.var(axis=0, ddof=1))) / batches

    coarse, fine = variance_of_means(BATCHES), variance_of_means(FINE_BATCHES)
    return max(round(float(np.mean(below.var(axis=0))) / max(2.0 * coarse - fine, coarse)), 1)


def in_mm(calibration: Calibration, x: FloatArray, signal: FloatArray) -> FloatArray:
    """Return differences of the signal (..., n) at x (n,) as those of x, by the slope of the curve there."""
    slopes = np.abs(calibration.slope(x))
    return np.asarray(signal / np.maximum(slopes, LEAST_SLOPE * slopes.max()))


def greatest_band_error(posteriors: Sequence[Posterior], unit: Literal["mm", "%FSO", "y"]) -> float:
    """Return the error (k = 2) of the bands of sensors by their draws: of the worst limit of all; NaN without one.

    Parameters
    ----------
    posteriors, unit : as `band_errors`.
    """
    return _error(band_errors(posteriors, unit))


def band_errors(posteriors: Sequence[Posterior], unit: Literal["mm", "%FSO", "y"]) -> FloatArray:
    """Return errors that the worst limit of the band of each sensor may have by its draws, [sensors, OTHERS].

    Parameters
    ----------
    unit : % of the full scale, the unit of y itself, or that of x, by the slope of the curve.
    """
    worst = np.zeros((len(posteriors), OTHERS))
    for number, posterior in enumerate(posteriors):
        calibration = posterior.calibration
        x = np.linspace(*calibration.x_range, POINTS)
        noise = band_noise(posterior, x, number)
        if unit == "mm":
            noise = in_mm(calibration, x, noise)
        elif unit == "%FSO":
            noise = 100.0 * noise / calibration.full_scale
        worst[number] = np.abs(noise).max(axis=(1, 2))
    return worst


def analyse_within(
    recording: Recording | str | Path,
    elongation: str | Path | None,
    options: Options,
    tolerance: float,
    unit: Unit,
    *,
    progress: Progress | None = None,
) -> Analysis:
    """Compute every figure of a run with no more draws than a tolerance takes.

    Parameters
    ----------
    recording, elongation, options : as `analyse`; resamples and samples of the posterior are chosen.
    tolerance, unit : greatest error by the draws, k = 2: of the posterior's band in mm, or of all intervals in % FSO.
    progress : as `analyse`, of the coarse analysis and again of the last.

    Raises
    ------
    RequestError : the tolerance cannot be met, or nothing has an error in that unit. Others as `analyse`.
    """
    *_, last = analyses_within(recording, elongation, options, tolerance, unit, progress=progress)
    return last


def analyses_within(
    recording: Recording | str | Path,
    elongation: str | Path | None,
    options: Options,
    tolerance: float,
    unit: Unit,
    *,
    progress: Progress | None = None,
) -> Iterator[Analysis]:
    """Yield analyses with more and more draws, of which the last has as many as a tolerance takes.

    Parameters
    ----------
    recording, elongation, options, tolerance, unit, progress : as `analyse_within`, and what is raised.
    """
    check_tolerance(tolerance, unit)
    run = recording if isinstance(recording, Recording) else load_recording(recording)
    chosen = replace(options, posterior_samples=FEWEST_SAMPLES)
    if unit == "%FSO":  # the resamples first, without the posterior
        chosen = replace(chosen, mcmc=False, resamples=FEWEST)
    analysis = analyse(run, elongation, options=chosen, progress=progress)
    while True:
        yield analysis
        found = accuracy_of(analysis)
        sampled = not options.mcmc or chosen.mcmc or all(each.calibration is None for each in analysis.sensors)
        if unit == "%FSO" and found.intervals_percent_fso > tolerance:
            resamples = draws_for(found.resamples, found.intervals_percent_fso, tolerance, unit, MOST_RESAMPLES)
            chosen = replace(chosen, resamples=resamples)
        elif not sampled:
            chosen = replace(chosen, mcmc=True)
        elif found.error(unit) > tolerance and unit == "%FSO" and found.intervals_percent_fso > found.band_percent_fso:
            resamples = draws_for(found.resamples, found.error(unit), tolerance, unit, MOST_RESAMPLES)
            chosen = replace(chosen, resamples=resamples)
        elif found.error(unit) > tolerance:
            samples = _samples_for(chosen.posterior_samples or 0, found.samples, found.error(unit), tolerance, unit)
            chosen = replace(chosen, posterior_samples=samples)
        elif math.isnan(found.error(unit)):
            why = "the posterior is not sampled" if unit == "mm" else "no figure has an interval"
            raise RequestError(f"no error in {unit}: {why}", "analyse a calibration run, with its posterior")
        else:
            return
        if analysis.parts:
            analysis = analyse(run, elongation, options=chosen, progress=progress)
        else:
            analysis = redrawn(analysis, chosen, progress=progress)


@dataclass(frozen=True, slots=True)
class WithinTolerance:
    """Analyses runs of a batch to a tolerance, in its unit; the columns are those of their accuracy."""

    tolerance: float
    unit: Unit

    def __call__(self, run: Path, elongation: Path | None, options: Options) -> tuple[Analysis, dict[str, Any]]:
        """Return the analysis, and what its draws leave uncertain."""
        analysis = analyse_within(run, elongation, options, self.tolerance, self.unit)
        return analysis, {f"accuracy_{name}": value for name, value in accuracy_of(analysis).as_json().items()}


def sample_within(
    sample: Callable[[int], Posterior], tolerance: float, unit: Literal["mm", "%FSO", "y"] = "y"
) -> tuple[Posterior, float]:
    """Return a posterior with no more samples than a tolerance takes, and the error of its band.

    Parameters
    ----------
    sample : returns the posterior with at least so many effective samples. tolerance : of its 95 % band, k = 2.
    unit : of tolerance and error, as `greatest_band_error`.

    Raises
    ------
    RequestError : the tolerance cannot be met.
    """
    check_tolerance(tolerance, unit)
    samples = FEWEST_SAMPLES
    while (error := greatest_band_error([found := sample(samples)], unit)) > tolerance:
        samples = _samples_for(samples, int(found.n_eff), error, tolerance, unit)
    return found, error


def check_tolerance(tolerance: float, unit: str) -> None:
    """Reject a tolerance that is not a number above 0.

    Raises
    ------
    RequestError : it is none.
    """
    if not 0.0 < tolerance < math.inf:
        raise RequestError(f"a tolerance of {tolerance:g} {unit}", "give a number above 0")


def _samples_for(asked: int, reached: int, error: float, tolerance: float, unit: str) -> int:
    """Return as many effective samples as a tolerance takes.

    Parameters
    ----------
    asked, reached : effective samples of the chain, which ends at its most steps.

    Raises
    ------
    RequestError : the longest chain, or all samples that are kept, leave more.
    """
    if reached < 0.99 * asked:
        raise _refusal("a longer chain than is sampled", error, tolerance, unit)
    return draws_for(reached, error, tolerance, unit, MOST_SAMPLES)


def _refusal(what: str, error: float, tolerance: float, unit: str) -> RequestError:
    """Return the refusal of a tolerance; the error of the most draws is the least that can be allowed."""
    return RequestError(f"an error of {tolerance:g} {unit} takes {what}", f"allow {rounded_up(error):g} {unit}")


def draws_for(now: int, error: float, tolerance: float, unit: str, most: int) -> int:
    """Return as many draws as a tolerance takes, by the root law from an error that is above it.

    Where they are many more, half of them come first: the error of few draws is not well enough known. Where they seem
    to be more than there can be, all are taken: a tolerance is refused by the error that they leave, not by a law.

    Parameters
    ----------
    now, error : draws, and the error that they leave.

    Raises
    ------
    RequestError : there are as many as there can be.
    """
    if now >= most:
        raise _refusal("more draws than are kept", error, tolerance, unit)
    finer = min(SPARE * error / tolerance, math.sqrt(most / now))  # before it is squared: a tolerance may be tiny
    needed = min(math.ceil(now * finer**2), most)
    if needed == most and now >= ENOUGH_TO_BELIEVE:
        return most
    next_ = needed // 2 if needed > MOST_GROWTH * now else needed
    return min(max(next_, math.ceil(LEAST_GROWTH * now)), MOST_GROWTH * now, most)
