"""`boat-daq reproduce`: what of the paper this program computes again, beside the paper's own figures."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar, writing
from boat_daq.commands.optics import curves_of

if TYPE_CHECKING:
    from analysis import Analysis
    from analysis.studies.paper.numbers import Reproduction

app = typer.Typer(invoke_without_command=True, no_args_is_help=True)
CYCLES = 100


@app.callback()
def paper(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for numbers, drawings and runs.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the virtual board.")] = 0,
    speed: Annotated[float, typer.Option(min=1, max=200, help="Virtual board's time over real time.")] = 60.0,
    as_json: JsonOption = False,
) -> None:
    """Compute the paper's figures and numbers again, beside the paper's own: one to three minutes on two cores.

    Calibration, sensitivities and SNR, hysteresis over 100 cycles, the optimal pattern, frames a second and states.
    Runs that are in DIR already are not recorded again, so that a call that was stopped (Ctrl-C) continues.

    Example: boat-daq reproduce --out out/paper
    """
    if context.invoked_subcommand is not None:
        return
    if out is None:
        raise typer.BadParameter("is missing", param_hint="--out")
    from time import perf_counter

    from protocol.base.whole_file import write_whole

    begun = perf_counter()
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    found = _reproduced(out, seed=seed, speed=speed)
    table = out / "reproduction.md"
    with writing(table):
        write_whole(table, found.table())
    seconds = perf_counter() - begun
    notify(f"wrote {table} and {len(found.drawings)} drawings in {seconds:.0f} s")
    lines = [f"{row.quantity}: {row.ours:.5g} {row.unit} (paper {row.paper:.5g})" for row in found.rows]
    present(found.as_json() | {"seconds": seconds}, "SIMULATED: sensors are those of the virtual board", *lines,
            as_json=as_json)  # fmt: skip


def _reproduced(out: Path, *, seed: int, speed: float) -> Reproduction:
    """Return every row, and write the drawings."""
    from analysis.studies.paper import numbers as reproduction

    found = reproduction.Reproduction()
    calibration = _run(out, "calibration", 5, seed=seed, speed=speed)
    found.rows += reproduction.calibration_rows(calibration)
    _draw(found, out, "4A", "signals of the five cycles", "signals", partial(reproduction.draw_signals, calibration))
    _draw(
        found, out, "4B", "calibration functions", "calibration_curves",
        partial(reproduction.draw_calibration, calibration),
    )  # fmt: skip
    cycles = _run(out, "repeatability", CYCLES, seed=seed, speed=speed)
    found.rows += reproduction.hysteresis_rows(cycles)
    _draw(found, out, "4C", "signals of 100 cycles", "cycles", partial(reproduction.draw_signals, cycles))
    _draw(found, out, "", "mean loops of the 100 cycles", "hysteresis_loops", partial(reproduction.draw_loops, cycles))
    _optics(found, out)
    _shadow(found, out)
    return found


def _run(out: Path, name: str, cycles: int, *, seed: int, speed: float) -> Analysis:
    """Return the analysis of a run of a plan that comes with the program, recorded where there is none yet."""
    import dataclasses

    from analysis import Options, analyse
    from boat_daq.commands.demo import record_on_virtual_board
    from boat_daq.engine.plan import load_plan

    run = out / f"{name}.boat"
    if not run.exists():  # recorded under another name, so that a stopped one is not taken for whole
        part = out / f"{name}.part.boat"
        for old in out.glob(f"{name}.part.boat*"):
            old.unlink()
        plan = dataclasses.replace(load_plan(name), cycles=cycles)
        record_on_virtual_board(part, plan, unit="SA1", seed=seed, speed=speed)
        part.rename(run)
    with progress_bar(f"analysing {name}") as advance:
        return analyse(run, options=Options(seed=seed, mcmc=False), progress=advance)


def _draw(found: Reproduction, out: Path, figure: str, shows: str, name: str, draw: Callable[[Path], None]) -> None:
    """Draw a file of the folder, and add it to what was found."""
    from analysis.studies.paper.numbers import PaperDrawing

    path = out / f"{name}.png"
    with writing(path):
        draw(path)
    found.drawings.append(PaperDrawing(figure, shows, path))


def _optics(found: Reproduction, out: Path) -> None:
    """Add the paper's sweep: rays in both end states, response, the best pattern and the map."""
    from analysis.optics.scene.curves import default_curves, frames_of
    from analysis.optics.scene.parameters import PAPER_OPTIMUM, Light, Waveguide
    from analysis.optics.sweep import report
    from analysis.optics.sweep.sweep import SweepRequest, run_sweep
    from analysis.studies.paper.numbers import optics_rows

    def saved(figure: Any) -> Callable[[Path], None]:
        return lambda path: report.save(figure, path)

    with progress_bar("sweeping the paper's designs") as advance:
        run_sweep(SweepRequest((PAPER_OPTIMUM,)))  # compiles the tracer, so that the time of the sweep is its own
        sweep = run_sweep(SweepRequest(), progress=advance)
    found.rows += optics_rows(sweep)
    frames = frames_of(default_curves(), Waveguide())
    for state, word in ((0, "compressed"), (-1, "elongated")):
        figure = report.draw_scene(frames[state], PAPER_OPTIMUM, Waveguide(), Light(), f"most {word}")
        _draw(found, out, "3A", f"rays in the paper's pattern, most {word}", f"rays_{word}", saved(figure))
    best = max(zip(sweep.merit().p.tolist(), sweep.designs, strict=True), key=lambda one: one[0])[1]
    for panel, shows, name, chosen in (
        ("3B", "detected rays over the states: the paper's pattern and the best one here", "response",
         [PAPER_OPTIMUM, *([best] if best != PAPER_OPTIMUM else [])]),
        ("3C", "detected rays of patterns as the paper's, by spacing", "response_by_spacing",
         [d for d in sweep.designs if d.values[:3] == PAPER_OPTIMUM.values[:3]]),
    ):  # fmt: skip
        _draw(found, out, panel, shows, name, saved(report.draw_response(sweep, chosen)))
    _draw(found, out, "3D", "P of five cavities over depth and spacing", "map", saved(report.draw_maps(sweep, 5)))


def _shadow(found: Reproduction, out: Path) -> None:
    """Add the states of the shadow, and whole frames and tracked points of it a second."""
    from time import perf_counter

    import numpy as np

    from analysis.optics.sweep.report import save
    from analysis.shadow.model.drawing import shadow_figure
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.states import kept_states
    from analysis.studies.paper import numbers as reproduction

    with progress_bar("building the shadow") as advance:
        shadow = Shadow(progress=advance)
    shadow.state(elongation_mm=0.5)
    begun, frames = perf_counter(), 200
    for mm in np.linspace(-2.5, 3.5, frames):
        shadow.state(elongation_mm=float(mm))
    frames_per_s = frames / (perf_counter() - begun)
    states, critical_kpa = kept_states(), float(shadow.table.critical_kpa)
    found.rows += reproduction.shadow_rows(states, critical_kpa, frames_per_s, shadow.table.states_per_second())
    shows = "shapes of the guides in the fifteen states"
    _draw(found, out, "2B, 2C", shows, "states", partial(reproduction.draw_states, states.curves_mm))
    for kpa, word in ((50.0, "elongated"), (0.0, "rest"), (-40.0, "compressed")):
        figure = shadow_figure(shadow.state(pressure_kpa=kpa), shadow.topology)
        _draw(found, out, "2A, 5", f"the actuator at {kpa:+g} kPa", f"actuator_{word}", partial(save, figure))


@app.command()
def optics(
    fans: Annotated[int, typer.Option(min=1, help="Turns of the fan with the paper's 250 rays.")] = 3,
    rays: Annotated[int, typer.Option(min=251, help="Rays of the converged sweeps.")] = 1_000,
    every: Annotated[
        bool, typer.Option("--all", help="Turns and converged sweeps of every reading; default those with one change.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for outcomes and their table; a stopped call is resumed from it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank the paper's optical design under every credible reading of what the paper leaves open.

    Readings are the place of the cavities, the guide's thickness, the states and the emission: 48 combinations, each
    swept over the paper's 648 designs in 15 states.

    Example: boat-daq reproduce optics --out optics
    """
    from analysis.optics.scene.curves import default_curves, parametric_curves
    from analysis.studies.paper.readings import readings_json, readings_table, readings_text, reproduce
    from protocol.base.whole_file import write_whole

    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    wider = curves_of(Path("paper"))
    curves = {"-40 to +50 kPa": default_curves(), "-50 to +50 kPa": wider, "formula": parametric_curves()}
    with progress_bar("readings") as advance:
        outcomes = reproduce(curves, fans=fans, rays=rays, alike=every, folder=out, progress=advance)
    if out is not None:
        table = out / "optics.md"
        with writing(table):
            write_whole(table, readings_table(outcomes))
        notify(f"wrote {table}")
    present(readings_json(outcomes), readings_text(outcomes), as_json=as_json)
