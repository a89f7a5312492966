"""Whole jobs: a calibration, its report, the paper's sweep, each from its input to its result.

The chart of a method is the cost of one step; a job adds all its steps, with those that no method has: segmentation
beside the posterior, page setting, the building of scenes. The sweep is measured on 24 designs and its time multiplied
by 27, which gives that of the paper's 648.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from analysis.data.recording import Recording
from analysis.fidelity import LEVELS, Level
from analysis.figures.pipeline import Analysis
from analysis.figures.sensor_analysis import Options
from analysis.optics.scene.parameters import Light, Waveguide
from analysis.optics.sweep.figure_of_merit import merit, resolution
from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep
from analysis.reports.build import write_report
from analysis.studies.failure_maps.figures import Stairs, analysed_with
from analysis.studies.tradeoff.measure import Method, Setting
from analysis.studies.tradeoff.mechanics import BASIS, MESH
from analysis.studies.tradeoff.metrology import BOOTSTRAP, INVERSE, SEGMENTATION
from analysis.studies.tradeoff.posterior import POSTERIOR
from analysis.studies.tradeoff.rays import RANKING, TRACER, rays_text, turned
from analysis.studies.tradeoff.references import load
from protocol.base.arrays import FloatArray

_GRID_MM = 0.5
_BULGE_PERCENT = 2.0
_SENSORS = (Stairs(cycles=5, bulge_percent=_BULGE_PERCENT), Stairs(cycles=5, bulge_percent=-_BULGE_PERCENT, seed=1))
_BAND_POINTS = 31
PAPER_DESIGNS = 648


def calibrated(options: Options) -> Analysis:
    """Analyse a simulated run of five cycles and two sensors, with elongations read on a grid of 0.5 mm."""
    run = _SENSORS[0]
    levels, branch = run.holds
    read = _GRID_MM * np.round(run.elongation(levels, branch) / _GRID_MM)
    rows = "".join(f"{p:.6f},{x:.1f}\n" for p, x in zip(levels, read, strict=True))
    return analysed_with(_five_cycles(), f"pressure_kpa,elongation_mm\n{rows}", options)


@cache
def _five_cycles() -> Recording:
    (time_s, pressure, _), signals = _SENSORS[0].columns, np.stack([s.columns[2] for s in _SENSORS], axis=1)
    return Recording.from_arrays(time_s, pressure, signals, source="trade-off")


def widths(analysis: Analysis) -> FloatArray:
    """Return of each sensor the mean width of its 95 % band, mV, and the widths of the intervals of its figures."""
    found: list[float] = []
    for sensor in analysis.sensors:
        if sensor.posterior is not None and sensor.calibration is not None:
            low, high = sensor.posterior.curve_band(np.linspace(*sensor.calibration.x_range, _BAND_POINTS))
            found.append(float(np.mean(high - low)))
        found += [f.high - f.low for f in sensor.figures.values() if np.isfinite(f.high - f.low)]
    return np.array(found)


def _width_error(analysis: Analysis) -> float:
    """Return how far the widths that draws determine are from those of many draws, rms, %."""
    table = load("jobs")
    off = widths(analysis) / np.array(table["widths"]) - 1.0
    return 100.0 * float(np.sqrt(np.mean(off[np.array(table["drawn"])] ** 2)))


def calibration_settings(_: bool) -> list[Setting]:
    """Return the levels; a call analyses the run with other draws each time."""

    def analysed(level: Level, repeat: int) -> Analysis:
        return calibrated(Options(seed=repeat, fidelity=level))

    return [Setting(level, partial(analysed, level), _width_error) for level in LEVELS]


def report_settings(_: bool) -> list[Setting]:
    """Return the levels; a call analyses the run and writes its report as PDF."""

    def reported(level: Level, repeat: int) -> Analysis:
        analysis = calibrated(Options(seed=repeat, fidelity=level))
        with tempfile.TemporaryDirectory() as folder:
            write_report([analysis], Path(folder, "report.pdf"))
        return analysis

    return [Setting(level, partial(reported, level), _width_error) for level in LEVELS]


def sweep_settings(quick: bool) -> list[Setting]:
    """Return numbers of rays; a call is a sweep of a part of the grid, from curves to the ranking."""
    table = load("tracer")
    designs = tuple(paper_grid()[:: table["every"]])
    truth = merit(np.array(table["ranking_ndr"]), resolution(table["ranking_rays"])).p
    curves = np.array(table["curves_mm"])

    def ranked(rays: int, repeat: int) -> FloatArray:
        light = turned(Light().with_rays(rays), repeat)
        return run_sweep(SweepRequest(designs, Waveguide(), light, curves), threads=1).merit().p

    def error(p: FloatArray) -> float:
        return 1.0 - float(spearmanr(truth, p).statistic)

    rays = (50, 250, 2_500) if quick else (50, 250, 1_000, 2_500, 5_000, 25_000)
    return [Setting(rays_text(n), partial(ranked, n), error, work=len(designs) / PAPER_DESIGNS) for n in rays]


_WIDTHS = "the same job with 50,000 resamples and 8,000 samples, mean of 16 seeds"
_WIDTHS_CONSUMER = "the reader of widths of bands and intervals, printed with two digits: 5 %"
CALIBRATION = Method(
    "calibration", "Job: calibration of a run", _WIDTHS, False, _WIDTHS_CONSUMER, 5.0, "% of the widths",
    "a five-cycle run", lambda level: level.level, calibration_settings,
)  # fmt: skip
REPORT = Method(
    "report", "Job: report on a run", _WIDTHS, False, _WIDTHS_CONSUMER, 5.0, "% of the widths", "a report",
    lambda level: level.level, report_settings,
)  # fmt: skip
SWEEP = replace(
    RANKING, name="sweep", title="Job: the paper's sweep", per="9,720 scenes on one core, scaled from 360",
    settings=sweep_settings,
)  # fmt: skip

STEPS = (TRACER, RANKING, MESH, BASIS, POSTERIOR, INVERSE, SEGMENTATION, BOOTSTRAP)
JOBS = (CALIBRATION, REPORT, SWEEP)
METHODS: dict[str, Method] = {m.name: m for m in (*STEPS, *JOBS)}
