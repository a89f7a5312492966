"""The leak behind the gauge: loss of a cycle, the healthy loop, hysteresis and holds."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.monitoring.leak import HealthyLoop, LeakWatch, loss_percent_per_min


def test_loss_is_the_leak_behind_the_gauge() -> None:
    """r' = loss p is recovered whatever offset and gain lie beneath; a cycle without pressure gives NaN."""
    time = np.arange(0, 40, 0.01)
    pressure = 5 + 45 * np.sin(2 * np.pi * time / 40)
    integral = np.concatenate([[0], np.cumsum((pressure[1:] + pressure[:-1]) / 2 * 0.01)])
    residual = 1.0 + 0.03 * pressure + 2 / 6000 * integral
    assert loss_percent_per_min(time, pressure, residual) == pytest.approx(2.0, rel=1e-6)
    # the leak's own growth from cycle to cycle is 5 kPa a second on average; any other drift is none of it
    assert loss_percent_per_min(time, pressure, residual, 2 / 6000 * 5) == pytest.approx(2.0, rel=1e-3)
    assert loss_percent_per_min(time, pressure, residual + 0.1 * time, 2 / 6000 * 5 + 0.1) == pytest.approx(
        2.0, rel=1e-3
    )
    assert np.isnan(loss_percent_per_min(time, np.zeros_like(time), residual))


def test_hysteresis_and_the_length_of_holds_are_no_leak() -> None:
    """A loop of +-4 kPa and holds that double leave next to nothing; two per cent a minute are seen."""
    watch, losses, lost, start = LeakWatch(2), [], 0.0, 0.0
    for cycle in range(8):
        hold = np.full(300 if cycle % 2 else 600, 1.0)
        down, up = np.linspace(50, -40, 4500), np.linspace(-40, 50, 4500)
        pressure = np.concatenate([50 * hold, down, -40 * hold, up])
        loop = np.concatenate([0 * hold, -4 * (1 - ((down - 5) / 45) ** 2), 0 * hold, 4 * (1 - ((up - 5) / 45) ** 2)])
        leak = np.cumsum(pressure) * 0.01 * 2 / 6000 * (cycle >= 5)
        time = start + 0.01 * np.arange(len(pressure))
        losses.append(watch.take(time, pressure, 0.02 * pressure + loop + lost + leak))
        lost, start = lost + leak[-1], time[-1] + 0.01
    assert np.isnan(losses[:2]).all()
    np.testing.assert_allclose(losses[2:5], 0.0, atol=0.3)
    np.testing.assert_allclose(losses[6:], 2.0, atol=0.3)


def test_without_span_or_residual_there_is_no_loop() -> None:
    """Constant pressure, or no residual at all."""
    assert HealthyLoop.of([(np.full(20, 5.0), np.zeros(20))]) is None
    assert HealthyLoop.of([(np.linspace(-40, 50, 20), np.full(20, np.nan))]) is None
