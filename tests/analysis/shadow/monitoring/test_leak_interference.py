"""Periodic interference: found in a noisy record, absent from noise."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.monitoring.leak import find_interference


def test_interference_is_found_and_noise_is_not() -> None:
    """A sine's values come back within its error; noise, or fewer than three cycles, gives none."""
    time, rng = np.arange(0, 200, 0.5), np.random.default_rng(0)
    columns = np.stack([np.ones_like(time), np.sin(2 * np.pi * time / 20), time / 200], axis=1)
    wave, noise = 0.05 * np.cos(2 * np.pi * time / 25 + 1), 0.03 * rng.standard_normal(time.size)
    found = find_interference(time, columns @ [1.0, 0.5, 0.2] + wave + noise, columns, 20.0)
    assert found.frequency_hz == pytest.approx(0.04, abs=5e-4)
    assert np.abs(found.at(time) - wave).max() < 0.02
    assert not find_interference(time, noise, columns, 20.0).at(time).any()
    assert not find_interference(time[:90], (wave + noise)[:90], columns[:90], 20.0).at(time).any()
