"""As few samples as an error of the period takes: strokes of a thinned record, and their error by half-sampling.

Strategy: a rise is found at the first sample beyond its threshold, late by up to an interval: interval²/12 of variance.
Noise moves it besides. Each half of the samples, every other one, finds the same rises, interpolated between two
samples; half of the mean square of what the halves differ by is the variance by noise. A period is the difference of
two rises. The first part alone gives the fewest samples that may do; from there on more are tried.

Rules: what delays all rises alike is no error of a period. Where the halves find other strokes than the whole, the
error is infinite. A thinned record counts only if half as many samples again find as many rises: a record with less
than two samples a stroke repeats its strokes at a false period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import RequestError
from analysis.segmentation.strokes import crossings, thresholds

COVERAGE = 2.0
"""Standard deviations of a stated error: about 95 %."""
BY_INTERVAL = COVERAGE * float(np.sqrt(2.0 / 12.0))
"""Error of a period without noise, in sampling intervals."""
FEWEST = 20


@dataclass(frozen=True, slots=True)
class StrokeSampling:
    """The samples by which strokes are found.

    Parameters
    ----------
    every : one sample in so many is used.
    period_error_s : of each period by the sampling, k = 2; inf where half of the samples finds other strokes.
    """

    every: int
    samples: int
    period_error_s: float


def sampling_of(time_s: FloatArray, drive: FloatArray, every: int = 1) -> StrokeSampling:
    """Return the error of the periods that one sample in `every` gives.

    Parameters
    ----------
    time_s, drive : [n] as `find_strokes`; rows that are not finite are left out.
    every : one sample in so many is used.
    """
    _, whole = _thinned(time_s, drive, 1)
    return _sampling(time_s, drive, every, thresholds(whole)) if whole.size else StrokeSampling(every, 0, float("inf"))


def _sampling(time_s: FloatArray, drive: FloatArray, every: int, ends: tuple[float, float]) -> StrokeSampling:
    """Return the same with the thresholds of all samples."""
    time, x = _thinned(time_s, drive, every)
    if x.size < FEWEST:
        return StrokeSampling(every, x.size, float("inf"))
    rises, _ = crossings(x, *ends)
    halves = [_between_samples(time[first::2], x[first::2], ends) for first in (0, 1)]
    if rises.size < 2 or any(half.size != rises.size for half in halves):
        return StrokeSampling(every, x.size, float("inf"))
    by_interval = float(np.mean((time[rises] - time[rises - 1]) ** 2)) / 12.0
    by_noise = float(np.mean((halves[0] - halves[1]) ** 2)) / 2.0
    return StrokeSampling(every, x.size, COVERAGE * float(np.sqrt(2.0 * (by_interval + by_noise))))


def sampling_within(time_s: FloatArray, drive: FloatArray, tolerance_s: float) -> StrokeSampling:
    """Return the fewest samples whose periods have an error within a tolerance.

    Parameters
    ----------
    time_s, drive : as `sampling_of`. tolerance_s : of a period from rise to rise, k = 2.

    Raises
    ------
    RequestError : the tolerance is no time, or every sample is too few for it.
    """
    if not 0.0 < tolerance_s < np.inf:
        raise RequestError(f"a tolerance of {tolerance_s:g} s", "give a time above 0")
    time, x = _thinned(time_s, drive, 1)
    interval_s = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    every = int(min(tolerance_s / (BY_INTERVAL * interval_s), x.size / FEWEST)) if interval_s > 0.0 else 1
    ends = thresholds(x) if x.size else (0.0, 0.0)

    def rises(of_each: int) -> int:
        return int(crossings(x[::of_each], *ends)[0].size)

    while (found := _sampling(time, x, max(every, 1), ends)).every > 1:
        if found.period_error_s <= tolerance_s and rises(every) == rises(2 * every // 3):
            return found
        every = min(every - 1, max(int(every * tolerance_s / found.period_error_s), 2 * every // 3))
    if found.period_error_s <= tolerance_s:
        return found
    if not np.isfinite(found.period_error_s):
        raise RequestError(
            "half of the samples shows other strokes than all, so the error of a period is not known",
            "record at a higher rate, and at least two strokes up",
        )
    raise RequestError(
        f"an error of {1e3 * tolerance_s:.3g} ms of a period takes more samples than the {found.samples} of the run",
        f"allow {1e3 * found.period_error_s * 1.005:.3g} ms or more, or record at a higher rate",
    )


def _thinned(time_s: FloatArray, drive: FloatArray, every: int) -> tuple[FloatArray, FloatArray]:
    time, x = time_s[::every], drive[::every]
    known = np.isfinite(time) & np.isfinite(x)
    return time[known], x[known]


def _between_samples(time_s: FloatArray, drive: FloatArray, ends: tuple[float, float]) -> FloatArray:
    """Return the times of the rises through the upper threshold, on the line between two samples."""
    rises, _ = crossings(drive, *ends)
    before, after = drive[rises - 1], drive[rises]
    return np.asarray(time_s[rises - 1] + (time_s[rises] - time_s[rises - 1]) * (ends[1] - before) / (after - before))
