"""The interval to the next calibration, proposed from the drift, as ILAC-G24 proposes from control charts.

The check point's error over time, as elongation, is fitted by a line with weights 1/u^2. The interval ends where the
drift since the last calibration, with its expanded uncertainty, would reach the permissible drift, by default U of an
elongation there. It is no longer than twice the time that the calibrations cover; one calibration gives none.
Sources: ILAC-G24 / OIML D 10:2022, method 2 (control chart); R. T. Birge, Phys. Rev. 40 (1932) 207.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.json_object import json_object
from analysis.numbers import with_uncertainty
from protocol.base.arrays import FloatArray
from protocol.base.units import COVERAGE_FACTOR

DAYS_PER_YEAR = 365.25
LONGEST_RATIO = 2.0
LEAST_DAYS = 1.0  # that calibrations cover: less shows warm-up and handling, not ageing


@dataclass(frozen=True, slots=True)
class CalibrationInterval:
    """A proposed interval; `days` is NaN where `void` gives the reason, `due_utc` an ISO 8601 date or "".

    `extrapolated` : the interval is cut at twice the time that the calibrations cover.
    """

    days: float
    due_utc: str
    drift_mm_per_year: float
    drift_u: float
    limit_mm: float
    extrapolated: bool = False
    void: str = ""

    @property
    def significant(self) -> bool:
        """Whether the drift exceeds its expanded uncertainty."""
        return abs(self.drift_mm_per_year) > COVERAGE_FACTOR * self.drift_u

    @property
    def sentence(self) -> str:
        """The proposal as a sentence without its end."""
        if self.void:
            return f"no recalibration interval is proposed: {self.void}"
        drift = f"drift {with_uncertainty(self.drift_mm_per_year, COVERAGE_FACTOR * self.drift_u)} mm a year"
        cut = ", twice the time that the calibrations cover" if self.extrapolated else ""
        days = f"{self.days:.0f} days" if self.days >= 1 else "less than a day"
        return f"due again {self.due_utc[:10]}, {days} after the last{cut}; {drift}, permissible {self.limit_mm:.2g} mm"

    def as_json(self) -> dict[str, Any]:
        """Return `interval` of `history --json`."""
        drift = ("drift_mm_per_year", "drift_u_mm_per_year=drift_u")
        return json_object(self, "days", "due_utc", *drift, "limit_mm", "extrapolated", "void", "significant")


def proposed_interval(
    when: Sequence[datetime.datetime | None], error_mm: FloatArray, u_mm: FloatArray, limit_mm: float
) -> CalibrationInterval:
    """Propose the interval to the next calibration, from [n] dates in order, errors of the check point and their u."""
    known = [time for time in when if time is not None]
    days = np.asarray([(time - known[0]).total_seconds() / 86_400.0 for time in known])
    void = ""
    if len(known) < len(when):
        void = "the time of a calibration is not known"
    elif len(known) < 2:
        void = "one calibration shows no drift"
    elif not days[-1] >= LEAST_DAYS:
        void = "the calibrations cover less than a day"
    elif not (np.isfinite(error_mm).all() and np.isfinite(u_mm).all() and (u_mm > 0).all()):
        void = "the uncertainty of a calibration is not known"
    elif not (math.isfinite(limit_mm) and limit_mm > 0):
        void = "the uncertainty of an elongation is not known, and no permissible drift is given"
    if void:
        return CalibrationInterval(math.nan, "", math.nan, math.nan, limit_mm, void=void)
    slope, u_slope = _drift(days, error_mm, u_mm)
    longest = LONGEST_RATIO * float(days[-1])
    span = min(_time_to(limit_mm, abs(slope), u_slope, float(u_mm[-1])), longest)
    due = (known[-1] + datetime.timedelta(days=math.floor(span) if span >= 1 else span)).isoformat(timespec="seconds")
    per_year = (slope * DAYS_PER_YEAR, u_slope * DAYS_PER_YEAR)
    return CalibrationInterval(span, due, *per_year, limit_mm, extrapolated=span == longest)


def _drift(days: FloatArray, error_mm: FloatArray, u_mm: FloatArray) -> tuple[float, float]:
    """Return the slope of the weighted line, mm a day, and its standard uncertainty."""
    weight = 1.0 / u_mm**2
    centred = days - weight @ days / weight.sum()
    spread = float(weight @ centred**2)
    slope = float(weight @ (centred * error_mm)) / spread
    residual = error_mm - weight @ error_mm / weight.sum() - slope * centred
    dof = days.size - 2
    birge = math.sqrt(float(weight @ residual**2) / dof) if dof > 0 else 1.0
    return slope, max(birge, 1.0) / math.sqrt(spread)


def _time_to(limit: float, slope: float, u_slope: float, u_last: float) -> float:
    """Return t with slope t + 2 sqrt(u_last^2 + (u_slope t)^2) = limit, days; 0 where the limit is reached at once."""
    if limit <= COVERAGE_FACTOR * u_last:
        return 0.0
    a = slope**2 - (COVERAGE_FACTOR * u_slope) ** 2
    half_b, c = -limit * slope, limit**2 - (COVERAGE_FACTOR * u_last) ** 2
    # a t^2 + 2 half_b t + c = 0; this form of its smaller root holds for a of either sign, and for zero
    return c / (-half_b + math.sqrt(max(half_b**2 - a * c, 0.0)))
