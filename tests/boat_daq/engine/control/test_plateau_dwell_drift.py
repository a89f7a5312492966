"""The drift test: steady is found where it is true, and only there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from boat_daq.engine.control.plateau_dwell import drift

T = np.arange(200) / 100.0


def test_slope_and_error_against_the_textbook() -> None:
    """For independent noise: numpy's least squares and its covariance, to the autocorrelation's correction."""
    rng = np.random.default_rng(1)
    y = 3.0 * T + rng.standard_normal(T.size)
    (slope, _), covariance = np.polyfit(T, y, 1, cov=True)
    found = drift(T, y)
    assert found.slope == pytest.approx(slope, rel=1e-9)
    assert found.std_error == pytest.approx(math.sqrt(covariance[0, 0]), rel=0.1)


def test_the_error_is_true_for_autocorrelated_noise() -> None:
    """Over 400 first-order autoregressive windows slopes scatter as their errors predict; the plain one fails."""
    rng = np.random.default_rng(2)
    slopes, errors = [], []
    for _ in range(400):
        y = np.zeros(400)
        for i in range(1, 400):
            y[i] = 0.7 * y[i - 1] + rng.standard_normal()
        found = drift(np.arange(400) / 100.0, y)
        slopes.append(found.slope)
        errors.append(found.std_error)
    ratio = np.std(slopes) / np.mean(errors)
    assert 0.8 < ratio < 1.25
    plain = np.mean(errors) / math.sqrt((1 + 0.7) / (1 - 0.7))
    assert np.std(slopes) / plain > 1.8


def test_a_steady_channel_passes_and_a_drifting_one_does_not() -> None:
    """Of 200 windows with noise of 1.5 mV, nearly all without drift pass 1 mV/s, and none of 2 mV/s does."""
    rng = np.random.default_rng(3)
    noise = 1.5 * rng.standard_normal((200, T.size))
    assert sum(drift(T, y).within(1.0) for y in noise) > 190
    assert not any(drift(T, y + 2.0 * T).within(1.0) for y in noise)


def test_noise_alone_is_no_evidence() -> None:
    """A channel too noisy to decide does not pass, however small its slope happens to be."""
    rng = np.random.default_rng(4)
    assert not any(drift(T, 50.0 * rng.standard_normal(T.size)).within(1.0) for _ in range(50))


@pytest.mark.parametrize(
    "values", [np.empty(0), np.ones(3), np.full(200, np.nan), np.array([1.0] * 199 + [np.inf])], ids=str
)
def test_too_little_is_never_steady(values: np.ndarray) -> None:
    """No samples, three, or not numbers: nothing follows."""
    assert not drift(T[: values.size], values).within(1e9)


def test_a_constant_is_steady_and_a_line_is_its_slope() -> None:
    """Without noise every slope is decided."""
    assert drift(T, np.full(T.size, 1650.0)).within(1e-9)
    assert drift(T, 5.0 * T).slope == pytest.approx(5.0)
    assert not drift(T, 5.0 * T).within(4.9)


def test_samples_of_one_instant_are_no_evidence() -> None:
    """A clock that does not advance gives no slope."""
    assert not drift(np.zeros(50), np.arange(50.0)).within(1e9)


def test_a_channel_that_drifts_at_the_tolerance_passes_in_one_window_of_44() -> None:
    """P(z < -2) = 2.3 %, by the normal distribution; 1.645 standard errors would let 5 % pass."""
    rng = np.random.default_rng(5)
    passed = np.mean([drift(T, T + 0.1 * rng.standard_normal(T.size)).within(1.0) for _ in range(3000)])
    assert passed == pytest.approx(stats.norm.sf(2.0), abs=0.01)
