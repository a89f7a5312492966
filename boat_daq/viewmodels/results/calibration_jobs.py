"""What the calibration and repeatability pages compute in a helper process.

Everything here is a call of `analysis`; only what a page draws is returned, so that a long recording is not copied
between processes. The window does not import this module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.fidelity import Level, fidelity
from boat_daq.viewmodels.common.formatting import NOTHING, sensor_words
from boat_daq.viewmodels.results.analysis_view import (
    BreakResult,
    CycleSeries,
    LoopSet,
    PosteriorResult,
    RunResult,
    SensorResult,
    figure_rows,
)

if TYPE_CHECKING:
    from analysis.figures.across_breaks import Break, Comparison
    from analysis.figures.pipeline import Analysis
    from analysis.segmentation.loops import Loops

Progress = Callable[[float, float], None]
GRID = 161


def analyse_run(path: str, *, seed: int = 0, level: Level = "normal", progress: Progress | None = None) -> RunResult:
    """Return all figures and curves of a recording, without the posterior.

    Parameters
    ----------
    path : of the recording.
    seed : of the bootstrap.
    level : of fidelity.
    progress : is called with the steps done and their number.

    Raises
    ------
    AnalysisError : the recording cannot be read.
    """
    from analysis.data.load import load_recording
    from analysis.figures.pipeline import analyse
    from analysis.figures.sensor_analysis import Options

    recording = load_recording(Path(path))
    if progress is not None:
        progress(1, 4)
    found = analyse(
        recording,
        options=Options(seed=seed, mcmc=False, fidelity=level),
        progress=lambda done, total: _report(progress, 1 + done, 1 + total),
    )
    return RunResult(
        path=path,
        unit=str(recording.meta.get("unit") or ""),
        simulated=recording.simulated,
        duration_s=recording.duration_s,
        cycles=found.loops.n_cycles,
        partial=len(found.cycles.partial),
        sensors=tuple(_sensor(found, i) for i in range(len(found.sensors))),
        figures=figure_rows([sensor.figures for sensor in found.sensors]),
        loops=_loops(found.loops),
        warnings=found.warnings,
        reading_sd_mm=found.reading_sd_mm,
        breaks=tuple(_break(each) for each in found.breaks),
        plateaus=_requested_plateaus(found),
        read=int(found.elongations.known.sum()) if found.elongations is not None else 0,
    )


def _requested_plateaus(found: Analysis) -> int:
    """Return how many plateaus are to be read: the steps of the run without the last, else those of its cycles."""
    steps = found.recording.steps
    if len(steps):
        return int(((steps["branch"] != "end") & (steps["status"] != "aborted")).sum())
    return sum(bool(p.branch) for p in found.plateaus)


def _report(progress: Progress | None, done: float, total: float) -> None:
    if progress is not None:
        progress(done, total)


def _sensor(found: Analysis, index: int) -> SensorResult:
    from analysis.figures.acceptance import out_of_tolerance

    sensor, cycles = found.sensors[index], _cycles(found, index)
    label, calibration = sensor_words(sensor.name), sensor.calibration
    if calibration is None:
        none, band = np.zeros(0), (np.zeros(0), np.zeros(0))
        return SensorResult(
            label, sensor.calibration_void, cycles, none, none, none, none > 0, none, none, band, band, None
        )
    points = [found.plateaus[int(i)] for i in sensor.point_plateau]
    loading = np.array([p.branch != "unloading" for p in points])
    grid = np.linspace(*calibration.x_range, GRID)
    return SensorResult(
        label, "", cycles, calibration.x, calibration.y, calibration.residuals, loading, grid,
        calibration.predict(grid), calibration.band(grid, 0.68), calibration.band(grid, 0.95), _content(found, index),
        out_of_tolerance(sensor, found.reading_sd_mm),
    )  # fmt: skip


def _cycles(found: Analysis, index: int) -> CycleSeries:
    each = found.sensors[index].by_cycle
    return CycleSeries(each.hysteresis_percent_fso, each.snr_db, each.sensitivity, each.sensitivity_unit, each.warm_up)


def _break(found: Break) -> BreakResult:
    comparisons = tuple(replace(c, sensor=sensor_words(c.sensor)) for c in found.comparisons)
    at = 0.5 + float(max(found.before, default=0))
    return BreakResult(at, replace(found, comparisons=comparisons).sentence, tuple(map(_tested, comparisons)))


def _tested(c: Comparison) -> tuple[str, ...]:
    """Return one comparison across an interruption as texts; a rejected test is marked."""
    p = [
        ("\u25b2 " if name in c.significant else "") + (f"{value:.2g}" if np.isfinite(value) else NOTHING)
        for name, value in (("t", c.t_p), ("F", c.f_p))
    ]
    means = f"{c.mean_before:.4g} (n = {c.n_before})", f"{c.mean_after:.4g} (n = {c.n_after})"
    return f"{c.sensor}: {c.quantity} ({c.unit})", *means, *p


def _content(found: Analysis, index: int) -> dict[str, Any]:
    """Return what acceptance stores: fit as `fit --json`, points, uncertainty of a live reading, figures."""
    from analysis.figures.uncertainty import signal_parts

    sensor, parts = found.sensors[index], signal_parts(found, index)
    assert sensor.calibration is not None
    reading = sensor.calibration.reading
    finite = {key: figure.value for key, figure in sensor.figures.items() if np.isfinite(figure.value)}
    return {
        "name": sensor.name,
        "fit": sensor.calibration.as_json(),
        "elongation_mm": sensor.calibration.x.tolist(),
        "signal_mv": sensor.calibration.y.tolist(),
        "positions": None if reading is None else reading.of_point.tolist(),
        "reading_sd_mm": found.reading_sd_mm,
        "noise_mv": parts.independent,
        "model_mv": parts.shared,
        "figures": finite,
    }


def _loops(loops: Loops) -> LoopSet:
    return LoopSet(loops.numbers, loops.pressure_kpa, loops.elongation_mm, loops.signal_mv)


def sample_run(
    points: list[tuple[list[float], list[float], int, list[int] | None]],
    reading_sd_mm: float,
    *,
    seed: int = 0,
    max_steps: int = fidelity().posterior_steps,
    progress: Progress | None = None,
) -> tuple[PosteriorResult, ...]:
    """Return the posterior of each sensor's calibration, as bands on a grid.

    Parameters
    ----------
    points : for each sensor elongations (mm), signals (mV), the degree, and the position where each point was read.
    reading_sd_mm : standard uncertainty of a reading, mm.
    seed : of the first sensor's sampler.
    max_steps : of the sampler.
    progress : is called with what is done and the total.
    """
    from analysis.calibration.posterior import sample_posterior

    results = []
    for number, (x, y, degree, positions) in enumerate(points):

        def within(done: float, total: float, /, number: int = number) -> None:
            _report(progress, number + done / total, len(points))

        posterior = sample_posterior(
            x, y, degree, reading_sd=reading_sd_mm, positions=positions, seed=seed + number, max_steps=max_steps,
            progress=within,
        )  # fmt: skip
        grid = np.linspace(min(x), max(x), GRID)
        results.append(
            PosteriorResult(
                grid, posterior.curves(grid).mean(axis=0),
                posterior.curve_band(grid, 0.68), posterior.curve_band(grid, 0.95),
                posterior.new_reading_band(grid, 0.95), posterior.as_json(),
            )
        )  # fmt: skip
    return tuple(results)
