"""A calibration as one C99 header without a library: Newton's method in double precision, or tables in single.

The header has the arrays of `Inverse` and the same steps. Its start table has 33 nodes, so at most 5 bisections and 60
steps are needed; 3 or 4 steps are usual. With a bound on the error, tables over the signal in single precision replace
the iteration: constant time, a tenth of it without a floating-point unit. Names from a recording appear in comments and
a string only; nothing in them ends a comment or a string.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.calibration.inverse import BEYOND_SIGMA, DISAGREEMENT_SIGMA, NODES, U_NODES, Inverse
from analysis.calibration_export.calibration_file import CalibrationFile
from analysis.numbers import rounded_up
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.base.units import COVERAGE_FACTOR

START_NODES, _STEPS = 33, 60
PER_ROW = 6


def c_header(calibration: CalibrationFile, table_error_mm: float | None = None) -> str:
    """Return the header's text, with tables of at most `table_error_mm` error in single precision if given.

    DataError: the calibration gives no elongation. RequestError: no table keeps to the bound.
    """
    fusion, single = calibration.reader(), table_error_mm is not None
    sensors = [_sensor(inverse, number, table_error_mm) for number, inverse in enumerate(fusion.inverses)]
    if table_error_mm is not None:
        method = f"Tables over the signal: within {table_error_mm:g} mm of the calibration's inverse, sensor by sensor."
    else:
        method = "Newton's method, kept inside its bracket: within 1e-9 mm of the calibration's inverse."
    text: str = template_of("calibration.h.j2", single=single).render(
        comment=[comment_text(line) for line in (calibration.title, *calibration.remarks)],
        method=method,
        precision="single" if single else "double",
        real="float" if single else "double",
        simulated=int(calibration.head["simulated"]),
        unit=_string(calibration.head["unit"]),
        sensors=sensors,
        correlation=fusion.correlation.tolist(),
        used=fusion.used,
        stand_in=int(bool(fusion.u_stand_in)),
        u_known=not fusion.u_void,
        reference=fusion.inverses[0].reference,
        table=single,
        per_row=PER_ROW,
        nodes=START_NODES,
        bisections=(START_NODES - 1).bit_length() - 1,
        steps=_STEPS,
        u_nodes=U_NODES,
        rounding=1e-6 if single else 1e-13,
        beyond=BEYOND_SIGMA,
        disagreement=DISAGREEMENT_SIGMA,
    )
    return text


def template_of(name: str, *, single: bool = False) -> Any:
    """Return a template of this package; `real` writes a number with all its digits, `row` a row vector of MATLAB."""

    def real(value: float) -> str:
        if not single:
            return repr(float(value))
        text = f"{np.float32(value):.9g}"
        return f"{text}f" if "." in text or "e" in text else f"{text}.0f"

    def row(values: Sequence[float]) -> str:
        numbers = [real(value) for value in values]
        lines = [" ".join(numbers[first : first + PER_ROW]) for first in range(0, len(numbers), PER_ROW)]
        joined = " ...\n        ".join(lines)
        return f"[{joined}]"

    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(  # noqa: S701 - no HTML
        loader=PackageLoader("analysis.calibration_export", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"real": real, "row": row}
    return environment.get_template(name)


def comment_text(text: str) -> str:
    """Return text for one line of a comment in C or MATLAB: printable ASCII that ends no comment and no line."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in " ".join(text.split()))
    for ending in ("*/", "/*"):
        plain = plain.replace(ending, "* /" if ending == "*/" else "/ *")
    return plain.replace("??", "? ?").rstrip("\\ ")[:400]


def _string(text: str) -> str:
    """Return the inside of a C string."""
    plain = "".join(c if " " <= c <= "~" else "?" for c in text)[:200]
    return plain.replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")


def _sensor(inverse: Inverse, number: int, table_error_mm: float | None) -> dict[str, Any]:
    low_mv, high_mv = inverse.nodes[[0, -1]]
    ends = [*inverse.x_range, inverse.half_division_mm, low_mv, high_mv, *inverse.end_slopes]
    uncertainty = [("noise_mm", inverse.noise_mm.tolist()), ("shared_mm", inverse.shared_mm.tolist())]
    if table_error_mm is not None:
        _, x = signal_table(inverse, table_error_mm, single=True)
        x = x if high_mv > low_mv else x[::-1]
        arrays = [("elongation_mm", x.tolist()), *uncertainty]
        per_mv = (x.size - 1) / abs(high_mv - low_mv)
        return {"number": number, "ends": ends, "arrays": arrays, "nodes": x.size, "nodes_per_mv": per_mv}
    start = inverse.nodes[:: (NODES - 1) // (START_NODES - 1)]
    curve = [("starts", inverse.starts), ("powers", inverse.powers.ravel()), ("nodes_mv", start)]
    arrays = [*((name, values.tolist()) for name, values in curve), *uncertainty]
    pieces, size = inverse.powers.shape
    return {"number": number, "ends": ends, "arrays": arrays, "pieces": pieces, "degree": size - 1}


_FEWEST, _MOST = 5, 4097
_BETWEEN = 8  # signals between two nodes at which the error is computed
SHARE = 0.9  # of the bound: the rest is for signals between those
USUAL_ERROR_MM = 0.001


def signal_table(inverse: Inverse, error_mm: float, *, single: bool = False) -> tuple[FloatArray, FloatArray]:
    """Return rising signals and elongations [nodes] for linear interpolation. RequestError: `error_mm` is too small."""
    if not error_mm > 0:
        cause = f"an error of {error_mm:g} mm is no bound for a table"
        raise RequestError(cause, "Give a length above 0, such as 0.001.")
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
