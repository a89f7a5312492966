"""What resampling and sampling leave uncertain in the figures of a run, and as many draws as a tolerance allows.

Strategy: intervals rest on resamples of the cycles, the posterior's band on its samples. The error of an interval's
limit follows from its own width and the number of resamples, that of the band from its own samples in batches. A coarse
analysis measures both; they fall as one over the root of the draws, which gives the draws that a tolerance takes.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from analysis.arrays import FloatArray
from analysis.calibration.posterior import KEPT_SAMPLES, Posterior
from analysis.data.load import load_recording
from analysis.data.recording import Recording
from analysis.errors import RequestError
from analysis.fidelity import fidelity
from analysis.figures.pipeline import Analysis, analyse
from analysis.figures.sensor_analysis import MOST_RESAMPLES, Options
from analysis.progress import Progress

Unit = Literal["mm", "%FSO"]
BATCHES, LEVEL = 16, 0.95
LIMIT_ERROR = 2.0 * math.sqrt(0.025 * 0.975) / 0.05845 / 3.92
"""2 sd of the 2.5 % quantile of n draws, times the root of n, over the width of the interval: of a normal density."""
FEWEST = 100
FEWEST_SAMPLES = 500
SPARE = 1.15
_POINTS = 31


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of a run's figures by its finite draws, at k = 2; NaN where there is nothing that has one.

    Parameters
    ----------
    intervals_percent_fso : greatest of the limits of the intervals in % FSO. resamples : that they rest on.
    band_percent_fso, band_mm : greatest of the limits of the posterior's band, mm by the slope of the curve.
    samples : of the posterior, effective ones that ended it.
    """

    intervals_percent_fso: float
    band_percent_fso: float
    band_mm: float
    resamples: int
    samples: int

    def error(self, unit: Unit) -> float:
        """Return the greatest error in a unit; NaN where nothing has one."""
        errors = [self.band_mm] if unit == "mm" else [self.intervals_percent_fso, self.band_percent_fso]
        return max((each for each in errors if math.isfinite(each)), default=math.nan)

    def as_json(self) -> dict[str, Any]:
        """Return it as a dictionary."""
        return asdict(self)


def accuracy_of(analysis: Analysis) -> Accuracy:
    """Return the errors that the draws of an analysis leave."""
    options, level = analysis.options, fidelity(analysis.options.fidelity)
    resamples = options.resamples or level.resamples
    widths = [
        figure.high - figure.low
        for sensor in analysis.sensors
        for figure in sensor.figures.values()
        if not figure.void and figure.unit == "% FSO" and math.isfinite(figure.high - figure.low)
    ]
    intervals = LIMIT_ERROR * max(widths, default=math.nan) / math.sqrt(resamples)
    percent, mm = [], []
    for sensor in analysis.sensors:
        if sensor.posterior is not None and sensor.calibration is not None:
            x = np.linspace(*sensor.calibration.x_range, _POINTS)
            errors, slopes = band_errors(sensor.posterior, x), np.abs(sensor.calibration.slope(x))
            percent.append(100.0 * float(errors.max()) / sensor.calibration.full_scale)
            mm.append(float(np.max(errors / np.maximum(slopes, 0.1 * slopes.max()))))  # near a turn mm mean nothing
    samples = options.posterior_samples or level.posterior_samples
    return Accuracy(intervals, max(percent, default=math.nan), max(mm, default=math.nan), resamples, samples)


def band_errors(posterior: Posterior, x: FloatArray) -> FloatArray:
    """Return the error (k = 2) of the limits of the band at x (n,), the greater of both, by batches of the chain.

    Notes
    -----
    Batches are much longer than the autocorrelation time, so that their quantiles are independent (Flegal and Jones,
    Ann. Statist. 38, 2010, 1034).
    """
    curves = posterior.curves(x)
    used = len(curves) // BATCHES * BATCHES
    tails = [50.0 - 50.0 * LEVEL, 50.0 + 50.0 * LEVEL]
    limits = np.percentile(curves[:used].reshape(BATCHES, -1, x.size), tails, axis=1)
    return np.asarray(2.0 * np.max(limits.std(axis=1, ddof=1), axis=0) / math.sqrt(BATCHES))


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
    if not 0.0 < tolerance < math.inf:
        raise RequestError(f"a tolerance of {tolerance:g} {unit}", "give a number above 0")
    run = recording if isinstance(recording, Recording) else load_recording(recording)
    chosen = replace(options, resamples=FEWEST, posterior_samples=FEWEST_SAMPLES)
    for _ in range(3):
        analysis = analyse(run, elongation, options=chosen, progress=progress)
        found = accuracy_of(analysis)
        if math.isnan(found.error(unit)):
            why = "the posterior is not sampled" if unit == "mm" else "no figure has an interval"
            raise RequestError(f"no error in {unit}: {why}", "analyse a calibration run, with its posterior")
        if found.error(unit) <= tolerance:
            return analysis
        chosen = _refined(chosen, found, tolerance, unit)
    raise RequestError(f"the draws leave an error of {found.error(unit):.2g} {unit}", "allow that, or more")


def _refined(options: Options, found: Accuracy, tolerance: float, unit: Unit) -> Options:
    """Return options with as many draws as the tolerance takes.

    Raises
    ------
    RequestError : more draws than are kept.
    """

    def needed(now: int, error: float, fewest: int) -> int:
        return max(fewest, math.ceil(now * (SPARE * error / tolerance) ** 2)) if math.isfinite(error) else now

    resamples, samples = cast(int, options.resamples), cast(int, options.posterior_samples)
    if unit == "%FSO":
        resamples = needed(resamples, found.intervals_percent_fso, FEWEST)
    samples = needed(samples, found.band_mm if unit == "mm" else found.band_percent_fso, FEWEST_SAMPLES)
    most = max(resamples / MOST_RESAMPLES, samples / KEPT_SAMPLES)
    if most > 1.0:
        best = tolerance * math.sqrt(most)
        raise RequestError(
            f"an error of {tolerance:g} {unit} takes more draws than are kept", f"allow {best:.2g} {unit}"
        )
    return replace(options, resamples=resamples, posterior_samples=samples)
