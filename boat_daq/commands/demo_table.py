"""The demo's figures beside the truth of the virtual board they were measured on."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

from boat_daq.commands.console import out
from protocol.simulator.truth import Truth, truth_figures

if TYPE_CHECKING:
    from analysis import Analysis
    from boat_daq.engine.plan import Plan


def truth_of(unit: str, plan: Plan) -> Truth:
    """Return the virtual unit's own figures over one cycle of this plan."""
    cycle_kpa = (plan.high_kpa, *plan.targets_kpa)
    dwell_s = plan.step_duration_s(0.0, 0.0)
    return truth_figures(unit, cycle_kpa=cycle_kpa, ramp_kpa_per_s=plan.ramp_kpa_per_s, dwell_s=dwell_s)


def truth_json(truth: Truth) -> dict[str, Any]:
    """Return the truth under the keys of `analyze --json`."""
    content = dataclasses.asdict(truth)
    for sensor in content["sensors"]:
        sensor["hysteresis_percent_fso"] = {
            "abscissa": "elongation_mm",
            "mean": sensor.pop("sensor_hysteresis_percent_fso"),
        }
        sensor["calibration"] = {"coefficients": sensor.pop("coefficients")}
    return content


def comparison(analysis: Analysis, truth: Truth) -> list[dict[str, Any]]:
    """Return figure, unit, measured, interval and truth, a row each."""
    rows: list[dict[str, Any]] = []

    def row(
        name: str, unit: str, measured: float, true: float | None, interval: tuple[float, float] | None = None
    ) -> None:
        rows.append({"figure": name, "unit": unit, "measured": measured, "interval": interval, "truth": true})

    for number, (sensor, true) in enumerate(zip(analysis.sensors, truth.sensors, strict=True), 1):
        if sensor.calibration is not None:
            fit = sensor.calibration
            for k, (b, error, b_true) in enumerate(
                zip(fit.coefficients, fit.std_errors_with_reading, true.coefficients, strict=True)
            ):
                unit = "mV" if k == 0 else "mV/mm" if k == 1 else f"mV/mm{'²' if k == 2 else '³'}"
                row(f"s{number} b{k}", unit, float(b), b_true, (float(b - 2 * error), float(b + 2 * error)))
            row(f"s{number} R²", "", fit.r2, None)
        for key, label, value in (
            ("sensitivity_mv_per_mm", "sensitivity", true.sensitivity_mv_per_mm),
            ("fso_mv", "full-scale output", true.fso_mv),
            ("sensor_hysteresis_percent_fso", "sensor hysteresis", true.sensor_hysteresis_percent_fso),
            ("system_hysteresis_percent_fso", "system hysteresis", true.system_hysteresis_percent_fso),
            ("snr_db", "SNR", true.snr_db),
            ("noise_mv", "noise, rms", true.noise_mv),
        ):
            figure = sensor.figures[key]
            row(f"s{number} {label}", figure.unit, figure.value, value, (figure.low, figure.high))
    system = analysis.system_sensitivity
    row("system sensitivity", system.unit, system.value, truth.system_sensitivity_mv_per_mm, (system.low, system.high))
    actuator = analysis.actuator_hysteresis
    row("actuator hysteresis", actuator.unit, actuator.value, truth.actuator_hysteresis_percent)
    return rows


def print_comparison(rows: list[dict[str, Any]]) -> None:
    """Print the figures beside the truth, numbers with as many digits as their interval warrants."""
    from rich.table import Table

    table = Table(title="SIMULATED: measured on the virtual board, beside its own truth", box=None, pad_edge=False)
    for name in ("figure", "measured", "95 % interval", "truth", "off by", "unit"):
        table.add_column(name, justify="left" if name in ("figure", "unit") else "right", no_wrap=True)
    for row in rows:
        table.add_row(row["figure"], *cells(row), row["unit"])
    out.print(table)


def cells(row: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return measured value, interval, truth and difference of a row as text."""
    low, high = row["interval"] or (math.nan, math.nan)
    width = high - low
    digits = 5 if not width > 0 else max(0, min(6, 1 - math.floor(math.log10(width / 4))))
    measured, true = row["measured"], row["truth"]
    between = f"{low:.{digits}f} .. {high:.{digits}f}" if width > 0 else ""
    if true is None:
        return f"{measured:.{digits}f}", between, "", ""
    return f"{measured:.{digits}f}", between, f"{true:.{digits}f}", f"{measured - true:+.{digits}f}"
