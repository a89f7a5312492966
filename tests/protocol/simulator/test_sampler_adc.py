"""Light and converter: noise of the stated size, ambient light that the subtraction takes away."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.simulator.sampler import AMBIENT_MV, FULL_SCALE, LSB_MV, FrontEnd, SampleNoise
from protocol.simulator.specimens import find_specimen

SENSORS = find_specimen("SA1").sensors
N = 40_000


def readings(**faults: float) -> tuple[np.ndarray, np.ndarray]:
    """Counts and signals (mV) of a minute at 100 Hz or so, the true signal at 1600 mV."""
    noise, _ = SampleNoise(1, 1, 2).rows(0, N)
    time_us = np.arange(N) * 10_007
    counts = FrontEnd(SENSORS).convert(np.full((N, 2), 1600.0), time_us, noise[:, 1:].reshape(N, 2, 2), faults, 0)
    lit, dark = counts[:, :, 0].astype(float), counts[:, :, 1].astype(float)
    return counts, (lit - dark) * LSB_MV


def test_noise_is_the_specimens_figure():
    """rms of the signal, quantisation included, is 1.49 and 1.04 mV within 2 %, and the mean is true."""
    _, signal = readings()
    assert signal.std(axis=0) == pytest.approx([s.noise_mv for s in SENSORS], rel=0.02)
    assert signal.mean(axis=0) == pytest.approx([1600.0, 1600.0], abs=0.05)


@pytest.mark.fault(23, how="hundreds of mV of light, stepped and ramped", times=2)
@pytest.mark.parametrize("fault", ["ambient_step", "ambient_ramp"])
def test_slow_ambient_light_is_rejected(fault):
    """Hundreds of mV of light from outside show in the dark counts, not in the signal."""
    counts, signal = readings(**{fault: 300.0})
    assert (counts[-100:, :, 1] * LSB_MV).mean() > AMBIENT_MV + 250.0
    assert signal.mean(axis=0) == pytest.approx([1600.0, 1600.0], abs=0.1)
    assert signal.std(axis=0) == pytest.approx([s.noise_mv for s in SENSORS], rel=0.03)


@pytest.mark.fault(23, how="200 mV of mains flicker", times=1)
def test_strong_flicker_is_not_wholly_rejected():
    """The two readings are 50 us apart: of 200 mV at 100 Hz some 6 mV stay, and can be seen."""
    _, signal = readings(flicker=200.0)
    left = 200.0 * 2 * np.pi * 100 * 50e-6
    expected = [np.hypot(s.noise_mv, left / np.sqrt(2)) for s in SENSORS]
    assert signal.std(axis=0) == pytest.approx(expected, rel=0.05)


def test_saturation_disagreement_freezing():
    """Each sensor fault hits the sensor named and leaves the other alone."""
    saturated, _ = readings(saturate=1.0)
    assert (saturated[:, 0] == FULL_SCALE).all()
    assert (saturated[:, 1] < FULL_SCALE).all()
    _, shifted = readings(sensor_disagreement=20.0)
    assert shifted.mean(axis=0) == pytest.approx([1600.0, 1620.0], abs=0.1)
    frozen, _ = readings(frozen_channel=2.0)
    assert (frozen[:, 1] == frozen[0, 1]).all()
    assert np.unique(frozen[:, 0, 0]).size > 3


@given(st.integers(0, 5000), st.lists(st.integers(1, 3000), min_size=1, max_size=4))
def test_noise_belongs_to_the_number(first, lengths):
    """The noise of a sample is the same for any slices and any order of calls."""
    whole = SampleNoise(3, 1, 2).rows(first, sum(lengths))
    source, start, parts = SampleNoise(3, 1, 2), first, []
    for length in lengths:
        parts.append(source.rows(start, length))
        start += length
    for column in (0, 1):
        np.testing.assert_array_equal(whole[column], np.concatenate([part[column] for part in parts]))
