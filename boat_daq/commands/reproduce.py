"""`boat-daq reproduce`: what of the paper this program computes again, beside the paper's own figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar
from boat_daq.commands.optics import curves_of
from protocol.base.errors import writing

if TYPE_CHECKING:
    from analysis import Analysis

app = typer.Typer(invoke_without_command=True, no_args_is_help=True)
_CYCLES = 100
_SEED, _SPEED = 0, 60.0  # of the virtual board


@app.callback()
def paper(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for numbers, drawings and runs.")] = None,
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

    from analysis.studies.paper.reproduction import (
        TABLE,
        calibration_part,
        optics_part,
        repeatability_part,
        shadow_part,
        write_reproduction,
    )

    begun = perf_counter()
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
    parts = [
        calibration_part(_run(out, "calibration", 5)),
        repeatability_part(_run(out, "repeatability", _CYCLES)),
    ]
    with progress_bar("sweeping the paper's designs") as advance:
        parts.append(optics_part(advance))
    with progress_bar("building the shadow") as advance:
        parts.append(shadow_part(advance))
    with writing(out):
        content = write_reproduction(parts, out)
    seconds = perf_counter() - begun
    notify(f"wrote {out / TABLE} and {len(content['drawings'])} drawings in {seconds:.0f} s")
    rows = [row for part in parts for row in part.rows]
    lines = [f"{row.quantity}: {row.ours:.5g} {row.unit} (paper {row.paper:.5g})" for row in rows]
    present(content | {"seconds": seconds}, "SIMULATED: sensors are those of the virtual board", *lines,
            as_json=as_json)  # fmt: skip


def _run(out: Path, name: str, cycles: int) -> Analysis:
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
        record_on_virtual_board(part, plan, unit="SA1", seed=_SEED, speed=_SPEED)
        part.rename(run)
    with progress_bar(f"analysing {name}") as advance:
        return analyse(run, options=Options(seed=_SEED, mcmc=False), progress=advance)


@app.command()
def optics(
    out: Annotated[
        Path | None, typer.Option(help="Folder for outcomes and their table; a stopped call is resumed from it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank the paper's design under each reading of the paper.

    A reading settles what the paper leaves open: the place of the cavities, the guide's thickness, the states, the
    emission, or the order of the secondary rays. Each is swept over the paper's 648 designs in 15 states.

    Example: boat-daq reproduce optics --out optics
    """
    from analysis.optics.scene.curves import default_curves, parametric_curves
    from analysis.studies.paper.interpretations import readings_json, readings_table, readings_text, reproduce
    from protocol.base.whole_file import write_whole

    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    wider = curves_of("paper")
    curves = {"-40 to +50 kPa": default_curves(), "-50 to +50 kPa": wider, "formula": parametric_curves()}
    with progress_bar("readings") as advance:
        outcomes = reproduce(curves, folder=out, progress=advance)
    if out is not None:
        table = out / "optics.md"
        with writing(table):
            write_whole(table, readings_table(outcomes))
        notify(f"wrote {table}")
    present(readings_json(outcomes), readings_text(outcomes), as_json=as_json)
