"""The report's section on the elongation by a camera: its record, and the calibration on it beside the plateaus'.

Rules: nothing is computed here but differences of curves and a thinning.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.axes import Axes

from analysis import figure_style as style
from analysis.figures.pipeline import Analysis
from analysis.numbers import rounded, with_uncertainty
from analysis.reports.document import ReportDrawing, ReportTable, Section, SectionPart, cell
from analysis.reports.drawings import DRAWN_POINTS, TRACE_POINTS, envelope, legend, over_cycles
from analysis.tracking.continuous import CameraFigures, ContinuousCalibration
from protocol.base.units import NOTHING

TITLE = "Elongation by the camera"


def camera_section(analysis: Analysis, camera: CameraFigures) -> Section:
    """Record and delay, then each sensor on the continuous record beside its plateaus."""
    parts: list[SectionPart] = [
        _summary(camera),
        ReportDrawing((partial(_trace, analysis, camera),), "Elongation at every frame, and of the plateaus.", 1.9),
        _table(analysis, camera),
    ]
    for i, one in enumerate(camera.sensors):
        if one.calibration is None:
            parts.append(f"Sensor {i + 1} is not calibrated on the continuous record: {one.void}.")
            continue
        drawn = partial(_branches, analysis, i, one), partial(_by_speed, i, one)
        caption = "Left: mean branches and the plateaus' curve, less the curve of the continuous record. Right: the "
        parts.append(ReportDrawing(drawn, f"{caption}signal's distance from its mean branch, against speed.", 2.6))
    if len(camera.cycles) > 1:
        caption = "Largest distance of the branches, signal over elongation, in every cycle."
        parts.append(ReportDrawing((partial(_per_cycle, camera),), caption, 2.2))
    return Section(TITLE, tuple(parts))


def _summary(camera: CameraFigures) -> str:
    record, delay = camera.film.record, camera.film.delay
    text = (
        f"{int(record.valid.sum())} of {record.time_s.size} frames give an elongation, {record.dropped} are missing. "
        f"Standard uncertainty of a frame {1000 * camera.u_mm:.1f} µm, of the scale {100 * camera.film.u_scale:.2f} %. "
    )
    if delay is None:
        return text + "The delay of the frames is not known."
    text += f"The frames are late by {with_uncertainty(1000 * delay.delay_s, 1000 * delay.u_s)} ms"
    if delay.certain_drift:
        text += f" and drift by {with_uncertainty(1e6 * delay.drift, 1e6 * delay.u_drift)} ppm"
    return text + "; this is corrected."


def _table(analysis: Analysis, camera: CameraFigures) -> ReportTable:
    rows = []
    for i, (sensor, one) in enumerate(zip(analysis.sensors, camera.sensors, strict=True), 1):
        plateaus = (
            sensor.figures.get("sensitivity_mv_per_mm"),
            sensor.figures.get("sensor_hysteresis_percent_fso"),
        )
        r2 = f"{sensor.calibration.r2:.5f}" if sensor.calibration is not None else NOTHING
        rows.append((f"Sensor {i}, plateaus", *map(cell, plateaus), r2, NOTHING, NOTHING))
        if one.calibration is not None:
            found = (
                f"{one.sensitivity_mv_per_mm:.2f}",
                NOTHING if one.hysteresis_void else f"{one.hysteresis_percent_fso:.2f}",
                f"{one.r2:.5f}",
                with_uncertainty(one.dynamic_mv_per_mm_per_s, one.u_dynamic),
                rounded(one.apart_percent_fso, 0.05),
            )
            rows.append((f"Sensor {i}, continuous record", *found))
    header = ("", "Sensitivity, mV/mm", "Hysteresis, % FSO", "R²", "Dynamic error, mV per mm/s", "Apart, % FSO")
    caption = (
        "Hysteresis: sensor, signal over elongation, of the mean loop. Dynamic error: change of the signal with the "
        "speed of elongation on one branch. Apart: largest distance of both curves. The plateaus' curve is the "
        "calibration; the continuous record checks it."
    )
    return ReportTable(header, tuple(rows), caption)


def _trace(analysis: Analysis, camera: CameraFigures, ax: Axes) -> None:
    record = camera.film.record
    time, low, high = envelope(record.time_s, record.elongation_mm, TRACE_POINTS // 2)
    ax.fill_between(
        time, low, high, color=style.ELONGATION_COLOUR, lw=0.6, edgecolor=style.ELONGATION_COLOUR, label="frames"
    )
    if analysis.elongations is not None:
        at = [analysis.recording.time_s[(p.settled_first + p.last - 1) // 2] for p in analysis.plateaus]
        x = analysis.elongations.elongation_mm
        ax.plot(at, x, "o", color=style.INK, mfc=style.PAPER_COLOUR, mew=0.7, ms=3.2, label="plateaus")
    ax.set(xlabel="time, s", ylabel="elongation, mm", title="Elongation by the camera")
    ax.margins(x=0)
    legend(ax, ncols=2, loc="upper right")


def _branches(analysis: Analysis, sensor: int, one: ContinuousCalibration, ax: Axes) -> None:
    assert one.calibration is not None
    colour, percent = style.sensor_colour(sensor), 100.0 / (one.calibration.full_scale or np.nan)
    for b, (label, dash) in enumerate((("unloading", "--"), ("loading", "-"))):
        x, y = one.loop_mm[b], one.loop_mv[b]
        ax.plot(x, percent * (y - one.calibration.predict(x)), dash, color=colour, label=label)
    plateaus = analysis.sensors[sensor].calibration
    if plateaus is not None:
        low, high = np.nanmin(one.loop_mm), np.nanmax(one.loop_mm)
        grid = np.linspace(max(low, plateaus.x_range[0]), min(high, plateaus.x_range[1]), DRAWN_POINTS)
        apart = percent * (plateaus.predict(grid) - one.calibration.predict(grid))
        ax.plot(grid, apart, color=style.INK, lw=0.9, label="plateaus' curve")
    ax.axhline(0.0, color=style.SOFT, linewidth=0.7)
    ax.set(xlabel="elongation, mm", ylabel="signal less curve, % FSO", title=f"Sensor {sensor + 1}: loop")
    legend(ax)


def _by_speed(sensor: int, one: ContinuousCalibration, ax: Axes) -> None:
    speed, off, u = one.by_speed.T
    ax.errorbar(speed, off, yerr=2.0 * u, fmt="o", color=style.sensor_colour(sensor), ms=3.0, lw=0.8, capsize=2)
    ax.axhline(0.0, color=style.SOFT, linewidth=0.7)
    ax.set(xlabel="speed, mm/s", ylabel="from the branch, mV", title=f"Sensor {sensor + 1}: dynamic error, k = 2")


def _per_cycle(camera: CameraFigures, ax: Axes) -> None:
    for i, one in enumerate(camera.sensors):
        if len(one.per_cycle) == len(camera.cycles):
            colour = style.sensor_colour(i)
            ax.plot(camera.cycles, one.per_cycle, "o-", color=colour, ms=2, lw=0.7, label=f"sensor {i + 1}")
    over_cycles(ax, "hysteresis, % FSO", "Hysteresis over elongation per cycle")
    legend(ax)
