"""`boat-daq shadow`: the mechanical model of the actuator."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, load, notify, present, progress_bar, show, show_table
from boat_daq.commands.options import PlotOption, RunArgument, UnusedFidelity, one_of
from boat_daq.commands.shadow_model import (
    MeshOption,
    ParametersOption,
    SolvedState,
    chosen_model,
    chosen_parameters,
    chosen_shadow,
    chosen_table,
    note_unused,
    solved_state,
)
from protocol.base.errors import writing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.optics.scene.parameters import Design
    from analysis.optics.sweep.signal import ChainSignal
    from analysis.optics.sweep.sweep import SweepResult
    from analysis.shadow.fem.solver import Solution
    from analysis.shadow.model.full import Assessment
    from analysis.warning import Warning
    from protocol.base.arrays import FloatArray


def save_figure(figure: Figure, path: Path) -> None:
    from analysis.figure_style import save_picture

    with writing(path):
        save_picture(figure, path, dpi=144)
    notify(f"wrote {path}")


app = typer.Typer(
    help="The digital shadow: solve, table, modulus, states, replay, export, chain.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command()
def solve(
    pressure: Annotated[float | None, typer.Option(help="Pressure in the bladders, kPa.")] = None,
    elongation: Annotated[float | None, typer.Option(help="Elongation of the tip, mm.")] = None,
    model: Annotated[str, typer.Option(callback=one_of("full", "reduced"), help="full or reduced.")] = "full",
    parameters: ParametersOption = None,
    mesh: MeshOption = None,
    plot: PlotOption = None,
    fidelity: UnusedFidelity = None,
    as_json: JsonOption = False,
) -> None:
    """Solve the state at a pressure, an elongation, or both.

    Both are imposed together by a force at the tip.

    Beyond the critical pressure the actuator is unstable; such a state is refused with that pressure.

    Example: boat-daq shadow solve --pressure -30 --json
    """
    if pressure is None and elongation is None:
        raise typer.BadParameter("give --pressure, --elongation, or both", param_hint="--pressure")
    if mesh is not None and (model == "reduced" or plot is not None):
        raise typer.BadParameter("needs --model full, without --plot", param_hint="--mesh")
    note_unused(fidelity)
    load("analysis.shadow.model.full")
    from analysis.json_object import json_object
    from analysis.shadow.model.full import assess

    with progress_bar("solving"):
        solved = solved_state(pressure, elongation, model, parameters, mesh)
        found = assess(solved.model, solved.solution)
    fallback = _fallback(model, solved, parameters)
    warnings = [*found.warnings, *fallback]
    for warning in warnings:
        notify(warning.text)
    if plot is not None:
        _plot_state(solved.solution, parameters, plot)
    notes = {
        "notes": [warning.text for warning in warnings],
        "warnings": [json_object(warning) for warning in warnings],
    }
    lines = _lines(solved, found)
    present(_json(solved, found) | notes, *lines, as_json=as_json)


def _json(solved: SolvedState, found: Assessment) -> dict[str, Any]:
    from analysis.shadow.model.guides import both_guides

    solution, size = solved.solution, solved.model.parameters
    return {
        "pressure_kpa": solution.pressure_kpa,
        "elongation_mm": solution.elongation_mm,
        "error_mm": solved.error_mm,
        "mesh": list(size.elements),
        "lowest_eigenvalue": found.lowest_eigenvalue,
        "iterations": solution.iterations,
        "seconds": solved.seconds,
        "tracked_points_mm": both_guides(solved.model.tracked(solution)),
        "model": solved.used,
        "tip_force_mn": solution.tip_force_mn,
        "critical_pressure_kpa": solved.model.vacuum_limit.pressure_kpa,
    }


def _lines(solved: SolvedState, found: Assessment) -> list[str]:
    solution, size = solved.solution, solved.model.parameters
    limit_kpa = solved.model.vacuum_limit.pressure_kpa
    lines = [
        f"{solution.pressure_kpa:+z.3f} kPa, {solution.elongation_mm:+z.4f} mm; {solved.used} model, "
        f"{1e3 * solved.seconds:.1f} ms, {solution.iterations} iterations",
        f"lowest eigenvalue {found.lowest_eigenvalue:.3f} (1 at rest, 0 at the critical pressure of "
        f"{limit_kpa:.3g} kPa)",
    ]
    elements = "{} x ({} + {})".format(*size.elements)
    if math.isfinite(solved.error_mm):
        whose = "" if solved.measured else ", at most, of 95 % of all actuators"
        lines.append(f"error of the elongation by the mesh of {elements} elements: {solved.error_mm:.2g} mm{whose}")
    return lines


def _fallback(model: str, solved: SolvedState, parameters: Path | None) -> list[Warning]:
    """Return the warning that the full model was used because the reduced one, which was chosen, has no such state."""
    if model == solved.used:
        return []
    from analysis.warning import Warning, WarningCode

    table = chosen_table(chosen_parameters(parameters))
    text = f"outside the table of the reduced model ({table.rectangle}): the full model was used"
    return [Warning(WarningCode.OUTSIDE_TABLE, "", text)]


def _plot_state(solution: Solution, parameters: Path | None, path: Path) -> None:
    from analysis.shadow.model.drawing import shadow_figure

    shadow = chosen_shadow(parameters)
    state = shadow.state(pressure_kpa=solution.pressure_kpa, elongation_mm=solution.elongation_mm)
    save_figure(shadow_figure(state, shadow.topology), path)


@app.command()
def table(
    parameters: ParametersOption = None,
    plot: Annotated[Path | None, typer.Option(help="Plot error against the number of shapes into this file.")] = None,
    fidelity: UnusedFidelity = None,
    as_json: JsonOption = False,
) -> None:
    """Show range, error and speed of the reduced model.

    The default actuator's comes with the program; another is loaded from the cache, or built.

    Example: boat-daq shadow table --plot errors.png
    """
    note_unused(fidelity)
    from analysis.shadow.model.drawing import table_errors_figure
    from analysis.shadow.model.reduced import TableSettings
    from analysis.shadow.model.table import load_table

    chosen = chosen_parameters(parameters)
    begun = time.perf_counter()
    with progress_bar("building the table") as progress:
        made = load_table(chosen, progress=progress)
    seconds = time.perf_counter() - begun
    result = {
        "pressure_range_kpa": made.pressure_range_kpa,
        "elongation_range_mm": made.elongation_range_mm,
        "modes": made.shapes.shape[1],
        "errors_mm": made.errors_mm,
        "error_bound_mm": made.error_bound_mm,
        "error_bound_percent": 100.0 * made.error_bound_mm / float(made.nominal_range_mm[1]),
        "held_out": TableSettings().held_out,
        "critical_pressure_kpa": float(made.critical_kpa),
        "states_per_s": made.states_per_second(),
        "seconds": seconds,
    }
    if plot is not None:
        save_figure(table_errors_figure(chosen), plot)
    (p0, p1), (q0, q1) = made.pressure_range_kpa, made.elongation_range_mm
    present(
        result,
        f"{p0:.1f} .. {p1:.1f} kPa, {q0:.2f} .. {q1:.2f} mm; {result['modes']} shapes, ready in {seconds:.1f} s",
        f"error of every tracked point below {made.error_bound_mm:.2g} mm; {result['states_per_s']:,.0f} states/s",
        as_json=as_json,
    )


@app.command()
def export(
    out: Annotated[Path, typer.Option(help="File to write.")],
    file_format: Annotated[str, typer.Option("--format", help="vtu, msh or inp.")],
    pressure: Annotated[float, typer.Option(help="Pressure of the state, kPa (msh: the state at rest).")] = 0.0,
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write mesh and state for ParaView, Gmsh or CalculiX.

    vtu: mesh with state; msh: mesh; inp: the whole problem.

    Example: boat-daq shadow export --format inp --pressure 50 --out actuator.inp
    """
    from analysis.shadow.fem.mesh_files import write_state

    model = chosen_model(parameters, None)
    with progress_bar("solving"):
        state = model.solve(pressure_kpa=pressure)
    write_state(out, file_format, model.parameters, model.mesh, state)
    nodes, elements = len(model.mesh.nodes), len(model.mesh.quads)
    content = {"out": out, "format": file_format, "pressure_kpa": pressure, "nodes": nodes, "elements": elements}
    present(content, f"wrote {out}: {nodes} nodes, {elements} elements, {pressure:+g} kPa", as_json=as_json)


@app.command()
def states(
    out: Annotated[Path, typer.Option(help="CSV (or .npz) to write.")],
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the guides in 15 states for the optical model.

    They are curves, from -40 to +50 kPa.

    Example: boat-daq shadow states --out curves.csv
    """
    load("analysis.shadow.model.states")
    from analysis.shadow.model.states import check_suffix, guide_states, write_states

    check_suffix(out)
    with progress_bar("solving"):
        found = guide_states(chosen_model(parameters, None))
    write_states(found, out)
    bow, points = found.bow_mm(), found.curves_mm.shape[2]
    content = {
        "out": out,
        "pressure_kpa": found.pressure_kpa,
        "elongation_mm": found.elongation_mm,
        "bow_mm": bow,
        "curvature_per_mm": found.curvature_per_mm(),
        "points": points,
    }
    present(
        content,
        f"wrote {out}: 15 states, {points} points a guide, elongation {found.elongation_mm[0]:+z.2f} .. "
        f"{found.elongation_mm[-1]:+z.2f} mm, bow {bow[0]:.2f} .. {bow[-1]:.2f} mm",
        as_json=as_json,
    )


BAND_PRESSURES_KPA = (-40.0, -20.0, 20.0, 50.0)


@app.command()
def modulus(
    files: Annotated[list[Path], typer.Argument(metavar="FILE.csv...", help="One compression test a specimen.")],
    height_mm: Annotated[float, typer.Option(help="Height of the specimens at rest, mm.")],
    area_mm2: Annotated[float, typer.Option(help="Cross-section of the specimens at rest, mm².")],
    columns: Annotated[
        str, typer.Option(metavar="FORCE,DISPLACEMENT", help="Names or numbers of the columns; default found by name.")
    ] = "",
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find the modulus of the lattice from compression tests.

    Also shows its effect on the nominal elongation.

    Example: boat-daq shadow modulus s1.csv s2.csv s3.csv --height-mm 50 --area-mm2 2500
    """
    import numpy as np

    from analysis.shadow.model.modulus import effective_modulus, read_compression_test

    if len({path.resolve() for path in files}) < len(files):
        raise typer.BadParameter("one file is given for two specimens, which leaves no spread", param_hint="FILE.csv")
    force, _, displacement = columns.partition(",")
    if bool(force) != bool(displacement):
        raise typer.BadParameter(f"{columns!r} is not FORCE,DISPLACEMENT", param_hint="--columns")
    tests = [read_compression_test(path, height_mm, area_mm2, force or None, displacement or None) for path in files]
    found = effective_modulus(tests)
    spread = found.sd_kpa if math.isfinite(found.sd_kpa) else found.standard_error_kpa
    table = chosen_table(
        replace(chosen_parameters(parameters), lattice_modulus_kpa=found.mean_kpa, lattice_modulus_sd_kpa=spread)
    )
    low, high = table.pressure_range_kpa
    pressures = np.array([p for p in BAND_PRESSURES_KPA if low <= p <= high])
    band = list(zip(pressures, *table.nominal_elongation(pressures), strict=True))
    keys = ("pressure_kpa", "nominal_elongation_mm", "standard_uncertainty_mm")
    present(
        asdict(found)
        | {
            "n": len(tests),
            "band": [dict(zip(keys, row, strict=True)) for row in band],
            "error_mm": table.errors_mm[-1],
        },
        *(f"{one.name}: {one.modulus_kpa:.2f} kPa (R² {one.r2:.4f}, {one.points} points)" for one in found.specimens),
        f"E = {found.mean_kpa:.2f} ± {spread:.2f} kPa, N = {len(tests)}",
        *(f"{p:+z.0f} kPa: {x:+z.3f} ± {u:.3f} mm (k = 1)" for p, x, u in band),
        as_json=as_json,
    )


@app.command()
def replay(
    run: RunArgument,
    calibration: Annotated[
        Path | None, typer.Option(help="Run to calibrate from; default RUN itself, else the calibration of its unit.")
    ] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of the calibration's elongation readings.")] = None,
    parameters: ParametersOption = None,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compare a run with the shadow: deviation, drift, alarms.

    Example: boat-daq shadow replay repeatability.boat --calibration calibration.boat --plot deviation.png
    """
    load("analysis.figures.pipeline", "analysis.shadow.monitoring.replay")
    from analysis import find_cycles, load_recording
    from analysis.shadow.monitoring.replay import replay as compare
    from analysis.shadow.monitoring.replay import replay_figure
    from boat_daq.workflows.run_analysis import elongation_by_sensor

    recording = load_recording(run)
    with progress_bar("calibrating") as progress:
        measured_mm, by = elongation_by_sensor(run, recording, calibration, elongation, progress=progress)
    table = chosen_table(chosen_parameters(parameters))
    cycles = [cycle.rows for cycle in find_cycles(recording).complete]
    result = compare(table, recording.time_s, recording.pressure_kpa, measured_mm, cycles)
    summary = result.summary() | {"simulated": recording.simulated, "error_mm": table.errors_mm[-1], "calibration": by}
    if plot is not None:
        save_figure(replay_figure(result), plot)
    if as_json:
        emit_json(summary)
        return
    if recording.simulated:
        show("SIMULATED")
    show(
        f"calibration: {by}\n{summary['cycles']} cycles; deviation {summary['deviation_mean_mm']:+z.3f} mm on average, "
        f"{summary['deviation_rms_mm']:.3f} mm rms; drift {result.trend}"
    )
    show_table(("cycle", "mean deviation, mm"), [(str(k), f"{mm:+z.3f}") for k, mm in enumerate(result.levels_mm, 1)])
    if not result.alarms:
        show("no alarm")
    for alarm in result.alarms:
        show(f"ALARM in cycle {alarm.cycle}: {alarm.sentence}")
    for cause in result.left_out:
        notify(f"omitted: {cause}")
    detectable = ", ".join(f"{name} {size:.2g}" for name, size in result.smallest_shift.items() if math.isfinite(size))
    shifts = f"smallest shifts that further cycles would show: {detectable}"
    show(shifts if detectable else "too few cycles for the alarms to detect a shift")


@app.command()
def chain(
    rays: Annotated[int | None, typer.Option(help="Rays of each simulation; default 5000.", min=1)] = None,
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compute the chain from pressure to detected light.

    The best pattern too, and both with the parametric curves.

    The light of the paper's design is compared with the published calibrations, by the best gain and offset.

    Example: boat-daq shadow chain --rays 5000
    """
    from analysis.optics.scene.curves import parametric_curves
    from analysis.optics.sweep.signal import SIGNAL_RAYS, chain_signal
    from analysis.optics.sweep.sweep import paper_grid
    from analysis.shadow.model.states import guide_states

    designs = tuple(paper_grid())
    with progress_bar("solving"):
        states = guide_states(chosen_model(parameters, None))
    found: dict[str, Any] = {}
    for name, curves in (("shadow", states.curves_mm), ("parametric", parametric_curves())):
        found[name] = _outcome(_chain_sweep(name, designs, curves, rays or SIGNAL_RAYS))
    found["bow_mm"], found["curvature_per_mm"] = states.bow_mm(), states.curvature_per_mm()
    found["elongation_mm"] = states.elongation_mm
    found["same_best"] = found["shadow"]["best"] == found["parametric"]["best"]
    signal = chain_signal(states.curves_mm, states.elongation_mm, rays or SIGNAL_RAYS)
    found["signal"] = asdict(signal) | {
        "light_change_percent": signal.light_change_percent,
        "inverted": signal.inverted,
    }
    if signal.rays < SIGNAL_RAYS:
        notify(f"with fewer than {SIGNAL_RAYS} rays the light scatters more than it changes between two states")
    if as_json:
        emit_json(found)
        return
    for line in _chain_lines(found, signal):
        show(line)


def _chain_lines(found: Mapping[str, Any], signal: ChainSignal) -> Iterator[str]:
    for name in ("shadow", "parametric"):
        one = found[name]
        design = "{cavities} cavities {width_mm:.1f} wide, {depth_mm:.1f} deep, {spacing_mm:.1f} apart"
        yield (
            f"{name}: best {design.format(**one['best'])}, P {one['p']:.3g}, tied with {one['tied']}; "
            f"NDR {one['ndr'][0]:.0f} compressed, {one['ndr'][7]:.0f} at rest, {one['ndr'][-1]:.0f} elongated; "
            f"the paper's optimum has rank {one['paper_optimum_rank']}; error of 95 % of the counts "
            f"{one['error']['of_95_percent']:.2g} rays with {one['rays']} rays"
        )
    yield (
        f"light of the paper's design, all reflections followed: {signal.light_change_percent:+z.1f} % from "
        f"{signal.elongation_mm[0]:+z.2f} to {signal.elongation_mm[-1]:+z.2f} mm"
    )
    for number, fit in enumerate(signal.sensors, start=1):
        yield (
            f"published signal of sensor {number}: {fit.signal_change_percent:+z.1f} %; gain "
            f"{fit.gain_mv_per_percent:+z.1f} mV per percent of light, R2 {fit.r2:.3f}, "
            f"rms {fit.rms_percent_fso:.1f} % FSO; a straight line in elongation R2 {fit.line_r2:.3f}, a parabola "
            f"{fit.parabola_r2:.4f}"
        )
    if signal.inverted:
        yield "negative gains: the front end inverts, or in the real guides light rises where it falls here"
    straighter = found["curvature_per_mm"][-1] < found["curvature_per_mm"][0]
    yield f"the shadow's guides get {'straighter' if straighter else 'more bent'} as the actuator lengthens"


def _chain_sweep(name: str, designs: tuple[Design, ...], curves: FloatArray, rays: int) -> SweepResult:
    from analysis.optics.scene.parameters import Light, phase_of
    from analysis.optics.sweep.sweep import SweepRequest, run_sweep

    request = SweepRequest(designs, light=Light(rays=rays, phase=phase_of(rays)), curves=curves)
    with progress_bar(f"sweep over the {name} curves") as progress:
        return run_sweep(request, progress=progress)


def _outcome(result: SweepResult) -> dict[str, Any]:
    """Return a sweep's best design, the number tied with it, and the rank of the paper's optimum."""
    import numpy as np

    from analysis.optics.sweep.fans import count_errors

    p = result.merit().p
    best, paper = int(np.argmax(p)), result.find()
    design = asdict(result.designs[best])
    del design["face"]  # the same of all designs
    return {
        "best": design,
        "p": float(p[best]),
        "tied": int(np.sum(result.uncertainty().tied)),
        "ndr": result.ndr[best],
        "paper_optimum_rank": None if paper is None else int(result.ranks()[paper]),
        "seconds": result.seconds,
        "simulations": result.simulated,
        "rays": result.request.light.rays,
        "error": count_errors(result),
    }
