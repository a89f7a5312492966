"""The published signals as gain and offset of the traced light."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves, elongations
from analysis.optics.sweep.signal import SIGNAL_RAYS, chain_signal, fit_signal


def test_gain_and_offset_of_a_signal_made_from_light_are_found() -> None:
    """An affine signal is explained wholly; noise of known size is what is left."""
    light = np.linspace(34.0, 26.0, 15)
    noise = np.tile([1.0, -1.0], 8)[:15]
    x = np.arange(15.0) ** 2
    exact, noisy = fit_signal(light, x, 2000.0 - 24.0 * light), fit_signal(light, x, 100.0 + 5.0 * light + noise)
    assert (exact.gain_mv_per_percent, exact.offset_mv) == pytest.approx((-24.0, 2000.0))
    assert (exact.r2, exact.rms_mv) == pytest.approx((1.0, 0.0), abs=1e-9)
    assert exact.signal_change_percent == pytest.approx(100 * 192 / 1184)
    assert noisy.rms_mv == pytest.approx(1.0, abs=0.01)
    assert noisy.r2 == pytest.approx(1 - noisy.rms_mv**2 / np.var(100.0 + 5.0 * light + noise))


def test_polynomials_in_elongation_stand_beside_a_fit() -> None:
    """x^2 over -1, 0, 1 is explained by no line and by its parabola; half of the variance of |x| is."""
    x = np.array([-1.0, 0.0, 1.0])
    fit = fit_signal(np.array([1.0, 3.0, 2.0]), x, 5.0 + x**2)
    assert (fit.line_r2, fit.parabola_r2) == pytest.approx((0.0, 1.0), abs=1e-12)
    assert fit_signal(x, x, 5.0 + x + x**2).line_r2 == pytest.approx(2.0 / (2.0 + 2.0 / 3.0))


@pytest.mark.parametrize("rays", [1_000, pytest.param(SIGNAL_RAYS, marks=pytest.mark.nightly)])
def test_published_signals_rise_where_the_traced_light_falls(rays: int) -> None:
    """Over the default states light falls by about a fifth; both gains are negative and explain nine tenths."""
    found = chain_signal(default_curves(), elongations(), rays)
    assert found.inverted
    assert -25.0 < found.light_change_percent < -20.0
    assert all(0.88 < fit.r2 < 0.93 < 0.97 < fit.line_r2 < 0.99 < 0.999 < fit.parabola_r2 for fit in found.sensors)
    assert [round(fit.signal_change_percent, 1) for fit in found.sensors] == [16.9, 12.5]
