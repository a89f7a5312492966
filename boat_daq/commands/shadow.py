"""`boat-daq shadow`: the mechanical model of the actuator, asked from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say
from boat_daq.commands.fidelity import FidelityOption, level_of
from boat_daq.commands.shadow_chain import chain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.fidelity import Level
    from analysis.recording import Recording
    from analysis.shadow.arrays import Floats
    from analysis.shadow.full_model import FullModel
    from analysis.shadow.parameters import ActuatorParameters
    from analysis.shadow.shadow import Shadow
    from analysis.shadow.solver import Solution

app = typer.Typer(
    help="The digital shadow: solve, table, modulus, states, replay, export, chain.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

ParametersOption = Annotated[Path | None, typer.Option("--parameters", help="TOML file of actuator parameters.")]
NO_SIGHT = "too few cycles for the alarms to find anything"
MeshOption = Annotated[Path | None, typer.Option("--mesh", help="A .vtu or .msh mesh in place of the parametric one.")]


def chosen_parameters(path: Path | None, level: Level = "normal") -> ActuatorParameters:
    """Return the parameters of a file, or the defaults, on the mesh of a fidelity; normal leaves a file's own mesh."""
    from analysis.fidelity import fidelity
    from analysis.shadow.fidelity import actuator
    from analysis.shadow.parameter_files import read_parameters

    if path is None:
        return actuator(fidelity(level))
    read = read_parameters(path)
    return read if level == "normal" else actuator(fidelity(level), read)


def chosen_model(parameters: Path | None, mesh: Path | None, level: Level = "normal") -> FullModel:
    """Return the full model of the chosen parameters and mesh."""
    from analysis.shadow.full_model import FullModel
    from analysis.shadow.mesh_files import read_mesh

    return FullModel(chosen_parameters(parameters, level), mesh=None if mesh is None else read_mesh(mesh))


def chosen_shadow(parameters: Path | None, level: Level = "normal") -> Shadow:
    """Return the shadow of the chosen parameters, its table of the fidelity's size."""
    from analysis.fidelity import fidelity
    from analysis.shadow.fidelity import table_settings
    from analysis.shadow.shadow import Shadow
    from analysis.shadow.table import load_table

    chosen = chosen_parameters(parameters, level)
    with progress_bar("building the table") as progress:
        return Shadow(chosen, load_table(chosen, table_settings(fidelity(level)), progress=progress))


@app.command()
def solve(
    pressure: Annotated[float | None, typer.Option(help="Pressure in the bladders, kPa.")] = None,
    elongation: Annotated[float | None, typer.Option(help="Elongation of the tip, mm.")] = None,
    model: Annotated[str, typer.Option(help="full or reduced.")] = "full",
    parameters: ParametersOption = None,
    mesh: MeshOption = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the state into this PNG, SVG or PDF.")] = None,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Solve the state at a pressure, at an elongation, or with both imposed (then the tip needs a force).

    Beyond the critical pressure the actuator is not stable; such a state is refused with that pressure.

    Example: boat-daq shadow solve --pressure -30 --json
    """
    if model not in ("full", "reduced"):
        raise typer.BadParameter(f"'{model}' is neither full nor reduced", param_hint="--model")
    if pressure is None and elongation is None:
        raise typer.BadParameter("give --pressure, --elongation, or both", param_hint="--pressure")
    if mesh is not None and (model == "reduced" or plot is not None):
        raise typer.BadParameter("goes with --model full and without --plot", param_hint="--mesh")
    from analysis.shadow.guides import both_guides

    level = level_of(fidelity)
    full, solution, answered, seconds = answer(pressure, elongation, model, parameters, mesh, level)
    limit = full.vacuum_limit
    result: dict[str, Any] = {
        "pressure_kpa": solution.pressure_kpa,
        "elongation_mm": solution.elongation_mm,
        "lowest_eigenvalue": full.stability.lowest_eigenvalue(solution),
        "iterations": solution.iterations,
        "seconds": seconds,
        "tracked_points_mm": both_guides(full.tracked(solution)),
        "model": answered,
        "tip_force_mn": solution.tip_force_mn,
        "critical_pressure_kpa": limit.pressure_kpa,
    }
    result["notes"] = notes = [*full.reservations, *unstable(result["lowest_eigenvalue"])]
    for note in notes:
        say(note)
    if plot is not None:
        draw(solution, parameters, plot, level)
    if as_json:
        emit_json(result)
    else:
        say(
            f"{solution.pressure_kpa:+.3f} kPa, {solution.elongation_mm:+.4f} mm; {answered} model, "
            f"{1e3 * seconds:.1f} ms, {solution.iterations} iterations"
        )
        say(
            f"lowest eigenvalue {result['lowest_eigenvalue']:.3f} (1 at rest, 0 at the critical pressure of "
            f"{limit.pressure_kpa:.1f} kPa)"
        )


def unstable(lowest_eigenvalue: float) -> tuple[str, ...]:
    """What to say of a state with both pressure and elongation imposed, which no critical pressure judges."""
    if lowest_eigenvalue > 0.0:
        return ()
    return ("this state is in balance but not stable: an actuator brought there would buckle",)


def answer(
    pressure: float | None,
    elongation: float | None,
    model: str,
    parameters: Path | None,
    mesh: Path | None,
    level: Level = "normal",
) -> tuple[FullModel, Solution, str, float]:
    """Return the model, its state, which model answered, and the seconds that it took."""
    import time

    if model == "full":
        full = chosen_model(parameters, mesh, level)
        full.refuse_beyond_limits(pressure, elongation)  # finds the limits, once for all states: not one state's cost
        begun = time.perf_counter()
        return full, full.solve(pressure_kpa=pressure, elongation_mm=elongation), "full", time.perf_counter() - begun
    shadow = chosen_shadow(parameters, level)
    begun = time.perf_counter()
    solution, answered = shadow.solution(elongation_mm=elongation, pressure_kpa=pressure)
    return shadow.model, solution, answered, time.perf_counter() - begun


def draw(solution: Solution, parameters: Path | None, path: Path, level: Level = "normal") -> None:
    """Draw a state into a file."""
    from analysis.shadow.figure import shadow_figure

    shadow = chosen_shadow(parameters, level)
    state = shadow.state(pressure_kpa=solution.pressure_kpa, elongation_mm=solution.elongation_mm)
    save_figure(shadow_figure(state, shadow.topology), path)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure in the format of its suffix."""
    from analysis.errors import FileError

    try:
        figure.savefig(path, dpi=144)
    except (OSError, ValueError) as error:
        raise FileError(
            f"{path} cannot be written: {error}", "choose a .png, .svg or .pdf in a writable folder"
        ) from error
    say(f"wrote {path}")


@app.command()
def table(
    parameters: ParametersOption = None,
    plot: Annotated[Path | None, typer.Option(help="Draw error against the number of shapes into this file.")] = None,
    rebuild: Annotated[bool, typer.Option("--rebuild", help="Build it again even if it is in the cache.")] = False,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Build the reduced model (or take it from the cache) and say its range, its error and its speed.

    Example: boat-daq shadow table --plot errors.png
    """
    import time

    from analysis.fidelity import fidelity as at
    from analysis.shadow.charts import basis_chart, states_per_second
    from analysis.shadow.fidelity import table_settings
    from analysis.shadow.table import build_table, load_table

    chosen, settings = chosen_parameters(parameters, level_of(fidelity)), table_settings(at(fidelity))
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
        "states_per_s": states_per_second(made),
        "seconds": seconds,
    }
    if plot is not None:
        save_figure(basis_chart(chosen), plot)
    if as_json:
        emit_json(result)
        return
    (p0, p1), (q0, q1) = made.pressure_range_kpa, made.elongation_range_mm
    say(f"{p0:.1f} .. {p1:.1f} kPa, {q0:.2f} .. {q1:.2f} mm; {result['modes']} shapes, ready in {seconds:.1f} s")
    say(f"no tracked point off by more than {made.error_bound_mm:.2g} mm; {result['states_per_s']:,.0f} states/s")


@app.command()
def export(
    out: Annotated[Path, typer.Option(help="File to write.")],
    file_format: Annotated[str, typer.Option("--format", help="vtu, msh or inp.")],
    pressure: Annotated[float, typer.Option(help="Pressure of the state, kPa (msh holds the rest alone).")] = 0.0,
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the mesh with its state (vtu), the mesh (msh), or the whole problem for CalculiX (inp).

    Example: boat-daq shadow export --format inp --pressure 50 --out actuator.inp
    """
    from analysis.shadow.mesh_files import write_state

    model = chosen_model(parameters, None)
    write_state(model, model.solve(pressure_kpa=pressure), out, file_format)
    if as_json:
        emit_json(
            {
                "out": out,
                "format": file_format,
                "pressure_kpa": pressure,
                "nodes": len(model.mesh.nodes),
                "elements": len(model.mesh.quads),
            }
        )
    else:
        say(f"wrote {out}: {len(model.mesh.nodes)} nodes, {len(model.mesh.quads)} elements, {pressure:+g} kPa")


@app.command()
def states(
    out: Annotated[Path, typer.Option(help="CSV (or .npz) to write.")],
    lowest: Annotated[float, typer.Option(help="Pressure of the most compressed state, kPa.")] = -40.0,
    highest: Annotated[float, typer.Option(help="Pressure of the most elongated state, kPa.")] = 50.0,
    dense: Annotated[bool, typer.Option("--dense", help="Every 0.5 mm in place of 7 points a guide.")] = False,
    parameters: ParametersOption = None,
    mesh: MeshOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the guides in 15 states (7 compressed, rest, 7 elongated), the optical model's curves.

    Example: boat-daq shadow states --out curves.csv
    """
    from analysis.shadow.states import guide_states, write_states

    found = guide_states(chosen_model(parameters, mesh), lowest_kpa=lowest, highest_kpa=highest, every_half_mm=dense)
    write_states(found, out)
    bow, curvature = found.bow_mm(), found.curvature_per_mm()
    if as_json:
        emit_json(
            {
                "out": out,
                "pressure_kpa": found.pressure_kpa,
                "elongation_mm": found.elongation_mm,
                "bow_mm": bow,
                "curvature_per_mm": curvature,
                "points": found.curves_mm.shape[2],
            }
        )
    else:
        say(
            f"wrote {out}: 15 states, {found.curves_mm.shape[2]} points a guide, elongation "
            f"{found.elongation_mm[0]:+.2f} .. {found.elongation_mm[-1]:+.2f} mm, bow {bow[0]:.2f} .. {bow[-1]:.2f} mm"
        )


@app.command()
def modulus(
    files: Annotated[list[Path], typer.Argument(metavar="FILE.csv...", help="One compression test a specimen.")],
    height_mm: Annotated[float, typer.Option(help="Height of the specimens at rest, mm.")],
    area_mm2: Annotated[float, typer.Option(help="Cross-section of the specimens at rest, mm².")],
    window: Annotated[tuple[float, float], typer.Option(help="Strains between which the slope is taken.")] = (
        0.02,
        0.1,
    ),
    force_column: Annotated[str | None, typer.Option(help="Name or number of the force column.")] = None,
    displacement_column: Annotated[str | None, typer.Option(help="Name or number of the displacement column.")] = None,
    parameters: ParametersOption = None,
    as_json: JsonOption = False,
) -> None:
    """Effective modulus of the lattice from uniaxial compression, and the band it leaves of nominal elongation.

    Example: boat-daq shadow modulus s1.csv s2.csv s3.csv --height-mm 50 --area-mm2 2500
    """
    import math
    from dataclasses import asdict, replace

    import numpy as np

    from analysis.shadow.modulus import effective_modulus, read_compression_test
    from analysis.shadow.table import load_table

    if len({path.resolve() for path in files}) < len(files):
        raise typer.BadParameter("one file is given for two specimens, which leaves no spread", param_hint="FILE.csv")
    tests = [read_compression_test(path, height_mm, area_mm2, force_column, displacement_column) for path in files]
    found = effective_modulus(tests, window)
    spread = found.sd_kpa if math.isfinite(found.sd_kpa) else found.standard_error_kpa
    actuator = replace(chosen_parameters(parameters), lattice_modulus_kpa=found.mean_kpa, lattice_modulus_sd_kpa=spread)
    with progress_bar("building the table") as progress:
        table = load_table(actuator, progress=progress)
    ends = table.pressure_range_kpa
    pressures = np.array([p for p in (-40.0, -20.0, 20.0, 50.0) if ends[0] <= p <= ends[1]])
    nominal, band = table.nominal_elongation(pressures)
    if as_json:
        emit_json(
            asdict(found)
            | {
                "n": len(tests),
                "band": [
                    {"pressure_kpa": p, "nominal_elongation_mm": x, "standard_uncertainty_mm": u}
                    for p, x, u in zip(pressures, nominal, band, strict=True)
                ],
            }
        )
        return
    for one in found.specimens:
        say(f"{one.name}: {one.modulus_kpa:.2f} kPa (R² {one.r2:.4f}, {one.points} points)")
    say(f"E = {found.mean_kpa:.2f} ± {spread:.2f} kPa, N = {len(tests)}")
    for p, x, u in zip(pressures, nominal, band, strict=True):
        say(f"{p:+.0f} kPa: {x:+.3f} ± {u:.3f} mm (k = 1)")


@app.command()
def replay(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A .boat file, or a CSV that `import` understands.")],
    calibration: Annotated[Path | None, typer.Option(help="Run to calibrate from; RUN itself by default.")] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of read elongations of the calibration.")] = None,
    parameters: ParametersOption = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the deviation into this file.")] = None,
    as_json: JsonOption = False,
) -> None:
    """A run against the shadow: deviation, drift over cycles, and the alarms that it would have raised.

    Example: boat-daq shadow replay repeatability.boat --calibration calibration.boat --plot deviation.png
    """
    import math

    from analysis.cycles import find_cycles
    from analysis.recording import load_recording
    from analysis.shadow.replay import replay as compare
    from analysis.shadow.replay import replay_figure
    from analysis.shadow.table import load_table

    recording = load_recording(run)
    elongations = measured_elongations(recording, calibration or run, elongation)
    with progress_bar("building the table") as progress:
        table = load_table(chosen_parameters(parameters), progress=progress)
    result = compare(
        table,
        recording.time_s,
        recording.pressure_kpa,
        elongations,
        [cycle.rows for cycle in find_cycles(recording).complete],
    )
    summary = result.summary() | {"simulated": recording.simulated}
    if plot is not None:
        save_figure(replay_figure(result), plot)
    if as_json:
        emit_json(summary)
        return
    if recording.simulated:
        say("SIMULATED")
    say(
        f"{summary['cycles']} cycles; deviation {summary['deviation_mean_mm']:+.3f} mm on average, "
        f"{summary['deviation_rms_mm']:.3f} mm rms, {summary['inside_band_percent']:.0f} % inside the band (k = 2)"
    )
    for alarm in result.alarms:
        say(f"ALARM in cycle {alarm.cycle}: {alarm.sentence}")
    for cause in result.left_out:
        say(f"left out: {cause}")
    seen = ", ".join(f"{name} {size:.2g}" for name, size in result.sight.items() if math.isfinite(size))
    say(f"smallest shifts that these cycles would show from now on: {seen}" if seen else NO_SIGHT)


def measured_elongations(recording: Recording, calibration: Path, elongation: Path | None) -> Floats:
    """Return each sensor's elongation by the calibration of a run, shape (n, sensors); NaN outside its range."""
    import numpy as np

    from analysis.errors import DataError
    from analysis.inverse import Inverse
    from analysis.pipeline import analyse

    sensors = analyse(calibration, elongation, mcmc=False).sensors
    if len(sensors) != recording.n_sensors:
        raise DataError(
            f"{calibration.name} has {len(sensors)} sensors, the run {recording.n_sensors}",
            "give a calibration of the same unit",
        )
    columns = []
    for number, sensor in enumerate(sensors):
        if sensor.calibration is None:
            raise DataError(
                f"{calibration.name} holds no calibration: {sensor.calibration_void}",
                "give --calibration RUN or --elongation FILE.csv",
            )
        signal = np.where(recording.usable[:, number], recording.signal_mv[:, number], np.nan)
        columns.append(Inverse.of(sensor.calibration)(signal))
    return np.stack(columns, axis=1)


app.command()(chain)
