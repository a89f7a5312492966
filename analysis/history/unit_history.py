"""A unit's calibrations over time: curves, coefficients, a control chart of a check point, En, and when one is due.

The check point is y(x0) of each calibration. Control limits are the mean plus and minus three times the mean moving
range / 1.128 (ISO 7870-2, individuals). The En score of a calibration against the one before is
(y - y') / sqrt(U^2 + U'^2), U expanded with k = 2; |En| <= 1 is agreement (ISO 13528). The same recording counts once;
simulated and real runs are never compared.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.calibration.fit import Calibration
from analysis.figures.pipeline import Analysis, analyse
from analysis.history.batch import readings_beside, runs_in
from analysis.history.calibration_interval import CalibrationInterval, proposed_interval
from analysis.progress import Progress
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, DataError, RequestError

MOVING_RANGE_TO_SD = 1.128
_CURVE_POINTS = 81


@dataclass(frozen=True, slots=True)
class DatedCalibration:
    """A calibration of one sensor: when, and x and U of an elongation over its range, [points, 2] mm."""

    when: str
    calibration: Calibration
    u_elongation: FloatArray
    signal_unit: str = "mV"


@dataclass(frozen=True, slots=True)
class UnitHistory:
    """Calibrations of one sensor in order of time."""

    sensor: str
    when: tuple[str, ...]
    coefficients: FloatArray  # [n, degree + 1]; NaN beyond a curve's degree, and of a spline
    std_errors: FloatArray  # [n, degree + 1], the reading of x included
    check_point_mm: float
    value_mv: FloatArray  # [n] y(x0)
    expanded_mv: FloatArray  # [n] its U (k = 2)
    centre_mv: float  # this and the limits of the control chart: NaN below two calibrations
    lower_mv: float
    upper_mv: float
    en: FloatArray  # [n] En score against the calibration before
    expanded_mm: FloatArray  # [n] U of an elongation there
    curves: tuple[FloatArray, ...]  # [points, 2] of each: x and y over its range
    interval: CalibrationInterval
    signal_unit: str = "mV"

    @property
    def out_of_control(self) -> tuple[int, ...]:
        """Positions outside the control limits."""
        outside = (self.value_mv < self.lower_mv) | (self.value_mv > self.upper_mv)
        return tuple(int(i) for i in np.flatnonzero(outside))

    @property
    def drift_per_calibration(self) -> FloatArray:
        """Least-squares slope of each coefficient over the calibrations, [degree + 1]; NaN below two."""
        order = np.arange(len(self.when)) - (len(self.when) - 1) / 2
        with np.errstate(invalid="ignore"):
            return np.asarray(order @ self.coefficients / np.float64(order @ order), dtype=np.float64)

    def as_json(self) -> dict[str, Any]:
        """Return the history as `history --json` reports it."""
        outside = set(self.out_of_control)
        columns = (
            self.when,
            self.coefficients,
            self.std_errors,
            self.value_mv,
            self.expanded_mv,
            self.expanded_mm,
            self.en,
        )
        return {
            "name": self.sensor,
            "signal_unit": self.signal_unit,
            **{name: getattr(self, name) for name in ("check_point_mm", "centre_mv", "lower_mv", "upper_mv")},
            "drift_per_calibration": self.drift_per_calibration.tolist(),
            "calibrations": [
                {
                    "started_utc": when, "coefficients": b.tolist(), "std_errors": u.tolist(), "value_mv": float(v),
                    "expanded_mv": float(expanded), "u_elongation_mm": float(mm), "en": float(e),
                    "in_control": k not in outside,
                }
                for k, (when, b, u, v, expanded, mm, e) in enumerate(zip(*columns, strict=True))
            ],
            "interval": self.interval.as_json(),
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Calibrations:
    """The calibrations of one unit that a folder holds, and why its other runs are none."""

    analyses: tuple[Analysis, ...]
    left_out: tuple[dict[str, str], ...]


def refuse_mixture(simulated: Iterable[bool]) -> None:
    """Raise RequestError if there are both simulated and real runs."""
    if len(set(simulated)) > 1:
        cause = "simulated and real runs are not compared: they share nothing but the name of the unit"
        raise RequestError(cause, "Choose runs of the virtual board only, or none of them.")


def one_signal_unit(units: Iterable[str]) -> str:
    """Return the unit of the signals of all runs; raises RequestError where they have several."""
    found = list(dict.fromkeys(units))
    if len(found) > 1:
        raise RequestError(f"signals in {' and '.join(found)} are not compared", "Choose runs of one unit of signals.")
    return found[0]


def calibrations_in(
    folder: str | Path, unit: str, *, simulated: bool | None = None, progress: Progress | None = None
) -> Calibrations:
    """Analyse the runs of a folder and keep the calibrations of one unit; raises BoatDaqError if there are none.

    `simulated` selects simulated or real boards; None takes the real ones, or the simulated ones if there are no
    others.
    """
    if not unit.strip():
        raise RequestError("a unit without a name has no history: its runs may be of several units", "Name the unit.")
    files = runs_in(folder)
    kept: list[Analysis] = []
    left_out: list[dict[str, str]] = []
    units: set[str] = set()
    for done, path in enumerate(files):
        if progress is not None:
            progress(done, len(files))
        try:
            analysis = analyse(path, readings_beside(path), mcmc=False)
        except BoatDaqError as error:
            left_out.append({"run": path.name, "reason": error.cause})
            continue
        units.add(analysis.recording.unit)
        if analysis.recording.unit == unit:
            if analysis.kind == "calibration":
                kept.append(analysis)
            else:
                left_out.append({"run": path.name, "reason": analysis.sensors[0].calibration_void})
    if simulated is None:
        simulated = bool(kept) and all(analysis.recording.simulated for analysis in kept)
    other, reason = [a for a in kept if a.recording.simulated is not simulated], "real" if simulated else "simulated"
    left_out += [{"run": Path(a.recording.source).name, "reason": f"of a {reason} board"} for a in other]
    kept = [analysis for analysis in kept if analysis.recording.simulated is simulated]
    if not kept:
        known = ", ".join(sorted(filter(None, units))) or "none"
        kind = "simulated calibration" if simulated else "calibration"
        raise DataError(f"{folder} holds no {kind} of unit {unit!r}", f"Units found: {known}.")
    return Calibrations(tuple(kept), tuple(left_out))


def unit_history(
    analyses: Sequence[Analysis], sensor: int, *, check_point_mm: float = 0.0, limit_mm: float | None = None
) -> UnitHistory:
    """Arrange the calibrations of one sensor over time; raises BoatDaqError as `history_of`, or for mixed runs.

    `limit_mm` is the permissible drift, by default U of an elongation at the check point.
    """
    refuse_mixture(analysis.recording.simulated for analysis in analyses)
    found: dict[str, DatedCalibration] = {}
    for analysis in analyses:
        calibration = analysis.sensors[sensor].calibration if sensor < len(analysis.sensors) else None
        if calibration is not None:
            key = str(analysis.recording.meta.get("uuid") or analysis.recording.source)
            when = analysis.recording.started_utc
            found[key] = DatedCalibration(
                when, calibration, analysis.u_elongation[sensor], analysis.recording.signal_unit
            )
    if not found:
        raise DataError("none of the runs is a calibration", "Give recordings with readings of elongation.")
    return history_of(tuple(found.values()), f"s{sensor + 1}", check_point_mm=check_point_mm, limit_mm=limit_mm)


def history_of(
    calibrations: Sequence[DatedCalibration], sensor: str, *, check_point_mm: float = 0.0, limit_mm: float | None = None
) -> UnitHistory:
    """Arrange calibrations of one sensor over time; raises DataError if one does not hold the check point."""
    ordered = sorted(calibrations, key=lambda one: _instant(one.when))
    for one in ordered:
        if not one.calibration.x_range[0] <= check_point_mm <= one.calibration.x_range[1]:
            cause = f"the check point {check_point_mm:g} mm is outside the calibration of {one.when}"
            raise DataError(cause, "Move it.")
    fits = [one.calibration for one in ordered]
    size = max((fit.coefficients.size for fit in fits), default=0)
    coefficients, errors = (np.full((len(fits), size), np.nan) for _ in range(2))
    for row, fit in enumerate(fits):
        coefficients[row, : fit.coefficients.size] = fit.coefficients
        errors[row, : fit.coefficients.size] = fit.std_errors_with_reading
    values = np.asarray([float(fit.predict(check_point_mm)) for fit in fits])
    expanded = np.asarray([2.0 * float(fit.curve_u(check_point_mm)) for fit in fits])
    expanded_mm = np.asarray([_interpolated(one.u_elongation, check_point_mm) for one in ordered])
    centre, reach = float(values.mean()), float("nan")
    if values.size > 1:
        reach = 3.0 * float(np.abs(np.diff(values)).mean()) / MOVING_RANGE_TO_SD
    slope = float(fits[-1].slope(check_point_mm))
    with np.errstate(divide="ignore", invalid="ignore"):  # a curve may be level there
        error_mm, u_mm = (values - values[0]) / slope, 0.5 * expanded / abs(slope)
    limit = float(expanded_mm[-1]) if limit_mm is None else limit_mm
    times = [time_of(one.when) for one in ordered]
    grids = [np.linspace(*fit.x_range, _CURVE_POINTS) for fit in fits]
    return UnitHistory(
        sensor, tuple(one.when for one in ordered), coefficients, errors, check_point_mm, values, expanded, centre,
        centre - reach, centre + reach, en_scores(values, expanded), expanded_mm,
        tuple(np.column_stack([x, fit.predict(x)]) for x, fit in zip(grids, fits, strict=True)),
        proposed_interval(times, error_mm, u_mm, limit), one_signal_unit(one.signal_unit for one in ordered),
    )  # fmt: skip


def due_first(histories: Sequence[UnitHistory]) -> CalibrationInterval:
    """Return the interval of the sensor that is due first; one that is void where all are."""
    proposed = [history.interval for history in histories if not history.interval.void]
    return min(proposed, key=lambda one: one.days) if proposed else histories[0].interval


def _interpolated(u_elongation: FloatArray, x_mm: float) -> float:
    """Return U at x; NaN outside, and where it is not known."""
    if not u_elongation.size:
        return float("nan")
    return float(np.interp(x_mm, u_elongation[:, 0], u_elongation[:, 1], left=np.nan, right=np.nan))


def _instant(when: str) -> float:
    """Seconds since 1970 of an ISO time; an unknown one is before all others."""
    time = time_of(when)
    return -np.inf if time is None else time.timestamp()


def time_of(when: str) -> datetime.datetime | None:
    """Return an ISO time, whatever its offset (none: UTC); None of an unknown one."""
    try:
        time = datetime.datetime.fromisoformat(when)
    except ValueError:
        return None
    return time if time.tzinfo else time.replace(tzinfo=datetime.UTC)


def en_scores(values: FloatArray, expanded: FloatArray) -> FloatArray:
    """Return the En score of each value against the one before, [n]; NaN first."""
    scores = np.full(values.size, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        scores[1:] = np.diff(values) / np.hypot(expanded[1:], expanded[:-1])
    return scores
