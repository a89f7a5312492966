"""A unit over time: its accepted calibrations, how they changed, and when it is due again. For a window and a report.

Rules: calibrations of virtual boards and of real ones are never together: each library is read by itself. A calibration
that was withdrawn is left out, one that is in force again counts once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.calibration.record import SensorRecord
from boat_daq.engine.settings import StoredCalibration, Unit, UnitLibrary
from boat_daq.formatting import NOTHING, number
from boat_daq.viewmodels.common.notices import Notices, Severity
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from protocol.base.arrays import FloatArray

if TYPE_CHECKING:
    from analysis.figures.unit_history import UnitHistory

CURVE_POINTS = 41
HEADINGS = ("Accepted", "Sensor", "b\u2081 \u00b1 U, mV/mm", "U of x, \u00b5m", "E\u2099", "Finding")
Line = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True)
class UnitOverTime:
    """The calibrations of a unit: the history of each sensor, none where `void` gives the reason."""

    histories: tuple[UnitHistory, ...]
    sentence: str
    void: str = ""

    def days(self, sensor: int) -> FloatArray:
        """Return the time of each calibration of a sensor since its first one, days."""
        times = [np.datetime64(when[:19], "s") for when in self.histories[sensor].when]
        return np.asarray([(time - times[0]) / np.timedelta64(1, "D") for time in times])

    def rows(self) -> list[tuple[str, ...]]:
        """Return the calibrations as lines of a table, in the order of `HEADINGS`, the newest first."""
        rows = []
        for place, history in enumerate(self.histories, 1):
            for k, when in enumerate(history.when):
                b1, u = (part[k, 1] if part.shape[1] > 1 else np.nan for part in _coefficients(history))
                en = float(history.en[k])
                found = ["outside the control limits"] if k in history.out_of_control else []
                found += ["\u25b2 differs from the one before"] if abs(en) > 1 else []
                stated = f"{number(float(b1), 2)} \u00b1 {number(2.0 * float(u), 2)}" if np.isfinite(b1) else NOTHING
                micrometres = number(1000.0 * float(history.expanded_mm[k]), 0)
                shown = (when[:16].replace("T", "  "), str(place), stated, micrometres, number(en, 2, sign=True))
                rows.append((*shown, ", ".join(found) or NOTHING))
        return sorted(rows, key=lambda row: row[0], reverse=True)


def _coefficients(history: UnitHistory) -> tuple[FloatArray, FloatArray]:
    return history.coefficients, history.std_errors


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
    from analysis.figures.unit_history import due_first, history_of
    from protocol.base.errors import BoatDaqError

    entries = in_force_at_times(unit.history)
    if not entries:
        return UnitOverTime((), "", f"{unit.name} has no accepted calibration yet")
    try:
        histories = []
        for sensor in range(len(entries[-1].content["sensors"])):
            of_sensor = [one for one in entries if sensor < len(one.content["sensors"])]
            dated = [_dated(one, sensor) for one in of_sensor]
            low = max(one.calibration.x_range[0] for one in dated)
            high = min(one.calibration.x_range[1] for one in dated)
            point = 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
            histories.append(history_of(dated, f"s{sensor + 1}", check_point_mm=point))
    except BoatDaqError as error:
        return UnitOverTime((), "", error.cause)
    sentence = due_first(histories).sentence
    return UnitOverTime(tuple(histories), f"{sentence[0].upper()}{sentence[1:]}.")


def _dated(entry: StoredCalibration, sensor: int) -> Any:
    from analysis.figures.unit_history import DatedCalibration

    inverse = SensorRecord.parse(entry.content["sensors"][sensor]).inverse()
    assert inverse.calibration is not None
    x = np.linspace(*inverse.x_range, CURVE_POINTS)
    return DatedCalibration(entry.utc, inverse.calibration, np.column_stack([x, 2.0 * inverse.standard_uncertainty(x)]))


def load_unit_over_time(units: UnitLibrary, name: str) -> UnitOverTime:
    """Return a unit of a library over time; for a helper process."""
    return unit_over_time(units.load(name))


def report_unit(units: UnitLibrary, name: str, target: Path) -> None:
    """Write the report of a unit over time, HTML or PDF; for a helper process.

    Parameters
    ----------
    units, name : the library and the unit.

    Raises
    ------
    RequestError : the unit has no calibration. BoatDaqError : the file cannot be written.
    """
    from analysis.reports.unit import write_unit_report
    from protocol.base.errors import RequestError

    found = load_unit_over_time(units, name)
    if found.void:
        raise RequestError(found.void, "Accept a calibration of it first.")
    write_unit_report(name, found.histories, target, simulated=units.simulated)


class UnitOverTimeModel:
    """State of the window of a unit.

    Parameters
    ----------
    units : the library of the unit: of real or of simulated boards.
    """

    def __init__(self, units: UnitLibrary, name: str, jobs: JobRunner, notices: Notices) -> None:
        self.units, self.name, self._jobs, self._notices = units, name, jobs, notices
        self.found: UnitOverTime | None = None
        self.failed = ""
        label = f"Reading the calibrations of {name}"
        self._start("unit over time", Job(label, load_unit_over_time, units, name), self._take)

    def _take(self, found: UnitOverTime) -> None:
        self.found = found

    @property
    def title(self) -> str:
        """The unit as the window names it."""
        return f"{self.name}  SIMULATED" if self.units.simulated else self.name

    def report(self, target: Path) -> None:
        """Write the report of the unit, HTML or PDF, in the background."""
        job = Job(f"Making the report of {self.name}", report_unit, self.units, self.name, target)
        job.target = target
        self._start("unit report", job, lambda _: self._notices.inform_saved(target))

    def _start(self, slot: str, job: Job, done: Callable[[Any], None]) -> None:
        def ended(job: Job) -> None:
            if job.failure is not None:
                self.failed = job.failure.cause
                self._notices.add(Severity.WARNING, job.failure.cause, job.failure.remedy, details=job.failure.details)
            elif job.state is JobState.DONE:
                done(job.result)

        self._jobs.start(slot, job, ended)
