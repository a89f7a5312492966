"""The curves that a calibration can have, by name in files, options and forms; `Degree` in the analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from protocol.base.errors import ChoiceError

AUTO: Final = "auto"
SPLINE: Final = "spline"
DEGREES = (1, 2, 3, 4, 5, 6)
USUAL_DEGREE = 3
CURVES = (*map(str, DEGREES), SPLINE)
Degree = int | Literal["auto", "spline"]


def degree_of(name: str) -> Degree:
    """Return the curve that a choice names: auto, spline, or a degree; raises RequestError if it names none."""
    found: dict[str, Degree] = {AUTO: AUTO, SPLINE: SPLINE, **{str(degree): degree for degree in DEGREES}}
    if name not in found:
        raise ChoiceError(f"{name!r:.40} is not a curve", f"Give one of {', '.join(found)}.")
    return found[name]


def curve_name(name: str) -> str:
    return "a monotone spline" if name == SPLINE else f"degree {name}"


@dataclass(frozen=True, slots=True)
class CurveCandidate:
    """One candidate curve of a sensor: rms error of predicting inner positions, U in mid-range; NaN if unknown."""

    name: str
    verdict: str = ""
    sentence: str = ""
    prediction_rms_mv: float = float("nan")
    expanded_mm: float = float("nan")
    void: str = ""
