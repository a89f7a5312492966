"""From the traced light to a sensor's signal: the best gain and offset against the published calibrations.

Rules: light is detected power in percent of the emitted one, because a photodiode measures power. The front end is one
gain and one offset; the sign of the gain is free, because the paper states neither the circuit nor its polarity. Beside
every fit stand a straight line and a parabola in elongation: what needs no optics.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Waveguide, light_by
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.published import SENSORS
from protocol.base.arrays import FloatArray

SIGNAL_RAYS = 5_000
"""Fewer rays scatter more than the light changes between two states: R2 is 0.44 at 250 rays and 0.91 from here on."""


@dataclass(frozen=True, slots=True)
class SignalFit:
    """One sensor's signal as gain times light plus offset."""

    gain_mv_per_percent: float
    offset_mv: float
    r2: float  # with rms_mv, rms_percent_fso: what it explains of the published signal, and what it misses
    rms_mv: float
    rms_percent_fso: float
    signal_change_percent: float
    line_r2: float  # with parabola_r2: what polynomials in elongation explain
    parabola_r2: float


@dataclass(frozen=True, slots=True)
class ChainSignal:
    """The light of one design over the states, beside the published signals."""

    rays: int
    elongation_mm: FloatArray  # with light_percent, light_sd_percent: (15,), one a state
    light_percent: FloatArray
    light_sd_percent: FloatArray
    sensors: tuple[SignalFit, ...]  # the fit of each published sensor

    @property
    def light_change_percent(self) -> float:
        """Return the change of the light from the first state to the last."""
        return float(100.0 * (self.light_percent[-1] / self.light_percent[0] - 1.0))

    @property
    def inverted(self) -> bool:
        """Return whether every published signal rises where this light falls."""
        return all(fit.gain_mv_per_percent < 0.0 for fit in self.sensors)


def polynomial_r2(x: FloatArray, y: FloatArray, degree: int) -> float:
    """Return the share of the variance of y (n,) that a polynomial in x (n,) explains, by least squares."""
    fitted = np.polynomial.Polynomial.fit(x, y, degree)
    return 1.0 - float(np.mean((y - fitted(x)) ** 2)) / float(np.var(y))


def fit_signal(light_percent: FloatArray, elongation_mm: FloatArray, signal_mv: FloatArray) -> SignalFit:
    """Return gain and offset of a signal (n,) over light (n,), by least squares, beside polynomials in elongation."""
    ones = np.ones_like(light_percent)
    (gain, offset), *_ = np.linalg.lstsq(np.stack([light_percent, ones], axis=1), signal_mv, rcond=None)
    residual = signal_mv - gain * light_percent - offset
    rms, change = float(np.sqrt(np.mean(residual**2))), 100.0 * (signal_mv[-1] / signal_mv[0] - 1.0)
    r2 = 1.0 - rms**2 / float(np.var(signal_mv))
    baselines = [polynomial_r2(elongation_mm, signal_mv, degree) for degree in (1, 2)]
    fso = float(np.ptp(signal_mv))
    return SignalFit(float(gain), float(offset), r2, rms, 100.0 * rms / fso, float(change), *baselines)


def chain_signal(
    curves_mm: FloatArray, elongation_mm: FloatArray, rays: int = SIGNAL_RAYS, design: Design = PAPER_OPTIMUM
) -> ChainSignal:
    """Trace a design with every reflection followed, and fit the published calibrations to its light.

    `curves_mm`, `elongation_mm`: (15, 2, points, 2) and (15,) of the states. `design`: the paper's by default.
    """
    request = SweepRequest((design,), Waveguide(), light_by("power", rays), curves_mm, "power")
    result = run_sweep(request)
    light = 100.0 * result.power[0]
    powers = np.vander(elongation_mm, 4, increasing=True)
    fits = tuple(fit_signal(light, elongation_mm, powers @ np.array(sensor.coefficients)) for sensor in SENSORS)
    return ChainSignal(request.light.rays, elongation_mm, light, 100.0 * result.power_sd[0], fits)
