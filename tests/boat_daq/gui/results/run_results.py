"""Results of a run made up for the tests of the pages."""

from __future__ import annotations

import dataclasses

import numpy as np
from PySide6.QtCore import QPoint, QRect

from analysis.calibration.fit import fit_calibration
from analysis.calibration.record import SensorRecord
from analysis.warning import Warning, WarningCode
from boat_daq.viewmodels.results.run_result import CurveBands, CycleSeries, LoopSet, RunResult, SensorResult
from boat_daq.workflows.acceptance import ReadingToCheck, RunVerdict

CYCLES = 8
USABLE = RunVerdict(
    "usable",
    "ok",
    "U = 0.13 mm (k = 2) from -2.7 to 3.8 mm",
    limits_text="all 8 published limits are kept",
    limits_state="ok",
)
X = np.linspace(-2.7, 3.8, 19)
GRID = np.linspace(-2.7, 3.8, 161)


def sensor(number: int, offset: float = 0.0) -> SensorResult:
    """A cubic with a little scatter."""
    y = 1650 + offset + 40 * X - 2 * X**2 + 0.5 * np.cos(7 * X)
    fit = fit_calibration(X, y)
    each = np.linspace(0.0, 1.0, CYCLES)
    cycles = CycleSeries(5 + each, 44 + each, 2.8 + 0.01 * each, "mV/kPa", 0)
    record = SensorRecord(f"s{number}", fit.as_json(), X, y)
    curve = CurveBands(GRID, fit.predict(GRID), fit.residuals, fit.band(GRID, 0.68), fit.band(GRID, 0.95))
    return SensorResult(record=record, cycles=cycles, loading=X > 0, fit=curve)


def turning(sensor: SensorResult) -> SensorResult:
    """The sensor with a curve that has no inverse."""
    bent = dataclasses.replace(sensor.record, fit=sensor.record.fit | {"monotone": False})
    return dataclasses.replace(sensor, record=bent)


def without_curve(sensor: SensorResult, void: str = "...") -> SensorResult:
    """The sensor without readings."""
    return dataclasses.replace(sensor, record=SensorRecord(sensor.record.name, void=void), fit=None)


def run_result(offset: float = 0.0, warnings: tuple[Warning, ...] = (), **more) -> RunResult:
    """A run of two sensors and eight cycles."""
    level = np.linspace(-40.0, 50.0, 10)
    pressure = np.broadcast_to(level, (2, CYCLES, 10))
    loops = LoopSet(tuple(range(1, CYCLES + 1)), pressure, None, np.stack([1650 + 3 * pressure] * 2))
    sensors = (sensor(1, offset), sensor(2, offset))
    run = {"path": "run.boat", "unit": "SA1", "simulated": True, "cycles": CYCLES, "partial": 0}
    run["verdict"] = USABLE
    return RunResult(**run | {"sensors": sensors, "figures": (), "loops": loops, "warnings": warnings} | more)


def out_of_tolerance_result(**more) -> RunResult:
    """The same run with a fit that misses two bounds."""
    missed = (
        Warning(WarningCode.OUT_OF_TOLERANCE, "r2", "R\u00b2 0.7512 is below 0.9988"),
        Warning(WarningCode.OUT_OF_TOLERANCE, "combined_error_percent_fso", "combined error 33.0 % FSO is above 12.1"),
    )
    whole = run_result(**more)
    first = dataclasses.replace(whole.sensors[0], out_of_tolerance=missed)
    headline = f"{USABLE.headline}; out of tolerance"
    verdict = dataclasses.replace(USABLE, code="out_of_tolerance", state="check", headline=headline)
    return dataclasses.replace(whole, sensors=(first, whole.sensors[1]), verdict=verdict)


def result_to_check(step: int | None = 6, **more) -> RunResult:
    """The same run with a reading that is to be checked."""
    text = "+10.00 mm at +10 kPa, 9.2 mm from the others"
    verdict = RunVerdict(
        "readings_to_check", "check", f"{USABLE.headline}; 1 reading to check", "1 reading to check",
        f"1 reading to check: {text}", USABLE.limits_text, (ReadingToCheck(step, text),),
    )  # fmt: skip
    return run_result(verdict=verdict, **more)


def without_readings(read: int, **more) -> RunResult:
    """A run that has no curve."""
    whole = run_result()
    sensors = tuple(map(without_curve, whole.sensors))
    return dataclasses.replace(whole, sensors=sensors, plateaus=37, read=read, **more)


def whole_in_sight(window, widget) -> bool:
    """Whether all of a widget is inside the window's page without scrolling."""
    viewport = window.scrolls["Calibration"].viewport()
    place = widget.mapTo(viewport, QPoint(0, 0))
    return widget.isVisible() and viewport.rect().contains(QRect(place, widget.size()))
