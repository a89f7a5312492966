"""The report of a dynamic calibration: figures of steps of elongation, and gain and phase over frequency."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from analysis.elongation_control.dynamic_figures import BODE_HEADINGS, STEP_HEADINGS, DynamicCalibration
from analysis.figure_style import SOFT, sensor_colour
from analysis.progress import Progress
from analysis.reports.document import Report, ReportDrawing, ReportTable, Section, date_of
from analysis.reports.unit_report import write_built
from analysis.version import program_version
from protocol.base.units import NOTHING


def write_dynamic_report(found: DynamicCalibration, path: str | Path, progress: Progress | None = None) -> Report:
    """Write a dynamic calibration as .html or .pdf; raises BoatDaqError for another ending, or a refused file."""
    return write_built(partial(dynamic_report, found), Path(path), progress)


def dynamic_report(found: DynamicCalibration) -> Report:
    """Return the report."""
    sections = [*([_steps(found)] if found.steps else []), *([_bode(found)] if found.bode else [])]
    return Report(
        title="Dynamic calibration",
        subject=f"unit {found.unit}",
        simulated=found.simulated,
        verdict=found.verdict[:1].upper() + found.verdict[1:],
        facts=(
            ("Unit", found.unit),
            ("Recording", Path(found.recording).name),
            ("Recorded", date_of(found.recorded_utc) or NOTHING),
            ("Calibration", date_of(found.calibration_utc) or NOTHING),
        ),
        sections=tuple(sections),
        footer=f"boat-daq {program_version()}",
        date=found.recorded_utc,
    )


def _steps(found: DynamicCalibration) -> Section:
    text = (
        "Steps of the setpoint under control, up and down, from the instant at which it changed. Time constant: until "
        f"63.2 % of the step. Settling: until it stays within {found.tolerance_mm:g} mm. Each value is the mean of the "
        "steps of its size, with the 95 % interval of the mean (Student t). The ramp of the pressure limits the rise "
        "of larger steps."
    )
    drawing = ReportDrawing((partial(_draw_steps, found),), "Mean response to the steps of each size.")
    table = ReportTable(STEP_HEADINGS, found.step_rows())
    return Section("Step response", (text, *([drawing] if found.responses else []), table))


def _bode(found: DynamicCalibration) -> Section:
    text = (
        "Sines of the setpoint under control; whole periods after the transient, by least squares. At the ends of the "
        "bandwidth's interval every gain is off by its U. The ramp of the pressure limits large amplitudes at high "
        "frequencies."
    )
    caption = "Gain and phase of the measured elongation over its setpoint, with U (k = 2)."
    drawing = ReportDrawing((partial(_draw, found, gain=True), partial(_draw, found, gain=False)), caption)
    return Section("Frequency response", (text, drawing, ReportTable(BODE_HEADINGS, found.bode_rows())))


def _draw_steps(found: DynamicCalibration, axes: Axes) -> None:
    """Draw the mean response to the steps of each size over time."""
    for number, (size, (time_s, share)) in enumerate(found.responses.items()):
        axes.plot(time_s, 100.0 * share, color=sensor_colour(number), label=f"{size:g} mm")
    axes.axhline(100.0, linestyle=":", color=SOFT)
    axes.set(xlabel="time since the setpoint changed, s", ylabel="elongation, % of the step")
    axes.legend(loc="lower right")


def _draw(found: DynamicCalibration, axes: Axes, *, gain: bool) -> None:
    """Draw gain or phase over frequency."""
    frequency = [p.frequency_hz for p in found.bode]
    values = [p.gain_db if gain else p.phase_deg for p in found.bode]
    half = [2 * (p.u_gain_db if gain else p.u_phase_deg) for p in found.bode]
    axes.errorbar(frequency, values, yerr=half, fmt="o-", capsize=2)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda hz, _: f"{hz:g}"))
    if gain:
        axes.axhline(-3.0, linestyle=":", color=SOFT)
        axes.annotate("-3 dB", (min(frequency), -3.0), xytext=(0, 2), textcoords="offset points", color=SOFT)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("gain, dB" if gain else "phase, °")
