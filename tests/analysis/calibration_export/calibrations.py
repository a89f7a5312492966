"""Calibrations to export: every kind of curve, rising and falling, one or several sensors, with a reference."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, Literal

import numpy as np

from analysis.calibration.inverse import Fusion, Inverse
from analysis.calibration.type_b import contributions
from analysis.calibration_export.calibration_file import CalibrationFile
from tests.analysis.calibration.sessions import CUBIC, TRUTHS, session

HEAD: Mapping[str, Any] = {
    "program_version": "1", "simulated": True, "unit": "SA1", "recording": "r.boat", "recording_id": "u",
    "calibrated_utc": "2026-11-22T10:00:00+00:00", "operator": "", "traceability": "not traceable", "warnings": [],
}  # fmt: skip
TYPE_B = contributions({
    "scale": {"u_percent": 0.5},
    "parallax": {"half_width_mm": 0.05, "distribution": "rectangular"},
})  # fmt: skip


def falling_cubic(x: np.ndarray) -> np.ndarray:
    """Return a sensor whose signal falls."""
    return 3300.0 - CUBIC(x)


def inverse_of(truth: Callable[[np.ndarray], np.ndarray], curve: int | Literal["spline"]) -> Inverse:
    """Return the inverse of one sensor, its readings on the paper's grid."""
    return Inverse.of(session(truth).fit(curve), noise_sd=1.0, model_sd=0.7, type_b=TYPE_B)


def calibration_file(*inverses: Inverse, **head: Any) -> CalibrationFile:
    """Return the file of these sensors."""
    sensors = tuple(
        {"name": f"s{number}", "fit": None, "adequacy": None, "u_elongation_mm": []}
        for number in range(1, len(inverses) + 1)
    )
    count = len(inverses)
    correlation = np.full((count, count), 0.3) + 0.7 * np.eye(count)
    return CalibrationFile({**HEAD, **head}, sensors, Fusion(inverses, correlation))


SENSORS: Mapping[str, tuple[tuple[Callable[[np.ndarray], np.ndarray], int | Literal["spline"]], ...]] = {
    "line": ((CUBIC, 1),),
    "falling cubic": ((falling_cubic, 3),),
    "spline": ((TRUTHS["sigmoid"], "spline"),),
    "sextic and falling spline": ((TRUTHS["sigmoid"], 6), (lambda x: -TRUTHS["sigmoid"](x), "spline")),
    "three": ((CUBIC, 2), (TRUTHS["sigmoid"], "spline"), (falling_cubic, 5)),
}


@functools.cache
def inverses_of(name: str) -> tuple[Inverse, ...]:
    """Return the inverses of a set of `SENSORS`, made once."""
    return tuple(inverse_of(truth, curve) for truth, curve in SENSORS[name])


def file_of(name: str, **head: Any) -> CalibrationFile:
    """Return the file of a set of `SENSORS`."""
    return calibration_file(*inverses_of(name), **head)


def signals(calibration: CalibrationFile, count: int, seed: int = 0) -> np.ndarray:
    """Return signals of elongations 10 % beyond the range on either side, each sensor off by some u; some missing."""
    rng = np.random.default_rng(seed)
    inverses = calibration.reader().inverses
    columns = []
    x = rng.uniform(-0.1, 1.1, count)
    for inverse in inverses:
        low, high = inverse.nodes[[0, -1]]
        own = np.interp(np.clip(x, 0, 1), np.linspace(0, 1, inverse.nodes.size), inverse.nodes)
        own += (np.clip(x, None, 0) + np.clip(x - 1, 0, None)) * (high - low) + 3.0 * rng.standard_normal(count)
        own[rng.random(count) < 0.02] = np.nan
        own[:2] = low, high
        columns.append(own.astype(np.float32).astype(np.float64))
    return np.stack(columns, axis=1)


def expected(calibration: CalibrationFile, signal_mv: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return elongation, U and flags as `Fusion` gives them."""
    found = calibration.reader().evaluate(signal_mv)
    flags = found.outside + 2 * found.beyond + 4 * found.disagreement
    return found.elongation_mm, 2.0 * found.standard_uncertainty_mm, flags
