"""An analysis as the pages show it, and what a helper process makes of recordings: analyses, exports, reports.

Everything here is a call of `analysis`; only what a page draws is returned, plain arrays and texts, so that a long
recording is not copied between processes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.calibration.curve_choice import CurveCandidate
from analysis.calibration.type_b import Traceability
from analysis.fidelity import Level, fidelity
from analysis.figures.figure import SENSOR_FIGURES, Figure
from analysis.progress import Progress, part_of
from analysis.warning import Warning
from boat_daq.formatting import NOTHING, number, sensor_words
from boat_daq.viewmodels.common.tolerance import TypedTolerance
from boat_daq.viewmodels.results.camera import CameraResult, camera_result
from boat_daq.workflows.calibration_in_force import chosen_curve, exported_elongation, stated_contributions
from boat_daq.workflows.plugin_figures import with_plugins
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.units import STORED_UNITS, ShownUnits

if TYPE_CHECKING:
    from analysis.conformity import Conformity
    from analysis.figures.acceptance import LimitStatement
    from analysis.figures.across_breaks import Break, Comparison
    from analysis.figures.pipeline import Analysis
    from analysis.figures.sensor_analysis import SensorAnalysis

Band = tuple[FloatArray, FloatArray]
Cell = tuple[str, str]
"""A text of a table with its tooltip."""
GRID = 161
EXPORTED_TABLE_ERRORS = tuple(TypedTolerance(mm, "mm") for mm in (0.01, 0.001, 0.0001))
WRITING = 2  # what a report takes to be set, in analyses of a run


SHAPES = {"pass": "\u25cf", "conditional_pass": "\u25d0", "conditional_fail": "\u25b3", "fail": "\u25b2"}
"""Marks of a statement of conformity beside a value; one that is undetermined has none."""
MARKS = ", ".join(f"{shape} {statement.replace('_', ' ')}" for statement, shape in SHAPES.items())


def figure_text(figure: Figure | None, decimals: int, stated: LimitStatement | None = None) -> Cell:
    """Return a figure as text, its 95 % interval in a second line, with definition and count as its tooltip.

    Parameters
    ----------
    figure : an en dash without one.
    stated : its conformity with a limit, which marks the value.
    """
    if figure is None:
        return NOTHING, "not computed for this run"
    text, lines = number(figure.value, decimals), [figure.definition] if figure.definition else []
    if stated is not None:
        text = f"{SHAPES.get(stated.conformity, '')} {text}".strip()
        lines.append(f"{stated.conformity.label}: {stated.text}")
    if math.isfinite(figure.low) and math.isfinite(figure.high):
        text += f"\n{number(figure.low, decimals)} to {number(figure.high, decimals)}"
        lines.append("second line: 95 % confidence interval")
    if figure.n:
        lines.append(f"n = {figure.n}")
    lines += [part for part in (figure.void, figure.note) if part]
    return text, "\n".join(lines)


def figure_rows(sensors: Sequence[SensorAnalysis]) -> tuple[tuple[Cell, ...], ...]:
    """Return the table of figures: name over unit and published limit, then every sensor; none that no sensor has."""
    from analysis.figures.acceptance import TOLERANCES, against_published

    limits = {tolerance.key: tolerance for tolerance in TOLERANCES}
    stated = [{one.tolerance.key: one for one in against_published(sensor)} for sensor in sensors]
    rows = []
    for d in SENSOR_FIGURES.values():
        if any(d.key in sensor.figures for sensor in sensors):
            pairs = zip(sensors, stated, strict=True)
            cells = [figure_text(s.figures.get(d.key), d.decimals, known.get(d.key)) for s, known in pairs]
            limit, tip = limits.get(d.key), f"{d.label_with_unit}\n{cells[0][1]}"
            below = d.unit
            if limit is not None:
                below, tip = f"{d.unit}, limit {limit.symbol} {limit.limit:g}", f"{tip}\nlimit: {limit.source}; {MARKS}"
            rows.append(((f"{d.label}\n{below}", tip), *cells))
    return tuple(rows)


def verdict_rows(sensors: Sequence[SensorAnalysis]) -> list[tuple[Cell, ...]]:
    """Return the row with the verdict on each sensor's curve; none where no curve was tested."""
    found = [sensor.calibration.adequacy if sensor.calibration is not None else None for sensor in sensors]
    cells = [(str(a.verdict), a.sentence) if a is not None else (NOTHING, "not tested") for a in found]
    return [(("Curve", "Whether the curve follows the readings within their scatter"), *cells)] if any(found) else []


def lab_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    """Return a row for each figure of the lab's plugins; one of the unit is shown with the first sensor."""
    rows: list[tuple[Cell, ...]] = []
    for figure in found.lab_figures:
        tip = f"{figure.label_with_unit}\nComputed by the plugin {figure.plugin}, not by boat-daq"
        values = [*figure.values, *[math.nan] * len(found.sensors)][: len(found.sensors)]
        cells: list[Cell] = [(f"{value:.4g}" if math.isfinite(value) else NOTHING, tip) for value in values]
        rows.append(((f"{figure.label}\n{figure.unit}, {figure.plugin}", tip), *cells))
    return rows


@dataclass(frozen=True, slots=True)
class LoopSet:
    """The loops of a run: [2 branches, cycles, levels], signals [sensors, 2, cycles, levels]."""

    numbers: tuple[int, ...]
    pressure_kpa: FloatArray
    elongation_mm: FloatArray | None
    signal_mv: FloatArray

    def broken(self, abscissa: FloatArray, ordinate: FloatArray, cycles: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return cycles as one line: each closed, down the unloading branch and up the loading one, then a NaN.

        Parameters
        ----------
        abscissa, ordinate : [2 branches, cycles, levels].
        cycles : numbers along the second axis.
        """
        (down_x, up_x), (down_y, up_y) = abscissa[:, cycles], ordinate[:, cycles]
        gap = np.full((len(cycles), 1), np.nan)
        x = np.concatenate([down_x[:, ::-1], up_x, gap], axis=1)
        y = np.concatenate([down_y[:, ::-1], up_y, gap], axis=1)
        keep = np.isfinite(x) & np.isfinite(y)
        keep[:, -1] = True
        return x[keep], y[keep]


@dataclass(frozen=True, slots=True)
class CycleSeries:
    """A sensor's figures cycle by cycle, [cycles]: hysteresis over pressure % FSO, SNR dB, end-to-end sensitivity.

    The sensitivity is in mV/mm where the elongation was read in every cycle, else in mV/kPa.
    """

    hysteresis_percent_fso: FloatArray
    snr_db: FloatArray
    sensitivity: FloatArray
    sensitivity_unit: str
    warm_up: int


@dataclass(frozen=True, slots=True)
class CurveBands:
    """A sensor's curve over a grid of elongations with its bands, the residuals of its points, mV, and its record.

    It is the least-squares fit with what acceptance stores, or the mean of the posterior with the figures of the
    sampler; only the latter has the band of a new reading.
    """

    grid: FloatArray
    curve: FloatArray
    residuals: FloatArray
    band_68: Band
    band_95: Band
    content: Mapping[str, Any]
    new_reading_95: Band | None = None


@dataclass(frozen=True, slots=True)
class SensorResult:
    """One sensor: its points, its curve, or why there is none."""

    label: str
    void: str
    cycles: CycleSeries
    x: FloatArray
    y: FloatArray
    loading: BoolArray
    fit: CurveBands | None
    out_of_tolerance: tuple[Warning, ...] = ()


@dataclass(frozen=True, slots=True)
class BreakResult:
    """An interruption of a run that was resumed: between which cycles, as a sentence, and the tests across it.

    A row has quantity, mean before, mean after, p of t, p of F, as text.
    """

    at_cycle: float
    sentence: str
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class RunResult:
    """All that a page shows of one run; of its `plateaus`, `read` have an elongation.

    `uncertainty` has a row for each component of the budget of an elongation, and for each published limit.
    `u_elongation` has x and U of each sensor, [points, 2] mm, none where the curve gives no elongation;
    `u_elongation_void` says why. `traceability` is that of an elongation by every sensor. `recording_id` is the
    `identity` of the recording. `curve` is the choice that was fitted; `candidates` are each sensor's curves, none
    where they were not compared. `camera` is None without one. `drift_half` and `spread_half` are the half widths of
    the 95 % intervals of drift (% FSO per 100 cycles) and repeatability (% FSO), of the worse sensor; else NaN.
    """

    path: str
    unit: str
    simulated: bool
    duration_s: float
    cycles: int
    partial: int
    sensors: tuple[SensorResult, ...]
    figures: tuple[tuple[Cell, ...], ...]
    loops: LoopSet
    warnings: tuple[Warning, ...]
    reading_sd_mm: float
    breaks: tuple[BreakResult, ...] = ()
    plateaus: int = 0
    read: int = 0
    uncertainty: tuple[tuple[Cell, ...], ...] = ()
    u_elongation: tuple[FloatArray, ...] = ()
    u_elongation_void: tuple[str, ...] = ()
    traceability: Traceability | None = None
    recording_id: str = ""
    curve: str = ""
    candidates: tuple[tuple[CurveCandidate, ...], ...] = ()
    stepped: bool = True  # whether the plateaus are steps of a plan, at which readings are typed
    camera: CameraResult | None = None
    drift_half: float = math.nan
    spread_half: float = math.nan

    @property
    def unit_text(self) -> str:
        """The unit, marked where it is simulated."""
        return f"{self.unit or 'no unit'}{'  SIMULATED' if self.simulated else ''}"

    @property
    def calibrated(self) -> bool:
        """Whether every sensor has a calibration."""
        return bool(self.sensors) and all(sensor.fit is not None for sensor in self.sensors)


def load_analysis() -> None:
    """Load the libraries of an analysis and of a report."""
    from importlib import import_module

    for name in ("analysis.figures.pipeline", "analysis.figures.uncertainty", "analysis.reports.build"):
        import_module(name)


def analyse_run(
    path: str,
    *,
    level: Level = "normal",
    curve: str = "",
    compare: bool = False,
    progress: Progress | None = None,
) -> RunResult:
    """Return all figures and curves of a recording, without the posterior.

    Parameters
    ----------
    curve : that is fitted, see `chosen_curve`.
    compare : whether every curve is tried, which takes longer than the rest.
    progress : is called with the steps done and their number.

    Raises
    ------
    BoatDaqError : the recording cannot be read.
    """
    from analysis.data.load import load_recording
    from analysis.figures.batch import readings_beside
    from analysis.figures.pipeline import analyse
    from analysis.figures.sensor_analysis import Options
    from analysis.figures.uncertainty import curve_candidates_of
    from analysis.stopping.criterion import DRIFT, SPREAD, half_width

    recording = load_recording(Path(path))
    part_of(progress, 0, 1, 4)(1, 1)
    degree, type_b = chosen_curve(recording, curve), stated_contributions(recording)
    options = Options(degree, mcmc=False, fidelity=level, type_b=type_b)
    readings = readings_beside(Path(path))
    analysis = analyse(recording, readings, options=options, progress=part_of(progress, 1, 1, 4))
    found = with_plugins(analysis, path)
    candidates = []
    if compare and found.budgets is not None:
        for i in range(len(found.sensors)):
            candidates.append(curve_candidates_of(found, i, found.budgets.x_mm))
            part_of(progress, 2, 2, 4)(i + 1, len(found.sensors))
    loops, budgets = found.loops, found.budgets.budgets if found.budgets is not None else ()
    plateaus, read = _plateaus(found)
    return RunResult(
        path=path,
        unit=str(recording.meta.get("unit") or ""),
        simulated=recording.simulated,
        duration_s=recording.duration_s,
        cycles=loops.n_cycles,
        partial=len(found.cycles.partial),
        sensors=tuple(_sensor(found, i) for i in range(len(found.sensors))),
        figures=(*figure_rows(found.sensors), *verdict_rows(found.sensors), *lab_rows(found)),
        loops=LoopSet(loops.numbers, loops.pressure_kpa, loops.elongation_mm, loops.signal_mv),
        warnings=found.warnings,
        reading_sd_mm=found.reading_sd_mm,
        breaks=tuple(map(_break, found.breaks)),
        plateaus=plateaus,
        read=read,
        uncertainty=(*_expanded_rows(found), *_limit_rows(found), *_component_rows(found)),
        u_elongation=found.u_elongation,
        u_elongation_void=found.u_elongation_void,
        traceability=next((b.traceability for b in budgets), None),
        recording_id=recording.identity,
        curve=str(degree),
        candidates=tuple(candidates),
        stepped=bool(len(recording.steps)),
        camera=camera_result(found),
        drift_half=half_width(found.sensors, DRIFT)[0],
        spread_half=half_width(found.sensors, SPREAD)[0],
    )


def _expanded_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    """Return the expanded uncertainty of an elongation and whether it is traceable; none without a calibration."""
    if found.budgets is None or not found.budgets.budgets:
        return []
    where, budgets = f"at {found.budgets.x_mm:+.2f} mm", found.budgets.budgets
    expanded = [
        (f"\u00b1{1000 * b.expanded:.0f} \u00b5m", f"k = 2, {b.dof:.0f} degrees of freedom, {where}") for b in budgets
    ]
    traced = [one for b in budgets if (one := b.traceability) is not None]
    reasons = [("yes" if one.traceable else "no", one.text) for one in traced]
    return [
        (("Expanded uncertainty", f"of one reading of elongation, {where}"), *expanded),
        (("Traceable", reasons[0][1] if reasons else ""), *reasons),
    ]


def _component_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    """Return the budgets of an elongation, a row a component and a column a sensor; none without a calibration."""
    if found.budgets is None or not found.budgets.budgets:
        return []
    budgets, shares = found.budgets.budgets, [budget.shares() for budget in found.budgets.budgets]
    rows = []
    for parts in zip(*(budget.components for budget in budgets), strict=True):
        cells = []
        for c, own in zip(parts, shares, strict=True):
            text = f"{1000 * c.contribution:.1f} \u00b5m" if c.assessed else "not assessed"
            share = f"{100 * own[c.name]:.0f} % of the variance; " if c.assessed else ""
            cells.append((text, f"{share}{c.source}"))
        rows.append(((parts[0].name.capitalize(), parts[0].source), *cells))
    return rows


def _limit_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    """Return the conformity with the published limits, a row a limit and a column a sensor."""
    from analysis.conformity import RULE
    from analysis.figures.acceptance import against_published

    rows = []
    for stated in zip(*(against_published(sensor) for sensor in found.sensors), strict=False):
        tolerance, definition = stated[0].tolerance, SENSOR_FIGURES[stated[0].tolerance.key]
        name = f"{definition.label}\n{tolerance.symbol} {tolerance.limit:g} {definition.unit}"
        cells = [(_conformity_text(one.conformity), f"{one.text}\n{RULE}") for one in stated]
        rows.append(((name, tolerance.source), *cells))
    return rows


def _conformity_text(conformity: Conformity) -> str:
    """Return a statement with its mark, a condition in a second line: two of them leave names their width."""
    condition, _, stated = conformity.label.rpartition(" ")
    return f"{SHAPES.get(conformity, '')} {stated}\n{condition}".strip()


def _plateaus(found: Analysis) -> tuple[int, int]:
    """Return how many plateaus are to be read, and how many were, as the readings of the live page count them.

    They are the steps of the run without the last; an interrupted one counts where it was read. Without steps they are
    the plateaus of the pressure.
    """
    recording = found.recording
    passed = [bool(json.loads(str(detail) or "{}").get("passed")) for detail in recording.steps["detail"]]
    steps = recording.steps[(recording.steps["branch"] != "end") & ~np.asarray(passed, dtype=bool)]
    if not len(steps):
        known = int(found.elongations.known.sum()) if found.elongations is not None else 0
        return sum(bool(p.branch) for p in found.plateaus), known
    if not len(recording.readings) and found.elongations is not None:  # given in a file
        return int((steps["status"] != "aborted").sum()), int(found.elongations.known.sum())
    readings = recording.current_readings
    read = steps["id"].isin(readings["step"][readings["elongation_mm"].notna()])
    return int(((steps["status"] != "aborted") | read).sum()), int(read.sum())


def _sensor(found: Analysis, index: int) -> SensorResult:
    from analysis.calibration_export.run_record import sensor_record
    from analysis.figures.acceptance import out_of_tolerance

    sensor, none = found.sensors[index], np.zeros(0)
    label, fit, each = sensor_words(sensor.name), sensor.calibration, sensor.by_cycle
    cycles = CycleSeries(
        each.hysteresis_percent_fso, each.snr_db, each.sensitivity, each.sensitivity_unit, each.warm_up
    )
    if fit is None:
        return SensorResult(label, sensor.calibration_void, cycles, none, none, none > 0, None)
    loading = np.array([found.plateaus[int(i)].branch != "unloading" for i in sensor.point_plateau])
    grid = np.linspace(*fit.x_range, GRID)
    bands = fit.band(grid, 0.68), fit.band(grid, 0.95)
    curve = CurveBands(grid, fit.predict(grid), fit.residuals, *bands, sensor_record(found, index).as_json())
    return SensorResult(label, "", cycles, fit.x, fit.y, loading, curve, out_of_tolerance(sensor, found.reading_sd_mm))


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


def sample_run(
    points: list[tuple[list[float], list[float], int, list[int] | None]],
    reading_sd_mm: float,
    level: Level = "normal",
    *,
    progress: Progress | None = None,
) -> tuple[CurveBands, ...]:
    """Return the posterior of each sensor's calibration, as bands on a grid.

    Parameters
    ----------
    points : for each sensor elongations (mm), signals (mV), the degree, and the position where each point was read.
    reading_sd_mm : standard uncertainty of a reading, mm.
    level : of the sampler's fidelity.
    progress : is called with what is done and the total.
    """
    from analysis.calibration.posterior import sample_posterior

    results, fineness = [], fidelity(level)
    for i, (x, y, degree, positions) in enumerate(points):
        posterior = sample_posterior(
            x, y, degree, reading_sd=reading_sd_mm, positions=positions, seed=i, walkers=fineness.walkers,
            samples=fineness.posterior_samples, progress=part_of(progress, i, 1, len(points)),
        )  # fmt: skip
        error_percent = 100.0 * posterior.band_error() / posterior.calibration.full_scale
        grid = np.linspace(min(x), max(x), GRID)
        mean = posterior.curves(grid).mean(axis=0)
        bands = posterior.curve_band(grid, 0.68), posterior.curve_band(grid, 0.95)
        results.append(
            CurveBands(
                grid, mean, np.asarray(y) - np.interp(x, grid, mean), *bands,
                posterior.as_json() | {"band_error_percent_fso": error_percent},
                posterior.new_reading_band(grid, 0.95),
            )
        )  # fmt: skip
    return tuple(results)


def export_run(path: Path, target: Path, *, progress: Progress | None = None) -> str:
    """Write the samples of a recording as the suffix of `target` says, with elongation where a calibration gives it.

    Parameters
    ----------
    progress : is called with what is done and the total.

    Returns
    -------
    Why the file has no elongation; empty where it has.

    Raises
    ------
    BoatDaqError : it cannot be read, or the target cannot be written.
    """
    from analysis.data.export import SUFFIXES, export, require_library
    from analysis.data.load import load_recording
    from analysis.figures.sensor_analysis import Options
    from analysis.tracking.run import with_camera_placed

    format = SUFFIXES.get(target.suffix, "csv")
    require_library(format)
    recording = load_recording(path)
    options = Options(chosen_curve(recording), mcmc=False, type_b=stated_contributions(recording))
    converted, void = exported_elongation(recording, options)
    export(with_camera_placed(recording), target, format, converted=converted, progress=progress)
    return void


def export_calibration(
    path: Path,
    target: Path,
    *,
    curve: str = "",
    table_error: TypedTolerance | None = None,
    progress: Progress | None = None,
) -> str:
    """Write the calibration of a recording as the suffix of `target` says: .json, .h, .m or .csv.

    Parameters
    ----------
    curve : that is fitted, see `chosen_curve`.
    table_error : bound on the error of a table, mm; None for the usual one in a CSV, and for no table in C.
    progress : is called with what is done and the total.

    Returns
    -------
    What must be known of it; empty where nothing is noted.

    Raises
    ------
    BoatDaqError : the run is no calibration, it gives no elongation, no table keeps to the bound, or the target cannot
        be written.
    """
    from analysis.calibration_export.calibration_file import CalibrationFile
    from analysis.calibration_export.forms import FORMS, write_calibration
    from analysis.data.load import load_recording
    from analysis.figures.pipeline import analyse
    from analysis.figures.sensor_analysis import Options

    recording = load_recording(path)
    options = Options(chosen_curve(recording, curve), mcmc=False, type_b=stated_contributions(recording))
    found = CalibrationFile.of_run(analyse(recording, options=options, progress=progress))
    form = next(form for form, suffix in FORMS.items() if suffix == target.suffix)
    write_calibration(found, target, form, None if table_error is None else table_error.value)
    return ". ".join(found.remarks)


def preview_table(path: Path, separator: str | None) -> dict[str, Any]:
    """Return what the importer sees in a CSV file, and the units that each quantity may have.

    Raises
    ------
    BoatDaqError : it is not a table of numbers.
    """
    from analysis.data.csv_import import preview, units_of

    roles = ("time_s", "pressure_kpa", "target_kpa", *(f"s{n}_mv" for n in range(1, 5)))
    return preview(path, separator=separator) | {"units": {role: units_of(role) for role in roles}}


def import_table(
    path: Path, target: Path, columns: Mapping[str, str], rate_hz: float | None, separator: str | None
) -> list[str]:
    """Write a CSV file as a recording; returns what the importer noted.

    Parameters
    ----------
    columns, rate_hz, separator : as `analysis.data.csv_import.import_csv` takes them.

    Raises
    ------
    BoatDaqError : it cannot be imported, or the target cannot be written.
    """
    from analysis.data.boat_writer import write_boat_file
    from analysis.data.csv_import import import_csv

    recording = import_csv(path, columns=columns, rate_hz=rate_hz, separator=separator)
    write_boat_file(target, recording, original=path)
    return [*recording.meta.get("import_notes", ()), *recording.meta.get("import_issues", ())]


def report_runs(
    paths: list[Path],
    target: Path,
    *,
    curve: str = "",
    level: Level = "normal",
    units: ShownUnits = STORED_UNITS,
    progress: Progress | None = None,
) -> str:
    """Write the report of one or several recordings; returns its verdict.

    Parameters
    ----------
    curve : that is fitted, see `chosen_curve`.
    progress : is called with the parts that are analysed and set, and their number.

    Raises
    ------
    BoatDaqError : one of them cannot be read, or the target cannot be written.
    """
    from analysis import Options, analyse, load_recording, write_report
    from analysis.figures.batch import readings_beside

    parts, analyses = len(paths) + WRITING, []
    for i, path in enumerate(paths):
        recording = load_recording(path)
        type_b = stated_contributions(recording)
        options = Options(chosen_curve(recording, curve), fidelity=level, type_b=type_b)
        part = part_of(progress, i, 1, parts)
        found = analyse(recording, readings_beside(path), options=options, progress=part)
        analyses.append(with_plugins(found, str(path)))
    setting = part_of(progress, len(paths), WRITING, parts)
    return write_report(analyses, target, units=units, progress=setting).verdict


def compare_runs(paths: list[Path], *, progress: Progress | None = None) -> tuple[RunResult, ...]:
    """Return the analyses of several recordings.

    Raises
    ------
    BoatDaqError : one of them cannot be read, or simulated and real ones are among them.
    """
    from analysis.figures.unit_history import refuse_mixture

    found = [analyse_run(str(path), progress=part_of(progress, i, 1, len(paths))) for i, path in enumerate(paths)]
    refuse_mixture(run.simulated for run in found)
    return tuple(found)
