"""A run as the pages show it, made by a helper process: plain arrays and texts, never the samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.calibration.curve_choice import CurveCandidate
from analysis.calibration.record import SensorRecord
from analysis.calibration.type_b import Traceability
from analysis.fidelity import Level, fidelity
from analysis.figures.figure import KEY_FIGURES
from analysis.progress import Progress, part_of
from analysis.warning import Warning
from boat_daq.viewmodels.results.figure_tables import (
    DRIFT_KEY,
    FSO_KEY,
    BreakResult,
    Cell,
    RunFigure,
    break_result,
    figure_rows,
    run_figures,
    uncertainty_rows,
    verdict_rows,
)
from boat_daq.workflows.acceptance import RunCalibration, SensorCalibration, run_calibration
from boat_daq.workflows.run_analysis import analysed_run
from protocol.base.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from analysis.figures.pipeline import Analysis

Band = tuple[FloatArray, FloatArray]
GRID = 161


@dataclass(frozen=True, slots=True)
class LoopSet:
    """The loops of a run: [2 branches, cycles, levels], signals [sensors, 2, cycles, levels]."""

    numbers: tuple[int, ...]
    pressure_kpa: FloatArray
    elongation_mm: FloatArray | None
    signal_mv: FloatArray

    def spread(self, most: int) -> IntArray:
        """Return the cycles, at most so many: then evenly apart, with the first and the last."""
        n = len(self.numbers)
        return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int)) if n else np.zeros(0, int)

    def opened(self, sensor: int, scale_mv: float, cycles: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return loading minus unloading over pressure of cycles, % of `scale_mv`, as one line with gaps."""
        middle = self.pressure_kpa[:, cycles].mean(axis=0)
        apart = 100.0 * (self.signal_mv[sensor][1] - self.signal_mv[sensor][0])[cycles] / scale_mv
        return _lines(middle, apart)

    def actuator_opened(self, cycles: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return loading minus unloading of the elongation over pressure of cycles, % of its span; empty without."""
        mm = self.elongation_mm
        if mm is None or not np.isfinite(mm[1] - mm[0]).any():
            return np.zeros(0), np.zeros(0)
        span = float(np.nanmax(mm) - np.nanmin(mm)) or math.nan
        return _lines(self.pressure_kpa[:, cycles].mean(axis=0), 100.0 * (mm[1] - mm[0])[cycles] / span)


def _lines(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rows [cycles, levels] as one line with a NaN behind each; levels without a value are left out."""
    gap = np.full((len(x), 1), np.nan)
    x, y = np.concatenate([x, gap], axis=1), np.concatenate([y, gap], axis=1)
    keep = np.isfinite(x) & np.isfinite(y)
    keep[:, -1] = True
    return x[keep], y[keep]


@dataclass(frozen=True, slots=True)
class CycleSeries:
    """A sensor's figures cycle by cycle, [cycles]: hysteresis over pressure % FSO, SNR dB, end-to-end sensitivity.

    The sensitivity is in mV/mm where the elongation was read in every cycle, else in mV/kPa.

    Attributes
    ----------
    ends : [2, cycles] signal at the lowest and at the highest level, % FSO from its mean over the cycles.
    whole : figures of the whole run, by key.
    lift_percent_fso : how far noise lifts the hysteresis of single cycles above that of the run; NaN where not.
    """

    hysteresis_percent_fso: FloatArray
    snr_db: FloatArray
    sensitivity: FloatArray
    sensitivity_unit: str
    warm_up: int
    ends: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))
    whole: Mapping[str, RunFigure] = field(default_factory=dict)
    lift_percent_fso: float = math.nan

    @property
    def full_scale_mv(self) -> float:
        """The full-scale output; NaN where it is not known."""
        return self.whole.get(FSO_KEY, RunFigure()).value

    def drift_line(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the drift of the run and the ends of its interval over cycle numbers, % FSO from the mean."""
        found = self.whole.get(DRIFT_KEY, RunFigure())
        away = (numbers - numbers.mean()) / 100.0
        one, other = found.low * away, found.high * away
        return found.value * away, np.minimum(one, other), np.maximum(one, other)


@dataclass(frozen=True, slots=True)
class CurveBands:
    """A sensor's curve over a grid of elongations with its bands, and the residuals of its points, mV.

    Attributes
    ----------
    sampler : figures of the sampler, where the curve is the mean of the posterior; none of a least-squares fit.
    new_reading_95 : band of a new reading; of the posterior only.
    """

    grid: FloatArray
    curve: FloatArray
    residuals: FloatArray
    band_68: Band
    band_95: Band
    sampler: Mapping[str, Any] = field(default_factory=dict)
    new_reading_95: Band | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorResult(SensorCalibration):
    """One sensor: points of its calibration, `loading` or not, and its curve; none where `void` gives the reason."""

    cycles: CycleSeries
    loading: BoolArray
    fit: CurveBands | None

    @property
    def x(self) -> FloatArray:
        """[points] elongation, mm."""
        return self.record.elongation_mm

    @property
    def y(self) -> FloatArray:
        """[points] signal, mV."""
        return self.record.signal_mv


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult(RunCalibration):
    """All that a page shows of one run.

    Attributes
    ----------
    partial : number of partial cycles, which are left out.
    u_elongation : [points, 2] x and U, mm, of each sensor; none where the curve gives no elongation.
    u_reason : reason of each sensor for which U is not given everywhere.
    candidates : the curves of each sensor; none where they were not compared.
    key_figures : the six figures that are read first.
    preliminary : whether the intervals are rough, and the result with the final ones follows.
    drift_half, spread_half : half widths of the 95 % intervals of drift (% FSO per 100 cycles) and repeatability
        (% FSO), of the worse sensor.
    """

    partial: int
    sensors: tuple[SensorResult, ...]
    figures: tuple[tuple[Cell, ...], ...]
    loops: LoopSet
    warnings: tuple[Warning, ...]
    breaks: tuple[BreakResult, ...] = ()
    uncertainty: tuple[tuple[Cell, ...], ...] = ()
    u_elongation: tuple[FloatArray, ...] = ()
    u_reason: tuple[str, ...] = ()
    traceability: Traceability | None = None
    candidates: tuple[tuple[CurveCandidate, ...], ...] = ()
    key_figures: tuple[tuple[Cell, ...], ...] = ()
    preliminary: bool = False
    drift_half: float = math.nan
    spread_half: float = math.nan

    @property
    def unit_text(self) -> str:
        return f"{self.unit or 'no unit'}{'  SIMULATED' if self.simulated else ''}"


def analyse_run(
    path: str,
    *,
    level: Level = "normal",
    curve: str = "",
    compare: bool = False,
    progress: Progress | None = None,
    first: Callable[[object], None] | None = None,
) -> RunResult:
    """Return all figures and curves of a recording, without the posterior; `compare` tries every curve.

    `first` takes the curves and figures with rough intervals, as soon as they are known.
    """
    from analysis.figures.uncertainty import curve_candidates_of

    if first is not None:
        rough = analysed_run(Path(path), curve=curve, level="draft", progress=part_of(progress, 0, 1, 4))
        first(_run_result(rough, Path(path), preliminary=True))
    found = analysed_run(Path(path), curve=curve, level=level, progress=part_of(progress, 1, 1, 4))
    candidates = []
    if compare and found.budgets is not None:
        for i in range(len(found.sensors)):
            candidates.append(curve_candidates_of(found, i, found.budgets.x_mm))
            part_of(progress, 2, 2, 4)(i + 1, len(found.sensors))
    return _run_result(found, Path(path), candidates)


def _run_result(
    found: Analysis, path: Path, candidates: Sequence[tuple[CurveCandidate, ...]] = (), *, preliminary: bool = False
) -> RunResult:
    from analysis.stopping.criterion import DRIFT, SPREAD, half_width

    loops, budgets = found.loops, found.budgets.budgets if found.budgets is not None else ()
    run = run_calibration(found, path)
    shown = {name.name: getattr(run, name.name) for name in fields(run) if name.name != "sensors"}
    return RunResult(
        **shown,
        partial=len(found.cycles.partial),
        sensors=tuple(_sensor(found, i, sensor) for i, sensor in enumerate(run.sensors)),
        figures=(*figure_rows(found.sensors, signal_unit=run.signal_unit), *verdict_rows(found.sensors)),
        key_figures=figure_rows(found.sensors, KEY_FIGURES, run.signal_unit, brief=True),
        loops=LoopSet(loops.numbers, loops.pressure_kpa, loops.elongation_mm, loops.signal_mv),
        warnings=found.warnings,
        breaks=tuple(map(break_result, found.breaks)),
        uncertainty=uncertainty_rows(found),
        u_elongation=found.u_elongation,
        u_reason=found.u_reason,
        traceability=next((b.traceability for b in budgets), None),
        candidates=tuple(candidates),
        drift_half=half_width(found.sensors, DRIFT)[0],
        spread_half=half_width(found.sensors, SPREAD)[0],
        preliminary=preliminary,
    )


def _sensor(found: Analysis, index: int, own: SensorCalibration) -> SensorResult:
    from analysis.reports.run_section import single_cycles

    sensor = found.sensors[index]
    each, fit, curve = sensor.by_cycle, sensor.calibration, None
    if fit is not None:
        grid = np.linspace(*fit.x_range, GRID)
        curve = CurveBands(grid, fit.predict(grid), fit.residuals, fit.band(grid, 0.68), fit.band(grid, 0.95))
    points = sensor.point_plateau if fit is not None else ()
    return SensorResult(
        record=own.record,
        out_of_tolerance=own.out_of_tolerance,
        cycles=CycleSeries(
            each.hysteresis_percent_fso,
            each.snr_db,
            each.sensitivity,
            each.sensitivity_unit,
            each.warm_up,
            each.level_displacement_percent_fso[:, [0, -1]].T,
            run_figures(sensor),
            each.hysteresis_lift_percent_fso if single_cycles(index + 1, sensor) else math.nan,
        ),
        loading=np.array([found.plateaus[int(i)].branch != "unloading" for i in points], dtype=bool),
        fit=curve,
    )


def sample_run(
    sensors: Sequence[SensorRecord], level: Level = "normal", *, progress: Progress | None = None
) -> tuple[CurveBands, ...]:
    """Return the posterior of each sensor's calibration, as bands on a grid."""
    from analysis.calibration.posterior import sample_calibration

    results, fineness = [], fidelity(level)
    for i, sensor in enumerate(sensors):
        x, y, fit = sensor.elongation_mm, sensor.signal_mv, sensor.calibration()
        posterior = sample_calibration(
            fit, sensor.positions, sensor.branches, reading_sd=sensor.reading_sd_mm, seed=i, walkers=fineness.walkers,
            samples=fineness.posterior_samples, progress=part_of(progress, i, 1, len(sensors)),
        )  # fmt: skip
        error_percent = 100.0 * posterior.band_error() / posterior.calibration.full_scale
        grid = np.linspace(*fit.x_range, GRID)
        mean = posterior.curves(grid).mean(axis=0)
        bands: tuple[Band, ...] = (
            posterior.curve_band(grid, 0.68), posterior.curve_band(grid, 0.95), posterior.new_reading_band(grid, 0.95),
        )  # fmt: skip
        if fit.deviation(grid).any():  # no draw of the curve knows of other curves
            known = fit.band(grid, 0.68), fit.band(grid, 0.95), fit.band(grid, 0.95, new_reading=True)
            bands = tuple((np.minimum(a[0], b[0]), np.maximum(a[1], b[1])) for a, b in zip(bands, known, strict=True))
        sampler = posterior.as_json() | {"band_error_percent_fso": error_percent}
        results.append(CurveBands(grid, mean, y - np.interp(x, grid, mean), bands[0], bands[1], sampler, bands[2]))
    return tuple(results)


def compare_runs(paths: list[Path], *, progress: Progress | None = None) -> tuple[RunResult, ...]:
    from analysis.history.unit_history import one_signal_unit, refuse_mixture

    found = [analyse_run(str(path), progress=part_of(progress, i, 1, len(paths))) for i, path in enumerate(paths)]
    refuse_mixture(run.simulated for run in found)
    one_signal_unit(run.signal_unit for run in found)
    return tuple(found)
