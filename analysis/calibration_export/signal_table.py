"""A calibration as a table over the signal, for linear interpolation, with a chosen bound on its error."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.calibration.inverse import Inverse
from analysis.calibration_export.calibration_file import CalibrationFile
from analysis.numbers import rounded_up
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.base.units import COVERAGE_FACTOR

_FEWEST, _MOST = 5, 4097
_BETWEEN = 8  # signals between two nodes at which the error is computed
SHARE = 0.9  # of the bound: the rest is for signals between those
USUAL_ERROR_MM = 0.001


def signal_table(inverse: Inverse, error_mm: float, *, single: bool = False) -> tuple[FloatArray, FloatArray]:
    """Return rising signals and elongations [nodes] for linear interpolation. RequestError: `error_mm` is too small."""
    if not error_mm > 0:
        raise RequestError(
            f"an error of {error_mm:g} mm is no bound for a table", "Give a length above 0, such as 0.001."
        )
    low, high = sorted(map(float, inverse.nodes[[0, -1]]))
    count, least = _FEWEST, math.inf
    while count <= _MOST:
        signal = np.linspace(low, high, count)
        x = inverse(signal, clamp=True)
        least = min(least, _error(inverse, signal, x, single=single))
        if least <= SHARE * error_mm:
            return signal, x
        count = 2 * count - 1
    remedy = f"Allow {rounded_up(least / SHARE):g} mm or more, or take the form without a table."
    raise RequestError(f"no table of {_FEWEST} to {_MOST} nodes keeps to {error_mm:g} mm", remedy)


def _error(inverse: Inverse, signal: FloatArray, x: FloatArray, *, single: bool) -> float:
    """Return the greatest error of the elongation between the nodes."""
    at = np.linspace(signal[0], signal[-1], (signal.size - 1) * _BETWEEN + 1)
    kind: Any = np.float32 if single else np.float64
    per_mv = kind((signal.size - 1) / (signal[-1] - signal[0]))
    position = (at.astype(kind) - kind(signal[0])) * per_mv
    node = np.minimum(position.astype(np.int64), signal.size - 2)
    table = x.astype(kind)
    found = table[node] + (position - node.astype(kind)) * (table[node + 1] - table[node])
    return float(np.abs(found.astype(np.float64) - inverse(at.astype(kind).astype(np.float64), clamp=True)).max())


def table_csv(calibration: CalibrationFile, error_mm: float = USUAL_ERROR_MM) -> str:
    """Return the tables of all sensors as CSV: sensor, signal_mv, elongation_mm, u_mm (U, k = 2).

    DataError: the calibration gives no elongation. RequestError: no table keeps to `error_mm`.
    """
    lines = [f"# {' '.join(line.replace(',', ';').split())}" for line in (calibration.title, *calibration.remarks)]
    lines.append(f"# between the rows interpolate linearly: within {error_mm:g} mm of the calibration's inverse")
    lines.append("# u_mm is the expanded uncertainty of one reading; k = 2")
    lines.append("sensor,signal_mv,elongation_mm,u_mm")
    for sensor, inverse in zip(calibration.sensors, calibration.reader().inverses, strict=True):
        signal, x = signal_table(inverse, error_mm)
        u = COVERAGE_FACTOR * inverse.standard_uncertainty(x)
        rows = zip(signal.tolist(), x.tolist(), u.tolist(), strict=True)
        lines += [
            f"{sensor['name']},{y!r},{at!r},{'' if np.isnan(spread) else f'{spread:.6g}'}" for y, at, spread in rows
        ]
    return "\n".join(lines) + "\n"
