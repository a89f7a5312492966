"""The numbers of the paper beside this program's.

What is measured on the virtual board is simulated: its truth has the paper's figures, so that these rows show that the
analysis finds them again, not that the paper's units have them. Optics, states and speed are computed as in the paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.figures.pipeline import Analysis
from analysis.optics.scene.parameters import PAPER_OPTIMUM
from analysis.optics.sweep.figure_of_merit import ranks_within
from analysis.optics.sweep.sweep import SweepResult
from analysis.published import RANGE_MM, SENSORS, SYSTEM_SENSITIVITY_MV_PER_MM
from analysis.shadow.model.states import GuideStates

PAPER_FPS = 2.0  # of its SOFA scene on 16 cores
PAPER_SIMULATION_S = 8.0
PAPER_SIMULATIONS = 9720


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


def numbers_table(rows: Sequence[PaperRow]) -> list[str]:
    """Return the rows as lines of a Markdown table."""
    lines = ["| quantity | unit | paper | here | 95 % interval | what differs, and why |", "|--|--|--|--|--|--|"]
    for row in rows:
        interval = f"{row.low:.5g} .. {row.high:.5g}" if math.isfinite(row.low) else ""
        lines.append(f"| {row.quantity} | {row.unit} | {row.paper:.6g} | {row.ours:.6g} | {interval} | {row.why} |")
    return lines


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
    text = "system: sensitivity"
    rows.append(PaperRow(text, "mV/mm", SYSTEM_SENSITIVITY_MV_PER_MM, system.value, system.low, system.high))
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
        name = f"sensor {number}: hysteresis over pressure, {found.loops.n_cycles} cycles"
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
    rank = math.nan if at is None else float(ranks_within(p, mapped)[at])
    rows.append(PaperRow("rank of the paper's pattern among the 36 of figure 3D", "", 1.0, rank, why=why))
    each_s, why = result.seconds / result.simulated, "compiled, all cores"
    return [
        *rows,
        PaperRow("simulations", "", PAPER_SIMULATIONS, result.simulated),
        PaperRow("time of a simulation", "s", PAPER_SIMULATION_S, each_s, why=why),
        PaperRow("time of the sweep", "s", PAPER_SIMULATIONS * PAPER_SIMULATION_S, result.seconds, why=why),
    ]


def shadow_rows(states: GuideStates, critical_kpa: float, frames_per_s: float, states_per_s: float) -> list[PaperRow]:
    """Return the rows of the shadow: its two end states, where it buckles, and how fast it is."""
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
