"""A calibration as a JSON file: identity, coefficients, covariance, ranges, U over x, and its inverse.

The file holds the arrays of `Inverse` as shortest exact decimals, so that a reader gives the values of the program that
wrote it, to the last bit. `c_header` and `matlab` make code from the same value. A newer version of the file is
refused. Warnings of the run are in the file. A calibration that gives no elongation has the reason and no inverse.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.calibration.inverse import NODES, U_NODES, Fusion, Inverse, signal_at
from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.calibration.type_b import contributions, traceability
from analysis.json_object import json_object
from analysis.numbers import finite
from analysis.warning import Warning
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, DataError, FileError
from protocol.base.regular_file import read_regular
from protocol.base.units import COVERAGE_FACTOR

if TYPE_CHECKING:
    from analysis.figures.pipeline import Analysis

_FORMAT, _VERSION = "boat-daq calibration", 3  # 2 for signals in mV, 1 where every U is known too
MOST_BYTES = 4_000_000
MOST_SENSORS, MOST_PIECES, MOST_POWERS = 16, 64, 11
_HEAD = (
    "program_version", "simulated", "unit", "recording", "recording_id", "calibrated_utc", "operator", "traceability",
)  # fmt: skip
_INVERSE = ("range_mm", "starts", "powers", "noise_mm", "shared_mm", "half_division_mm")


@dataclass(frozen=True, slots=True)
class CalibrationFile:
    """A calibration that leaves the program."""

    head: Mapping[str, Any]  # unit, recording, operator and so on, as `calibration --format json` shows them
    sensors: tuple[Mapping[str, Any], ...]  # name, fit (as `fit --json`), adequacy, and U over x of each
    fusion: Fusion | None  # the inverses of all sensors; None where `void` gives the reason
    void: str = ""
    signal_unit: str = "mV"

    @classmethod
    def of(
        cls, record: CalibrationRecord, *, u_elongation: Sequence[FloatArray] = (), warnings: Sequence[Warning] = ()
    ) -> CalibrationFile:
        """Return the file; `u_elongation` is (x, U) in mm, [points, 2] each. DataError: no sensor is calibrated."""
        if all(sensor.void for sensor in record.sensors):
            cause = f"this run is not a calibration: {record.sensors[0].void}"
            raise DataError(cause, "Give its readings of elongation, or choose a calibration run.")
        stated = contributions(record.sensors[0].type_b)
        head = {
            "program_version": record.program_version,
            "simulated": record.simulated,
            "unit": record.unit,
            "recording": record.recording,
            "recording_id": record.recording_id,
            "calibrated_utc": record.calibrated_utc,
            "operator": record.operator,
            "traceability": traceability(stated).text,
            "warnings": [json_object(warning) for warning in warnings],
        }
        u_mm = [*(u.tolist() for u in u_elongation), *[[] for _ in record.sensors]]
        sensors = tuple(_sensor(sensor, u) for sensor, u in zip(record.sensors, u_mm, strict=False))
        try:
            fusion = record.fusion()
        except BoatDaqError as error:
            return cls(head, sensors, None, error.cause, record.signal_unit)
        if not all(np.isfinite(inverse.noise_mm + inverse.shared_mm).all() for inverse in fusion.inverses):
            void = "the uncertainty of an elongation is not known over the whole range"
            return cls(head, sensors, None, void, record.signal_unit)
        return cls(head, sensors, fusion, "", record.signal_unit)

    @classmethod
    def of_run(cls, analysis: Analysis) -> CalibrationFile:
        """Return the file of the calibration of a run; raises as `of`."""
        from analysis.calibration_export.run_record import calibration_record  # the whole analysis, 2 s of CPU

        return cls.of(calibration_record(analysis), u_elongation=analysis.u_elongation, warnings=analysis.warnings)

    @property
    def title(self) -> str:
        """What it is of, in a line."""
        kind = "SIMULATED calibration" if self.head["simulated"] else "Calibration"
        unit = f"unit {self.head['unit']}" if self.head["unit"] else "a unit without a name"
        return f"{kind} of {unit}, {self.head['calibrated_utc'] or 'at an unknown time'}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user of the values must know, a sentence each: adequacy, traceability, warnings."""
        found = [] if self.head["unit"] else ["the unit has no name: nothing shows which unit the values belong to"]
        for sensor in self.sensors:
            verdict = (sensor["adequacy"] or {}).get("verdict", "")
            if verdict not in ("", "adequate"):
                found.append(f"{sensor['name']}: the curve is {verdict}, and U is widened by what it misses")
            if sensor.get("u_reason"):
                found.append(f"{sensor['name']}: U is not known: {sensor['u_reason']}")
            if sensor.get("u_stand_in"):
                found.append(f"{sensor['name']}: {sensor['u_stand_in']}")
        warned = [" ".join(filter(None, (w.get("subject"), w.get("text")))) for w in self.head["warnings"]]
        return (*found, f"an elongation is {self.head['traceability']}", *warned)

    def reader(self) -> Fusion:
        """Return the fusion that converts signals. DataError: the calibration gives no elongation."""
        if self.fusion is None:
            raise DataError(f"this calibration gives no elongation: {self.void}", "Choose another curve or run.")
        return self.fusion

    def as_json(self) -> dict[str, Any]:
        fusion, sensors = self.fusion, []
        for number, sensor in enumerate(self.sensors):
            inverse = None if fusion is None else _inverse_json(fusion.inverses[number])
            sensors.append({**sensor, "inverse": inverse})
        known = 2 if any(sensor.get("u_reason") for sensor in sensors) else 1
        length = {"elongation": "mm", "noise_mm, shared_mm": "mm, standard uncertainty (k = 1)"}
        constant, relative = fusion.inverses[0].reference if fusion is not None else (0.0, 0.0)
        return {
            "format": _FORMAT,
            "version": known if self.signal_unit == "mV" else _VERSION,
            **self.head,
            "units": {"signal": self.signal_unit, **length},
            "coverage_factor": COVERAGE_FACTOR,
            "sensors": sensors,
            "correlation": None if fusion is None else fusion.correlation.tolist(),
            "reference_u": {"constant_mm": constant, "relative": relative},
            "void": self.void,
        }

    def text(self) -> str:
        return json.dumps(finite(self.as_json()), indent=1, ensure_ascii=False, allow_nan=False, default=str) + "\n"


def _sensor(record: SensorRecord, u_mm: list[Any]) -> Mapping[str, Any]:
    """Return the curve of a sensor, its test and U; without a curve the reason is in the file's `void`."""
    adequacy = None if record.void else record.calibration().adequacy
    return {
        "name": record.name,
        "adequacy": adequacy.as_json() if adequacy is not None else None,
        "u_elongation_mm": u_mm or None,
        "u_reason": record.u_reason,
        "u_stand_in": record.u_stand_in,
        "fit": record.fit or None,
    }


def _inverse_json(inverse: Inverse) -> dict[str, Any]:
    values = {"range_mm": inverse.x_range} | {key: getattr(inverse, key) for key in _INVERSE[1:]}
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}


def read_calibration(path: str | Path) -> CalibrationFile:
    """Return the calibration of a file by `CalibrationFile.text`. FileError: of another kind, newer, or damaged."""
    path = Path(path)
    if not path.is_file():
        raise FileError(f"{path} does not exist" if not path.exists() else f"{path} is not a file", "Check the name.")
    try:
        content = json.loads(read_regular(path, MOST_BYTES))
    except OSError as error:
        raise FileError(f"{path.name} cannot be read: {error.strerror}", "Check the file.") from error
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        cause = f"{path.name} is not a calibration of boat-daq"
        raise FileError(cause, "Give the JSON file of an exported calibration.")
    version = content.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or not 1 <= version <= _VERSION:
        remedy = "Update boat-daq."
        raise FileError(f"{path.name} has version {version!r:.20}; this program reads up to {_VERSION}", remedy)
    try:
        return _parsed(content)
    except _DamageError as error:
        raise FileError(f"{path.name} is damaged: {error}", "Export the calibration again.") from None


class _DamageError(ValueError):
    """What of a file is wrong."""


def _parsed(content: Mapping[str, Any]) -> CalibrationFile:
    head = {key: _typed(content, key, bool if key == "simulated" else str) for key in _HEAD}
    head["warnings"] = [one for one in _typed(content, "warnings", list) if isinstance(one, dict)]
    void, sensors = _typed(content, "void", str), _typed(content, "sensors", list)
    if not 1 <= len(sensors) <= MOST_SENSORS or not all(isinstance(sensor, dict) for sensor in sensors):
        raise _DamageError("sensors is not a list of sensors")
    for number, sensor in enumerate(sensors, 1):
        if not isinstance(sensor.get("adequacy"), dict | None):
            raise _DamageError(f"adequacy of sensor {number} is not an object")
        sensor["name"] = str(sensor.get("name") or f"s{number}")
    kept = tuple({key: value for key, value in sensor.items() if key != "inverse"} for sensor in sensors)
    signal_unit = str((content.get("units") or {}).get("signal") or "mV")
    if void:
        return CalibrationFile(head, kept, None, void, signal_unit)
    terms = _typed(content, "reference_u", dict)
    reference = (_number(terms, "constant_mm", least=0.0), _number(terms, "relative", least=0.0))
    inverses = tuple(
        replace(
            _inverse(sensor.get("inverse"), sensor["name"], reference),
            u_void=str(sensor.get("u_reason") or ""),
            u_stand_in=str(sensor.get("u_stand_in") or ""),
        )
        for sensor in sensors
    )
    correlation = _array(content, "correlation", (len(sensors), len(sensors)))
    if np.abs(correlation).max() > 1.0 + 1e-9 or not np.allclose(correlation, correlation.T):
        raise _DamageError("correlation is not a correlation matrix")
    return CalibrationFile(head, kept, Fusion(inverses, correlation), "", signal_unit)


def _inverse(content: Any, name: str, reference: tuple[float, float]) -> Inverse:
    if not isinstance(content, Mapping):
        raise _DamageError(f"inverse of {name} is missing")
    low, high = (float(end) for end in _array(content, "range_mm", (2,)))
    starts, powers = _array(content, "starts", None), _array(content, "powers", None)
    fits = starts.ndim == 1 and powers.ndim == 2 and 2 <= starts.size <= MOST_PIECES + 1
    if not low < high or not fits or powers.shape[0] != starts.size - 1 or not 2 <= powers.shape[1] <= MOST_POWERS:
        raise _DamageError(f"range, starts and powers of {name} do not fit each other")
    if starts[0] != -1.0 or starts[-1] != 1.0 or (np.diff(starts) <= 0).any():
        raise _DamageError(f"starts of {name} do not rise from -1 to 1")
    nodes = signal_at(np.linspace(-1.0, 1.0, NODES), starts, powers)
    steps = np.diff(nodes)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise _DamageError(f"the curve of {name} is not monotone")
    noise, shared = (_array(content, key, (U_NODES,)) for key in ("noise_mm", "shared_mm"))
    if min(noise.min(), shared.min()) < 0:
        raise _DamageError(f"an uncertainty of {name} is negative")
    half_division = _number(content, "half_division_mm", least=0.0)
    return Inverse((low, high), starts, powers, nodes, noise, shared, half_division, reference)


def _typed(content: Mapping[str, Any], key: str, kind: type) -> Any:
    value = content.get(key)
    if not isinstance(value, kind):
        raise _DamageError(f"{key} is missing or of another kind")
    return value


def _number(content: Mapping[str, Any], key: str, least: float) -> float:
    value = content.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        raise _DamageError(f"{key} is not a number of at least {least:g}")
    return float(value)


def _array(content: Mapping[str, Any], key: str, shape: tuple[int, ...] | None) -> FloatArray:
    try:
        array = np.asarray(content.get(key), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise _DamageError(f"{key} is not an array of numbers") from None
    if not array.size or (shape is not None and array.shape != shape) or not np.isfinite(array).all():
        raise _DamageError(f"{key} is missing, of another shape or not finite")
    return array
