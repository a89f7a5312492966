"""The delay of a camera: by how much its frames are later than the board's samples of the same instant.

Strategy: a sensor's signal follows the elongation without delay, and over one branch is a smooth function of it. So in
a window of up to five ramps of one direction with the holds about them, every signal is fitted as a polynomial of the
elongation shifted in time: the signal has the noise. The shift with the least residuals is the delay. More ramps tell
a delay from the branch's shape better than one. Where a run turns without a hold, each branch has its own polynomial,
because of the hysteresis. Every window gives a delay; their mean without outliers is that of the run, its uncertainty
follows from their scatter, and their trend is the drift of the two clocks.

A video whose beginning is unknown is first laid over the run by the cross-correlation of elongation and pressure.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from analysis.statistics import white_noise_sd
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import DataError

NEARLY = 0.02  # correlations that differ by less are equal
COARSE_U_S = 0.1  # of a place that no ramp makes finer


def place_second(first: Mapping[str, FloatArray], second: Mapping[str, FloatArray]) -> tuple[float, float]:
    """Return when the second file begins in the time of the first, from its first row, s, and the standard uncertainty.

    Pressures are compared where both files have one, else the pressure with the first signal, of either sign. Raises
    DataError: nothing in the files follows one another.
    """
    one, two = _compared(first, second)
    begin_s, end_s = first["time_s"] - first["time_s"][0], second["time_s"] - second["time_s"][0]
    known = np.isfinite(one)
    found = []
    for sign in (1.0, -1.0):
        try:
            at_s = find_place(end_s, sign * two, begin_s[known], one[known])
        except DataError:
            continue
        found.append((*_alike(begin_s[known], one[known], end_s + at_s, sign * two), at_s, sign))
    if not found:
        cause = "the two files do not show one run: nothing in the second follows what the first shows"
        raise DataError(cause, "Give the files of one run, with dates in both, or map the columns that move together.")
    # half a cycle away the other sign is as much alike: then the longer overlap counts
    best = max(alike for alike, *_ in found)
    _, _, place_s, sign = max((entry for entry in found if entry[0] > best - NEARLY), key=lambda entry: entry[1])
    delay = find_delay(end_s + place_s, sign * two, begin_s[known], one[known, None])
    return (place_s, COARSE_U_S) if delay is None else (place_s - delay.delay_s, delay.u_s)


def _alike(time_s: FloatArray, values: FloatArray, own_s: FloatArray, others: FloatArray) -> tuple[float, int]:
    """Return the correlation of values with others where both are known, and how many rows that are."""
    inside = (time_s >= own_s[0]) & (time_s <= own_s[-1])
    known = np.isfinite(others)
    at = np.interp(time_s[inside], own_s[known], others[known])
    return float(np.corrcoef(values[inside], at)[0, 1]), int(inside.sum())


def _compared(first: Mapping[str, FloatArray], second: Mapping[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    signals = [sorted(name for name in values if name.endswith("_mv")) for values in (first, second)]
    if "pressure_kpa" in first and "pressure_kpa" in second:
        return first["pressure_kpa"], second["pressure_kpa"]
    if "pressure_kpa" in first and signals[1]:
        return first["pressure_kpa"], second[signals[1][0]]
    if "pressure_kpa" in second and signals[0]:
        return first[signals[0][0]], second["pressure_kpa"]
    raise DataError("the two files have not both a pressure and a signal", "Map the columns.")


COARSE_HZ = 20.0
LEAST_OVERLAP = 0.3  # of the shorter record, when its place is sought
LEAST_CORRELATION = 0.8
REACH_S = 0.4  # the delay is sought this far about the expected one
STEPS_S = (0.02, 0.004)
_HOLD_S, BRANCH_S = 1.5, 2.0  # of a hold, and of a branch at a turn, in a window
RAMPS_MOST, RAMP_S = 5, 3.0  # of one direction in a window; a longer ramp counts as several
DEGREE_MOST = 4  # of signal over elongation
_MOVING = 0.2  # of the high speed of the run
_FEWEST_FRAMES = 12  # of a window
LONGEST_GAP = 4.5  # intervals of frames inside a window
TURN_S = 0.8  # the elongation turns this near to the signal
WINDOWS_MAX = 200
FEWEST_FOR_DRIFT = 10


@dataclass(frozen=True, slots=True)
class Delay:
    """The delay of a camera's frames."""

    delay_s: float  # with u_s: at `about_s`, and its standard uncertainty
    u_s: float
    drift: float  # with u_drift: growth of the delay, s/s; 0 where too few windows show one
    u_drift: float
    about_s: float  # middle of the windows, recording time
    windows: FloatArray  # [n, 2] time and delay of each

    @property
    def certain_drift(self) -> float:
        """The drift where it is beyond two standard uncertainties, else 0."""
        return self.drift if abs(self.drift) > 2.0 * self.u_drift else 0.0


def find_place(frame_s: FloatArray, elongation_mm: FloatArray, time_s: FloatArray, pressure_kpa: FloatArray) -> float:
    """Return the time of a recording at which a video begins its own time, to about 0.1 s.

    `frame_s`, `elongation_mm`: [frames] of the video, NaN where there is none. `time_s`, `pressure_kpa`: [n] of the
    recording.
    Raises DataError: the video does not show this run.
    """
    seen = np.isfinite(elongation_mm)
    cause = "the video does not show the run: its elongation does not follow the pressure"
    if seen.sum() < 2 * COARSE_HZ or np.ptp(elongation_mm[seen]) <= 0 or np.ptp(pressure_kpa) <= 0:
        raise DataError(cause, "Check that it is the video of this recording and shows the unit moving.")
    x, x0 = _on_grid(frame_s[seen], elongation_mm[seen])
    p, p0 = _on_grid(time_s, pressure_kpa)
    size = 1 << (x.size + p.size).bit_length()

    def correlate(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray(np.fft.irfft(np.fft.rfft(a, size) * np.conj(np.fft.rfft(b, size)), size))

    one_x, one_p = np.ones(x.size), np.ones(p.size)
    x, p = x - x.mean(), p - p.mean()
    n = np.maximum(np.rint(correlate(one_p, one_x)), 1.0)
    sum_p, sum_x = correlate(p, one_x), correlate(one_p, x)
    var_p = correlate(p * p, one_x) - sum_p**2 / n
    var_x = correlate(one_p, x * x) - sum_x**2 / n
    floor = 0.1 * min(x.size * x.var(), p.size * p.var() * (x.size / p.size if p.size > x.size else 1.0))
    enough = (n >= LEAST_OVERLAP * min(x.size, p.size)) & (var_p > 1e-3 * p.var() * n) & (var_x > 1e-3 * x.var() * n)
    enough &= np.isfinite(floor)
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.where(enough, (correlate(p, x) - sum_p * sum_x / n) / np.sqrt(var_p * var_x), -1.0)
    # of equally good places, as cycles repeat, the one of the longest overlap
    best = float(score.max())
    if not best >= LEAST_CORRELATION:
        raise DataError(cause, "Check that it is the video of this recording and shows the unit moving.")
    near = np.flatnonzero(score > best - 0.01)
    at = int(near[np.argmax(n[near])])
    at = int(near[np.argmax(np.where(abs(n[near] - n[at]) < COARSE_HZ, score[near], -1.0))])
    lag = at - size if at > size // 2 else at
    return p0 + lag / COARSE_HZ - x0


def find_delay(
    frame_s: FloatArray, elongation_mm: FloatArray, time_s: FloatArray, signals: FloatArray, expected_s: float = 0.0
) -> Delay | None:
    """Return the delay of the frames; None where no ramp shows it.

    `frame_s`, `elongation_mm`: [frames] on the recording's clock but for the delay; NaN where there is none. `time_s`:
    [n] of the recording, increasing. `signals`: [n, signals] of the sensors, or the pressure; rows with NaN are left
    out. `expected_s`: the delay to within `REACH_S`.
    """
    seen, good = np.isfinite(elongation_mm), np.isfinite(signals).all(axis=1)
    t, x = frame_s[seen], elongation_mm[seen]
    if t.size < _FEWEST_FRAMES or good.sum() < _FEWEST_FRAMES or not np.ptp(x) > 0:
        return None
    time_s, signals = time_s[good], signals[good]
    noise = np.array([white_noise_sd(column) for column in signals.T])
    signals = signals[:, noise > 0] / noise[noise > 0]
    if not signals.shape[1]:
        return None
    clearest = signals[:, int(np.argmax(np.ptp(signals, axis=0)))]
    windows = _windows(time_s, clearest)
    every = np.unique(np.linspace(0, len(windows) - 1, WINDOWS_MAX).astype(int)).tolist() if windows else []
    found = []
    reach_s = REACH_S + STEPS_S[-1]
    for window in (windows[i] for i in every):  # as far as frames reach about it
        first_s = max(window.first_s, float(t[0]) - expected_s + reach_s)
        last_s = min(window.last_s, float(t[-1]) - expected_s - reach_s)
        part = slice(*np.searchsorted(time_s, [first_s, last_s]))
        delay = _of_window(time_s[part], signals[part], t, x, window, expected_s) if last_s > first_s else None
        if delay is not None:
            found.append((0.5 * (first_s + last_s), *delay))
    return _together(np.array(found)) if found else None


def _together(found: FloatArray) -> Delay:
    """Return the delay of windows [n, 3]: time, delay, and its standard uncertainty by the noise of the signals."""
    at_s, delay_s, u_s = found.T
    middle = float(np.median(delay_s))
    spread = max(1.4826 * float(np.median(abs(delay_s - middle))), float(np.median(u_s)))
    kept = abs(delay_s - middle) <= 4.0 * spread
    at_s, delay_s, weights = at_s[kept], delay_s[kept], 1.0 / u_s[kept] ** 2
    total, n = float(weights.sum()), at_s.size
    about_s, mean = float(weights @ at_s) / total, float(weights @ delay_s) / total
    left, drift, u_drift, used = delay_s - mean, 0.0, 0.0, 1
    lever = float(weights @ (at_s - about_s) ** 2)
    if n >= FEWEST_FOR_DRIFT and lever > 0:
        drift = float(weights @ ((at_s - about_s) * left)) / lever
        left, used = left - drift * (at_s - about_s), 2
    excess = max(1.0, float(weights @ left**2) / (n - used)) if n > used else 1.0  # scatter beyond the noise
    if used == 2:
        u_drift = float(np.sqrt(excess / lever))
    return Delay(mean, float(np.sqrt(excess / total)), drift, u_drift, about_s, found[:, :2])


def _on_grid(t: FloatArray, y: FloatArray) -> tuple[FloatArray, float]:
    """Return a record on the coarse grid, and its first time."""
    grid = np.arange(t[0], t[-1], 1.0 / COARSE_HZ)
    return np.interp(grid, t, y), float(t[0])


@dataclass(frozen=True, slots=True)
class _Window:
    """A stretch in which a delay shows: its ends, where the run turns, if it does, direction and number of ramps."""

    first_s: float
    last_s: float
    turn_s: float | None
    direction: int = 0
    ramps: int = 1

    @property
    def degree(self) -> int:
        """Of the signal over elongation."""
        return min(1 + self.ramps, DEGREE_MOST)


def _windows(time_s: FloatArray, signal_mv: FloatArray) -> list[_Window]:
    """Return the windows in which a delay shows."""
    interval_s = float(np.median(np.diff(time_s)))
    width = max(3, round(0.3 / interval_s))
    speed = np.gradient(uniform_filter1d(signal_mv, width), time_s)
    speed = uniform_filter1d(speed, width)
    limit = _MOVING * float(np.quantile(abs(speed), 0.97))
    state = np.where(speed > limit, 1, np.where(speed < -limit, -1, 0))
    edges = [0, *(np.flatnonzero(np.diff(state)) + 1).tolist(), state.size]
    runs: list[tuple[int, float, float]] = []
    for first, last in itertools.pairwise(edges):
        begin, end = float(time_s[first]), float(time_s[last - 1])
        if state[first] == 0 and end - begin < 0.4 and runs and runs[-1][0]:
            continue  # the instant of a turn
        runs.append((int(state[first]), begin, end))
    found: list[_Window] = []
    for i, (direction, begin, end) in enumerate(runs):
        if not direction:
            continue
        after = runs[i + 1] if i + 1 < len(runs) else None
        before = runs[i - 1] if i else None
        if after is not None and after[0] == -direction:
            turn_s = 0.5 * (end + after[1])
            found.append(_Window(max(begin, end - BRANCH_S), min(after[2], after[1] + BRANCH_S), turn_s))
        if before is not None and after is not None and not before[0] and not after[0]:
            first_s, last_s = max(before[1], begin - _HOLD_S), min(after[2], end + _HOLD_S)
            ramps = max(1, round((end - begin) / RAMP_S))
            same = found[-1] if found and found[-1].direction == direction else None
            if same is not None and same.ramps + ramps <= RAMPS_MOST:
                found[-1] = replace(same, last_s=last_s, ramps=same.ramps + ramps)
            else:
                found.append(_Window(first_s, last_s, None, direction, ramps))
    return found


def _of_window(
    time_s: FloatArray, signals: FloatArray, t: FloatArray, x: FloatArray, window: _Window, expected_s: float
) -> tuple[float, float] | None:
    """Return the delay with the least residuals in a window, and its standard uncertainty; None where there is none.

    `time_s`, `signals`: [n], [n, signals] of the window. `t`, `x`: [frames] of the record.
    """
    near = slice(*np.searchsorted(t, [time_s[0] + expected_s - REACH_S - 0.1, time_s[-1] + expected_s + REACH_S + 0.1]))
    t, x = t[near], x[near]
    if t.size < _FEWEST_FRAMES or t[0] > time_s[0] + expected_s - REACH_S or t[-1] < time_s[-1] + expected_s + REACH_S:
        return None
    if float(np.diff(t).max()) > LONGEST_GAP * float(np.median(np.diff(t))):
        return None
    turn_s = window.turn_s
    if turn_s is not None:  # the extremum of the elongation
        about = abs(t - turn_s - expected_s) < TURN_S
        if about.sum() < 3:
            return None
        rises = x[about].mean() > np.interp(turn_s + expected_s - 1.5, t, x)
        turn_s = float(t[about][np.argmax(x[about]) if rises else np.argmin(x[about])])
    reach_s, found = REACH_S, expected_s
    for step_s in STEPS_S:
        delays = found + step_s * np.arange(-round(reach_s / step_s), round(reach_s / step_s) + 1)
        costs = np.array(
            [_cost(np.interp(time_s + d, t, x), signals, time_s + d, turn_s, window.degree) for d in delays]
        )
        at = int(np.argmin(costs))
        if not 1 <= at < costs.size - 1 or (step_s == STEPS_S[0] and float(np.median(costs)) < 1.1 * costs[at]):
            return None
        found, reach_s = float(delays[at]), 3 * step_s
    parabola = np.polynomial.Polynomial.fit(delays, costs, 2)
    curvature = float(parabola.deriv(2)(found))
    lowest = float(parabola.deriv().roots()[0].real)
    if curvature <= 0 or abs(lowest - found) > reach_s:
        return None
    return lowest, float(np.sqrt(2.0 / curvature))  # the costs are chi squared


def _cost(x: FloatArray, signals: FloatArray, at_s: FloatArray, turn_s: float | None, degree: int) -> float:
    """Return the sum of squares that polynomials of x leave of the signals, one for each branch.

    `x`, `signals`, `at_s`: [n], [n, signals] and [n] elongation and signals over the errors, at times of the frames.
    `turn_s`: where the run turns, or None.
    """
    z = (x - x.mean()) / (float(np.ptp(x)) or 1.0)
    branches: IntArray = np.zeros(z.size, np.int64) if turn_s is None else (at_s > turn_s).astype(np.int64)
    columns = [
        np.where(branches == branch, z**power, 0.0) for branch in np.unique(branches) for power in range(degree + 1)
    ]
    design, _ = np.linalg.qr(np.stack(columns, axis=1))
    return float((signals**2).sum() - ((design.T @ signals) ** 2).sum())
