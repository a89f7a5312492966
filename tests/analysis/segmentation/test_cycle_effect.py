"""What the plateaus of a cycle differ by together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.segmentation.cycle_effect import CycleEffect


def loops_of(values: np.ndarray) -> SimpleNamespace:
    """Return the loops of one sensor, of values [cycles, places]."""
    cycles, places = values.shape
    signal = values.reshape(cycles, 2, places // 2).transpose(1, 0, 2)[None]
    return SimpleNamespace(n_cycles=cycles, own=np.ones(signal.shape[1:], dtype=bool), signal_mv=signal)


def test_cycles_that_differ_as_a_whole_have_few_degrees_of_freedom() -> None:
    """Three cycles 3 mV apart, four places that scatter by 0.1 mV about them: 2 degrees of freedom, not 6."""
    own = 0.1 * np.array([[1.0, -1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    effect = CycleEffect.of(loops_of(own + 3.0 * np.array([[-1.0], [0.0], [1.0]])), 0)
    assert (effect.cycles, effect.places) == (3, 4)
    assert effect.mean_variance == pytest.approx(9.0)
    assert effect.own_variance == pytest.approx(8 * 0.01 / 6)
    pooled = np.sqrt(9.0 + 0.01)
    shared = 9.0 - effect.own_variance / 4
    assert effect.repeatability(pooled, 0.0) == pytest.approx(np.sqrt(shared * 4 / 3 + pooled**2 - shared))
    assert effect.dof(pooled, 0.0) == pytest.approx(2.0, rel=0.02)
    assert effect.repeatability(pooled, 9.0) == pytest.approx(pooled)
    assert effect.dof(pooled, 9.0) == pytest.approx(6.0)
    assert effect.upper_mv(0.8) == pytest.approx(np.sqrt(9.0 * 2 / 0.44628710 * 4 / 3))


def test_interval_of_a_pooled_sd_is_that_of_its_degrees_of_freedom() -> None:
    """Without a shared part that of a normal sample of 3 (4 - 1) degrees of freedom: 0.7166 to 1.6507 of it for 9."""
    own = np.array([[1.0, -1.0, 1.0, -1.0], [-1.0, 1.0, -1.0, 1.0], [1.0, 1.0, -1.0, -1.0], [-1.0, -1.0, 1.0, 1.0]])
    effect = CycleEffect.of(loops_of(own), 0)
    assert effect.dof(1.0, 0.0) == pytest.approx(9.0)
    assert effect.interval(2.0) == pytest.approx((2.0 * 3.0 / 19.0227678**0.5, 2.0 * 3.0 / 2.7003895**0.5))
