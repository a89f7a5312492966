"""`boat-daq shadow`: the mechanical model of the actuator."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar
from boat_daq.commands.options import FidelityOption, PlotOption, one_of
from boat_daq.commands.shadow_chain import chain
from boat_daq.commands.shadow_measured import modulus, replay
from boat_daq.commands.shadow_options import (
    MeshOption,
    ParametersOption,
    chosen_model,
    chosen_parameters,
    chosen_shadow,
    save_figure,
)

if TYPE_CHECKING:
    from analysis.fidelity import Level
    from analysis.shadow.fem.solver import Solution
    from analysis.shadow.model.full import FullModel

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
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Solve the state at a pressure, at an elongation, or with both imposed (by a force at the tip).

    Beyond the critical pressure the actuator is unstable; such a state is refused with that pressure.

    Example: boat-daq shadow solve --pressure -30 --json
    """
    if pressure is None and elongation is None:
        raise typer.BadParameter("give --pressure, --elongation, or both", param_hint="--pressure")
    if mesh is not None and (model == "reduced" or plot is not None):
        raise typer.BadParameter("goes with --model full and without --plot", param_hint="--mesh")
    from analysis.shadow.model.guides import both_guides

    full, solution, used, seconds = _solved(pressure, elongation, model, parameters, mesh, fidelity)
    limit = full.vacuum_limit
    result: dict[str, Any] = {
        "pressure_kpa": solution.pressure_kpa,
        "elongation_mm": solution.elongation_mm,
        "lowest_eigenvalue": full.stability.lowest_eigenvalue(solution),
        "iterations": solution.iterations,
        "seconds": seconds,
        "tracked_points_mm": both_guides(full.tracked(solution)),
        "model": used,
        "tip_force_mn": solution.tip_force_mn,
        "critical_pressure_kpa": limit.pressure_kpa,
    }
    result["notes"] = notes = [warning.text for warning in full.warnings]
    if result["lowest_eigenvalue"] <= 0.0:  # with both values imposed there is no critical pressure to refuse it by
        notes.append("this state is an unstable equilibrium: a real actuator would buckle")
    for note in notes:
        notify(note)
    if plot is not None:
        _plot_state(solution, parameters, plot, fidelity)
    present(
        result,
        f"{solution.pressure_kpa:+.3f} kPa, {solution.elongation_mm:+.4f} mm; {used} model, "
        f"{1e3 * seconds:.1f} ms, {solution.iterations} iterations",
        f"lowest eigenvalue {result['lowest_eigenvalue']:.3f} (1 at rest, 0 at the critical pressure of "
        f"{limit.pressure_kpa:.1f} kPa)",
        as_json=as_json,
    )


def _solved(
    pressure: float | None,
    elongation: float | None,
    model: str,
    parameters: Path | None,
    mesh: Path | None,
    level: Level = "normal",
) -> tuple[FullModel, Solution, str, float]:
    """Return the full model, the state, the name of the model that solved it, and the seconds it took."""
    import time

    if model == "full":
        full = chosen_model(parameters, mesh, level)
        full.check_limits(pressure, elongation)  # finds the limits, once for all states: not timed
        begun = time.perf_counter()
        return full, full.solve(pressure_kpa=pressure, elongation_mm=elongation), "full", time.perf_counter() - begun
    shadow = chosen_shadow(parameters, level)
    begun = time.perf_counter()
    solution, used = shadow.solution(elongation_mm=elongation, pressure_kpa=pressure)
    return shadow.model, solution, used, time.perf_counter() - begun


def _plot_state(solution: Solution, parameters: Path | None, path: Path, level: Level = "normal") -> None:
    """Plot a state into a file."""
    from analysis.shadow.model.drawing import shadow_figure

    shadow = chosen_shadow(parameters, level)
    state = shadow.state(pressure_kpa=solution.pressure_kpa, elongation_mm=solution.elongation_mm)
    save_figure(shadow_figure(state, shadow.topology), path)


@app.command()
def table(
    parameters: ParametersOption = None,
    plot: Annotated[Path | None, typer.Option(help="Plot error against the number of shapes into this file.")] = None,
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Build it even if it is in the cache.")] = False,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Build the reduced model, or load it from the cache; show its range, error and speed.

    Example: boat-daq shadow table --plot errors.png
    """
    import time

    from analysis.fidelity import fidelity as at
    from analysis.shadow.model.drawing import table_errors_figure
    from analysis.shadow.model.fidelity import table_settings
    from analysis.shadow.model.table import build_table, load_table

    chosen, settings = chosen_parameters(parameters, fidelity), table_settings(at(fidelity))
    begun = time.perf_counter()
    with progress_bar("building the table") as progress:
        made = build_table(chosen, settings, progress) if rebuild else load_table(chosen, settings, progress=progress)
    seconds = time.perf_counter() - begun
    result = {
        "pressure_range_kpa": made.pressure_range_kpa,
        "elongation_range_mm": made.elongation_range_mm,
        "modes": made.shapes.shape[1],
        "errors_mm": made.errors_mm,
        "error_bound_mm": made.error_bound_mm,
        "error_bound_percent": 100.0 * made.error_bound_mm / float(made.nominal_range_mm[1]),
        "held_out": settings.held_out,
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
    """Write the mesh with its state (vtu), the mesh (msh), or the whole problem for CalculiX (inp).

    Example: boat-daq shadow export --format inp --pressure 50 --out actuator.inp
    """
    from analysis.shadow.fem.mesh_files import write_state

    model = chosen_model(parameters, None)
    write_state(out, file_format, model.parameters, model.mesh, model.solve(pressure_kpa=pressure))
    nodes, elements = len(model.mesh.nodes), len(model.mesh.quads)
    present(
        {"out": out, "format": file_format, "pressure_kpa": pressure, "nodes": nodes, "elements": elements},
        f"wrote {out}: {nodes} nodes, {elements} elements, {pressure:+g} kPa",
        as_json=as_json,
    )


@app.command()
def states(
    out: Annotated[Path, typer.Option(help="CSV (or .npz) to write.")],
    lowest: Annotated[float, typer.Option(help="Pressure of the most compressed state, kPa.")] = -40.0,
    highest: Annotated[float, typer.Option(help="Pressure of the most elongated state, kPa.")] = 50.0,
    dense: Annotated[bool, typer.Option("--dense", help="Points every 0.5 mm in place of 7 a guide.")] = False,
    parameters: ParametersOption = None,
    mesh: MeshOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the guides in 15 states (7 compressed, rest, 7 elongated), as curves for the optical model.

    Example: boat-daq shadow states --out curves.csv
    """
    from analysis.shadow.model.states import guide_states, write_states

    found = guide_states(chosen_model(parameters, mesh), lowest_kpa=lowest, highest_kpa=highest, every_half_mm=dense)
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
        f"wrote {out}: 15 states, {points} points a guide, elongation {found.elongation_mm[0]:+.2f} .. "
        f"{found.elongation_mm[-1]:+.2f} mm, bow {bow[0]:.2f} .. {bow[-1]:.2f} mm",
        as_json=as_json,
    )


for command in (modulus, replay, chain):
    app.command()(command)
