"""The window of a unit over time: its accepted calibrations as a table, its report."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from boat_daq.engine.settings import UnitLibrary
from boat_daq.formatting import as_shown, number
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.workflows.jobs import Job, JobRunner
from boat_daq.workflows.unit_history import UnitOverTime, load_unit_over_time, report_unit
from protocol.base.units import NOTHING, STORED_UNITS, Quantity, ShownUnits, UnitText, as_text


def check_point(found: UnitOverTime | None, units: ShownUnits) -> str:
    """Return where U is given, `at 0 mm`; without a place where it differs between the sensors."""
    points = {history.check_point_mm for history in found.histories} if found is not None else set()
    known = UnitText("at ", Quantity(points.pop(), "mm", ".2g")) if len(points) == 1 else "at the check point"
    return as_shown(known, units)


def history_headings(units: ShownUnits, found: UnitOverTime | None = None) -> tuple[str, ...]:
    slope, u = (as_text(units.shown(unit).symbol) for unit in ("mV/mm", "mm"))
    place = check_point(found, units)
    return "No., accepted", "Sensor", f"b\u2081 \u00b1 U, {slope}", f"U {place}, {u}", "E\u2099", "Finding"


def unit_rows(found: UnitOverTime, units: ShownUnits = STORED_UNITS) -> list[tuple[str, ...]]:
    """Return the calibrations as lines of a table, in the order of `history_headings`, the newest first."""
    slope, length = units.shown("mV/mm"), units.shown("mm")
    rows = []
    for place, history in enumerate(found.histories, 1):
        for k, when in enumerate(history.when):
            parts = history.coefficients, history.std_errors
            b1, u = (part[k, 1] if part.shape[1] > 1 else np.nan for part in parts)
            en = float(history.en[k])
            change = ["outside the control limits"] if k in history.out_of_control else []
            change += ["\u25b2 differs from the one before"] if abs(en) > 1 else []
            ends = (number(slope.value(float(value)), slope.decimals(2)) for value in (b1, 2.0 * u))
            stated = " \u00b1 ".join(ends) if np.isfinite(b1) else NOTHING
            expanded = number(length.value(float(history.expanded_mm[k])), length.decimals(3))
            accepted = f"{k + 1:>2}   {when[:16].replace('T', '  ')}"
            shown = (accepted, str(place), stated, expanded, number(en, 2, sign=True))
            rows.append((*shown, ", ".join(change) or NOTHING))
    return sorted(rows, key=lambda row: row[0], reverse=True)


class UnitOverTimeModel:
    def __init__(self, units: UnitLibrary, name: str, jobs: JobRunner, notices: Notices) -> None:
        self.units, self.name, self._jobs, self._notices = units, name, jobs, notices
        self.found: UnitOverTime | None = None
        self.failed = ""
        label = f"Reading the calibrations of {name}"
        jobs.start("unit over time", Job(label, load_unit_over_time, units, name), self._take)

    def _take(self, job: Job) -> None:
        self.found, self.failed = job.result, job.failure.cause if job.failure is not None else ""
        self._notices.ended(lambda _: None)(job)

    @property
    def title(self) -> str:
        return f"{self.name}  SIMULATED" if self.units.simulated else self.name

    def report(self, target: Path) -> None:
        job = Job(f"Making the report of {self.name}", report_unit, self.units, self.name, target)
        job.target = target
        saved = self._notices.ended(lambda _: self._notices.inform_saved(target))
        self._jobs.start(f"unit report {target}", job, saved)
