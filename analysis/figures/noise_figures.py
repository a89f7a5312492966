"""Noise and signal-to-noise ratio of a sensor, from plateaus or from the residuals of a local cubic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import signal as sp_signal
from scipy import stats

from analysis.data.recording import Recording
from analysis.figures.figure import Figure, Reason
from analysis.figures.intervals import at_least, bootstrap_figure, no_full_scale
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.plateaus import Plateau
from protocol.base.arrays import BoolArray, FloatArray

CORNER_SD, CORNER_OF_SPAN = 5.0, 0.005  # what a local cubic leaves of the pressure: noise (sd), and share of the span

_COURSE_TERMS, _BY_CHANCE = 3, 1e-3  # of the noise over x
_TREND_TERMS = 3  # of the parabola through a hold


def staircase_noise(plateaus: tuple[Plateau, ...], sensor: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sum of squares about each plateau's mean, its degrees of freedom, and its cycle; plateaus that count only."""
    usable = [p for p in plateaus if not p.void and p.branch and p.n[sensor] > 1]
    dof = np.asarray([p.n[sensor] - 1 for p in usable], dtype=np.float64)
    squares = np.asarray([p.signal_sd_mv[sensor] ** 2 for p in usable]) * dof
    return squares, dof, np.asarray([p.cycle for p in usable], dtype=np.float64)


def moving_noise(
    plateaus: tuple[Plateau, ...], sensor: int, recording: Recording
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same of holds that are not settled, about a parabola in each, so that its trend is no noise."""
    squares, dof, cycle_of = [], [], []
    for p in plateaus:
        rows = slice(p.settled_first, p.last + 1)
        good = recording.usable[rows, sensor]
        if p.void or not p.branch or good.sum() <= _TREND_TERMS:
            continue
        design = np.vander(np.linspace(-1.0, 1.0, good.size)[good], _TREND_TERMS)
        signal = recording.signal_mv[rows, sensor][good]
        left = signal - design @ np.linalg.lstsq(design, signal, rcond=None)[0]
        squares.append(float(left @ left))
        dof.append(float(good.sum() - _TREND_TERMS))
        cycle_of.append(float(p.cycle))
    return np.asarray(squares), np.asarray(dof), np.asarray(cycle_of)


def noise_course(x: FloatArray, variance: FloatArray, grid: FloatArray) -> FloatArray:
    """Return how the noise grows over x, [grid], relative to its rms; ones where it is the same everywhere.

    `x` and `variance` [n] are of the plateaus. A parabola through the logarithms, if it explains them better than a
    constant (F test, 0.1 %).
    """
    none, known = np.ones(grid.size), np.isfinite(x) & (variance > 0.0)
    dof = int(known.sum()) - _COURSE_TERMS
    if dof < _COURSE_TERMS or not np.ptp(x[known]) > 0.0:
        return none
    design, away = (np.vander((at - x[known].mean()) / np.ptp(x[known]), _COURSE_TERMS) for at in (x[known], grid))
    logs = np.log(variance[known])
    found, *_ = np.linalg.lstsq(design, logs, rcond=None)
    left, whole = float(((logs - design @ found) ** 2).sum()), float(((logs - logs.mean()) ** 2).sum())
    if not whole > left or stats.f.sf((whole - left) / (_COURSE_TERMS - 1) / (left / dof), 2, dof) > _BY_CHANCE:
        return none
    return np.asarray(np.exp(0.5 * (away @ found)) / np.sqrt(np.mean(np.exp(design @ found))))


def continuous_noise(
    recording: Recording, cycles: Cycles, sensor: int, driven_kpa: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the same for a continuous run: about a local cubic (Savitzky-Golay), per cycle.

    Where `driven_kpa` [n] is given, samples near what a cubic cannot follow in it are left out too.

    The residual of a point at the middle of the window has variance sigma^2 (1 - h), h the weight of the point in its
    own fit: its share of the degrees of freedom. Samples near the turns of the pressure, where a cubic cannot follow a
    corner, and those next to something not usable are left out.
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
    if driven_kpa is not None:
        clear &= _followed(driven_kpa, cycles.noise_kpa, weights)
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


def _followed(pressure_kpa: FloatArray, noise_kpa: float, weights: FloatArray) -> BoolArray:
    """Return where the local cubic follows the pressure in its whole window [n]: not at corners, as of short holds."""
    known = np.where(np.isfinite(pressure_kpa), pressure_kpa, 0.0)
    residual = np.abs(known - np.convolve(known, weights[::-1], mode="same"))
    limit = max(CORNER_SD * noise_kpa, CORNER_OF_SPAN * float(np.ptp(known)))
    half = weights.size // 2
    corners = np.concatenate([[0], np.cumsum(residual > limit)])
    rows = np.arange(known.size)
    return np.asarray(
        corners[np.minimum(rows + half + 1, known.size)] == corners[np.maximum(rows - half, 0)], dtype=bool
    )


def noise_and_snr(
    parts: tuple[FloatArray, FloatArray, FloatArray],
    numbers: tuple[int, ...],
    full_scale_value: float,
    weights: FloatArray,
    rounding_mv: float = 0.0,
) -> tuple[Figure, Figure]:
    """Return the noise rms (mV) and the SNR (dB) = 20 log10(FSO / noise), with intervals over cycles.

    `parts`: sums of squares, degrees of freedom and cycle, as `staircase_noise` returns them. `weights`: [resamples,
    cycles] bootstrap weights. `rounding_mv`: noise that the rounding of doubles at the signal's level may make; less
    counts as none.
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
    noise_figure = bootstrap_figure(
        noise, replicates, "mV", len(numbers), "rms about the plateau's mean or a local cubic"
    )
    # a few cycles may agree by chance: white noise of so many samples is known no better than this (chi-square)
    least = 1.96 / np.sqrt(2.0 * dof.sum())
    noise_figure = at_least(noise_figure, noise * least)
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
        none = replace(no_full_scale("dB", definition), value=float("-inf"), n=len(numbers))
        return noise_figure, none
    value = float(20.0 * np.log10(full_scale_value / noise))
    snr = bootstrap_figure(value, snr_replicates, "dB", len(numbers), definition)
    return noise_figure, at_least(snr, 20.0 * np.log10(1.0 + least))
