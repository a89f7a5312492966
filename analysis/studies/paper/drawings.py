"""The drawings of the paper, computed again."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from analysis.figure_style import INK, PRESSURE_COLOUR, sensor_colour, styled
from analysis.figures.pipeline import Analysis
from analysis.published import RANGE_MM, SENSORS
from analysis.reports.drawings import envelope
from protocol.base.arrays import FloatArray

_DRAWN_POINTS = 1500  # of a run's signals


@styled
def draw_calibration(found: Analysis) -> Figure:
    """Draw readings of both sensors beside the published cubics."""
    x = np.linspace(*RANGE_MM, 200)
    figure, (axes,) = _axes("elongation, mm", "signal, mV")
    for number, (sensor, paper) in enumerate(zip(found.sensors, SENSORS, strict=True), 1):
        if (fit := sensor.calibration) is None:
            continue
        colour = sensor_colour(number - 1)
        axes.plot(fit.x, fit.y, ".", color=colour, label=f"sensor {number}: readings (SIMULATED)")
        curve = np.polynomial.polynomial.polyval(x, paper.coefficients)
        axes.plot(x, curve, "--", color=colour, label=f"sensor {number}: published")
    axes.legend()
    return figure


@styled
def draw_loops(found: Analysis) -> Figure:
    """Draw the mean loop of each sensor's signal over pressure, from its own mean."""
    figure, (axes,) = _axes("pressure, kPa", "signal less its mean, mV (SIMULATED)")
    pressure = np.nanmean(found.loops.pressure_kpa, axis=1)[0]
    for number in range(len(found.sensors)):
        mean = np.nanmean(found.loops.signal_mv[number], axis=1)  # [2, levels]
        for branch, style, name in zip(mean, ("-", "--"), ("unloading", "loading"), strict=True):
            label = f"sensor {number + 1}, {name}"
            axes.plot(pressure, branch - np.nanmean(mean), style, color=sensor_colour(number), label=label)
    axes.legend()
    return figure


@styled
def draw_signals(found: Analysis) -> Figure:
    """Draw pressure and signals of a run over time, as the paper's figures 4A and 4C."""
    recording = found.recording
    figure, (above, below) = _axes("time, s", "pressure, kPa", "signal, mV (SIMULATED)")
    rows: list[tuple[Any, FloatArray, str, str]] = [(above, recording.pressure_kpa, PRESSURE_COLOUR, "")]
    rows += [
        (below, recording.signal_mv[:, i], sensor_colour(i), f"sensor {i + 1}") for i in range(recording.n_sensors)
    ]
    for axes, values, colour, label in rows:
        time, low, high = envelope(recording.time_s, values, _DRAWN_POINTS)
        axes.fill_between(time, low, high, color=colour, linewidth=0.6, edgecolor=colour, label=label)
        axes.margins(x=0)
    below.legend(loc="upper right")
    return figure


@styled
def draw_states(curves_mm: FloatArray) -> Figure:
    """Draw the two guides [15, 2, points, 2] in all states: compressed, at rest, elongated."""
    rest = len(curves_mm) // 2
    figure, (axes,) = _axes("across, mm", "along, mm", size=(4.0, 6.0))
    for number, state in enumerate(curves_mm):
        colour = INK if number == rest else sensor_colour(int(number > rest))
        for guide in state:
            axes.plot(guide[:, 0], guide[:, 1], ".-", linewidth=0.6, markersize=2, color=colour)
    for name, colour in (("compressed", sensor_colour(0)), ("rest", INK), ("elongated", sensor_colour(1))):
        axes.plot([], [], color=colour, label=name)
    axes.set_aspect("equal")
    axes.legend(loc="center")
    return figure


def _axes(across: str, *up: str, size: tuple[float, float] = (7.0, 4.0)) -> tuple[Figure, tuple[Any, ...]]:
    """Return a figure with axes one above another, of a common abscissa."""
    figure = Figure(figsize=size, layout="constrained")
    columns = figure.subplots(len(up), sharex=True, squeeze=False)[:, 0]
    for axes, title in zip(columns, up, strict=True):
        axes.set_ylabel(title)
    columns[-1].set_xlabel(across)
    return figure, tuple(columns)
