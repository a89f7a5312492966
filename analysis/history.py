"""A unit's calibrations over time: drift of the coefficients, a control chart of a check point, and the En score.

Definitions: the check point is y(x0) of each calibration. Control limits are the mean plus and minus three times the
mean moving range / 1.128 (ISO 7870-2, individuals). The En score of a calibration against the one before is
(y - y') / sqrt(U^2 + U'^2), U expanded with k = 2; |En| <= 1 is agreement (ISO 13528).

Rules: a calibration is taken at its UTC; the same recording counts once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.calibration import Calibration
from analysis.errors import DataError
from analysis.pipeline import Analysis
from analysis.recording import FloatArray

MOVING_RANGE_TO_SD = 1.128


@dataclass(frozen=True, slots=True)
class History:
    """Calibrations of one sensor in order of time.

    Attributes
    ----------
    when : [n] UTC, ISO 8601.
    coefficients, std_errors : [n, degree + 1].
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


def unit_history(analyses: Sequence[Analysis], sensor: int, *, check_point_mm: float = 0.0) -> History:
    """Arrange the calibrations of one sensor over time.

    Raises
    ------
    DataError : no calibration among the runs, or the check point lies outside one of them.
    """
    found: dict[str, tuple[str, Calibration]] = {}
    for analysis in analyses:
        calibration = analysis.sensors[sensor].calibration if sensor < len(analysis.sensors) else None
        if calibration is not None:
            meta = analysis.recording.meta
            key = str(meta.get("uuid") or analysis.recording.source)
            found[key] = (str(meta.get("started_utc") or ""), calibration)
    if not found:
        raise DataError("none of the runs is a calibration", "Give recordings with readings of elongation.")
    ordered = sorted(found.values(), key=lambda item: item[0])
    for when, calibration in ordered:
        if not calibration.x_range[0] <= check_point_mm <= calibration.x_range[1]:
            raise DataError(f"the check point {check_point_mm:g} mm is outside the calibration of {when}", "Move it.")
    values = np.asarray([float(c.predict(check_point_mm)) for _, c in ordered])
    expanded = np.asarray([2.0 * float(c.curve_sd(check_point_mm)) for _, c in ordered])
    centre, reach = float(values.mean()), float("nan")
    if values.size > 1:
        reach = 3.0 * float(np.abs(np.diff(values)).mean()) / MOVING_RANGE_TO_SD
    return History(
        f"s{sensor + 1}", tuple(when for when, _ in ordered), np.stack([c.coefficients for _, c in ordered]),
        np.stack([c.std_errors for _, c in ordered]), check_point_mm, values, expanded, centre, centre - reach,
        centre + reach, en_scores(values, expanded),
    )  # fmt: skip


def en_scores(values: FloatArray, expanded: FloatArray) -> FloatArray:
    """Return the En score of each value against the one before, [n]; NaN first."""
    scores = np.full(values.size, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        scores[1:] = np.diff(values) / np.hypot(expanded[1:], expanded[:-1])
    return scores
