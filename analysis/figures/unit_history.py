"""A unit's calibrations over time: drift of the coefficients, a control chart of a check point, and the En score.

Definitions: the check point is y(x0) of each calibration. Control limits are the mean plus and minus three times the
mean moving range / 1.128 (ISO 7870-2, individuals). The En score of a calibration against the one before is
(y - y') / sqrt(U^2 + U'^2), U expanded with k = 2; |En| <= 1 is agreement (ISO 13528).

Rules: a calibration is taken at its UTC; the same recording counts once. Simulated and real runs are never compared,
because a virtual SA1 and the SA1 on the bench share nothing but the name.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import FloatArray
from analysis.calibration.fit import Calibration
from analysis.errors import AnalysisError, DataError, RequestError
from analysis.figures.batch import readings_beside, runs_in
from analysis.figures.pipeline import Analysis, analyse
from analysis.progress import Progress
from protocol.errors import ProtocolError

MOVING_RANGE_TO_SD = 1.128


@dataclass(frozen=True, slots=True)
class UnitHistory:
    """Calibrations of one sensor in order of time.

    Attributes
    ----------
    when : [n] UTC, ISO 8601.
    coefficients, std_errors : [n, degree + 1], the reading of x included.
    check_point_mm : x0. value_mv, expanded_mv : [n] y(x0) and its U (k = 2).
    centre_mv, lower_mv, upper_mv : of the control chart; NaN below two calibrations.
    en : [n] En score against the calibration before; NaN for the first.
    """

    sensor: str
    when: tuple[str, ...]
    coefficients: FloatArray
    std_errors: FloatArray
    check_point_mm: float
    value_mv: FloatArray
    expanded_mv: FloatArray
    centre_mv: float
    lower_mv: float
    upper_mv: float
    en: FloatArray

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
        rows = zip(self.when, self.coefficients, self.std_errors, self.value_mv, self.expanded_mv, self.en, strict=True)
        return {
            "name": self.sensor,
            **{name: getattr(self, name) for name in ("check_point_mm", "centre_mv", "lower_mv", "upper_mv")},
            "drift_per_calibration": self.drift_per_calibration.tolist(),
            "calibrations": [
                {
                    "started_utc": when, "coefficients": b.tolist(), "std_errors": u.tolist(), "value_mv": float(v),
                    "expanded_mv": float(expanded), "en": float(e), "in_control": k not in outside,
                }
                for k, (when, b, u, v, expanded, e) in enumerate(rows)
            ],
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Calibrations:
    """The calibrations of one unit that a folder holds, and why its other runs are none."""

    analyses: tuple[Analysis, ...]
    left_out: tuple[dict[str, str], ...]


def refuse_mixture(simulated: Iterable[bool]) -> None:
    """Refuse to compare simulated with real runs.

    Raises
    ------
    RequestError : there are both.
    """
    if len(set(simulated)) > 1:
        cause = "simulated and real runs are not compared: they share nothing but the name of the unit"
        raise RequestError(cause, "Choose runs of the virtual board only, or none of them.")


def calibrations_in(
    folder: str | Path, unit: str, *, simulated: bool | None = None, seed: int = 0, progress: Progress | None = None
) -> Calibrations:
    """Analyse the runs of a folder and keep the calibrations of one unit.

    Parameters
    ----------
    folder : of the runs.
    unit : its name.
    simulated : whether those of simulated boards are kept, or those of real ones; None for the real ones where there
        are any, else the simulated ones.
    seed : of the analyses.
    progress : called as progress(done, total); raising from it cancels.

    Raises
    ------
    FileError, RequestError : no folder, or no run in it. DataError : no calibration of that unit among them.
    """
    files = runs_in(folder)
    kept: list[Analysis] = []
    left_out: list[dict[str, str]] = []
    units: set[str] = set()
    for done, path in enumerate(files):
        if progress is not None:
            progress(done, len(files))
        try:
            analysis = analyse(path, readings_beside(path), seed=seed, mcmc=False)
        except (AnalysisError, ProtocolError) as error:
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
    other, reason = (
        [a for a in kept if a.recording.simulated is not simulated],
        "simulated" if not simulated else "real",
    )
    left_out += [{"run": Path(a.recording.source).name, "reason": f"of a {reason} board"} for a in other]
    kept = [analysis for analysis in kept if analysis.recording.simulated is simulated]
    if not kept:
        known = ", ".join(sorted(filter(None, units))) or "none"
        kind = "simulated calibration" if simulated else "calibration"
        raise DataError(f"{folder} holds no {kind} of unit {unit!r}", f"Units found: {known}.")
    return Calibrations(tuple(kept), tuple(left_out))


def unit_history(analyses: Sequence[Analysis], sensor: int, *, check_point_mm: float = 0.0) -> UnitHistory:
    """Arrange the calibrations of one sensor over time.

    Parameters
    ----------
    analyses : of one unit, in any order.
    sensor : counted from 0.
    check_point_mm : elongation of the control chart.

    Raises
    ------
    DataError : no calibration among the runs, or the check point lies outside one of them. RequestError : simulated
        and real runs are among them.
    """
    refuse_mixture(analysis.recording.simulated for analysis in analyses)
    found: dict[str, tuple[str, Calibration]] = {}
    for analysis in analyses:
        calibration = analysis.sensors[sensor].calibration if sensor < len(analysis.sensors) else None
        if calibration is not None:
            meta = analysis.recording.meta
            key = str(meta.get("uuid") or analysis.recording.source)
            found[key] = (analysis.recording.started_utc, calibration)
    if not found:
        raise DataError("none of the runs is a calibration", "Give recordings with readings of elongation.")
    ordered = sorted(found.values(), key=lambda item: _instant(item[0]))
    for when, calibration in ordered:
        if not calibration.x_range[0] <= check_point_mm <= calibration.x_range[1]:
            raise DataError(f"the check point {check_point_mm:g} mm is outside the calibration of {when}", "Move it.")
    if len({c.curve for _, c in ordered}) > 1 or ordered[0][1].spline is not None:
        raise DataError("the calibrations are not polynomials of one degree", "Analyse them with one degree.")
    values = np.asarray([float(c.predict(check_point_mm)) for _, c in ordered])
    errors = np.stack([c.std_errors_with_reading for _, c in ordered])
    expanded = np.asarray([2.0 * float(c.curve_u(check_point_mm)) for _, c in ordered])
    centre, reach = float(values.mean()), float("nan")
    if values.size > 1:
        reach = 3.0 * float(np.abs(np.diff(values)).mean()) / MOVING_RANGE_TO_SD
    return UnitHistory(
        f"s{sensor + 1}", tuple(when for when, _ in ordered), np.stack([c.coefficients for _, c in ordered]),
        errors, check_point_mm, values, expanded, centre, centre - reach, centre + reach, en_scores(values, expanded),
    )  # fmt: skip


def _instant(when: str) -> float:
    """Seconds since 1970 of an ISO time, whatever its offset (none: UTC); an unknown one is before all others."""
    try:
        time = datetime.datetime.fromisoformat(when)
    except ValueError:
        return -np.inf
    return (time if time.tzinfo else time.replace(tzinfo=datetime.UTC)).timestamp()


def en_scores(values: FloatArray, expanded: FloatArray) -> FloatArray:
    """Return the En score of each value against the one before, [n]; NaN first."""
    scores = np.full(values.size, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        scores[1:] = np.diff(values) / np.hypot(expanded[1:], expanded[:-1])
    return scores
