"""A unit over time: its accepted calibrations, how they changed, and when it is due again.

Rules: calibrations of virtual boards and of real ones are never together: each library is read by itself. A calibration
that was withdrawn is left out, one that is in force again counts once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.calibration.record import CalibrationRecord
from boat_daq.engine.settings import StoredCalibration, Unit, UnitLibrary
from boat_daq.workflows.calibration_in_force import record_of
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError

if TYPE_CHECKING:
    from analysis.history.unit_history import DatedCalibration, UnitHistory

_CURVE_POINTS = 41
_TIMES = ((2.0 / 24.0, 1440.0, "min"), (2.0, 24.0, "h"), (math.inf, 1.0, "d"))  # longest in days, units in a day


@dataclass(frozen=True, slots=True)
class UnitOverTime:
    """The calibrations of a unit: the history of each sensor, none where `void` gives the reason."""

    histories: tuple[UnitHistory, ...]
    sentence: str
    void: str = ""

    @property
    def signal_unit(self) -> str:
        return self.histories[0].signal_unit if self.histories else "mV"

    def times(self) -> tuple[list[FloatArray], str]:
        """Return the time of each calibration of each sensor since its first one, and its unit: min, h or d."""
        days = [self.days(sensor) for sensor in range(len(self.histories))]
        longest = max(float(each[-1]) for each in days)
        size, unit = next((size, unit) for most, size, unit in _TIMES if longest <= most)
        return [size * each for each in days], unit

    def days(self, sensor: int) -> FloatArray:
        """Return the time of each calibration of a sensor since its first one, days."""
        times = [np.datetime64(when[:19], "s") for when in self.histories[sensor].when]
        return np.asarray([(time - times[0]) / np.timedelta64(1, "D") for time in times])


def in_force_at_times(history: Sequence[StoredCalibration]) -> list[StoredCalibration]:
    """Return the calibrations of a unit that were accepted and not withdrawn, oldest first, each once."""
    found: list[StoredCalibration] = []
    for entry in history:
        same = next((k for k, one in enumerate(found) if one.content == entry.content), None)
        if same is not None:  # in force again: what came after it was withdrawn
            del found[same + 1 :]
        elif entry.accepted:
            found.append(entry)
        elif found:
            found.pop()
    return found


def unit_over_time(unit: Unit) -> UnitOverTime:
    """Return a unit's calibrations over time; the check point is 0 mm, or the middle of the range that all share."""
    from analysis.history.unit_history import due_first, history_of
    from protocol.base.errors import BoatDaqError

    records = [record_of(unit, entry) for entry in in_force_at_times(unit.history)]
    if not records:
        return UnitOverTime((), "", f"{unit.name} has no accepted calibration yet")
    try:
        histories = []
        for sensor in range(len(records[-1].sensors)):
            dated = [_dated(one, sensor) for one in records if sensor < len(one.sensors)]
            low = max(one.calibration.x_range[0] for one in dated)
            high = min(one.calibration.x_range[1] for one in dated)
            point = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
            histories.append(history_of(dated, f"s{sensor + 1}", check_point_mm=point))
    except BoatDaqError as error:
        return UnitOverTime((), "", error.cause)
    sentence = due_first(histories).sentence
    return UnitOverTime(tuple(histories), f"{sentence[0].upper()}{sentence[1:]}.")


def _dated(record: CalibrationRecord, sensor: int) -> DatedCalibration:
    from analysis.history.unit_history import DatedCalibration

    inverse = record.sensors[sensor].inverse()
    assert inverse.calibration is not None
    x = np.linspace(*inverse.x_range, _CURVE_POINTS)
    u_mm = np.column_stack([x, 2.0 * inverse.standard_uncertainty(x)])
    return DatedCalibration(record.calibrated_utc, inverse.calibration, u_mm, record.signal_unit)


def load_unit_over_time(units: UnitLibrary, name: str) -> UnitOverTime:
    return unit_over_time(units.load(name))


def report_unit(units: UnitLibrary, name: str, target: Path) -> None:
    """Write the report of a unit over time, HTML or PDF."""
    from analysis.reports.unit_report import write_unit_report

    found = load_unit_over_time(units, name)
    if found.void:
        raise RequestError(found.void, "Accept a calibration of it first.")
    write_unit_report(name, found.histories, target, simulated=units.simulated)
