"""Dynamics of the elongation: a model from one step test, the loop's margins, a Bode plot from a sweep, step figures.

The model is a delay and a second-order lag of gain 1, fitted by least squares, with intervals widened for the
residuals' autocorrelation. The loop is an integrator, the model, and the controller's period: half of it from holding
the command, half from averaging the samples.

Sources: K. J. Astrom, R. M. Murray, Feedback Systems, 2nd edition (2021), chapters 10 and 11; IEC 60050-351 (rise,
settling, overshoot).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.signal import lsim
from scipy.stats import t as student

from analysis.elongation_control.dynamic_figures import BodePoint, DynamicFigure, StepFigures
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError
from protocol.base.units import COVERAGE_FACTOR

STEP_S = 0.01  # of the integration of a response
_LEAST_R2 = 0.9


@dataclass(frozen=True, slots=True)
class Lag:
    """A delay and a second-order lag of gain 1: exp(-s L) w^2 / (s^2 + 2 z w s + w^2); their covariance [3, 3]."""

    delay_s: float
    omega_rad_per_s: float
    damping: float
    covariance: tuple[tuple[float, ...], ...] = ((0.0,) * 3,) * 3

    @property
    def lag_s(self) -> float:
        """How far the response stays behind a slow ramp."""
        return self.delay_s + 2.0 * self.damping / self.omega_rad_per_s

    def response(self, omega: FloatArray) -> FloatArray:
        """Return the complex frequency response at angular frequencies [n], rad/s."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        w, z = self.omega_rad_per_s, self.damping
        return np.asarray(np.exp(-s * self.delay_s) * w * w / (s * s + 2.0 * z * w * s + w * w))

    def follow(self, time_s: FloatArray, command: FloatArray) -> FloatArray:
        """Return the response [n] at times [n] to a command [n] that was constant before the first."""
        grid = np.arange(time_s[0], time_s[-1] + STEP_S, STEP_S)
        moved = np.interp(grid - self.delay_s, time_s, command) - command[0]
        w, z = self.omega_rad_per_s, self.damping
        _, found, _ = lsim(([w * w], [1.0, 2.0 * z * w, w * w]), moved, grid - grid[0])
        return np.asarray(command[0] + np.interp(time_s, grid, found))


@dataclass(frozen=True, slots=True)
class Margins:
    """Margins of a loop. `crossover_hz`: where its gain is 1; `delay_s`: that it can bear in addition."""

    gain_db: float
    phase_deg: float
    crossover_hz: float
    delay_s: float


def fit_lag(time_s: FloatArray, command_mm: FloatArray, elongation_mm: FloatArray) -> Lag:
    """Return the model of a recorded response."""
    known = np.isfinite(elongation_mm) & np.isfinite(command_mm)
    time_s, command, x = time_s[known], command_mm[known], elongation_mm[known]
    step = abs(float(command[-1] - command[0])) if len(x) else 0.0
    if len(x) < 20 or step == 0.0:
        raise DataError("the step test has no step, or too few samples", "Repeat it with a larger step.")

    def residuals(parameters: FloatArray) -> FloatArray:
        lag = Lag(float(parameters[0]), float(np.exp(parameters[1])), float(np.exp(parameters[2])))
        shape = np.stack([lag.follow(time_s, command), np.ones(len(x))], axis=1)
        return np.asarray(x - shape @ np.linalg.lstsq(shape, x, rcond=None)[0])

    starts = [(0.05, math.log(w), math.log(0.8)) for w in (3.0, 12.0)]
    fits = [least_squares(residuals, start, bounds=([0.0, -2.3, -2.3], [3.0, 5.0, 2.3])) for start in starts]
    fit = min(fits, key=lambda one: one.cost)
    rest = fit.fun
    r2 = 1.0 - float(rest @ rest) / max(float(((x - x.mean()) ** 2).sum()), 1e-30)
    if r2 < _LEAST_R2:
        cause = f"the elongation does not follow the step (R² {r2:.2f}, at least {_LEAST_R2:g} is needed)"
        raise DataError(cause, "Repeat the step test with a larger step, and check pump and sensors.")
    delay, omega, damping = float(fit.x[0]), math.exp(fit.x[1]), math.exp(fit.x[2])
    r = min(max(float(rest[1:] @ rest[:-1]) / max(float(rest @ rest), 1e-30), 0.0), 0.95)
    variance = float(rest @ rest) / (len(x) - 5) * (1.0 + r) / (1.0 - r)
    jacobian = fit.jac / np.array([1.0, omega, damping])
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    return Lag(delay, omega, damping, tuple(tuple(row) for row in covariance.tolist()))


def loop_margins(lag: Lag, integral_per_s: float, period_s: float) -> Margins:
    """Return the margins of an integrator around a lag."""
    omega = np.geomspace(1e-3, math.pi / period_s, 6000)
    loop = integral_per_s / (1j * omega) * lag.response(omega) * np.exp(-1j * omega * period_s)
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    over = np.flatnonzero((size[:-1] >= 1.0) & (size[1:] < 1.0))  # the last crossing is the one that matters
    turned = np.flatnonzero((phase[:-1] > -math.pi) & (phase[1:] <= -math.pi))
    gain_db = -20.0 * math.log10(float(size[turned[0]])) if len(turned) else math.inf
    if not len(over):
        return Margins(gain_db, math.inf, math.nan, math.inf)
    at = int(over[-1])
    phase_margin = math.pi + float(phase[at])
    return Margins(gain_db, math.degrees(phase_margin), float(omega[at]) / (2 * math.pi), phase_margin / omega[at])


def integral_for(lag: Lag, period_s: float) -> float:
    """Return the largest gain of the integrator, 1/s, that leaves 60 degrees and 10 dB."""

    def spare(log_gain: float) -> float:
        margins = loop_margins(lag, math.exp(log_gain), period_s)
        return min(margins.phase_deg - 60.0, 6.0 * (margins.gain_db - 10.0), 1e3)

    low, high = math.log(1e-3), math.log(20.0)
    if spare(high) > 0:
        return 20.0
    return math.exp(float(brentq(spare, low, high, xtol=1e-3)))


def bode_point(time_s: FloatArray, setpoint: FloatArray, elongation: FloatArray, frequency_hz: float) -> BodePoint:
    """Return gain and phase at one frequency, by least squares of sine, cosine, mean and trend.

    Their uncertainties are unknown: what changes between repeats, such as creep, is far more than the residuals show.
    """
    known = np.isfinite(elongation) & np.isfinite(setpoint)
    if known.sum() < 12:
        raise DataError(f"too few samples at {frequency_hz:g} Hz", "Sample faster, or sweep more periods.")
    t = time_s[known]
    angle = 2.0 * math.pi * frequency_hz * t
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones(len(t)), t - t.mean()], axis=1)
    (a, b, *_), *_ = np.linalg.lstsq(columns, setpoint[known], rcond=None)
    (c, d, *_), *_ = np.linalg.lstsq(columns, elongation[known], rcond=None)
    ratio = complex(c, -d) / complex(a, -b)
    gain, phase = 20.0 * math.log10(abs(ratio)), math.degrees(math.atan2(ratio.imag, ratio.real))
    return BodePoint(frequency_hz, gain, phase, math.nan, math.nan)


def mean_bode_point(repeats: Sequence[BodePoint]) -> BodePoint:
    """Return the mean of repeats of one sine; U (k = 2) is then the 95 % interval of their mean (Student t)."""
    n = len(repeats)
    if n < 2:
        return repeats[0]
    gain, phase = (np.array([getattr(one, name) for one in repeats]) for name in ("gain_db", "phase_deg"))
    phase = np.degrees(np.unwrap(np.radians(phase)))
    half = float(student.ppf(0.975, n - 1)) / math.sqrt(n) / COVERAGE_FACTOR
    u_gain, u_phase = (half * float(one.std(ddof=1)) for one in (gain, phase))
    return replace(
        repeats[0],
        gain_db=float(gain.mean()),
        phase_deg=float(phase.mean()),
        u_gain_db=u_gain,
        u_phase_deg=u_phase,
        n=n,
    )


def bandwidth(points: Sequence[BodePoint]) -> DynamicFigure:
    """Return the lowest frequency at -3 dB, Hz, and its interval where every gain is off by U (k = 2); NaN beyond."""
    return DynamicFigure(*(_edge_hz(points, COVERAGE_FACTOR * side) for side in (0.0, -1.0, 1.0)))


def _edge_hz(points: Sequence[BodePoint], off: float) -> float:
    """Return the frequency at -3 dB with the gains off by so many standard uncertainties."""
    found = sorted((one.frequency_hz, one.gain_db + (off * one.u_gain_db if off else 0.0)) for one in points)
    for (low_hz, above), (high_hz, below) in pairwise(found):
        if above >= -3.0 > below:
            return float(low_hz * (high_hz / low_hz) ** ((above + 3.0) / (above - below)))
    return math.nan


def lag_figures(lag: Lag, draws: int = 200) -> StepFigures:
    """Return the figures of a model's unit step, with intervals from the covariance of its parameters."""
    generator = np.random.default_rng(0)
    mean = np.array([lag.delay_s, lag.omega_rad_per_s, lag.damping])
    drawn = generator.multivariate_normal(mean, np.asarray(lag.covariance), size=draws, method="eigh")
    rows = np.array([_step_values(Lag(*row)) for row in np.maximum(drawn, [0.0, 0.05, 0.02]).tolist()])
    values = _step_values(lag)
    low, high = np.percentile(rows, [2.5, 97.5], axis=0)
    return StepFigures(*(DynamicFigure(*map(float, one)) for one in zip(values, low, high, strict=True)))


def step_figures(
    time_s: Sequence[FloatArray], elongation_mm: Sequence[FloatArray], steps_mm: Sequence[float], tolerance_mm: float
) -> dict[str, DynamicFigure]:
    """Return rise, settling, overshoot and time constant of repeated steps: mean and its 95 % interval (Student t)."""
    rows = np.array([
        _recorded_values(t, x / step, tolerance_mm / abs(step))
        for t, x, step in zip(time_s, elongation_mm, steps_mm, strict=True)
    ])  # fmt: skip
    names = ("time_constant_s", "rise_s", "settling_s", "overshoot_percent")
    mean, n = rows.mean(axis=0), len(rows)
    half = student.ppf(0.975, n - 1) * rows.std(axis=0, ddof=1) / math.sqrt(n) if n > 1 else np.full(4, math.nan)
    return {k: DynamicFigure(float(m), float(m - h), float(m + h)) for k, m, h in zip(names, mean, half, strict=True)}


def _recorded_values(time_s: FloatArray, share: FloatArray, tolerance: float) -> tuple[float, float, float, float]:
    """Return time constant, rise, settling (s) and overshoot (%) of a normalised response."""

    def first(level: float) -> float:
        over = np.flatnonzero(share >= level)
        if not len(over):
            return math.nan
        at = int(over[0])
        if at == 0:
            return float(time_s[0])
        return float(np.interp(level, share[at - 1 : at + 1], time_s[at - 1 : at + 1]))

    noise = 2.0 * float(share[-(len(share) // 4) :].std())  # of the settled part: it is no departure, and no overshoot
    outside = np.flatnonzero(np.abs(share - 1.0) > tolerance + noise)
    settled = float(time_s[min(int(outside[-1]) + 1, len(time_s) - 1)]) if len(outside) else float(time_s[0])
    over = float(share.max()) - 1.0
    return first(0.632), first(0.9) - first(0.1), settled, max(0.0, 100.0 * (over - noise))


def _step_values(lag: Lag) -> tuple[float, ...]:
    """Return the six values of `StepFigures`."""
    span = lag.delay_s + 12.0 * max(1.0, lag.damping) / lag.omega_rad_per_s / min(1.0, lag.damping)
    t = np.linspace(0.0, span, 1200)
    s = np.clip(t - lag.delay_s, 0.0, None)
    w, z = lag.omega_rad_per_s, lag.damping
    root = np.sqrt(complex(z * z - 1.0)) if abs(z - 1.0) > 1e-6 else complex(1e-3)
    slow, fast = w * (-z + root), w * (-z - root)
    unit = np.real(1.0 + (fast * np.exp(slow * s) - slow * np.exp(fast * s)) / (slow - fast))
    omega = np.geomspace(w / 100.0, w * 10.0, 2000)
    below = np.abs(lag.response(omega)) < math.sqrt(0.5)
    edge = float(omega[int(np.argmax(below))]) / (2.0 * math.pi)
    phase = -math.degrees(np.unwrap(np.angle(lag.response(np.linspace(0.0, 0.2 * math.pi * edge, 50))))[-1])
    return (*_recorded_values(t, np.asarray(unit), 0.02), edge, phase)
