"""The texts of the calibration page: what is missing for a curve, warnings, curves and coefficients as rows."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from analysis.calibration.compare import Coefficient
from analysis.calibration.curve_choice import SPLINE, CurveCandidate
from analysis.numbers import decimals_for
from analysis.warning import WarningCode
from boat_daq.formatting import SUBSCRIPT, SUPERSCRIPT, count, number, sensor_words, typographic
from boat_daq.viewmodels.results.run_result import RunResult
from boat_daq.workflows.acceptance import Lack, lack_text, lacking
from protocol.base.units import NOTHING, Quantity, ShownUnits, as_text

Cells = tuple[str, ...]
LEAST_ELONGATIONS = 4  # of a cubic
OF_A_READING = (WarningCode.OUTLIER, WarningCode.HIGH_LEVERAGE)


class NextStep(Enum):
    """What the operator can do about a missing curve: the text of its button."""

    NONE = ""
    SHOW_PLAN = "Show the plan"
    SHOW_REPEATABILITY = "Show its cycles"
    ENTER_READINGS = "Enter readings \u2026"
    CHOOSE_READINGS = "Choose the file of readings \u2026"


class NoCurve(NamedTuple):
    """What is shown in place of a curve: title, text and the next step."""

    title: str
    text: str
    step: NextStep = NextStep.NONE


VERDICT_LOOKS = {  # state of a verdict -> state and mark of its text
    "ok": ("ok", "\u25cf"), "check": ("warning", "\u25b2"), "fail": ("fault", "\u25a0"), "none": ("", "\u25cb"),
}  # fmt: skip


def shown_text(text: str) -> str:
    """Return a text of the analysis with a capital and the window's minus."""
    return typographic(text[:1].upper() + text[1:])


def verdict_text(verdict_state: str, text: str) -> tuple[str, str]:
    """Return state and marked text of a verdict, or of its limits."""
    state, mark = VERDICT_LOOKS[verdict_state]
    return state, f"{mark} {shown_text(text)}"


def readings_text(result: RunResult) -> str:
    """Return how many plateaus were read and are in the curve; empty without plateaus."""
    n, read = result.plateaus, result.read
    if not n:
        return ""
    used = sorted({sensor.x.size for sensor in result.sensors if sensor.fit is not None})
    if not used:
        return f"{read or 'none'} of {count(n, 'plateau')} read"
    if read == n:
        return f"{' or '.join(map(str, used))} of {count(n, 'reading')} used"
    return f"{read} of {count(n, 'plateau')} read, {'all' if used == [read] else ' or '.join(map(str, used))} used"


def missing(result: RunResult) -> NoCurve | None:
    """Return what is missing for a curve of any sensor, and the next step; None where there is one."""
    lack = lacking(result)
    if lack is None:
        return None
    title = lack_text(result, lack)
    if lack is Lack.CYCLES:
        return NoCurve(
            title,
            "A cycle goes from the highest pressure to the lowest and back. Run the plan to its end.",
            NextStep.SHOW_PLAN,
        )
    if lack is Lack.PLATEAUS:
        return NoCurve(
            title,
            "A curve needs readings at constant pressures between the turning points. See its cycles in Repeatability.",
            NextStep.SHOW_REPEATABILITY,
        )
    least = f"A curve needs readings at {LEAST_ELONGATIONS} or more different elongations."
    if not result.stepped:
        text = f"{least} Choose a CSV file with pressure_kpa and elongation_mm, a row a plateau."
        return NoCurve(title, text, NextStep.CHOOSE_READINGS)
    text = f"{least} Type them, or paste a column of a spreadsheet."
    return NoCurve(title, text, NextStep.ENTER_READINGS)


def warnings(result: RunResult) -> tuple[str, ...]:
    """Return the warnings of a run as texts, first those of a reading, which can be corrected."""
    ordered = sorted(result.warnings, key=lambda warning: warning.code not in OF_A_READING)
    return tuple(shown_text(f"{sensor_words(w.subject)}: {w.text}" if w.subject else w.text) for w in ordered)


def curve_row(c: CurveCandidate, units: ShownUnits, *, chosen: bool) -> tuple[Cells, str]:
    error = Quantity(c.prediction_rms_mv, "mV", ".2f", named=False)
    name = "Spline" if c.name == SPLINE else f"Degree {c.name}"
    sign = {"adequate": "\u25cf", "doubtful": "\u25d0", "inadequate": "\u25b2"}.get(c.verdict, "")
    cells = (
        f"\u25b8 {name}" if chosen else name,
        f"{sign} {c.verdict}" if c.verdict else "not tested",
        _plain(units, "mm", c.expanded_mm, 3),
        error.text(units.shown("mV")) if np.isfinite(c.prediction_rms_mv) else NOTHING,
    )
    return cells, "\n".join(filter(None, (c.sentence, f"no U: {c.void}" if c.void else "")))


def _plain(units: ShownUnits, stored: str, value: float, decimals: int) -> str:
    """Return a value as shown, without its unit, which is in the heading."""
    shown = units.shown(stored)
    return number(shown.value(value), shown.decimals(decimals))


def coefficient_row(label: str, c: Coefficient, units: ShownUnits) -> tuple[Cells, str]:
    signal, length = units.shown("mV"), units.shown("mm")
    factor = signal.factor / length.factor**c.power
    power = "" if c.power == 1 else str(c.power).translate(SUPERSCRIPT)
    unit = as_text(f"{signal.symbol}/{length.symbol}{power}" if c.power else signal.symbol)
    cells = (
        f"b{str(c.power).translate(SUBSCRIPT)}, {unit}",
        measured(factor * c.value, factor * c.std_error),
        measured(factor * c.value_before, factor * c.std_error_before),
        number(c.e_n, 2, sign=True),
    )
    tip = (
        f"{label}: coefficient of x{power}, {unit}, with its standard error; "
        "E\u2099 = difference / (2 \u00b7 root of the sum of their squares)"
    )
    return cells, tip


def measured(value: float, std_error: float) -> str:
    """Return a value with its standard error in parentheses, in units of the last digit: `39.34(12)`."""
    if not (np.isfinite(value) and np.isfinite(std_error) and std_error > 0):
        return number(value, 3)
    places = max(0, decimals_for(std_error))
    return f"{number(value, places)}({round(std_error * 10**places)})"
