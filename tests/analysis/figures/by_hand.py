"""Loops and resamples of the tests that work figures out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

WEIGHTS = np.array([[1.0, 1.0, 1.0], [3.0, 0.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 2.0]])


def loops_of(signal: np.ndarray, **more: object) -> SimpleNamespace:
    """Return loops of signals [2, cycles, levels] at pressures -40, 0, 40 and so on."""
    pressure = -40.0 + 40.0 * np.arange(signal.shape[2])
    known = {
        "own": np.ones(signal.shape, bool), "signal_mv": signal[None], "n_cycles": signal.shape[1],
        "numbers": tuple(range(1, signal.shape[1] + 1)), "level_kpa": pressure, "binned": False,
        "pressure_kpa": np.broadcast_to(pressure, signal.shape), "ends_kpa": (pressure[0], pressure[-1]),
    }  # fmt: skip
    return SimpleNamespace(**{**known, **more})
