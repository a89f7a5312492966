"""The demo's figures beside the true values of the virtual board they were measured on."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from boat_daq.commands.console import show_table
from protocol.simulator.truth import Truth, truth_figures

if TYPE_CHECKING:
    from analysis import Analysis
    from analysis.figures.figure import Figure
    from boat_daq.engine.plan import Plan

COEFFICIENT_UNITS = ("mV", "mV/mm", "mV/mm²", "mV/mm³")
LABELS = {  # of the figures that `SensorTruth` has too
    "sensitivity_mv_per_mm": "sensitivity",
    "fso_mv": "full-scale output",
    "sensor_hysteresis_percent_fso": "sensor hysteresis",
    "system_hysteresis_percent_fso": "system hysteresis",
    "snr_db": "SNR",
    "noise_mv": "noise, rms",
}


def truth_of(unit: str, plan: Plan) -> Truth:
    """Return the true figures of a virtual unit over one cycle of a plan."""
    cycle_kpa = (plan.high_kpa, *plan.targets_kpa)
    dwell_s = plan.step_duration_s(0.0, 0.0)
    return truth_figures(unit, cycle_kpa=cycle_kpa, ramp_kpa_per_s=plan.ramp_kpa_per_s, dwell_s=dwell_s)


def truth_json(truth: Truth) -> dict[str, Any]:
    """Return the true figures under the keys of `analyze --json`."""
    content = dataclasses.asdict(truth)
    for sensor in content["sensors"]:
        mean = sensor.pop("sensor_hysteresis_percent_fso")
        sensor["hysteresis_percent_fso"] = {"abscissa": "elongation_mm", "mean": mean}
        sensor["calibration"] = {"coefficients": sensor.pop("coefficients")}
    return content


def comparison(analysis: Analysis, truth: Truth) -> list[dict[str, Any]]:
    """Return figure, unit, measured value, interval and true value, a row each."""
    rows: list[dict[str, Any]] = []

    def add(name: str, unit: str, measured: float, true: float | None, interval: tuple[float, float] | None) -> None:
        rows.append({"figure": name, "unit": unit, "measured": measured, "interval": interval, "truth": true})

    def add_figure(name: str, figure: Figure, true: float, *, interval: bool = True) -> None:
        add(name, figure.unit, figure.value, true, (figure.low, figure.high) if interval else None)

    for number, (sensor, true) in enumerate(zip(analysis.sensors, truth.sensors, strict=True), 1):
        if (fit := sensor.calibration) is not None:
            terms = zip(
                COEFFICIENT_UNITS, fit.coefficients, fit.std_errors_with_reading, true.coefficients, strict=True
            )
            for k, (unit, b, error, b_true) in enumerate(terms):
                add(f"s{number} b{k}", unit, float(b), b_true, (float(b - 2 * error), float(b + 2 * error)))
            add(f"s{number} R²", "", fit.r2, None, None)
        for key, label in LABELS.items():
            add_figure(f"s{number} {label}", sensor.figures[key], getattr(true, key))
    add_figure("system sensitivity", analysis.system_sensitivity, truth.system_sensitivity_mv_per_mm)
    add_figure("actuator hysteresis", analysis.actuator_hysteresis, truth.actuator_hysteresis_percent, interval=False)
    return rows


def show_comparison(rows: list[dict[str, Any]]) -> None:
    """Print the figures and their true values, with as many digits as their interval warrants."""
    columns = ("figure", "unit", "measured", "95 % interval", "truth", "deviation")
    cells = ((row["figure"], row["unit"], *_cells(row)) for row in rows)
    show_table(columns, cells, left=2, title="SIMULATED: measured on the virtual board, and its true values")


def _cells(row: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return measured value, interval, true value and deviation of a row as text."""
    low, high = row["interval"] or (math.nan, math.nan)
    width = high - low
    digits = 5 if not width > 0 else max(0, min(6, 1 - math.floor(math.log10(width / 4))))
    measured, true = row["measured"], row["truth"]
    interval = f"{low:.{digits}f} .. {high:.{digits}f}" if width > 0 else ""
    if true is None:
        return f"{measured:.{digits}f}", interval, "", ""
    return f"{measured:.{digits}f}", interval, f"{true:.{digits}f}", f"{measured - true:+.{digits}f}"
