"""Figures against limits: those of the published sensors of this design, and those that the user set.

One decision rule (`analysis.conformity`) judges every limit; its guard band is the half of a figure's 95 % interval
that faces the limit. A figure that fails a published limit is out of tolerance; the operator may accept it all the
same. The verdict of a report is against the limits that the user set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis import published
from analysis.calibration.type_b import NO_SPREAD
from analysis.conformity import Conformity, ConformityStatement, conformity_statement
from analysis.figures.figure import SENSOR_FIGURES, Figure, Reason, sensor_text
from analysis.json_object import json_object
from analysis.numbers import percent
from analysis.warning import Warning, WarningCode
from protocol.base.errors import ChoiceError, one_of

if TYPE_CHECKING:
    from analysis.calibration.fit import Calibration
    from analysis.figures.pipeline import Analysis
    from analysis.figures.sensor_analysis import SensorAnalysis

LEAST_R2 = 1.0 - 2.0**2 * (1.0 - min(sensor.r2 for sensor in published.SENSORS))
READING_ALLOWANCE = 2.0  # times the variance that the grid alone makes: 99 % of a chi-square over some 16 positions


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A limit of a figure: its key, the limit, its source, whether it is a lower one, or one of the absolute value."""

    key: str
    limit: float
    source: str
    is_lower: bool = False
    is_absolute: bool = False

    @property
    def symbol(self) -> str:
        return "\u2265" if self.is_lower else "\u2264"

    @property
    def limits(self) -> tuple[float, float]:
        if self.is_lower:
            return self.limit, math.inf
        return (-self.limit if self.is_absolute else -math.inf), self.limit


TOLERANCES = (
    Tolerance("sensor_hysteresis_percent_fso", 5.0, "published, less than 5 % FSO"),
    Tolerance("system_hysteresis_percent_fso", 5.0, "published, less than 5 % FSO"),
    Tolerance("combined_error_percent_fso", 24.2, "twice that of the published sensor 1"),
    Tolerance("snr_db", 38.7, "twice the published noise", is_lower=True),
)
SET_BY_USER = "set by the user"
_ALONE = {"sensor_hysteresis_percent_fso": "hysteresis"}  # of a sensor without its actuator
_MORE_DECIMALS = 3  # of a value that its usual ones round to the limit


@dataclass(frozen=True, slots=True)
class LimitStatement:
    """Conformity of one figure of a sensor with one limit; `name` is the limit's."""

    name: str
    sensor: str
    figure: Figure
    tolerance: Tolerance
    statement: ConformityStatement

    @property
    def conformity(self) -> Conformity:
        return self.statement.conformity

    @property
    def text(self) -> str:
        """Phrase and probability, e.g. `hysteresis, sensor 1: 4.95 % FSO, limit 5 % FSO, conformity 80 % probable`."""
        probable, one = self.statement.probability, self.figure.reason is Reason.ONE_CYCLE
        unknown = f"{NO_SPREAD}: run three" if one else "its uncertainty is not known"
        return f"{self.phrase}, {f'conformity {percent(probable)} probable' if math.isfinite(probable) else unknown}"

    @property
    def phrase(self) -> str:
        """Figure, value and limit, e.g. `hysteresis, system, sensor 1: 4.97 % FSO, limit 5 % FSO`."""
        definition, figure = SENSOR_FIGURES.get(self.tolerance.key), self.figure
        name = definition.phrase if definition is not None else self.name
        unit = f" {figure.unit}" if figure.unit else ""
        form = ".3g" if definition is None else f".{self.decimals(definition.decimals)}f"
        value = f"{figure.value:{form}}{unit}" if math.isfinite(figure.value) else "not known"
        alone = _ALONE.get(self.tolerance.key)
        whose = f"{alone or name}, {sensor_text(self.sensor)}{' alone' if alone else ''}"
        return f"{whose}: {value}, limit {self.tolerance.limit:g}{unit}"

    def decimals(self, usual: int) -> int:
        """Return the decimals that show on which side of the limit the value is, the usual ones where they do."""
        value = abs(self.figure.value) if self.tolerance.is_absolute else self.figure.value
        limit, most = self.tolerance.limit, usual + _MORE_DECIMALS
        return next((n for n in range(usual, most) if np.sign(round(value, n) - limit) == np.sign(value - limit)), most)

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `conformity`."""
        figure = ("figure=tolerance.key", "value=figure.value", "unit=figure.unit")
        limit = ("limit=tolerance.limit", "is_lower=tolerance.is_lower", "source=tolerance.source")
        return json_object(self, "name", "sensor", *figure, *limit) | self.statement.as_json()


def _stated(name: str, sensor: SensorAnalysis, tolerance: Tolerance) -> LimitStatement:
    unit = SENSOR_FIGURES[tolerance.key].unit
    figure = sensor.figures.get(tolerance.key) or Figure(math.nan, unit, 0)
    expanded = (figure.value - figure.low, figure.high - figure.value)
    statement = conformity_statement(figure.value, expanded, tolerance.limits)
    return LimitStatement(name, sensor.name, figure, tolerance, statement)


def against_published(sensor: SensorAnalysis) -> list[LimitStatement]:
    """State the conformity of a sensor with the published limits; without a calibration of figures that need none."""
    found = [t for t in TOLERANCES if t.key in sensor.figures]
    if sensor.calibration is None:
        found = [t for t in found if "sensor_" not in t.key or math.isfinite(sensor.figures[t.key].value)]
    return [_stated(t.key, sensor, t) for t in found]


def out_of_tolerance(sensor: SensorAnalysis, reading_sd_mm: float) -> tuple[Warning, ...]:
    """Return a warning for each figure of a calibration that is out of tolerance; its subject is the figure."""
    if sensor.calibration is None:
        return ()
    found = []
    of_r2 = r2_statement(sensor.name, sensor.calibration, reading_sd_mm)
    if _is_beyond(of_r2.statement):
        text = f"R² {of_r2.figure.value:.4f} is below {of_r2.tolerance.limit:.4f} ({of_r2.tolerance.source})"
        found.append(Warning(WarningCode.OUT_OF_TOLERANCE, "r2", text))
    for stated in against_published(sensor):
        figure, tolerance = stated.figure, stated.tolerance
        if _is_beyond(stated.statement):
            side = "below" if tolerance.is_lower else "above"
            value = f"{SENSOR_FIGURES[tolerance.key].phrase} {figure.value:.1f} {figure.unit}"
            text = f"{value} is {side} {tolerance.limit:.1f} ({tolerance.source})"
            found.append(Warning(WarningCode.OUT_OF_TOLERANCE, tolerance.key, text))
    return tuple(found)


def _is_beyond(statement: ConformityStatement) -> bool:
    """Return whether a limit is failed, or exceeded with no uncertainty to reach back."""
    unknown = statement.conformity is Conformity.CONDITIONAL_FAIL and not np.isfinite(statement.probability)
    return unknown or statement.conformity is Conformity.FAIL


def r2_statement(name: str, calibration: Calibration, reading_sd_mm: float) -> LimitStatement:
    """State the conformity of R² with the published residuals and what the grid of the readings makes."""
    grid = f" and what a grid of {np.sqrt(12.0) * reading_sd_mm:.2g} mm makes" if reading_sd_mm > 0 else ""
    source = f"twice the published residuals{grid}"
    tolerance = Tolerance("r2", _least_r2(calibration, reading_sd_mm), source, is_lower=True)
    value, (low, high) = calibration.r2, calibration.r2_interval
    statement = conformity_statement(value, (value - low, high - value), tolerance.limits)
    return LimitStatement("r2", name, Figure(value, "", calibration.n, low, high), tolerance, statement)


def _least_r2(calibration: Calibration, reading_sd_mm: float) -> float:
    low, high = calibration.x_range
    variance = float(np.var(calibration.y))
    if not variance > 0:
        return LEAST_R2
    by_reading = (reading_sd_mm * calibration.full_scale / (high - low)) ** 2
    return LEAST_R2 - READING_ALLOWANCE * by_reading / variance


LIMITS = {  # name -> the figure that it limits
    "hysteresis": "system_hysteresis_percent_fso",
    "sensor_hysteresis": "sensor_hysteresis_percent_fso",
    "repeatability": "repeatability_worst_percent_fso",
    "drift": "drift_percent_fso_per_100_cycles",
    "nonlinearity": "nonlinearity_percent_fso",
    "snr": "snr_db",
    "sensitivity": "sensitivity_mv_per_mm",
}
LOWER_LIMITS = ("snr", "sensitivity")  # the others are upper limits
ABSOLUTE_LIMITS = ("drift",)  # of a figure that has a sign


def judge(sensors: Sequence[SensorAnalysis], limits: Mapping[str, float]) -> list[LimitStatement]:
    """State the conformity of all figures with the user's limits; RequestError if a limit names no figure."""
    unknown = next((name for name in limits if name not in LIMITS), None)
    if unknown is not None:
        raise ChoiceError(f"there is no limit called {unknown!r}", one_of(unknown, LIMITS))
    tolerances = {
        name: Tolerance(LIMITS[name], limit, SET_BY_USER, name in LOWER_LIMITS, name in ABSOLUTE_LIMITS)
        for name, limit in limits.items()
    }
    return [_stated(name, sensor, tolerance) for name, tolerance in tolerances.items() for sensor in sensors]


def worst_conformity(statements: Sequence[LimitStatement]) -> Conformity:
    """Return the statement on all limits together: the worst of them, undetermined where no worse one is."""
    order = (
        Conformity.FAIL, Conformity.CONDITIONAL_FAIL, Conformity.UNDETERMINED, Conformity.CONDITIONAL_PASS,
        Conformity.PASS,
    )  # fmt: skip
    return min((one.conformity for one in statements), key=order.index, default=Conformity.UNDETERMINED)


def conformity_json(analysis: Analysis, limits: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return `conformity` of `analyze --json`: the limits that the user set, then the published ones, R² last."""
    stated = [*judge(analysis.sensors, limits), *(one for s in analysis.sensors for one in against_published(s))]
    fits = [(s.name, s.calibration) for s in analysis.sensors if s.calibration is not None]
    stated += [r2_statement(name, calibration, analysis.reading_sd_mm) for name, calibration in fits]
    return [one.as_json() for one in stated]
