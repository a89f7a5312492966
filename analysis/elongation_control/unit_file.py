"""What a unit needs under control, as a JSON file: the identified hysteresis, the gains, and what they rest on.

The file belongs to one calibration: after another one the hysteresis is identified again.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.elongation_control.controller import Tuning
from analysis.elongation_control.dynamics import Lag, Margins
from analysis.elongation_control.hysteresis import HysteresisModel
from analysis.json_object import json_object
from analysis.numbers import finite
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Face
from analysis.shadow.fem.parameters import ActuatorParameters
from protocol.base.errors import FileError, RequestError
from protocol.base.regular_file import read_regular
from protocol.base.whole_file import write_whole

_FORMAT, _VERSION = "boat-daq twin", 1
_MOST_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class TwinFile:
    """A unit under control."""

    unit: str
    simulated: bool
    calibration_utc: str  # when the calibration it rests on was accepted
    recording: str  # name of the run it was identified from
    model: HysteresisModel
    tuning: Tuning | None = None  # the gains; None before a step test
    # actuator, face: the actuator whose light predicts the signals, and the face of the guides with the cavities
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)
    face: Face = "outer"

    def tuned(self, tuning: Tuning) -> TwinFile:
        return replace(self, tuning=tuning)

    def as_json(self) -> dict[str, Any]:
        head = ("unit", "simulated", "calibration_utc", "recording", "hysteresis=model", "tuning", "actuator", "face")
        return {"format": _FORMAT, "version": _VERSION, **json_object(self, *head)}

    def write(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, json.dumps(finite(self.as_json()), indent=1, allow_nan=False) + "\n")


def read_twin(path: Path) -> TwinFile | None:
    """Return the unit of a file; None where there is no file."""
    try:
        content = json.loads(read_regular(path, _MOST_BYTES))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise FileError(f"{path.name} cannot be read: {error.strerror}", "Check the file.") from error
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise FileError(f"{path.name} is damaged", "Identify the unit again.")
    if content.get("version") != _VERSION:
        raise FileError(f"{path.name} has version {content.get('version')!r:.20}", "Update boat-daq.")
    try:
        return _parsed(content)
    except (KeyError, TypeError, ValueError, RequestError) as error:
        raise FileError(f"{path.name} is damaged: {error}", "Identify the unit again.") from error


def _parsed(content: Mapping[str, Any]) -> TwinFile:
    """Return the file's content, every number checked."""
    table = dict(content["hysteresis"])
    radii, weights = (np.asarray(table.pop(key), dtype=np.float64) for key in ("radii", "weights"))
    low, high = (float(end) for end in table.pop("pressure_range_kpa"))
    fits = radii.ndim == 1 and 1 <= radii.size == weights.size <= 100 and np.isfinite([radii, weights]).all()
    if not fits or radii.min() < 0 or weights.min() < 0 or not weights.sum() > 0 or not low < high:
        raise ValueError("radii and weights make no hysteresis")
    names = ("up_curvature", "down_curvature", "offset_mm", "rms_mm", "r2")
    up, down, *rest = (float(table[name]) for name in names)
    if not up <= down or not np.isfinite([up, down, *rest]).all():
        raise ValueError("the envelopes make no hysteresis")
    model = HysteresisModel(radii, weights, up, down, rest[0], (low, high), *rest[1:])
    tuning = None
    if content["tuning"] is not None:
        gains = dict(content["tuning"])
        lag, margins = gains.pop("lag"), gains.pop("margins")
        known = {key: float("nan") if value is None else float(value) for key, value in margins.items()}
        numbers = {key: float(value) for key, value in gains.items()}
        rows = tuple(tuple(map(float, row)) for row in lag.pop("covariance")) if lag is not None else ()
        tuning = Tuning(
            **numbers, margins=Margins(**known), lag=Lag(**lag, covariance=rows) if lag is not None else None
        )
        if not all(value > 0 for key, value in numbers.items() if not key.startswith("lead")):
            raise ValueError("the gains make no control")
    head = [str(content[key]) for key in ("unit", "calibration_utc", "recording")]
    actuator = ActuatorParameters(**content.get("actuator", {}))  # a file of an earlier version has none
    face = replace(PAPER_OPTIMUM, face=content.get("face", "outer")).face
    return TwinFile(head[0], bool(content["simulated"]), head[1], head[2], model, tuning, actuator, face)
