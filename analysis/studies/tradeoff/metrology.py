"""The inverse, the segmentation and the bootstrap, each on simulated data whose truth is known."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial
from scipy.special import gammaln

from analysis import published
from analysis.calibration.fit import Calibration, fit_calibration
from analysis.calibration.inverse import NODES, Inverse
from analysis.data.recording import Recording
from analysis.published import RANGE_MM, SENSORS
from analysis.segmentation.cycles import find_cycles
from analysis.segmentation.plateaus import Plateau, find_plateaus
from analysis.statistics import bootstrap_interval, resampling_weights
from analysis.studies.failure_maps.figures import Stairs
from analysis.studies.tradeoff.measure import REPEATS, Method, Setting
from protocol.base.arrays import FloatArray

_CUBIC, _NOISE_MV = Polynomial(SENSORS[0].coefficients), published.NOISE_MV[0]
ROUND_TRIP_MM = 1e-10  # guaranteed for mV -> mm, so that replay and export return what was measured
NEWTON = "Newton"
_CYCLES = 8
_SIGNALS = 20_000


def _calibration(degree: int) -> Calibration:
    x = np.tile(np.linspace(*RANGE_MM, 10), 9)
    return fit_calibration(x, _CUBIC(x) + _NOISE_MV * np.random.default_rng(0).standard_normal(x.size), degree)


def inverse_settings(quick: bool) -> list[Setting]:
    """Return Newton, the cubic's closed form, tables and companion matrices, for signals whose x is known.

    One call inverts a cubic and a quintic, since calibrations of either degree are fitted; the error is the greatest.
    """
    fits = (_calibration(3), _calibration(5))
    x = np.random.default_rng(1).uniform(*RANGE_MM, _SIGNALS)
    signals = [_signals(fit, x) for fit in fits]
    inverses = [Inverse.of(fit) for fit in fits]

    def setting(name: str, solve: Callable[[int, FloatArray], FloatArray], count: int = _SIGNALS) -> Setting:
        def call(_: int) -> list[FloatArray]:
            return [solve(i, y[:count]) for i, y in enumerate(signals)]

        def error(found: list[FloatArray]) -> float:
            return float(np.max([np.abs(f - x[:count]).max() for f in found]))

        return Setting(name, call, error, work=len(fits) * count)

    sizes = (17, 65, NODES) if quick else (9, 17, 33, 65, 129, NODES, 1025, 4097)
    return [
        setting(NEWTON, lambda i, y: inverses[i](y)),
        setting("closed form (Viete), cubics only", lambda i, y: closed_form(fits[i], y)),
        *(setting(f"table of {n}", _table(fits, n)) for n in sizes),
        setting("companion matrices", lambda i, y: _roots(fits[i], y), _SIGNALS // 40),
    ]


def _signals(fit: Calibration, x: FloatArray) -> FloatArray:
    return np.polyval(fit.coefficients[::-1].astype(np.longdouble), x.astype(np.longdouble)).astype(np.float64)


def closed_form(fit: Calibration, y: FloatArray) -> FloatArray:
    """Solve b3 x^3 + b2 x^2 + b1 x + b0 = y where the cubic has three real roots, the one inside the range.

    Source: F. Viete's trigonometric form: x = m + 2 r cos((arccos(q / r^3) + 2 pi k) / 3), m = -b2 / (3 b3),
    r^2 = m^2 - b1 / (3 b3); the root between the two turning points is k = 2. NaN for curves of another degree.
    """
    if fit.degree != 3:
        return np.full(y.shape, np.nan)
    b0, b1, b2, b3 = fit.coefficients
    middle = -b2 / (3.0 * b3)
    radius = np.sqrt(middle**2 - b1 / (3.0 * b3))
    q = middle**3 - b1 / b3 * middle / 2.0 - (b0 - y) / (2.0 * b3)
    angle = np.arccos(np.clip(q / radius**3, -1.0, 1.0))
    return np.asarray(middle + 2.0 * radius * np.cos((angle + 4.0 * np.pi) / 3.0))


def _table(fits: Sequence[Calibration], nodes: int) -> Callable[[int, FloatArray], FloatArray]:
    at = np.linspace(*fits[0].x_range, nodes)
    signals = [fit.predict(at) for fit in fits]
    return lambda i, y: np.interp(y, signals[i], at)


def _roots(fit: Calibration, y: FloatArray) -> FloatArray:
    """Find all roots as eigenvalues of a companion matrix, one signal after the other; the one inside the range."""
    powers, middle = fit.coefficients[::-1].copy(), float(np.mean(fit.x_range))
    found = np.empty(y.size)
    for i, value in enumerate(y):
        powers[-1] = fit.coefficients[0] - value
        roots = np.roots(powers)
        found[i] = roots.real[np.argmin(np.abs(roots - middle))]
    return found


def segmentation_settings(quick: bool) -> list[Setting]:
    """Return every sample, or every k-th, of a staircase of 5 cycles: plateau means against the noise-free truth."""
    runs = [Stairs(cycles=5, dwell_s=5.0, seed=seed) for seed in range(REPEATS)]
    truth = runs[0].signal(runs[0].elongation(*runs[0].holds))

    def segmented(every: int) -> Callable[[int], tuple[Plateau, ...]]:
        columns = [[values[::every] for values in run.columns] for run in runs]
        recordings = [Recording.from_arrays(time_s, kpa, mv[:, None]) for time_s, kpa, mv in columns]
        return lambda repeat: find_plateaus(recordings[repeat], find_cycles(recordings[repeat]))

    def error(found: tuple[Plateau, ...]) -> float:
        if len(found) != truth.size:
            return float("inf")
        return float(np.sqrt(np.mean((np.array([p.signal_mv[0] for p in found]) - truth) ** 2)))

    steps = (1, 2, 5, 10, 20) if quick else (1, 2, 3, 5, 10, 20, 50)
    return [Setting(_every(k), segmented(k), error) for k in steps]


def _every(k: int) -> str:
    return "every sample" if k == 1 else f"one sample in {k}"


def bootstrap_settings(quick: bool) -> list[Setting]:
    """Return numbers of resamples: the interval of a mean over cycles against that of all possible resamples."""
    values = np.random.default_rng(6).standard_normal(_CYCLES)
    estimate = float(values.mean())

    @cache
    def truth() -> float:
        return float(np.diff(exact_interval(values))[0])

    def intervals(resamples: int, many: int) -> Callable[[int], FloatArray]:
        def call(repeat: int) -> FloatArray:
            rng = np.random.default_rng(repeat)
            draws = (resampling_weights(_CYCLES, rng, resamples) @ values / _CYCLES for _ in range(many))
            return np.array([bootstrap_interval(estimate, means, _CYCLES) for means in draws])

        return call

    def error(found: FloatArray) -> float:
        widths = np.diff(found, axis=1) / truth() - 1.0
        return 100.0 * float(np.sqrt(np.mean(widths**2)))

    counts = (100, 500, 2_000, 20_000) if quick else (50, 100, 200, 500, 1_000, 2_000, 5_000, 20_000, 50_000)
    many = [max(4, 80_000 // n) for n in counts]
    return [Setting(_resamples(n), intervals(n, k), error, work=k) for n, k in zip(counts, many, strict=True)]


def exact_interval(values: FloatArray) -> tuple[float, float]:
    """Return `bootstrap_interval` of the mean over all multisets of the n values, weighted by its probability."""
    n = values.size
    counts = _compositions(n, n)
    weights = np.exp(gammaln(n + 1) - gammaln(counts + 1.0).sum(axis=1) - n * np.log(n))
    means = counts @ values / n
    order = np.argsort(means)
    low, high = np.interp([0.025, 0.975], np.cumsum(weights[order]) - 0.5 * weights[order], means[order])
    # the widening of the interval is a function of both ends alone
    return bootstrap_interval(float(values.mean()), np.repeat([low, high], 100), n)


def _compositions(total: int, parts: int) -> FloatArray:
    """Return every way to write `total` as a sum of so many whole numbers, by the places of the bars between them."""
    bars = np.array(list(itertools.combinations(range(total + parts - 1), parts - 1)))
    return np.diff(bars, axis=1, prepend=-1, append=total + parts - 1) - 1.0


def _resamples(count: int) -> str:
    return f"{count} resamples"


INVERSE = Method(
    "inverse", "Inverse: mV to mm",
    "the x that the signals of a cubic and a quintic were made from, in extended precision", True,
    "replay and export, which guarantee a round trip to 1e-10 mm", ROUND_TRIP_MM, "mm", "a value",
    lambda level: NEWTON, inverse_settings,
)  # fmt: skip
SEGMENTATION = Method(
    "segmentation", "Segmentation: samples used", "the noise-free signal at each level of the staircase", True,
    "the calibration's points: a tenth of the noise", _NOISE_MV / 10, "mV", "a run of 5 cycles",
    lambda level: _every(1), segmentation_settings,
)  # fmt: skip
BOOTSTRAP = Method(
    "bootstrap", "Bootstrap: resamples", "all 6,435 possible resamples of 8 cycles, each with its probability", True,
    "the reader of the interval's width, printed with two digits: 5 %", 5.0, "% of the width", "an interval",
    lambda level: _resamples(level.resamples), bootstrap_settings,
)  # fmt: skip
