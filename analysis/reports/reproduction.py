"""The paper's figures and numbers beside this program's: a value that the command fills, and its table and drawings.

What is measured on the virtual board is simulated: its truth has the paper's figures, so that these rows show that the
analysis finds them again, not that the paper's units have them. Optics, states and speed are computed as in the paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import FloatArray
from analysis.figure_style import save_picture, sensor_colour, styled
from analysis.figures.pipeline import Analysis
from analysis.optics.scene.parameters import PAPER_OPTIMUM
from analysis.optics.sweep.sweep import SweepResult
from analysis.published import RANGE_MM, SENSORS, SYSTEM_SENSITIVITY_MV_PER_MM

PAPER_FPS = 2.0  # of its SOFA scene on 16 cores
PAPER_SWEEP_S = 9720 * 8.0


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


@dataclass(slots=True)
class Reproduction:
    """The rows and drawings so far."""

    rows: list[PaperRow] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        """Return rows and files."""
        return {"simulated": True, "rows": [asdict(row) for row in self.rows], "files": [str(f) for f in self.files]}

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
        pictures = [f"![{path.stem}]({path.name})" for path in self.files if path.suffix == ".png"]
        return "\n".join([*lines, "", *pictures, ""])


def calibration_rows(found: Analysis) -> list[PaperRow]:
    """Return the rows of a calibration run: coefficients, R2, sensitivity, SNR, range."""
    rows = []
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
    rank = math.nan if at is None else float(result.ranks()[at])
    rows.append(PaperRow("rank of the paper's pattern", "", 1.0, rank, why=why))
    return [*rows, PaperRow("time of the sweep", "s", PAPER_SWEEP_S, result.seconds, why="compiled, all cores")]


def shadow_rows(elongation_mm: FloatArray, frames_per_s: float, states_per_s: float) -> list[PaperRow]:
    """Return the rows of the shadow: its two end states, and how fast it is.

    Parameters
    ----------
    elongation_mm : of the 15 states. frames_per_s, states_per_s : of whole frames, and of tracked points alone.
    """
    why = "wall and neck are fitted so that the ends agree; the paper gives neither"
    return [
        PaperRow("shadow: elongation at -40 kPa", "mm", RANGE_MM[0], float(elongation_mm[0]), why=why),
        PaperRow("shadow: elongation at +50 kPa", "mm", RANGE_MM[1], float(elongation_mm[-1]), why=why),
        PaperRow("shadow: states", "", 15.0, float(len(elongation_mm))),
        PaperRow("shadow: frames", "1/s", PAPER_FPS, frames_per_s, why="reduced model, one core; the paper: 16 cores"),
        PaperRow("shadow: tracked points", "1/s", PAPER_FPS, states_per_s, why="the table alone, in one call"),
    ]


@styled
def draw_calibration(found: Analysis, path: Path) -> None:
    """Draw readings and curves of both sensors beside the published cubics."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(7, 4))
    axes = canvas.add_subplot()
    x = np.linspace(*RANGE_MM, 200)
    for number, (sensor, paper) in enumerate(zip(found.sensors, SENSORS, strict=True), 1):
        if (fit := sensor.calibration) is None:
            continue
        colour = sensor_colour(number - 1)
        axes.plot(fit.x, fit.y, ".", color=colour, label=f"sensor {number}: readings (SIMULATED)")
        axes.plot(
            x,
            np.polynomial.polynomial.polyval(x, paper.coefficients),
            "--",
            color=colour,
            label=f"sensor {number}: published",
        )
    axes.set_xlabel("elongation, mm")
    axes.set_ylabel("signal, mV")
    axes.legend(fontsize=8)
    save_picture(canvas, path)


@styled
def draw_loops(found: Analysis, path: Path) -> None:
    """Draw the mean loop of each sensor's signal over pressure, from its own mean."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(7, 4))
    axes = canvas.add_subplot()
    loops = found.loops
    for number in range(len(found.sensors)):
        mean = np.nanmean(loops.signal_mv[number], axis=1)  # [2, levels]
        for branch, style in zip(mean, ("-", "--"), strict=True):
            line = branch - np.nanmean(mean)
            axes.plot(np.nanmean(loops.pressure_kpa, axis=1)[0], line, style, color=sensor_colour(number))
    axes.set_xlabel("pressure, kPa")
    axes.set_ylabel("signal less its mean, mV (SIMULATED)")
    save_picture(canvas, path)


@styled
def draw_readings(result: SweepResult, path: Path) -> None:
    """Draw rays at the receiver over the states, for the paper's pattern and the best one here."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(7, 4))
    axes = canvas.add_subplot()
    at, best = result.find(), int(np.argmax(result.merit().p))
    named: Sequence[tuple[str, int | None]] = (("paper's pattern", at), ("best here", best))
    for name, number in named:
        if number is not None:
            axes.plot(np.arange(result.ndr.shape[1]), result.ndr[number], ".-", label=name)
    axes.set_xlabel("state, 0 = most compressed")
    axes.set_ylabel("rays at the receiver, of 250")
    axes.legend(fontsize=8)
    save_picture(canvas, path)


@styled
def draw_states(curves_mm: FloatArray, path: Path) -> None:
    """Draw the two guides [15, 2, points, 2] in all states."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(4, 6))
    axes = canvas.add_subplot()
    for state in curves_mm:
        for guide in state:
            axes.plot(guide[:, 0], guide[:, 1], "-", linewidth=0.7, color="0.4")
    axes.set_xlabel("across, mm")
    axes.set_ylabel("along, mm")
    axes.set_aspect("equal")
    save_picture(canvas, path)
