"""The verdict of a run: what its calibration may be used for, as one value for window, report, commands and files.

A calibration is usable where its U is known and at most a tenth of its range, no reading is to be checked, and no limit
is failed. U is the largest over the range, of one reading by all sensors together, as the live display gives it. The
limits are those that the user set, else the published ones; without a calibration they alone give the verdict.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.checks import NEAR_TURN
from analysis.calibration_export.run_record import elongation_reader
from analysis.conformity import Conformity
from analysis.figures.acceptance import LimitStatement, against_published, judge, out_of_tolerance, worst_conformity
from analysis.figures.figure import sensor_text
from analysis.figures.pipeline import Analysis
from analysis.figures.reading_check import CheckedReading
from analysis.json_object import json_object
from analysis.numbers import percent
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError
from protocol.base.units import COVERAGE_FACTOR, Quantity, UnitText

_POINTS = 101
_INSIDE = 1e-6  # of the range: its very ends round out of it
_MOST_OF_U = 0.8  # a movement that makes nearly all of U
_LARGEST_U = 0.1  # of the range: six standard uncertainties then are 30 % of it, the limit of a gauge (AIAG, MSA)
_MOST_NAMED = 3  # readings to be checked; the warnings name all


class VerdictCode(StrEnum):
    """What decides the verdict, the gravest first; `LIMITS`: no calibration was tried, the limits alone decide."""

    NO_CURVE = "no_curve"
    TURNS = "turns"
    READINGS_TO_CHECK = "readings_to_check"
    U_NOT_KNOWN = "u_not_known"
    LARGE_U = "large_u"
    OUT_OF_TOLERANCE = "out_of_tolerance"
    USABLE = "usable"
    LIMITS = "limits"


class VerdictState(StrEnum):
    """How it is shown: green, amber, red, or without a colour."""

    OK = "ok"
    CHECK = "check"
    FAIL = "fail"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict of a run."""

    code: VerdictCode = VerdictCode.LIMITS
    state: VerdictState = VerdictState.NONE
    reason: str = ""  # why there is no curve, or why U is not known
    u_mm: float = math.nan  # largest U (k = 2) over the range, NaN where it is not known
    range_mm: tuple[float, float] = (math.nan, math.nan)
    u_stand_in: str = ""  # what U rests on besides the run; "" where it rests on the run
    readings: tuple[CheckedReading, ...] = ()  # those to be checked; `confirmed` those that were, each with its reason
    confirmed: tuple[CheckedReading, ...] = ()
    limits: tuple[LimitStatement, ...] = field(default=(), repr=False)  # with each limit and sensor
    limits_set: bool = False
    missed: tuple[str, ...] = ()  # figures out of tolerance, a sentence for each sensor that has one
    doubts: tuple[str, ...] = ()  # what U is given in spite of, a sensor each

    @property
    def conformity(self) -> Conformity:
        """The statement on all limits together."""
        return worst_conformity(self.limits)

    @property
    def limits_state(self) -> VerdictState:
        """How the limits alone are shown; a published one that is failed, of another design, is to be checked."""
        state = _state_of(self.limits)
        return VerdictState.CHECK if state is VerdictState.FAIL and not self.limits_set else state

    @property
    def check_count(self) -> str:
        """The number of readings to be checked, e.g. `1 reading to check`; empty without one."""
        n = len(self.readings)
        return f"{n} reading{'s' if n > 1 else ''} to check" if n else ""

    @property
    def check_text(self) -> str:
        """The readings to be checked, e.g. `1 reading to check: +10.00 mm at +10 kPa, 9.2 mm from the others`."""
        named = UnitText("; ").joined(one.text for one in self.readings[:_MOST_NAMED])
        more = f"; and {len(self.readings) - _MOST_NAMED} more" if len(self.readings) > _MOST_NAMED else ""
        return UnitText(f"{self.check_count}: ", named, more) if self.readings else ""

    @property
    def use(self) -> str:
        """What the calibration gives, e.g. `U = 0.13 mm (k = 2) from -2.5 to 4.0 mm`, or why it gives nothing."""
        if self.code is VerdictCode.LIMITS:
            return ""
        if self.code in (VerdictCode.NO_CURVE, VerdictCode.TURNS):
            return f"Not a calibration: {self.reason}"
        low, high = self.range_mm
        where = UnitText("from ", Quantity(low, "mm", ".1f", named=False), " to ", Quantity(high, "mm", ".1f"))
        if not math.isfinite(self.u_mm) and self.readings:
            return "U is not known yet"
        if not math.isfinite(self.u_mm):
            return UnitText("U is not known ", where, f": {self.reason}")
        mark = ", with a stated value" if self.u_stand_in else ""
        return UnitText("U = ", Quantity(self.u_mm, "mm", ".2g"), f" (k = {COVERAGE_FACTOR:g}{mark}) ", where)

    @property
    def headline(self) -> str:
        """What is known and what is to be done, e.g. `U = 0.13 mm (k = 2) from -2.5 to 4.0 mm; 1 reading to check`."""
        missed = "out of tolerance" if self.missed and not self.readings else ""
        parts = [part for part in (self.use, *self.doubts, self.check_count, missed) if part]
        return UnitText("; ").joined(parts) if parts else _capital(self.limits_text)

    @property
    def limits_text(self) -> str:
        """The gravest statement on the limits, e.g. `hysteresis, system, sensor 1: 4.97 % FSO, limit 5 % FSO, fail`."""
        if not self.limits:
            return "no figure to compare with a limit"
        worst, kind = self.conformity, "limits" if self.limits_set else "published limits"
        if worst is Conformity.PASS:
            count = len({one.name for one in self.limits})
            return f"all {count} {kind} are kept" if count > 1 else "the limit is kept"
        found = [one for one in self.limits if one.conformity is worst]
        least = min(found, key=lambda one: one.statement.probability if one.statement.probability >= 0 else 2.0)
        others = len({one.name for one in found} - {least.name})
        more = f"; the same for {others} more of the {kind}" if others else ""
        return f"{least.phrase}, {worst.label}{more}"

    @property
    def sentence(self) -> str:
        """The headline with the limits, or with the readings to be checked, on which all figures then rest."""
        if self.readings:
            return f"{self.use}; {self.check_text}"
        limits = _capital(self.limits_text)
        return limits if self.headline == limits else f"{self.headline}. {limits}"

    def as_json(self) -> dict[str, Any]:
        """Return `verdict` of `analyze --json`."""
        found = json_object(
            self, "code", "state", "headline", "reason", "u_mm", "range_mm", "u_stand_in", "confirmed", "limits_set"
        )
        return found | {
            "check": [one.as_json() for one in self.readings],
            "conformity": str(self.conformity),
            "out_of_tolerance": list(self.missed),
            "doubts": list(self.doubts),
        }


def verdict_of(analysis: Analysis, limits: Mapping[str, float] | None = None) -> Verdict:
    """Return the verdict of a run; `limits` as of `acceptance.judge`, those of the user."""
    stated = limit_statements(analysis, limits)
    readable = analysis.plateaus and analysis.elongations is not None
    if not readable and not any(sensor.calibration for sensor in analysis.sensors):
        alone = Verdict(VerdictCode.LIMITS, limits=stated, limits_set=bool(limits))
        return replace(alone, state=alone.limits_state)
    missed = tuple(
        f"{sensor_text(sensor.name)}: {', '.join(one.text for one in found)}"
        for sensor in analysis.sensors
        if (found := out_of_tolerance(sensor, analysis.reading_sd_mm))
    )
    readings = tuple(one for one in analysis.checked if not one.confirmed)
    u_mm, range_mm, unknown, stand_in = _largest_u(analysis)
    large = _large_u(analysis, u_mm, range_mm)
    code, reason = _code_of(analysis, readings, unknown, large=bool(large), missed=bool(missed))
    failed = worst_conformity(stated) is Conformity.FAIL and bool(limits)
    doubts = (*large, *_doubts(analysis, u_mm))
    state = VerdictState.OK if code is VerdictCode.USABLE and not (doubts or stand_in) else VerdictState.CHECK
    if failed or code in (VerdictCode.NO_CURVE, VerdictCode.TURNS):
        state = VerdictState.FAIL
    elif limits and state is VerdictState.OK:
        state = _state_of(stated)
    confirmed = tuple(one for one in analysis.checked if one.confirmed)
    return Verdict(
        code, state, reason, u_mm, range_mm, stand_in, readings, confirmed, stated, bool(limits), missed, doubts
    )


def _large_u(analysis: Analysis, u_mm: float, range_mm: tuple[float, float]) -> tuple[str, ...]:
    """Return how much of its range a U is that is too large, with the turn of a curve that is near; else nothing."""
    low, high = range_mm
    share = u_mm / (high - low) if high > low else math.nan
    if not share > _LARGEST_U:
        return ()
    turns = (t for s in analysis.sensors if s.calibration is not None for t in s.calibration.turning_points)
    near = [t for t in turns if max(low - t, t - high) < NEAR_TURN * (high - low)]
    why = (", a curve turns at ", Quantity(near[0], "mm", ".1f")) if near else ()
    return (UnitText(f"U is {percent(share, 0)} of the range", *why),)


def _doubts(analysis: Analysis, u_mm: float) -> tuple[str, ...]:
    """Return what U is given in spite of: a sensor without U; a curve that misses; holds or a drift of most of U."""
    found = []
    for sensor, u in zip(analysis.sensors, analysis.u_elongation, strict=True):
        calibration, name = sensor.calibration, sensor_text(sensor.name)
        if calibration is None or not math.isfinite(u_mm):
            continue
        if not u.size:
            found.append(f"without {name}")
            continue
        low, high = calibration.x_range
        noticed_mv = _MOST_OF_U * float(np.nanmedian(u[:, 1])) * calibration.full_scale / (high - low)
        if calibration.adequacy is not None and calibration.adequacy.verdict is not CurveVerdict.ADEQUATE:
            found.append(f"the curve of {name} is {calibration.adequacy.verdict}")
        if sensor.settling.most_mv > noticed_mv:
            found.append(f"the holds of {name} are not settled")
        elif abs(sensor.drift_mv) > noticed_mv:
            found.append(f"{name} drifts")
    return tuple(found)


def limit_statements(analysis: Analysis, limits: Mapping[str, float] | None = None) -> tuple[LimitStatement, ...]:
    """State the conformity of a run with the limits that the user set, else with the published ones."""
    if limits:
        return tuple(judge(analysis.sensors, limits))
    return tuple(one for sensor in analysis.sensors for one in against_published(sensor))


def _state_of(stated: Sequence[LimitStatement]) -> VerdictState:
    if not stated:
        return VerdictState.NONE
    states = {Conformity.PASS: VerdictState.OK, Conformity.FAIL: VerdictState.FAIL}
    return states.get(worst_conformity(stated), VerdictState.CHECK)


def _code_of(
    analysis: Analysis, readings: Sequence[CheckedReading], unknown: str, *, large: bool, missed: bool
) -> tuple[VerdictCode, str]:
    """Return what decides the verdict and the reason; a reading that is off may be why a curve turns."""
    without: dict[str, list[str]] = {}  # names of the sensors without a curve, by the reason
    for sensor in analysis.sensors:
        if sensor.calibration is None:
            without.setdefault(sensor.calibration_void, []).append(sensor_text(sensor.name))
    if without:
        return VerdictCode.NO_CURVE, "; ".join(f"{', '.join(names)} ({why})" for why, names in without.items())
    if readings:
        return VerdictCode.READINGS_TO_CHECK, unknown
    for sensor in analysis.sensors:
        if sensor.calibration is not None and not sensor.calibration.monotone:
            name, flat = sensor_text(sensor.name), not sensor.figures["fso_mv"].value
            return VerdictCode.TURNS, f"{name} is flat" if flat else f"the curve of {name} turns inside its range"
    if unknown:
        return VerdictCode.U_NOT_KNOWN, unknown
    if large:
        return VerdictCode.LARGE_U, ""
    return VerdictCode.OUT_OF_TOLERANCE if missed else VerdictCode.USABLE, ""


def _largest_u(analysis: Analysis) -> tuple[float, tuple[float, float], str, str]:
    """Return the largest U over the range of all sensors, mm, the range, why U is not known, and its stand-in."""
    fits = [sensor.calibration for sensor in analysis.sensors if sensor.calibration is not None]
    nothing = (math.nan, math.nan)
    if not fits:
        return math.nan, nothing, "", ""
    with_u = zip(analysis.sensors, analysis.u_elongation, strict=True)  # a lost sensor ends no range
    of_u = [sensor.calibration for sensor, u in with_u if sensor.calibration is not None and u.size] or fits
    range_mm = max(fit.x_range[0] for fit in of_u), min(fit.x_range[1] for fit in of_u)
    try:
        fusion = elongation_reader(analysis)
    except BoatDaqError as error:
        return math.nan, range_mm, error.cause, ""
    if fusion.u_void:
        return math.nan, range_mm, fusion.u_void, ""
    inside = _INSIDE * (range_mm[1] - range_mm[0])
    x = np.linspace(range_mm[0] + inside, range_mm[1] - inside, _POINTS)
    signals: FloatArray = np.column_stack([fit.predict(x) for fit in fits])
    u = np.asarray(fusion.evaluate(signals).standard_uncertainty_mm)
    known = u[np.isfinite(u)]
    if not known.size:
        why = next((why for why in analysis.u_reason if why), "the curve gives no elongation")
        return math.nan, range_mm, why, ""
    return COVERAGE_FACTOR * float(known.max()), range_mm, "", fusion.u_stand_in


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
