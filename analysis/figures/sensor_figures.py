"""The figures of a sensor, each with its unit, its count and its confidence interval.

Strategy: everything is computed from loops (`analysis.segmentation.loops`) and a calibration; intervals come from one
bootstrap over cycles, shared by all figures, so that they are consistent with one another. Terms are those of ISA-S37.1
and ISO 5725.

Rules: a figure is % of full-scale output (FSO), mV or dB, see its name; one that is undefined (no span, no noise,
one cycle) has a reason and is NaN or infinite, never an exception and never zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
from scipy import signal as sp_signal
from scipy import stats

from analysis.calibration.adequacy import Adequacy, CurveVerdict
from analysis.calibration.fit import Calibration
from analysis.calibration.joint_fit import JointFit, LoopEstimate
from analysis.data.recording import Recording
from analysis.figures.figure import Figure, Reason
from analysis.numbers import percent
from analysis.segmentation.cycle_effect import CycleEffect
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.loops import Loops, LoopWidth, branch_mean, end_levels, loop_width
from analysis.segmentation.plateaus import Plateau
from analysis.statistics import PERCENTILES, bootstrap_interval, theil_sen
from protocol.base.arrays import FloatArray

CURVE_POINTS = 201
NEVER_NEGATIVE = ("mV", "% FSO")  # spans, widths and spreads; slopes and decibels have a sign
LEAST_SHARED = 0.85  # of the abscissa: below it a wider loop may be missed
REASONS = {
    CurveVerdict.ADEQUATE: Reason.NONE,
    CurveVerdict.DOUBTFUL: Reason.DOUBTFUL,
    CurveVerdict.INADEQUATE: Reason.INADEQUATE,
}
BOUND_SHARE = 0.25  # of a hysteresis: what else may make so much of it turns it into an upper bound


class FittedCurve(Protocol):
    """A curve that is linear in its coefficients."""

    def predict(self, x: npt.ArrayLike) -> FloatArray:
        """Return y(x)."""

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """Return dy/dx."""

    def rows(self, x: npt.ArrayLike) -> FloatArray:
        """Return the design matrix at x."""

    def slope_rows(self, x: npt.ArrayLike) -> FloatArray:
        """Return its derivative by x."""


@dataclass(frozen=True, slots=True)
class CurveDraws:
    """A curve, and the curves that its errors allow.

    Attributes
    ----------
    x : [n] the readings.
    coefficients : [draws, coefficients]; NaN rows where a resample cannot carry the degree.
    ends : [draws, 2] the range of each draw.
    dof : degrees of freedom of the errors drawn; NaN where the draws are a bootstrap over the cycles.
    """

    fit: FittedCurve
    x: FloatArray
    x_range: tuple[float, float]
    coefficients: FloatArray
    ends: FloatArray
    n_cycles: int
    dof: float = float("nan")

    def values(self, x: FloatArray) -> FloatArray:
        """Return y(x) of every draw, [draws, x]."""
        return self.coefficients @ self.fit.rows(x).T

    def slopes(self, x: FloatArray) -> FloatArray:
        """Return dy/dx of every draw, [draws, x]."""
        return self.coefficients @ self.fit.slope_rows(x).T

    def spans(self) -> FloatArray:
        """Return y(x_max) - y(x_min) of every draw over its own range, [draws]."""
        low, high = ((self.coefficients * self.fit.rows(end)).sum(axis=1) for end in self.ends.T)
        return np.asarray(high - low)

    @property
    def full_scale(self) -> float:
        """|y(x_max) - y(x_min)| of the curve."""
        low, high = self.fit.predict(np.asarray(self.x_range))
        return abs(float(high - low))

    def figure(
        self, value: float, replicates: FloatArray, unit: str, definition: str, *, either_way: bool = False
    ) -> Figure:
        """Return a figure of the curve, its interval from what the draws make of it.

        Parameters
        ----------
        value, replicates : of the curve and of the draws, [draws].
        either_way : the wider, at each end, of the draws' percentiles and their reflection.
        """
        if np.isnan(self.dof):
            return _figure(value, replicates, unit, self.n_cycles, definition)
        widen = stats.t.ppf(0.975, self.dof) / stats.norm.ppf(0.975)

        drawn = replicates[np.isfinite(replicates)]
        below, above = widen * (np.percentile(drawn, PERCENTILES) - value)
        low, high = value - above, value - below  # what the draws are above it, the truth is below
        if either_way:
            low, high = min(low, value + below), max(high, value + above)
        if unit in NEVER_NEGATIVE:
            low = max(low, 0.0)
        low, high = min(low, value), max(high, value)  # a maximum can lie outside its draws
        return Figure(float(value), unit, self.n_cycles, float(low), float(high), definition=definition)


def draw_joint(joint: JointFit, x: FloatArray, n_cycles: int, rng: np.random.Generator, count: int) -> CurveDraws:
    """Draw the curves that the errors of the position means allow.

    Parameters
    ----------
    x : [n] the readings.
    """
    coefficients, ends = joint.draws(rng, count)
    return CurveDraws(joint, x, joint.ends, coefficients, ends, n_cycles, joint.effective_dof)


def resample_fit(
    calibration: Calibration, cycle_of: FloatArray, weights: FloatArray, rng: np.random.Generator | None = None
) -> CurveDraws:
    """Refit a calibration through points to every bootstrap resample of the cycles.

    Parameters
    ----------
    cycle_of : [n] position (0, 1, ...) of the cycle of each point of the calibration.
    weights : [resamples, cycles] how often each cycle was drawn.

    Notes
    -----
    The normal equations are formed cycle by cycle in the orthogonal basis, where they are well conditioned, and added
    with the weights: all resamples are solved at once.
    """
    design = calibration.fit.basis.design(calibration.x)
    cycles = weights.shape[1]
    grams = np.zeros((cycles, design.shape[1], design.shape[1]))
    sides = np.zeros((cycles, design.shape[1]))
    for k in range(cycles):
        rows = design[cycle_of == k]
        grams[k] = rows.T @ rows
        sides[k] = rows.T @ calibration.y[cycle_of == k]
    total = np.einsum("bk,kij->bij", weights, grams)
    solvable = np.linalg.cond(total) < 1e12
    coefficients = np.full((weights.shape[0], design.shape[1]), np.nan)
    right = np.einsum("bk,ki->bi", weights, sides)
    coefficients[solvable] = np.linalg.solve(total[solvable], right[solvable][..., None])[..., 0]
    positions = calibration.reading
    if positions is not None and rng is not None:
        moved = np.sqrt(positions.x_variance) * rng.standard_normal((weights.shape[0], positions.n))
        by_reading = -moved[:, positions.of_point] * calibration.slope(calibration.x)
        coefficients += by_reading @ np.linalg.pinv(design).T
    own = [calibration.x[cycle_of == k] for k in range(cycles)]
    ends = np.asarray([[x.min(initial=np.inf), x.max(initial=-np.inf)] for x in own])
    drawn = weights > 0
    low, high = (np.where(drawn, sign * ends[:, side], np.inf).min(axis=1) * sign for side, sign in ((0, 1), (1, -1)))
    drawn_ends = np.stack([low, high], axis=1)  # infinite where only cycles without readings were drawn
    drawn_ends = np.where(np.isfinite(drawn_ends), drawn_ends, np.nan)
    return CurveDraws(calibration.fit, calibration.x, calibration.x_range, coefficients, drawn_ends, cycles)


def full_scale(curves: CurveDraws) -> Figure:
    """Full-scale output, mV: of the fitted curve over its range."""
    definition = "|y(x_max) - y(x_min)| of the fit"
    return curves.figure(curves.full_scale, np.abs(curves.spans()), "mV", definition)


def pressure_full_scale(loops: Loops, sensor: int, weights: FloatArray) -> Figure:
    """Full-scale output, mV, of a run without x: between the extreme pressures.

    Parameters
    ----------
    sensor : counted from 0.
    weights : [resamples, cycles] of the bootstrap.
    """
    low, high = (float(v[0]) for v in end_levels(loops, sensor))
    if not np.isfinite(high - low):
        return Figure.nothing("mV", Reason.NO_CYCLE, "no complete cycle")
    lows, highs = end_levels(loops, sensor, weights)
    return _figure(
        abs(high - low), np.abs(highs - lows), "mV", loops.n_cycles, "|y(p_max) - y(p_min)|, means over cycles"
    )


def sensitivities(curves: CurveDraws) -> dict[str, Figure]:
    """Return the end-to-end sensitivity, the slope at rest and the least-squares slope, mV/mm."""
    low, high = curves.x_range
    with np.errstate(invalid="ignore", divide="ignore"):
        end_to_ends = np.abs(curves.spans()) / np.diff(curves.ends, axis=1)[:, 0]
    centred = curves.x - curves.x.mean()
    line, lines = (y @ centred / (centred @ centred) for y in (curves.fit.predict(curves.x), curves.values(curves.x)))
    rest = np.zeros(1)
    at_rest, at_rests = float(curves.fit.slope(rest)[0]), curves.slopes(rest)[:, 0]
    found = {
        "sensitivity_mv_per_mm": (
            curves.full_scale / (high - low), end_to_ends, "|y(x_max) - y(x_min)| / (x_max - x_min) of the fit",
        ),
        "least_squares_slope_mv_per_mm": (line, lines, "slope of the straight line through all points"),
        "slope_at_rest_mv_per_mm": (at_rest, at_rests, "dy/dx at x = 0, with its sign"),
    }  # fmt: skip
    figures = {key: curves.figure(v, each, "mV/mm", text) for key, (v, each, text) in found.items()}
    if not low <= 0.0 <= high:
        outside = Figure.nothing("mV/mm", Reason.REST_OUTSIDE_RANGE, "x = 0 is outside the calibrated range")
        figures["slope_at_rest_mv_per_mm"] = outside
    return figures


def curve_figures(curves: CurveDraws, other: CurveDraws | None = None, *, verdict: str = "") -> dict[str, Figure]:
    """Return the figures of a calibration's curve.

    Parameters
    ----------
    other : the curve that it may deviate from: the intervals hold the figures of either.
    """
    figures = {"fso_mv": full_scale(curves), **sensitivities(curves), "nonlinearity_percent_fso": nonlinearity(curves)}
    for key, of_other in (curve_figures(other) if other is not None else {}).items():
        own = figures[key]
        if np.isfinite([own.low, own.high, of_other.low, of_other.high]).all():
            figures[key] = replace(own, low=min(own.low, of_other.low), high=max(own.high, of_other.high))
    if not verdict:
        return figures
    note = f"the curve is {verdict}: the interval also holds the preferred curve's figure"
    reason = REASONS[CurveVerdict(verdict)]
    return {
        key: figure if figure.void else replace(figure, note=note, reason=reason) for key, figure in figures.items()
    }


def lack_of_fit(adequacy: Adequacy | None, n: int) -> Figure:
    """Rms by which the curve misses the position means beyond chance, % FSO, with the verdict; of `n` readings."""
    definition = "rms of the curve less the preferred curve / FSO; 0 where the lack of fit is no more than chance"
    if adequacy is None:
        return Figure.nothing("% FSO", Reason.FEW_POSITIONS, "too few positions to test the curve", definition)
    note = f"{adequacy.verdict}: {adequacy.sentence}"
    reason = REASONS[adequacy.verdict]
    return Figure(adequacy.remainder_percent, "% FSO", n, note=note, definition=definition, reason=reason)


def joint_hysteresis(
    estimate: LoopEstimate, width: LoopWidth, full_scale_value: float, n: int, over: str = "x"
) -> Figure:
    """Hysteresis, % of full scale, of the loop of a joint fit.

    Parameters
    ----------
    full_scale_value : what it is relative to, in its unit.
    """
    definition = f"max over {over} of |loading - unloading| / FSO, loop of the joint fit, less its variance"
    plain = hysteresis(width, full_scale_value, n, definition)
    if plain.void or not full_scale_value > 0:
        return plain
    scale = 100.0 / full_scale_value
    value, low, high = (scale * v for v in (estimate.width, estimate.low, estimate.high))
    keep = plain.reason is Reason.PART_OF_RANGE
    return replace(
        plain, value=value, low=low, high=high, note=plain.note if keep else "",
        reason=plain.reason if keep else Reason.NONE,
    )  # fmt: skip


def sensor_loop_width(loops: Loops, sensor: int, calibration: Calibration | None, weights: FloatArray) -> LoopWidth:
    """Measure the loop of a sensor's signal over elongation, mV; `weights` as `loop_width` takes them.

    The actuator's loop sets the branches' points apart, and a chord between two points is off a curved sensor by
    y'' d^2 / 8. So what the points leave of the calibration is interpolated: the curve is common to both branches and
    drops out of their difference. Without a calibration the points themselves are.

    Parameters
    ----------
    sensor : counted from 0.
    calibration : subtracted from the signal; None where there is none.
    weights : [resamples, cycles] of the bootstrap.
    """
    assert loops.elongation_mm is not None
    x, signal = loops.elongation_mm, loops.signal_mv[sensor].copy()
    if calibration is not None:
        known = np.isfinite(x)
        signal[known] -= calibration.predict(x[known])
    return loop_width(x, signal, weights)


def hysteresis(width: LoopWidth, full_scale_value: float, n: int, definition: str) -> Figure:
    """Hysteresis, % of full scale, of the loop averaged over cycles.

    Parameters
    ----------
    full_scale_value : what the width is relative to, in its unit.
    """
    if width.void:
        return Figure.nothing("% FSO", Reason.NO_OVERLAP, width.void, definition)
    if not full_scale_value > 0:
        return _no_full_scale("% FSO", definition)
    scale = 100.0 / full_scale_value
    figure = _figure(scale * width.mean_loop, scale * width.replicates, "% FSO", n, definition)
    if width.shared < LEAST_SHARED:
        note = f"the branches share only {percent(width.shared)} of the range: a wider loop elsewhere is not seen"
        figure = replace(figure, note=note, reason=Reason.PART_OF_RANGE)
    return figure


def loop_made_by_noise(
    plateaus: tuple[Plateau, ...], loops: Loops, cycles: Cycles, sensor: int, noise_mv: float
) -> float:
    """Width, mV, that noise alone gives the mean loop: the greatest of many differences that are zero in truth.

    sd sqrt(2 ln 2m) for m levels, sd that of the difference of two branch means; 0 where it is not known.

    Parameters
    ----------
    sensor : counted from 0.
    noise_mv : rms noise of a sample, mV.
    """
    if not loops.n_cycles or not np.isfinite(noise_mv):
        return 0.0
    if plateaus:
        errors = np.asarray([p.signal_se_mv[sensor] for p in plateaus if p.branch and not p.void])
        error = float(np.median(errors)) if errors.size and np.isfinite(errors).all() else 0.0
    else:
        samples = sum(c.last - c.first for c in cycles.used) / len(cycles.used)
        error = noise_mv / np.sqrt(max(samples / (2 * loops.level_kpa.size), 1.0))
    levels = max(loops.level_kpa.size, 2)
    return float(error * np.sqrt(2.0 / loops.n_cycles) * np.sqrt(2.0 * np.log(2.0 * levels)))


def limited(figure: Figure, floor: float, by: str, share: float = BOUND_SHARE) -> Figure:
    """Mark a hysteresis as an upper bound where something else than a loop makes a share of it.

    It lifts the maximum: the interval reaches down to the figure less the floor.

    Parameters
    ----------
    floor : what else makes, in the unit of the figure.
    by : the name of that cause.
    """
    figure = replace(figure, low=float(np.minimum(figure.low, np.maximum(figure.value - floor, 0.0))))
    if not floor > share * figure.value:
        return figure
    note = f"only an upper bound: {by} alone accounts for up to about {floor:.2g} {figure.unit} of it"
    return replace(figure, note=f"{note}; {figure.note}" if figure.note else note, reason=Reason.UPPER_BOUND)


def nonlinearity(curves: CurveDraws) -> Figure:
    """Largest distance of the fitted curve from the best-fit straight line, % FSO (ISA-S37.1)."""
    definition = "max |y(x) - line(x)| / FSO, line by least squares through all points"
    if not curves.full_scale > 0:
        return _no_full_scale("% FSO", definition)
    x, grid = curves.x, np.linspace(*curves.x_range, CURVE_POINTS)
    line = np.polynomial.Polynomial.fit(x, curves.fit.predict(x), 1)
    scale = 100.0 / curves.full_scale
    value = scale * float(np.abs(curves.fit.predict(grid) - line(grid)).max())
    # the data's own weighting of the line is kept: project each drawn curve's values at the data's x
    at_data = curves.values(x)
    if not np.isfinite(at_data).all():
        return Figure(
            value, "% FSO", x.size, note="no interval: a resample cannot carry the degree",
            definition=definition, reason=Reason.NO_INTERVAL,
        )  # fmt: skip
    lines = at_data @ np.linalg.pinv(np.vander(x, 2)).T
    apart = np.abs(curves.values(grid[1:-1]) - lines @ np.vander(grid[1:-1], 2).T).max(axis=1)
    for end in curves.ends.T:  # each draw ends where its own range does
        at_end = (curves.coefficients * curves.fit.rows(end)).sum(axis=1) - lines[:, 0] * end - lines[:, 1]
        apart = np.fmax(apart, np.abs(at_end))
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = 100.0 * apart / np.abs(curves.spans())
    # the greatest distance moves between places: on 0.5 mm either half alone held 85 % of the values of true cubics
    return curves.figure(value, shares, "% FSO", definition, either_way=True)


def pressure_nonlinearity(loops: Loops, sensor: int, full_scale_value: float, weights: FloatArray) -> Figure:
    """The same against pressure, for runs without x: the middle of the mean loop and its straight line.

    Parameters
    ----------
    sensor : counted from 0.
    full_scale_value : full-scale output, mV.
    weights : [resamples, cycles] of the bootstrap.
    """
    definition = "max |middle of the mean loop - line| / FSO against pressure"
    middle = branch_mean(loops.signal_mv[sensor])
    known = np.isfinite(middle).all(axis=0) & (loops.n_cycles > 0)
    if known.sum() < 3 or not full_scale_value > 0:
        return Figure.nothing("% FSO", Reason.NO_CYCLE, "no complete cycle, or no span", definition)
    p = loops.level_kpa[known]
    rows = np.vander(p, 2)
    hat = rows @ np.linalg.pinv(rows)
    curves = np.vstack([middle[:, known].mean(axis=0), weights @ middle[:, known] / weights.sum(axis=1, keepdims=True)])
    apart = 100.0 / full_scale_value * np.abs(curves - curves @ hat.T).max(axis=1)
    return _figure(float(apart[0]), apart[1:], "% FSO", loops.n_cycles, definition)


def repeatability(loops: Loops, sensor: int, full_scale_value: float, weights: FloatArray) -> dict[str, Figure]:
    """ISO 5725 repeatability sd over cycles at each pressure and branch, % FSO: pooled and worst.

    Parameters
    ----------
    sensor : counted from 0.
    full_scale_value : full-scale output, mV.
    weights : [resamples, cycles] of the bootstrap.
    """
    names = ("repeatability_percent_fso", "repeatability_worst_percent_fso")
    values = np.where(loops.own, loops.signal_mv[sensor], np.nan)
    counts = np.isfinite(values).sum(axis=1)
    enough = counts >= 2
    if loops.n_cycles < 2 or not enough.any():
        return {name: Figure.nothing("% FSO", Reason.FEW_CYCLES, "fewer than two complete cycles") for name in names}
    if not full_scale_value > 0:
        return {name: _no_full_scale("% FSO") for name in names}
    series = values.transpose(1, 0, 2)[:, enough]  # [cycles, level and branch]
    scale = 100.0 / full_scale_value
    pooled, worst = _pooled_and_worst(series, np.ones((1, loops.n_cycles)))
    n = loops.n_cycles
    # a resample's variance is (n - 1) / n of the sample's on average: without this the interval would sit too low
    pooled_b, worst_b = (np.sqrt(n / (n - 1.0)) * part for part in _pooled_and_worst(series, weights))
    figure = _figure(scale * pooled[0], scale * pooled_b, "% FSO", n, "pooled sd over cycles of all levels / FSO")
    if figure.value > 0.0:  # resamples of few cycles that differ as a whole scatter less than the sd does
        low, high = (scale * end for end in CycleEffect.of(loops, sensor).interval(float(pooled[0])))
        figure = replace(figure, low=float(np.minimum(figure.low, low)), high=float(np.maximum(figure.high, high)))
    return {
        names[0]: figure,
        names[1]: _figure(scale * worst[0], scale * worst_b, "% FSO", n, "largest sd over cycles of a level / FSO"),
    }


def drift(loops: Loops, sensor: int, full_scale_value: float) -> Figure:
    """Drift over cycles, % FSO per 100 cycles: Theil-Sen slope of the mean displacement of all levels.

    Parameters
    ----------
    sensor : counted from 0.
    full_scale_value : full-scale output, mV.
    """
    definition, unit = "Theil-Sen slope over cycles of the mean displacement of all levels", "% FSO/100 cycles"
    if loops.n_cycles < 3:
        return Figure.nothing(unit, Reason.FEW_CYCLES, "fewer than three complete cycles", definition)
    if not full_scale_value > 0:
        return _no_full_scale(unit, definition)
    values = np.where(loops.own, loops.signal_mv[sensor], np.nan)
    whole = np.isfinite(values).all(axis=1)
    if not whole.any():
        return Figure.nothing(unit, Reason.NO_COMMON_LEVEL, "no level is known in every cycle", definition)
    common = values.transpose(1, 0, 2)[:, whole].mean(axis=1)
    number, scale = np.asarray(loops.numbers, dtype=np.float64), 100.0 * 100.0 / full_scale_value
    slope, low, high = (scale * v for v in theil_sen(number, common))
    return Figure(slope, unit, loops.n_cycles, low, high, definition=definition)


def staircase_noise(plateaus: tuple[Plateau, ...], sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sum of squares about each plateau's mean, its degrees of freedom, and its cycle; plateaus that count only."""
    usable = [p for p in plateaus if not p.void and p.branch and p.n[sensor] > 1]
    dof = np.asarray([p.n[sensor] - 1 for p in usable], dtype=np.float64)
    squares = np.asarray([p.signal_sd_mv[sensor] ** 2 for p in usable]) * dof
    return squares, dof, np.asarray([p.cycle for p in usable], dtype=np.float64)


def continuous_noise(recording: Recording, cycles: Cycles, sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same for a continuous run: about a local cubic (Savitzky-Golay), per cycle.

    The residual of a point at the middle of the window has variance sigma^2 (1 - h), h the weight of the point in its
    own fit: its share of the degrees of freedom. Samples near the turns of the pressure, where a cubic cannot follow
    a corner, and those next to something not usable are left out.

    Parameters
    ----------
    sensor : counted from 0.
    """
    used = cycles.used
    period = float(np.median([c.last - c.first for c in used])) if used else 0.0
    window = int(np.clip(period / 40, 7, 31)) | 1
    if not used or recording.n < window:
        return np.empty(0), np.empty(0), np.empty(0)
    weights = sp_signal.savgol_coeffs(window, 3)
    y, good = recording.signal_mv[:, sensor], recording.usable[:, sensor]
    filled = y if good.all() else np.where(good, y, 0.0)
    residual = filled - np.convolve(filled, weights[::-1], mode="same")
    half = window // 2
    bad = np.concatenate([[0], np.cumsum(~good)])
    rows = np.arange(recording.n)
    clear = bad[np.minimum(rows + half + 1, recording.n)] == bad[np.maximum(rows - half, 0)]
    for gap in recording.gaps:
        clear[max(gap.row - half, 0) : gap.row + half + 2] = False
    turns = np.unique([row for c in used for row in (c.first, c.turn, c.last)])
    for row in turns:
        clear[max(row - window, 0) : row + window + 1] = False
    squares, dof = [], []
    for cycle in used:
        part = residual[cycle.rows][clear[cycle.rows]]
        squares.append(float(part @ part))
        dof.append(part.size * (1.0 - float(weights[half])))
    return np.asarray(squares), np.asarray(dof), np.asarray([c.number for c in used], dtype=np.float64)


def noise_and_snr(
    parts: tuple[FloatArray, FloatArray, FloatArray],
    numbers: tuple[int, ...],
    full_scale_value: float,
    weights: FloatArray,
    rounding_mv: float = 0.0,
) -> tuple[Figure, Figure]:
    """Return the noise rms (mV) and the SNR (dB) = 20 log10(FSO / noise), with intervals over cycles.

    `rounding_mv` is what the rounding of doubles at the signal's level may make: less is no noise.

    Parameters
    ----------
    parts : sums of squares, degrees of freedom and cycle, as `staircase_noise` returns them.
    full_scale_value : full-scale output, mV.
    weights : [resamples, cycles] of the bootstrap.
    rounding_mv : what the rounding of doubles may make.
    """
    squares, dof, cycle_of = parts
    if dof.sum() <= 0:
        noise_figure, snr = (
            Figure.nothing(unit, Reason.NO_SAMPLES, "no usable samples at rest or in a cycle") for unit in ("mV", "dB")
        )
        return noise_figure, snr
    noise = float(np.sqrt(squares.sum() / dof.sum()))
    by_cycle = np.asarray([[squares[cycle_of == k].sum(), dof[cycle_of == k].sum()] for k in numbers]).reshape(-1, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        totals = weights @ by_cycle if by_cycle.size else np.zeros((0, 2))
        replicates = np.sqrt(totals[:, 0] / totals[:, 1])
        snr_replicates = 20.0 * np.log10(full_scale_value / replicates)
    noise_figure = _figure(noise, replicates, "mV", len(numbers), "rms about the plateau's mean or a local cubic")
    # a few cycles may agree by chance: white noise of so many samples is known no better than this (chi-square)
    least = 1.96 / np.sqrt(2.0 * dof.sum())
    noise_figure = _at_least(noise_figure, noise * least)
    definition = "20 log10(FSO / noise rms)"
    if not np.isfinite(full_scale_value):
        return noise_figure, Figure.nothing("dB", Reason.NO_CYCLE, "the full-scale output is not known", definition)
    if noise <= max(1e-10 * full_scale_value, rounding_mv):  # rounding of the arithmetic, not noise
        if full_scale_value == 0:
            value, reason, void = float("nan"), Reason.NO_FULL_SCALE, "the signal is flat"
        else:
            value, reason, void = float("inf"), Reason.NO_NOISE, "no noise was found: infinite"
        return noise_figure, Figure(value, "dB", len(numbers), void=void, definition=definition, reason=reason)
    if full_scale_value == 0:
        none = replace(_no_full_scale("dB", definition), value=float("-inf"), n=len(numbers))
        return noise_figure, none
    value = float(20.0 * np.log10(full_scale_value / noise))
    snr = _figure(value, snr_replicates, "dB", len(numbers), definition)
    return noise_figure, _at_least(snr, 20.0 * np.log10(1.0 + least))


def _at_least(figure: Figure, reach: float) -> Figure:
    """Widen an interval, where there is one, to `reach` on either side of the value."""
    if not np.isfinite([figure.low, figure.high]).all():
        return figure
    least = 0.0 if figure.unit in NEVER_NEGATIVE else -np.inf

    low = min(figure.low, max(figure.value - reach, least))
    return replace(figure, low=low, high=max(figure.high, figure.value + reach))


def with_shared_error(figure: Figure, shared: float) -> Figure:
    """Widen the interval of a distance by an error of the means at its ends that the cycles share.

    Parameters
    ----------
    shared : sd of the error of each, in the unit of the figure.
    """
    if not shared > 0 or not np.isfinite([figure.value, figure.low, figure.high]).all():
        return figure
    reach = 1.96 * np.sqrt(2.0) * shared

    low = figure.value - np.hypot(figure.value - figure.low, reach)
    high = figure.value + np.hypot(figure.high - figure.value, reach)
    return replace(figure, low=float(max(low, 0.0)), high=float(high))


def with_full_scale(figure: Figure, full_scale: Figure) -> Figure:
    """Widen the interval of a figure in dB or % FSO by that of its full scale, as of independent parts."""
    ends = np.asarray([full_scale.low, full_scale.high])
    if figure.unit == "mV" or not np.isfinite([figure.value, figure.low, figure.high, *ends]).all() or not ends[0] > 0:
        return figure

    value, (smaller, larger) = figure.value, np.maximum(ends, 0.5 * ends[0]) / full_scale.value
    if figure.unit == "dB":
        down, up = np.abs(20.0 * np.log10([smaller, larger]))
    else:
        up, down = np.abs(value * (1.0 / np.array([smaller, larger]) - 1.0))
        down, up = (up, down) if value < 0 else (down, up)
    low, high = value - np.hypot(value - figure.low, down), value + np.hypot(figure.high - value, up)
    low = max(low, 0.0) if figure.unit in NEVER_NEGATIVE else low
    return replace(figure, low=float(low), high=float(high))


def combined_error(parts: list[Figure]) -> Figure:
    """Root sum of squares of non-linearity, hysteresis and repeatability, % FSO (ISA-S37.1, static error)."""
    definition = "sqrt(non-linearity^2 + hysteresis^2 + repeatability^2)"
    missing = next((p for p in parts if not np.isfinite(p.value)), None)
    if missing is not None:
        return Figure.nothing("% FSO", missing.reason, missing.void, definition)

    # each part's half-interval propagated linearly; the parts share cycles, so this is the cautious sum of squares
    value = np.sqrt(sum(p.value**2 for p in parts))
    share = 1.0 / value if value > 0 else 0.0
    down = np.sqrt(sum((p.value * (p.value - p.low)) ** 2 for p in parts)) * share
    up = np.sqrt(sum((p.value * (p.high - p.value)) ** 2 for p in parts)) * share
    n = min(p.n for p in parts)
    return Figure(float(value), "% FSO", n, float(value - down), float(value + up), definition=definition)


def _figure(value: float, replicates: FloatArray, unit: str, n: int, definition: str) -> Figure:
    positive = unit in NEVER_NEGATIVE
    low, high = bootstrap_interval(value, replicates, n, positive=positive)
    figure = Figure(float(value), unit, n, low, high, definition=definition)
    if not np.isfinite([low, high]).all():
        return replace(figure, note="one cycle gives no interval", reason=Reason.ONE_CYCLE) if n < 2 else figure
    return replace(figure, low=max(low, 0.0)) if positive else figure


def _no_full_scale(unit: str, definition: str = "") -> Figure:
    return Figure.nothing(unit, Reason.NO_FULL_SCALE, "the full-scale output is zero", definition)


def _pooled_and_worst(series: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pooled and largest sd over cycles, for every row of weights; NaN in `series` [cycles, levels] is left out."""
    known = np.isfinite(series)
    filled = np.where(known, series - np.nanmean(series, axis=0), 0.0)
    count = weights @ known
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = weights @ filled / count
        squares = weights @ filled**2 - count * mean**2
        distinct = (weights > 0).astype(float) @ known
        dof = np.where(distinct >= 2, count - 1, np.nan)
        variance = np.maximum(squares, 0.0) / dof
        pooled = np.sqrt(np.nansum(variance * dof, axis=1) / np.nansum(dof, axis=1))
    return pooled, np.sqrt(np.nanmax(np.where(np.isfinite(variance), variance, 0.0), axis=1))
