"""What the calibration and repeatability pages have computed for them, in a process of its own (`work.Job`).

Everything here is a call of `analysis`; what comes back is only what a page draws, so that a long recording does not
travel. This file is imported in the helper process, not by the window.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.fidelity import Level, fidelity
from boat_daq.viewmodels.common.formatting import NOTHING
from boat_daq.viewmodels.results.analysis_view import (
    FIGURES,
    BreakResult,
    CycleSeries,
    LoopSet,
    PosteriorResult,
    RunResult,
    SensorResult,
    figure_rows,
    figure_text,
)

if TYPE_CHECKING:
    from analysis.figures.across_breaks import Break, Comparison
    from analysis.figures.pipeline import Analysis
    from analysis.segmentation.loops import Loops

Progress = Callable[[float, float], None]
GRID = 161


def analyse_run(path: str, *, seed: int = 0, level: Level = "normal", progress: Progress | None = None) -> RunResult:
    """Return all figures and curves of a recording, without the posterior, at a level of fidelity.

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
        progress=lambda done, total: _tell(progress, 1 + done, 1 + total),
    )
    meta = recording.meta
    return RunResult(
        path=path,
        unit=str(meta.get("unit") or ""),
        started=str(meta.get("started_utc") or ""),
        simulated=recording.simulated,
        kind=found.kind,
        duration_s=recording.duration_s,
        cycles=found.loops.n_cycles,
        partial=len(found.cycles.partial),
        sensors=tuple(_sensor(found, i) for i in range(len(found.sensors))),
        figures=figure_rows([sensor.figures for sensor in found.sensors]),
        system_sensitivity=figure_text(found.system_sensitivity, 1),
        actuator_hysteresis=figure_text(found.actuator_hysteresis, 2),
        loops=_loops(found.loops),
        warnings=found.warnings,
        reading_sd_mm=found.reading_sd_mm,
        breaks=tuple(_break(each) for each in found.breaks),
        plateaus=_asked(found),
        read=int(found.elongations.known.sum()) if found.elongations is not None else 0,
    )


def _asked(found: Analysis) -> int:
    """Return at how many plateaus a run is read: its own steps but the last way out, else those of its cycles."""
    steps = found.recording.steps
    if len(steps):
        return int(((steps["branch"] != "end") & (steps["status"] != "aborted")).sum())
    return sum(bool(p.branch) for p in found.plateaus)


def _tell(progress: Progress | None, done: float, total: float) -> None:
    if progress is not None:
        progress(done, total)


def _in_words(text: str) -> str:
    """Return a flag with its sensor's name written out, e.g. `s1: ...` as `Sensor 1: ...`."""
    return re.sub(r"\bof s(\d)\b", r"of sensor \1", re.sub(r"^s(\d)(_mv)?: ", r"Sensor \1: ", text))


def _sensor(found: Analysis, index: int) -> SensorResult:
    from analysis.figures.acceptance import out_of_tolerance

    sensor = found.sensors[index]
    cycles = _cycles(found, index)
    values = {key: float(figure.value) for key, figure in sensor.figures.items() if key in FIGURES}
    calibration = sensor.calibration
    if calibration is None:
        empty, no_flags, no_numbers = np.zeros(0), np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.int64)
        return SensorResult(
            sensor.name, sensor.calibration_void, values, cycles, empty, empty, empty, no_flags, no_numbers,
            empty, empty, (empty, empty), (empty, empty), None, (),
        )  # fmt: skip
    points = [found.plateaus[int(i)] for i in sensor.point_plateau]
    loading = np.array([p.branch != "unloading" for p in points])
    grid = np.linspace(*calibration.x_range, GRID)
    return SensorResult(
        sensor.name, "", values, cycles, calibration.x, calibration.y, calibration.residuals, loading,
        np.array([p.cycle for p in points]), grid, calibration.predict(grid), calibration.band(grid, 0.68),
        calibration.band(grid, 0.95), _content(found, index), calibration.turning_points,
        out_of_tolerance(sensor, found.reading_sd_mm),
    )  # fmt: skip


def _cycles(found: Analysis, index: int) -> CycleSeries:
    from analysis.figures.repeatability import per_cycle, sensitivity_per_cycle

    each = per_cycle(found, index)
    sensitivity, unit = sensitivity_per_cycle(found, index)
    return CycleSeries(each.hysteresis_percent_fso, each.snr_db, sensitivity, unit, each.warm_up)


def _break(found: Break) -> BreakResult:
    at = 0.5 + float(max(found.before, default=0))
    return BreakResult(at, _in_words(found.sentence), tuple(_tested(c) for c in found.comparisons))


def _tested(c: Comparison) -> tuple[str, ...]:
    """Return one comparison over a break as text; what its test rejects is marked."""
    p = [
        ("\u25b2 " if name in c.significant else "") + (f"{value:.2g}" if np.isfinite(value) else NOTHING)
        for name, value in (("t", c.t_p), ("F", c.f_p))
    ]
    quantity = _in_words(f"{c.sensor}: {c.quantity}") + f" ({c.unit})"
    return quantity, f"{c.mean_before:.4g} (n = {c.n_before})", f"{c.mean_after:.4g} (n = {c.n_after})", *p


def _content(found: Analysis, index: int) -> dict[str, Any]:
    """Return what is stored with the unit: fit as `fit --json`, points, uncertainty of a live reading, figures."""
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
    return LoopSet(loops.numbers, loops.level_kpa, loops.pressure_kpa, loops.elongation_mm, loops.signal_mv)


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
    points : for each sensor elongations (mm), signals (mV), the degree, and the position that each point was read at.
    max_steps : of the sampler.
    """
    from analysis.calibration.posterior import sample_posterior

    results = []
    for number, (x, y, degree, positions) in enumerate(points):

        def tell(done: float, total: float, /, number: int = number) -> None:
            _tell(progress, number + done / total, len(points))

        posterior = sample_posterior(
            x, y, degree, reading_sd=reading_sd_mm, positions=positions, seed=seed + number, max_steps=max_steps,
            progress=tell,
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
