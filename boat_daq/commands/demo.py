"""`boat-daq demo`: a whole calibration session on the virtual board, its figures beside the truth it was made from."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say
from boat_daq.commands.fidelity import FidelityOption, level_of

if TYPE_CHECKING:
    from analysis import Analysis
    from analysis.fidelity import Level
    from boat_daq.engine.plan import Plan


def demo(
    headless: Annotated[bool, typer.Option("--headless", help="No window, even where there is a screen.")] = False,
    out_dir: Annotated[Path, typer.Option("--out", help="Folder for recording, tables and report.")] = Path("out/demo"),
    unit: Annotated[str, typer.Option(help="Virtual unit: SA1, SA2, SA3; with -falling behind it.")] = "SA1",
    seed: Annotated[int, typer.Option(min=0, help="Of the board, the reader and the posterior.")] = 0,
    speed: Annotated[float, typer.Option(min=1, max=100, help="Board time over wall time.")] = 50.0,
    cycles: Annotated[int, typer.Option(min=1, help="Cycles of the calibration.")] = 5,
    no_mcmc: Annotated[bool, typer.Option("--no-mcmc", help="Leave the posterior out.")] = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="Leave the report and the shadow out.")] = False,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """A whole calibration session on the virtual board: connect, cycles, readings, calibration, bands, shadow, report.

    With a screen it opens the window on the board; without, it prints the figures beside the board's truth.
    Everything it makes says SIMULATED.

    Example: boat-daq demo --headless --out out/demo
    """
    if not headless and not as_json and has_screen():
        from boat_daq.commands.gui import gui

        gui(port=None, board=True, speed=1.0)
        return
    import dataclasses

    from boat_daq.commands.demo_table import comparison, print_comparison, truth_json, truth_of
    from boat_daq.engine.plan import load_plan

    plan = dataclasses.replace(load_plan("calibration"), cycles=cycles)
    run = free_name(out_dir, f"demo_{unit}_seed{seed}")
    record_on_virtual_board(run, plan, unit=unit, seed=seed, speed=speed)
    analysis = analyse_and_keep(run, seed=seed, mcmc=not no_mcmc, level=level_of(fidelity))
    truth = truth_of(unit, plan)
    rows = comparison(analysis, truth)
    content = analysis.to_json() | {"truth": truth_json(truth), "comparison": rows, "recording": str(run)}
    if not no_report:
        content["shadow"] = beside_the_shadow(analysis, level_of(fidelity))
        content["reports"] = write_reports(analysis, run)
    if as_json:
        emit_json(content)
        return
    print_comparison(rows)
    say(f"recording: {run}")
    if not no_report:
        say(f"shadow: measured tip within {content['shadow']['largest_deviation_mm']:.2f} mm of the nominal model")
        say(f"reports: {', '.join(str(path) for path in content['reports'])}")


def has_screen() -> bool:
    """Whether a window could be opened here."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def free_name(folder: Path, stem: str) -> Path:
    """Return the path of a recording in `folder` whose name is not taken; create the folder.

    Raises
    ------
    OperatorError : a stem that is no file name. StorageError : the folder cannot be created.
    """
    from boat_daq.engine.file_names import check_file_name
    from boat_daq.errors import StorageError

    check_file_name(f"{stem}.boat")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{folder} cannot be made: {error.strerror}", "choose another folder with --out") from None
    names = (folder / (f"{stem}.boat" if n == 1 else f"{stem}_{n}.boat") for n in range(1, 10_000))
    return next(name for name in names if not name.exists())


def record_on_virtual_board(run: Path, plan: Plan, *, unit: str, seed: int, speed: float) -> None:
    """Run the plan on a virtual board over a real port and enter readings from its truth, labelled as simulated."""
    from boat_daq.commands.run_session import SessionRequest, run_session
    from boat_daq.engine.session.readings import enter_simulated_readings
    from boat_daq.engine.simulator.server import BoardSettings, serve
    from boat_daq.errors import DeviceError

    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.csv"
        port = "pty" if hasattr(os, "openpty") else "127.0.0.1:0"
        with serve(BoardSettings(port=port, speed=speed, unit=unit, seed=seed, truth=str(truth))) as board:
            request = SessionRequest(
                port=board.url,
                path=run,
                plan=plan,
                unit=unit.removesuffix("-falling"),
                metadata={"operator": "demo", "unit": unit, "note": f"SIMULATED, seed {seed}, {speed:g}x"},
            )
            _, failure = run_session(request, lambda session: enter_simulated_readings(session, truth, seed=seed))
    if failure:
        raise DeviceError(f"the demo's run ended early: {failure}", "try a lower --speed on a busy computer")


def analyse_and_keep(run: Path, *, seed: int, mcmc: bool, level: Level = "normal") -> Analysis:
    """Compute every figure of the run and keep the result in the recording."""
    from analysis import Options, analyse
    from analysis.figures.stored_results import store_analysis

    with progress_bar("analysing") as advance:
        analysis = analyse(run, options=Options(seed=seed, mcmc=mcmc, fidelity=level), progress=advance)
    store_analysis(run, analysis)
    return analysis


def beside_the_shadow(analysis: Analysis, level: Level = "normal") -> dict[str, float]:
    """Compare the plateaus' elongations with the ideal actuator's at the same pressures."""
    import numpy as np

    from analysis.errors import DataError
    from analysis.fidelity import fidelity
    from analysis.shadow.model.fidelity import shadow_at

    if analysis.elongations is None:
        raise DataError("no elongation was read, so there is nothing to hold against the shadow")
    with progress_bar("building the shadow") as advance:
        shadow = shadow_at(fidelity(level), progress=advance)
    known = analysis.elongations.known
    pressure_kpa = np.array([plateau.pressure_kpa for plateau in analysis.plateaus])[known]
    nominal_mm, _ = shadow.table.nominal_elongation(pressure_kpa)
    deviation_mm = analysis.elongations.elongation_mm[known] - nominal_mm
    return {
        "plateaus": int(known.sum()),
        "mean_deviation_mm": float(deviation_mm.mean()),
        "largest_deviation_mm": float(np.abs(deviation_mm).max()),
    }


def write_reports(analysis: Analysis, run: Path) -> list[Path]:
    """Write the calibration report beside the recording, to print and to look at."""
    from analysis import write_report
    from analysis.figures.against_shadow import against_shadow

    shadow = against_shadow(analysis)
    paths = [run.with_suffix(suffix) for suffix in (".pdf", ".html")]
    with progress_bar("writing the report") as advance:
        for number, path in enumerate(paths):
            write_report([analysis], path, shadow=shadow)
            advance(number + 1, len(paths))
    return paths
