"""The paper computed again, part by part: numbers beside its own, and one list of drawings, as a page and files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from analysis.figure_style import INK, PRESSURE_COLOUR, sensor_colour, styled
from analysis.figures.pipeline import Analysis
from analysis.optics.scene.curves import default_curves, frames_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Light, Waveguide
from analysis.optics.sweep import report
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.progress import Progress
from analysis.published import RANGE_MM, SENSORS
from analysis.reports.drawings import envelope
from analysis.shadow.model.drawing import shadow_figure
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.states import kept_states
from analysis.studies.harness import Picture, write_pictures
from analysis.studies.paper import numbers
from analysis.studies.paper.numbers import PaperRow, numbers_table
from protocol.base.arrays import FloatArray
from protocol.base.whole_file import write_whole

TABLE = "reproduction.md"
FRAMES = 200  # of the shadow, timed
_DPI = 150


@dataclass(frozen=True, slots=True)
class PaperDrawing:
    """One drawing: the figure of the paper, empty where it has none, what it shows, and its file without suffix."""

    figure: str
    shows: str
    name: str
    draw: Callable[[], Figure]


@dataclass(frozen=True, slots=True)
class PaperPart:
    """One part of the paper."""

    rows: Sequence[PaperRow]
    drawings: Sequence[PaperDrawing] = field(repr=False)


def calibration_part(found: Analysis) -> PaperPart:
    draw = partial(draw_calibration, found)
    return PaperPart(
        numbers.calibration_rows(found),
        (
            PaperDrawing("4A", "signals of the five cycles", "signals", partial(draw_signals, found)),
            PaperDrawing("4B", "calibration functions", "calibration_curves", draw),
        ),
    )


def repeatability_part(found: Analysis) -> PaperPart:
    loops = "mean loops of the 100 cycles"
    return PaperPart(
        numbers.hysteresis_rows(found),
        (
            PaperDrawing("4C", "signals of 100 cycles", "cycles", partial(draw_signals, found)),
            PaperDrawing("", loops, "hysteresis_loops", partial(draw_loops, found)),
        ),
    )


def optics_part(progress: Progress | None = None) -> PaperPart:
    """Sweep the paper's designs; return rays in both end states, responses, the best pattern and the map."""
    run_sweep(SweepRequest((PAPER_OPTIMUM,)))  # compiles the tracer, so that the time of the sweep is its own
    sweep, frames = run_sweep(SweepRequest(), progress=progress), frames_of(default_curves(), Waveguide())

    def rays(state: int, word: str) -> PaperDrawing:
        draw = partial(report.draw_scene, frames[state], PAPER_OPTIMUM, Waveguide(), Light(), f"most {word}")
        return PaperDrawing("3A", f"rays in the paper's pattern, most {word}", f"rays_{word}", draw)

    best = sweep.designs[int(np.argmax(sweep.merit().p))]
    two = list(dict.fromkeys((PAPER_OPTIMUM, best)))
    spaced = [d for d in sweep.designs if d.values[:3] == PAPER_OPTIMUM.values[:3]]
    both = "detected rays over the states: the paper's pattern and the best one here"
    by_spacing = "detected rays of patterns as the paper's, by spacing"
    depth_and_spacing = "P of five cavities over depth and spacing"
    return PaperPart(
        numbers.optics_rows(sweep),
        (
            rays(0, "compressed"),
            rays(-1, "elongated"),
            PaperDrawing("3B", both, "response", partial(report.draw_response, sweep, two)),
            PaperDrawing("3C", by_spacing, "response_by_spacing", partial(report.draw_response, sweep, spaced)),
            PaperDrawing("3D", depth_and_spacing, "map", partial(report.draw_maps, sweep, 5)),
        ),
    )


def shadow_part(progress: Progress | None = None) -> PaperPart:
    """Build the shadow; return its states, and its whole frames and tracked points a second."""
    shadow = Shadow(progress=progress)
    shadow.state(elongation_mm=0.5)
    begun = perf_counter()
    for mm in np.linspace(-2.5, 3.5, FRAMES):
        shadow.state(elongation_mm=float(mm))
    frames_per_s = FRAMES / (perf_counter() - begun)
    states, critical_kpa = kept_states(), float(shadow.table.critical_kpa)

    def actuator(kpa: float, word: str) -> PaperDrawing:
        draw = partial(shadow_figure, shadow.state(pressure_kpa=kpa), shadow.topology)
        return PaperDrawing("2A, 5", f"the actuator at {kpa:+g} kPa", f"actuator_{word}", draw)

    guides = partial(draw_states, states.curves_mm)
    return PaperPart(
        numbers.shadow_rows(states, critical_kpa, frames_per_s, shadow.table.states_per_second()),
        (
            PaperDrawing("2B, 2C", "shapes of the guides in the fifteen states", "states", guides),
            *(actuator(kpa, word) for kpa, word in ((50.0, "elongated"), (0.0, "rest"), (-40.0, "compressed"))),
        ),
    )


def write_reproduction(parts: Sequence[PaperPart], folder: Path) -> dict[str, Any]:
    """Write the drawings and the page; return what `reproduce --json` prints."""
    rows = [row for part in parts for row in part.rows]
    drawn = [drawing for part in parts for drawing in part.drawings]
    files = write_pictures((Picture(d.name, d.draw, _DPI) for d in drawn), folder, ("png",))
    lines = [
        "# The paper, computed again", "",
        "SIMULATED: rows of sensors are measured on the virtual board, whose truth has the paper's figures.", "",
        *numbers_table(rows),
    ]  # fmt: skip
    for drawing, path in zip(drawn, files, strict=True):
        figure = f"Figure {drawing.figure}: " if drawing.figure else ""
        lines += ["", f"![{drawing.name}]({path.name})", "", f"{figure}{drawing.shows}."]
    write_whole(folder / TABLE, "\n".join([*lines, ""]))
    shown = [{"figure": d.figure, "shows": d.shows, "file": str(p)} for d, p in zip(drawn, files, strict=True)]
    return {
        "simulated": True, "rows": [asdict(row) for row in rows], "drawings": shown, "files": [str(p) for p in files],
    }  # fmt: skip


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
