"""The paper's figures and numbers beside this program's: a value that the command fills, and its table and drawings.

What is measured on the virtual board is simulated: its truth has the paper's figures, so that these rows show that the
analysis finds them again, not that the paper's units have them. Optics, states and speed are computed as in the paper.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.figure_style import INK, PRESSURE, RC, save_picture, sensor_colour
from analysis.figures.pipeline import Analysis
from analysis.optics.scene.parameters import PAPER_OPTIMUM
from analysis.optics.sweep.figure_of_merit import ranks_within
from analysis.optics.sweep.sweep import SweepResult
from analysis.published import RANGE_MM, SENSORS, SYSTEM_SENSITIVITY_MV_PER_MM
from analysis.reports.drawings import envelope
from analysis.shadow.model.states import GuideStates
from protocol.base.arrays import FloatArray

PAPER_FPS = 2.0  # of its SOFA scene on 16 cores
PAPER_SIMULATION_S = 8.0
PAPER_SIMULATIONS = 9720
DRAWN_POINTS = 1500  # of a run's signals
DPI = 150


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One number: the paper's, ours with its 95 % interval where it has one, and why they differ."""

    quantity: str
    unit: str
    paper: float
    ours: float
    low: float = math.nan
    high: float = math.nan
    why: str = ""


@dataclass(frozen=True, slots=True)
class PaperDrawing:
    """One drawing: the paper's figure that it is of, empty where it has none, what it shows, and its file."""

    figure: str
    shows: str
    path: Path

    def as_json(self) -> dict[str, str]:
        """Return the three."""
        return {"figure": self.figure, "shows": self.shows, "file": str(self.path)}


@dataclass(slots=True)
class Reproduction:
    """The rows and drawings so far."""

    rows: list[PaperRow] = field(default_factory=list)
    drawings: list[PaperDrawing] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Return rows, drawings and their files."""
        rows, drawings = [asdict(row) for row in self.rows], [one.as_json() for one in self.drawings]
        return {"simulated": True, "rows": rows, "drawings": drawings, "files": [one["file"] for one in drawings]}

    def table(self) -> str:
        """Return the rows as a page in Markdown."""
        lines = [
            "# The paper, computed again", "",
            "SIMULATED: rows of sensors are measured on the virtual board, whose truth has the paper's figures.", "",
            "| quantity | unit | paper | here | 95 % interval | what differs, and why |", "|--|--|--|--|--|--|",
        ]  # fmt: skip
        for row in self.rows:
            interval = f"{row.low:.5g} .. {row.high:.5g}" if math.isfinite(row.low) else ""
            lines.append(f"| {row.quantity} | {row.unit} | {row.paper:.6g} | {row.ours:.6g} | {interval} | {row.why} |")
        for one in self.drawings:
            figure = f"Figure {one.figure}: " if one.figure else ""
            lines += ["", f"![{one.path.stem}]({one.path.name})", "", f"{figure}{one.shows}."]
        return "\n".join([*lines, ""])


def calibration_rows(found: Analysis) -> list[PaperRow]:
    """Return the rows of a calibration run: cycles, rate, coefficients, R2, sensitivity, SNR, range."""
    rows = [
        PaperRow("cycles of the calibration", "", 5.0, float(len(found.cycles.complete))),
        PaperRow("sampling rate", "Hz", 100.0, found.recording.rate_hz),
    ]
    for number, (sensor, paper) in enumerate(zip(found.sensors, SENSORS, strict=True), 1):
        fit = sensor.calibration
        if fit is None:
            continue
        terms = zip(paper.coefficients, fit.coefficients, fit.std_errors_with_reading, strict=True)
        for power, (published, b, error) in enumerate(terms):
            unit = ("mV", "mV/mm", "mV/mm²", "mV/mm³")[power]
            interval = float(b - 2 * error), float(b + 2 * error)
            rows.append(PaperRow(f"sensor {number}: b{power}", unit, published, float(b), *interval))
        why = "readings to 0.02 mm; the published fit's residuals are larger"
        rows.append(PaperRow(f"sensor {number}: R²", "", paper.r2, fit.r2, why=why))
        for key, name, unit, value in (
            ("sensitivity_mv_per_mm", "sensitivity", "mV/mm", paper.sensitivity_mv_per_mm),
            ("snr_db", "SNR", "dB", paper.snr_db),
        ):
            figure = sensor.figures[key]
            rows.append(PaperRow(f"sensor {number}: {name}", unit, value, figure.value, figure.low, figure.high))
    system = found.system_sensitivity
    rows.append(
        PaperRow("system: sensitivity", "mV/mm", SYSTEM_SENSITIVITY_MV_PER_MM, system.value, system.low, system.high)
    )
    if (fit := found.sensors[0].calibration) is not None:
        for end, kpa, published in zip(fit.x_range, ("-40", "+50"), RANGE_MM, strict=True):
            rows.append(
                PaperRow(f"elongation at {kpa} kPa", "mm", published, float(end), why="derived from the slopes")
            )
    return rows


def hysteresis_rows(found: Analysis) -> list[PaperRow]:
    """Return the rows of a run of 100 continuous cycles: the hysteresis of each sensor over pressure."""
    why = "signal over pressure; a maximum over the loop, which noise enlarges"
    rows = []
    for number, (sensor, paper) in enumerate(zip(found.sensors, SENSORS, strict=True), 1):
        figure = sensor.figures["system_hysteresis_percent_fso"]
        name = f"sensor {number}: hysteresis, {found.loops.n_cycles} cycles"
        published = paper.system_hysteresis_percent_fso
        rows.append(PaperRow(name, "% FSO", published, figure.value, figure.low, figure.high, why))
    return rows


def optics_rows(result: SweepResult) -> list[PaperRow]:
    """Return the rows of the paper's sweep: the best design here, the rank of the paper's, and the time."""
    best, at = result.designs[int(np.argmax(result.merit().p))], result.find()
    why = "the paper leaves open face, thickness, shapes and emission: see `boat-daq reproduce optics`"
    rows = [
        PaperRow(f"best pattern: {name}", unit, float(getattr(PAPER_OPTIMUM, key)), float(getattr(best, key)), why=why)
        for name, unit, key in (
            ("cavities", "", "cavities"), ("width", "mm", "width_mm"), ("depth", "mm", "depth_mm"),
            ("spacing", "mm", "spacing_mm"),
        )
    ]  # fmt: skip
    p, mapped = result.merit().p, np.asarray([(d.cavities, d.width_mm) == (5, 1.0) for d in result.designs])
    for name, group in (("", np.ones_like(mapped)), (" in the map of figure 3D", mapped)):
        rank = math.nan if at is None else float(ranks_within(p, group)[at])
        rows.append(PaperRow(f"rank of the paper's pattern{name}", "", 1.0, rank, why=why))
    each_s, why = result.seconds / result.simulated, "compiled, all cores"
    return [
        *rows,
        PaperRow("simulations", "", PAPER_SIMULATIONS, result.simulated),
        PaperRow("time of a simulation", "s", PAPER_SIMULATION_S, each_s, why=why),
        PaperRow("time of the sweep", "s", PAPER_SIMULATIONS * PAPER_SIMULATION_S, result.seconds, why=why),
    ]


def shadow_rows(states: GuideStates, critical_kpa: float, frames_per_s: float, states_per_s: float) -> list[PaperRow]:
    """Return the rows of the shadow: its two end states, where it buckles, and how fast it is.

    Parameters
    ----------
    states : the fifteen of the guides. critical_kpa : pressure at which the model buckles.
    """
    elongation_mm, points = states.elongation_mm, states.curves_mm[0, ..., 0].size
    why = "wall and neck are fitted so that the ends agree; the paper gives neither"
    return [
        PaperRow("shadow: elongation at -40 kPa", "mm", RANGE_MM[0], float(elongation_mm[0]), why=why),
        PaperRow("shadow: elongation at +50 kPa", "mm", RANGE_MM[1], float(elongation_mm[-1]), why=why),
        PaperRow("shadow: pressure of buckling", "kPa", -40.0, critical_kpa, why="the paper: below -40 kPa"),
        PaperRow("shadow: states", "", 15.0, float(len(elongation_mm))),
        PaperRow("shadow: points of both guides", "", 14.0, float(points)),
        PaperRow("shadow: frames", "1/s", PAPER_FPS, frames_per_s, why="reduced model, one core; the paper: 16 cores"),
        PaperRow("shadow: tracked points", "1/s", PAPER_FPS, states_per_s, why="the table alone, in one call"),
    ]


def draw_calibration(found: Analysis, path: Path) -> None:
    """Draw readings of both sensors beside the published cubics."""
    x = np.linspace(*RANGE_MM, 200)
    with _picture(path, "elongation, mm", "signal, mV") as (axes,):
        for number, (sensor, paper) in enumerate(zip(found.sensors, SENSORS, strict=True), 1):
            if (fit := sensor.calibration) is None:
                continue
            colour = sensor_colour(number - 1)
            axes.plot(fit.x, fit.y, ".", color=colour, label=f"sensor {number}: readings (SIMULATED)")
            curve = np.polynomial.polynomial.polyval(x, paper.coefficients)
            axes.plot(x, curve, "--", color=colour, label=f"sensor {number}: published")
        axes.legend()


def draw_loops(found: Analysis, path: Path) -> None:
    """Draw the mean loop of each sensor's signal over pressure, from its own mean."""
    with _picture(path, "pressure, kPa", "signal less its mean, mV (SIMULATED)") as (axes,):
        pressure = np.nanmean(found.loops.pressure_kpa, axis=1)[0]
        for number in range(len(found.sensors)):
            mean = np.nanmean(found.loops.signal_mv[number], axis=1)  # [2, levels]
            for branch, style, name in zip(mean, ("-", "--"), ("unloading", "loading"), strict=True):
                label = f"sensor {number + 1}, {name}"
                axes.plot(pressure, branch - np.nanmean(mean), style, color=sensor_colour(number), label=label)
        axes.legend()


def draw_signals(found: Analysis, path: Path) -> None:
    """Draw pressure and signals of a run over time, as the paper's figures 4A and 4C."""
    recording = found.recording
    with _picture(path, "time, s", "pressure, kPa", "signal, mV (SIMULATED)") as (above, below):
        rows: list[tuple[Any, FloatArray, str, str]] = [(above, recording.pressure_kpa, PRESSURE, "")]
        rows += [
            (below, recording.signal_mv[:, i], sensor_colour(i), f"sensor {i + 1}") for i in range(recording.n_sensors)
        ]
        for axes, values, colour, label in rows:
            time, low, high = envelope(recording.time_s, values, DRAWN_POINTS)
            axes.fill_between(time, low, high, color=colour, linewidth=0.6, edgecolor=colour, label=label)
            axes.margins(x=0)
        below.legend(loc="upper right")


def draw_states(curves_mm: FloatArray, path: Path) -> None:
    """Draw the two guides [15, 2, points, 2] in all states: compressed, at rest, elongated."""
    rest = len(curves_mm) // 2
    with _picture(path, "across, mm", "along, mm", size=(4.0, 6.0)) as (axes,):
        for number, state in enumerate(curves_mm):
            colour = INK if number == rest else sensor_colour(int(number > rest))
            for guide in state:
                axes.plot(guide[:, 0], guide[:, 1], ".-", linewidth=0.6, markersize=2, color=colour)
        for name, colour in (("compressed", sensor_colour(0)), ("rest", INK), ("elongated", sensor_colour(1))):
            axes.plot([], [], color=colour, label=name)
        axes.set_aspect("equal")
        axes.legend(loc="center")


@contextmanager
def _picture(path: Path, across: str, *up: str, size: tuple[float, float] = (7.0, 4.0)) -> Iterator[tuple[Any, ...]]:
    """Yield axes, one above another, and save the picture.

    Parameters
    ----------
    across : title of the common abscissa.
    """
    import matplotlib as mpl  # half a second that only who draws spends
    from matplotlib.figure import Figure as Canvas

    with mpl.rc_context(RC):
        canvas = Canvas(figsize=size, layout="constrained")
        columns = canvas.subplots(len(up), sharex=True, squeeze=False)[:, 0]
        yield tuple(columns)
        for axes, title in zip(columns, up, strict=True):
            axes.set_ylabel(title)
        columns[-1].set_xlabel(across)
        save_picture(canvas, path, dpi=DPI)
