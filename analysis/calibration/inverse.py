"""From mV to mm: the inverse of a calibration, with its uncertainty, for one sensor or several.

The curve is kept as powers of the scaled variable. A table of 257 nodes gives the start; Newton's method, bracketed by
bisection, the value. The uncertainty is interpolated between 129 nodes. An inverse in a file or in code
(`calibration_export`) gives the same values. Outside the range the value is NaN and marked, or the end on request. Up
to two standard uncertainties and half a division of the grid beyond it, it follows the tangent at the end and is
marked, since noise carries half the signals of the end there. A curve that turns inside its range is refused. Source:
ISO/TS 28038:2018, clause 8.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre, polynomial

from analysis.calibration.adequacy import expanded
from analysis.calibration.fit import Calibration
from analysis.calibration.type_b import TypeBContribution, reference_terms
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import DataError, RequestError
from protocol.base.units import COVERAGE_FACTOR

NODES = 257
U_NODES = 129
_AT_ONCE = 1 << 14  # signals, whose intermediate results stay in the cache of the processor
DISAGREEMENT_SIGMA = 4.0
_LEVEL = 1e-100  # mV/mm; a curve may be level at its very end
BEYOND_SIGMA = 2.0  # standard uncertainties beyond an end of the range, as it was read, that a value is given for


@dataclass(frozen=True, slots=True)
class ElongationEstimate:
    """Elongations with their uncertainty, k = 1; NaN where they are not known.

    `outside`: the signal is outside the range by more than two standard uncertainties and half a division of the grid;
    `beyond`: by less, from the tangent at the end; `disagreement`: two sensors differ by more than 4 sigma.
    """

    elongation_mm: FloatArray
    standard_uncertainty_mm: FloatArray
    outside: BoolArray
    beyond: BoolArray
    disagreement: BoolArray


def raise_without_inverse(calibration: Calibration, *, by_parts: bool = False) -> None:
    """Raise a DataError if a curve gives no elongation; `by_parts` allows one that turns inside its range."""
    turns = calibration.turns_inside
    if not calibration.monotone and not (by_parts and turns):
        where = f"it turns at {', '.join(f'{turn:.3g}' for turn in turns)}" if turns else "it is flat"
        cause = f"the calibration has no inverse over its range: {where}"
        raise DataError(cause, "Calibrate over a range where it is monotone.")
    if calibration.adequacy is not None and calibration.adequacy.refused:
        raise DataError(
            f"the curve misses the readings by {calibration.adequacy.remainder_percent:.1f} % FSO (rms)",
            "Choose the curve by cross-validation (degree auto).",
        )


@dataclass(frozen=True, slots=True)
class Inverse:
    """mV -> mm for one sensor. Make one with `Inverse.of(calibration)`; call it with an array of mV."""

    x_range: tuple[float, float]  # mm, mapped to u = -1..1
    starts: FloatArray  # [pieces + 1] ends of the pieces in u
    powers: FloatArray  # [pieces, degree + 1] of the signal, mV, in powers of u less the piece's middle
    nodes: FloatArray  # [NODES] signal at equally spaced u
    noise_mm: FloatArray  # [U_NODES] standard uncertainty at equally spaced u, by the noise of one signal
    shared_mm: FloatArray  # by what the sensors of one unit share in part; at most the width of the range
    half_division_mm: float = 0.0
    reference: tuple[float, float] = (0.0, 0.0)  # type B: a constant, mm, and a share of x, which add in squares
    calibration: Calibration | None = None
    u_void: str = ""  # why U is not known; what is known then weighs the sensors alone
    u_stand_in: str = ""

    def __repr__(self) -> str:
        low, high = np.sort(self.nodes[[0, -1]])
        return f"<Inverse: {low:.5g} to {high:.5g} mV give {self.x_range[0]:.3g} to {self.x_range[1]:.3g} mm>"

    @classmethod
    def of(
        cls,
        calibration: Calibration,
        *,
        noise_sd: npt.ArrayLike | None = None,
        model_sd: float = 0.0,
        half_loop: npt.ArrayLike = 0.0,
        reading_sd: float = 0.0,
        type_b: tuple[TypeBContribution, ...] = (),
        u_void: str = "",
        u_stand_in: str = "",
    ) -> Inverse:
        """Prepare the inverse. DataError: the curve turns inside its range, or is refused for its lack of fit.

        Parameters
        ----------
        noise_sd : sd of one new signal, mV, as `half_loop`, independent between sensors; by default that of the fit.
        model_sd : sd of what the curve leaves out and the sensors share (repeatability, drift), mV.
        half_loop : half the sensor's loop, mV: at equally spaced x from end to end of the range, or everywhere.
        reading_sd : sd of the readings of x, mm, if the calibration does not know its positions.
        type_b : contributions of the reference, the same in every sensor.
        """
        if calibration.reading is None:
            calibration = calibration.with_reading(reading_sd)
        raise_without_inverse(calibration)
        starts, powers = _pieces(calibration)
        x = np.linspace(*calibration.x_range, U_NODES)
        own = calibration.residual_sd if noise_sd is None else noise_sd
        given = (np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (own, half_loop))
        noise, loop = (np.interp(x, np.linspace(*calibration.x_range, one.size), one) for one in given)
        parts = _uncertainty(calibration, x, noise, model_sd, loop)
        half_division = calibration.reading.grid / 2.0 if calibration.reading is not None else 0.0
        nodes = signal_at(np.linspace(-1.0, 1.0, NODES), starts, powers)
        terms = reference_terms(type_b)
        return cls(
            calibration.x_range, starts, powers, nodes, *parts, half_division, terms, calibration, u_void, u_stand_in
        )

    def __call__(self, signal: npt.ArrayLike, *, clamp: bool = False) -> FloatArray:
        """Return x for every signal, of any shape; NaN outside the range, or its end with `clamp`."""
        values = np.asarray(signal, dtype=np.float64)
        flat, u = values.ravel(), np.empty(values.size)
        for first in range(0, flat.size, _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            u[part] = _invert(flat[part], self.starts, self.powers, self.nodes, clamp)
        low, half_width = self.x_range[0], 0.5 * (self.x_range[1] - self.x_range[0])
        return np.asarray(low + half_width + half_width * u.reshape(values.shape), dtype=np.float64)

    @property
    def end_slopes(self) -> tuple[float, float]:
        """dy/dx at the two ends of the range, mV/mm."""
        half_width = 0.5 * (self.x_range[1] - self.x_range[0])
        low, high = (
            float(polynomial.polyval(side * 0.5 * width, polynomial.polyder(powers))) / half_width
            for side, width, powers in zip(
                (-1.0, 1.0), np.diff(self.starts)[[0, -1]], self.powers[[0, -1]], strict=True
            )
        )
        return low, high

    @property
    def last_signals(self) -> tuple[float, float]:
        """The lowest and the highest signal that a value is given for, mV."""
        reach = BEYOND_SIGMA * self.known_u(self.x_range) + self.half_division_mm
        low, high = np.sort(self.nodes[[0, -1]] + np.array([-1.0, 1.0]) * (1.0 - 1e-9) * reach * self.end_slopes)
        return float(low), float(high)

    def standard_uncertainty(self, x: npt.ArrayLike) -> FloatArray:
        """Return u(x) of one new reading: noise, curve and reference, half of U where the curve misses; NaN unknown."""
        return np.full(np.shape(x), np.nan) if self.u_void else self.known_u(x)

    def known_u(self, x: npt.ArrayLike) -> FloatArray:
        """Return u(x) of what is known: u itself, unless `u_void` says that more is not."""
        noise, shared = self.parts(x)
        return np.asarray(np.sqrt(noise**2 + shared**2 + self.reference_u(x) ** 2), dtype=np.float64)

    def parts(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return u(x) of the noise alone, and of what sensors of one unit share in part: model, curve and reading."""
        at, grid = np.asarray(x, dtype=np.float64), np.linspace(*self.x_range, U_NODES)
        return np.asarray(np.interp(at, grid, self.noise_mm)), np.asarray(np.interp(at, grid, self.shared_mm))

    def reference_u(self, x: npt.ArrayLike) -> FloatArray:
        """Return the standard uncertainty of the reference: fully correlated, so that no weighing reduces it."""
        constant, relative = self.reference
        return np.asarray(np.hypot(constant, relative * np.asarray(x, dtype=np.float64)), dtype=np.float64)

    def evaluate(self, signal: npt.ArrayLike, *, clamp: bool = False) -> ElongationEstimate:
        """Return x with its uncertainty, and where it is outside the range or a little beyond its end."""
        values = np.asarray(signal, dtype=np.float64)
        inside, end = self(values), self(values, clamp=True)
        uncertainty = self.known_u(end)
        past = np.isnan(inside) & ~np.isnan(values)
        x, beyond = end if clamp else inside, np.zeros(values.shape, dtype=bool)
        if past.any():
            at_low = end == self.x_range[0]
            with np.errstate(divide="ignore", invalid="ignore"):  # the tangent may be level
                away = values - np.where(at_low, self.nodes[0], self.nodes[-1])
                tangent = away / np.where(at_low, *self.end_slopes)
                reach = BEYOND_SIGMA * uncertainty + self.half_division_mm
                beyond = np.asarray(past & (np.abs(tangent) <= reach), dtype=bool)
            x = np.where(beyond, end + tangent, x)
        outside = np.asarray(past & ~beyond, dtype=bool)
        none = np.zeros(x.shape, dtype=bool)
        stated = np.where(np.isnan(x) | bool(self.u_void), np.nan, uncertainty)
        return ElongationEstimate(x, stated, outside, beyond, none)


def signal_at(u: FloatArray, starts: FloatArray, powers: FloatArray) -> FloatArray:
    """Return the signal of a curve in pieces at the scaled variable u [n], -1 to 1."""
    piece = np.clip(np.searchsorted(starts, u, side="right") - 1, 0, len(powers) - 1)
    middle = 0.5 * (starts[piece] + starts[piece + 1])
    return np.asarray(polynomial.polyval(u - middle, powers[piece].T, tensor=False), dtype=np.float64)


def _pieces(calibration: Calibration) -> tuple[FloatArray, FloatArray]:
    """Return `starts` and `powers` of an inverse; u = -1 and 1 are the ends of the range itself."""
    if calibration.spline is None:
        powers = np.asarray(legendre.leg2poly(calibration.fit.basis_coefficients), dtype=np.float64)
        return np.asarray([-1.0, 1.0]), powers[None, :]
    starts = np.asarray([-1.0, *calibration.spline.knots, 1.0])
    middle, half = 0.5 * (starts[1:] + starts[:-1]), 0.5 * np.diff(starts)
    at = np.cos(np.pi * (np.arange(4) + 0.5) / 4)  # a cubic is known by its values at four points
    low, high = calibration.x_range
    signal = calibration.predict(0.5 * (low + high) + 0.5 * (high - low) * (middle[:, None] + half[:, None] * at))
    scaled = np.linalg.solve(np.vander(at, increasing=True), signal.T).T
    return starts, np.ascontiguousarray(scaled / half[:, None] ** np.arange(4))


def _uncertainty(
    calibration: Calibration, x: FloatArray, noise_sd: FloatArray, model_sd: float, half_loop: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return `noise_mm` and `shared_mm` of an inverse at x, mm; `noise_sd` and `half_loop` at x, mV."""
    per_mv = 1.0 / np.maximum(np.abs(calibration.slope(x)), _LEVEL)
    by_fit, by_reading = calibration.curve_parts(x)
    noise, shared = noise_sd * per_mv, np.sqrt(model_sd**2 + by_fit**2 + by_reading**2) * per_mv
    away = calibration.deviation_in_x(x)
    if np.any(away) or np.any(half_loop):
        whole = expanded(away, np.hypot(shared, noise), half_loop=half_loop * per_mv) / COVERAGE_FACTOR
        shared = np.sqrt(np.maximum(whole**2 - noise**2, 0.0))
    width = calibration.x_range[1] - calibration.x_range[0]
    return np.minimum(noise, width), np.minimum(shared, width)


@dataclass(frozen=True, slots=True)
class Fusion:
    """Several sensors as one. Make one with `Fusion.of(calibrations)`; call it with mV of shape [..., sensors]."""

    inverses: tuple[Inverse, ...]
    correlation: FloatArray

    def __repr__(self) -> str:
        return f"<Fusion of {list(self.inverses)}>"

    @classmethod
    def of(cls, sensors: Sequence[Calibration | Inverse]) -> Fusion:
        """Prepare the fusion of the sensors of one unit. RequestError: no sensor. DataError: one has no inverse.

        Noise is independent; the rest is correlated as the residuals are if the calibrations rest on the same points.
        """
        if not sensors:
            raise RequestError("there is no calibrated sensor", "Calibrate at least one.")
        inverses = tuple(s if isinstance(s, Inverse) else Inverse.of(s) for s in sensors)
        calibrations = [inverse.calibration for inverse in inverses if inverse.calibration is not None]
        same = len(calibrations) == len(inverses) and all(np.array_equal(c.x, calibrations[0].x) for c in calibrations)
        signs = np.asarray([1.0 if c.rises else -1.0 for c in calibrations])
        if same and len(calibrations) > 1 and all(c.residual_sd > 0 for c in calibrations):
            correlation = np.corrcoef(np.stack([c.residuals for c in calibrations]) * signs[:, None])
        else:
            correlation = np.eye(len(inverses))
        return cls(inverses, np.atleast_2d(correlation))

    @property
    def u_void(self) -> str:
        """Why U is not known: of no sensor; "" otherwise."""
        return self.inverses[0].u_void if all(inverse.u_void for inverse in self.inverses) else ""

    @property
    def u_stand_in(self) -> str:
        """What U rests on besides the run, of the first sensor of which it does; "" where it rests on the run."""
        return next(
            (one.u_stand_in for one, used in zip(self.inverses, self.used, strict=True) if used and one.u_stand_in), ""
        )

    @property
    def used(self) -> tuple[bool, ...]:
        """Whether each sensor takes part: all, or those whose U is known."""
        return tuple(bool(self.u_void) or not inverse.u_void for inverse in self.inverses)

    def evaluate(self, signal_mv: npt.ArrayLike, *, clamp: bool = False) -> ElongationEstimate:
        """Return the fused elongation of signals [..., sensors].

        Sensors outside their range do not take part; if all are outside, x is NaN (or clamped). `beyond`: one beyond
        the end of its range takes part; `disagreement`: two sensors differ by more than 4 sigma of their difference.
        A sensor whose U is not known takes part only if no other's is, and U is then NaN.
        """
        signal = np.asarray(signal_mv, dtype=np.float64)
        if signal.shape[-1:] != (len(self.inverses),):
            cause = f"signals of shape {signal.shape} do not fit {len(self.inverses)} sensors"
            raise RequestError(cause, "The last axis is the sensor.")
        if not all(self.used):
            signal = np.where(self.used, signal, np.nan)
        each = [inverse.evaluate(signal[..., i]) for i, inverse in enumerate(self.inverses)]
        x = np.stack([p.elongation_mm for p in each], axis=-1)
        if self.u_void:
            inside = (np.clip(x[..., i], *inverse.x_range) for i, inverse in enumerate(self.inverses))
            u = np.stack([inv.known_u(end) for inv, end in zip(self.inverses, inside, strict=True)], axis=-1)
        else:
            u = np.stack([p.standard_uncertainty_mm for p in each], axis=-1)
        known = np.isfinite(x)
        weight = np.where(known, 1.0 / np.where(known, u, 1.0) ** 2, 0.0)
        total = weight.sum(axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            fused = (weight * np.where(known, x, 0.0)).sum(axis=-1) / total
            parts = [inverse.parts(x[..., i]) for i, inverse in enumerate(self.inverses)]
            noise, shared = (weight * np.where(known, np.stack([p[j] for p in parts], axis=-1), 0.0) for j in (0, 1))
            common = np.einsum("...i,ij,...j->...", shared, self.correlation, shared)
            spread = np.sqrt(((noise**2).sum(axis=-1) + common) / total**2 + self.inverses[0].reference_u(fused) ** 2)
        none = ~known.any(axis=-1)
        outside = np.asarray(none & np.isfinite(signal).any(axis=-1), dtype=bool)
        if clamp and none.any():
            ends = np.stack([inv(signal[..., i], clamp=True) for i, inv in enumerate(self.inverses)], axis=-1)
            fused = np.where(outside, ends[..., self.used.index(True)], fused)
        beyond = np.asarray(np.stack([p.beyond for p in each], axis=-1).any(axis=-1), dtype=bool)
        if self.u_void:
            return ElongationEstimate(fused, np.full(fused.shape, np.nan), outside, beyond, np.zeros_like(none))
        return ElongationEstimate(fused, spread, outside, beyond, self._disagreement(x, u))

    def _disagreement(self, x: FloatArray, u: FloatArray) -> BoolArray:
        found = np.zeros(x.shape[:-1], dtype=bool)
        for i in range(x.shape[-1]):
            for j in range(i):
                # correlation would only make the difference smaller: leaving it out raises no false alarm
                apart = np.abs(x[..., i] - x[..., j])
                found |= apart > DISAGREEMENT_SIGMA * np.hypot(u[..., i], u[..., j])
        return found


def _invert(signal: FloatArray, starts: FloatArray, powers: FloatArray, nodes: FloatArray, clamp: bool) -> FloatArray:
    """Solve p(u) = signal on -1..1 for signals [n]; `nodes` are p at equally spaced u, monotone."""
    sign = 1.0 if nodes[-1] > nodes[0] else -1.0
    rising, y = sign * nodes, sign * signal
    rounding = 1e-13 * (rising[-1] - rising[0] + abs(rising[0]))
    inside = (rising[0] - rounding <= y) & (y <= rising[-1] + rounding)  # the ends, however they were computed
    out = np.full(y.shape, np.nan)
    if clamp:  # NaN compares false and stays NaN
        out[~inside & (y < rising[0])], out[~inside & (y > rising[-1])] = -1.0, 1.0
    at = np.flatnonzero(inside)
    y, step = y[at], 2.0 / (nodes.size - 1)
    low = np.clip(np.searchsorted(rising, y, "right") - 1, 0, nodes.size - 2)
    a, b = -1.0 + low * step, -1.0 + (low + 1) * step
    u = a + step * (y - rising[low]) / (rising[low + 1] - rising[low])
    for _ in range(60):
        if not at.size:
            break
        k = np.searchsorted(starts[1:-1], u, "right")
        t = u - 0.5 * (starts[k] + starts[k + 1])
        value, slope = powers[k, -1], np.zeros_like(u)
        for j in range(powers.shape[1] - 2, -1, -1):
            slope = slope * t + value
            value = value * t + powers[k, j]
        error = sign * value - y
        a, b = np.where(error > 0.0, a, u), np.where(error > 0.0, u, b)
        with np.errstate(divide="ignore", invalid="ignore"):  # a level curve: the middle is taken
            newton = u - error / (sign * slope)
        out[at] = following = np.where((a <= newton) & (newton <= b), newton, 0.5 * (a + b))
        more = np.abs(following - u) >= 1e-8  # Newton squares the error: the step just taken was the last that matters
        at, y, a, b, u = at[more], y[more], a[more], b[more], following[more]
    return out
