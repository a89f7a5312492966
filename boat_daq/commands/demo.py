"""`boat-daq gui`, the window, and `demo`: a calibration session on the virtual board beside its true values."""

from __future__ import annotations

import dataclasses
import math
import os
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, show_table
from boat_daq.commands.options import FidelityOption, NoMcmcOption, UncertaintyOption
from boat_daq.engine.file_names import path_in
from protocol.base.errors import RequestError, writing

if TYPE_CHECKING:
    from analysis import Analysis
    from analysis.figures.figure import Figure
    from boat_daq.engine.plan import Plan
    from protocol.simulator.truth import Hold, Truth


def gui(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="Recording, CSV, plan or profile to open.")
    ] = None,
    port: Annotated[str | None, typer.Option(help="Port to connect to at once.")] = None,
    board: Annotated[bool, typer.Option("--board", help="Connect to a virtual board.")] = False,
    profile: Annotated[Path | None, typer.Option(help="Text profile (TOML) of the firmware on the port.")] = None,
) -> None:
    """Open the window. F4 vents, in every state.

    Example: boat-daq gui --board
    """
    _open_window(port, board=board, profile=profile, file=file)


def _open_window(
    port: str | None = None,
    *,
    board: bool = False,
    profile: Path | None = None,
    file: Path | None = None,
    first_steps: bool = False,
) -> NoReturn:
    if port is not None and board:
        raise typer.BadParameter("use either --port or --board")
    if profile is not None and port is None:
        raise typer.BadParameter("--profile needs --port")
    from boat_daq.engine.log import start_log
    from boat_daq.engine.screen import missing_library, require_screen

    require_screen()
    start_log("gui")
    try:
        from boat_daq.gui.app import run
    except ModuleNotFoundError:
        raise
    except ImportError as error:  # a library of the system
        remedy = "Install boat-daq again in a new environment."
        raise (missing_library(error) or RequestError(f"Qt cannot be loaded: {error}", remedy)) from error
    raise typer.Exit(run(port, board=board, profile=str(profile or ""), file=file, first_steps=first_steps))


def demo(
    headless: Annotated[bool, typer.Option("--headless", help="No window, even with a screen.")] = False,
    out_dir: Annotated[Path, typer.Option("--out", help="Folder for recording and reports.")] = Path("out/demo"),
    unit: Annotated[str, typer.Option(help="Virtual unit: SA1, SA2, SA3; endings -falling, x1 to x4.")] = "SA1",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the board, the readings and the posterior.")] = 0,
    speed: Annotated[float, typer.Option(min=1, max=100, help="Board time over real time.")] = 50.0,
    cycles: Annotated[int, typer.Option(min=1, help="Cycles of the calibration.")] = 5,
    uncertainty: UncertaintyOption = None,
    no_mcmc: NoMcmcOption = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="Omit the reports and the digital shadow.")] = False,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Run a calibration session on the virtual board: connect, cycles, readings, calibration, bands, shadow, report.

    With a screen it opens the window at its first steps and uses no other option; without, it prints the figures and
    their true values. All data are marked SIMULATED.

    Example: boat-daq demo --headless --out out/demo
    """
    from analysis.stopping.requirement import check_asked

    if uncertainty is not None:
        check_asked(uncertainty, "mm")
    if not headless and not as_json:
        from boat_daq.engine.screen import screen_error

        if (refused := screen_error()) is None:
            _open_window(first_steps=True)
        notify(f"note: {refused.cause}; the session runs without a window")
    import dataclasses

    from analysis import Options, analyse
    from analysis.figures.stored_results import store_analysis
    from boat_daq.engine.plan import load_plan

    plan = dataclasses.replace(load_plan("calibration"), cycles=cycles)
    run = free_name(out_dir, f"demo_{unit}_seed{seed}")
    record_on_virtual_board(run, plan, unit=unit, seed=seed, speed=speed, uncertainty_mm=uncertainty)
    options = Options(seed=seed, mcmc=not no_mcmc, fidelity=fidelity)
    with progress_bar("analysing") as advance:
        analysis = analyse(run, options=options, progress=advance)
    store_analysis(run, analysis)
    truth = truth_of(unit, plan, analysis)
    rows = comparison(analysis, truth)
    content = analysis.to_json() | {"truth": truth_json(truth), "comparison": rows, "recording": str(run)}
    if not no_report:
        from analysis.figures.against_shadow import readings_against_shadow

        with progress_bar("building the shadow") as advance:
            content["shadow"] = readings_against_shadow(analysis, progress=advance)
        content["reports"] = write_reports(analysis, run)
    if as_json:
        emit_json(content)
        return
    show_comparison(rows)
    notify(f"recording: {run}")
    if not no_report:
        notify(f"shadow: readings within {content['shadow']['largest_deviation_mm']:.2f} mm of the nominal model")
        notify(f"reports: {', '.join(str(path) for path in content['reports'])}")


def free_name(folder: Path, stem: str) -> Path:
    """Return a free name of a recording in `folder`, which is made; RequestError for a name that leaves it."""
    path_in(folder, f"{stem}.boat")
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    names = (folder / (f"{stem}.boat" if n == 1 else f"{stem}_{n}.boat") for n in range(1, 10_000))
    return next(name for name in names if not name.exists())


def record_on_virtual_board(
    run: Path, plan: Plan, *, unit: str, seed: int, speed: float, uncertainty_mm: float | None = None
) -> None:
    """Run a plan on a virtual board over a real port, and enter readings from its true values, marked as simulated.

    DeviceError: the run ended early.
    """
    from boat_daq.engine.session.reading_sources import enter_simulated_readings
    from boat_daq.engine.simulator.server import BoardSettings, serve
    from boat_daq.workflows.run_session import SessionRequest, run_session
    from protocol.base.errors import DeviceError

    with tempfile.TemporaryDirectory() as folder:
        truth = Path(folder) / "truth.csv"
        port = "pty" if hasattr(os, "openpty") else "127.0.0.1:0"
        with serve(BoardSettings(port=port, speed=speed, unit=unit, seed=seed, truth=str(truth))) as board:
            metadata = {"operator": "demo", "unit": unit, "note": f"SIMULATED, seed {seed}, {speed:g}x"}
            known = unit.removesuffix("-falling")
            request = SessionRequest(
                port=board.url, path=run, plan=plan, unit=known, metadata=metadata, uncertainty=uncertainty_mm
            )
            ended = run_session(
                request,
                lambda session: enter_simulated_readings(session, truth, seed=seed),
                notify=notify,
                progress_bar=progress_bar,
            )
    if ended.failure:
        raise DeviceError(f"the demo's run ended early: {ended.failure}", "try a lower --speed on a busy computer")


def write_reports(analysis: Analysis, run: Path) -> list[Path]:
    """Write the calibration report beside the recording, as PDF and HTML; return the files."""
    from analysis import write_report
    from analysis.figures.against_shadow import against_shadow

    shadow = against_shadow(analysis)
    paths = [run.with_suffix(suffix) for suffix in (".pdf", ".html")]
    with progress_bar("writing the report") as advance:
        for number, path in enumerate(paths):
            write_report([analysis], path, shadow=shadow)
            advance(number + 1, len(paths))
    return paths


TERM_UNITS = ("mV", "mV/mm", "mV/mm²", "mV/mm³")
_LABELS = {  # of the figures that `SensorTruth` has too
    "sensitivity_mv_per_mm": "sensitivity",
    "fso_mv": "full-scale output",
    "sensor_hysteresis_percent_fso": "sensor hysteresis",
    "system_hysteresis_percent_fso": "system hysteresis",
    "snr_db": "SNR",
    "noise_mv": "noise, rms",
}


def truth_of(unit: str, plan: Plan, analysis: Analysis | None = None) -> Truth:
    """Return the true figures of a virtual unit, over a whole run as it was held, else over one cycle of its plan."""
    from protocol.simulator.truth import truth_figures, truth_of_holds

    if analysis is not None and (holds := _holds(plan, analysis)):
        return truth_of_holds(unit, holds, ramp_kpa_per_s=plan.ramp_kpa_per_s)
    cycle_kpa = (plan.high_kpa, *plan.targets_kpa)
    dwell_s = plan.step_duration_s(0.0, 0.0)
    return truth_figures(unit, cycle_kpa=cycle_kpa, ramp_kpa_per_s=plan.ramp_kpa_per_s, dwell_s=dwell_s)


def _holds(plan: Plan, analysis: Analysis) -> list[Hold]:
    """Return how long each level of a run was held, as its measured pressure shows; empty without its marks.

    A command reaches the board later than the mark of its step, at 50 times real time by a second of board time: ramps
    are placed by where the pressure passes their middle.
    """
    from protocol.simulator.truth import Hold, ramp_ends

    cycle = (plan.high_kpa, *plan.targets_kpa)
    low, ends = cycle.index(plan.low_kpa), (plan.high_kpa, plan.low_kpa)
    steps = analysis.recording.steps[analysis.recording.steps["branch"] != "end"]  # its vent is no ramp
    target_of = dict(zip(steps["id"], steps["target_kpa"], strict=True))
    time_s, used = analysis.recording.time_s, set(analysis.loops.numbers)
    held = [(p, target) for p in analysis.plateaus if (target := target_of.get(p.step)) in cycle]
    targets = (0.0, *(target for _, target in held))
    rows = (0, *(plateau.last for plateau, _ in held))
    ramps = [
        ramp_ends(time_s[start:], analysis.recording.pressure_kpa[start:], ramp, plan.ramp_kpa_per_s)
        for start, ramp in zip(rows, pairwise(targets), strict=False)
    ]
    leaving = (*(began for began, _ in ramps[1:]), math.inf)
    holds = []
    for (plateau, target), (_, arrived), left in zip(held, ramps, leaving, strict=True):
        settled_s, last_s = (float(time_s[row]) - arrived for row in (plateau.settled_first, plateau.last))
        rising = plateau.branch == "loading" and target not in ends
        place = cycle.index(target, low) if rising else cycle.index(target)
        analysed = plateau.branch and plateau.cycle in used and not plateau.void
        holds.append(Hold(target, min(left - arrived, last_s), settled_s, last_s, place if analysed else None))
    return holds


def truth_json(truth: Truth) -> dict[str, Any]:
    """Return the true figures under the keys of `analyze --json`."""
    content = dataclasses.asdict(truth)
    for sensor in content["sensors"]:
        mean = sensor.pop("sensor_hysteresis_percent_fso")
        sensor["hysteresis_percent_fso"] = {"abscissa": "elongation_mm", "mean": mean}
        sensor["calibration"] = {"coefficients": sensor.pop("coefficients")}
    return content


def comparison(analysis: Analysis, truth: Truth) -> list[dict[str, Any]]:
    """Return figure, unit, measured value, interval and true value, a row each."""
    rows: list[tuple[str, str, float, tuple[float, float] | None, float | None]] = []

    def add_figure(name: str, figure: Figure, true: float) -> None:
        rows.append((name, figure.unit, figure.value, (figure.low, figure.high), true))

    for number, (sensor, true) in enumerate(zip(analysis.sensors, truth.sensors, strict=True), 1):
        if (fit := sensor.calibration) is not None:
            terms = zip(TERM_UNITS, fit.coefficients, fit.std_errors_with_reading, true.coefficients, strict=True)
            for k, (unit, b, error, b_true) in enumerate(terms):
                rows.append((f"s{number} b{k}", unit, float(b), (float(b - 2 * error), float(b + 2 * error)), b_true))
            rows.append((f"s{number} R²", "", fit.r2, None, None))
        for key, label in _LABELS.items():
            add_figure(f"s{number} {label}", sensor.figures[key], getattr(true, key))
    add_figure("system sensitivity", analysis.system_sensitivity, truth.system_sensitivity_mv_per_mm)
    add_figure("actuator hysteresis", analysis.actuator_hysteresis, truth.actuator_hysteresis_percent)
    return [dict(zip(("figure", "unit", "measured", "interval", "truth"), row, strict=True)) for row in rows]


def show_comparison(rows: list[dict[str, Any]]) -> None:
    """Print the figures and their true values, with as many digits as their interval warrants."""
    columns = ("figure", "unit", "measured", "95 % interval", "truth", "deviation")
    cells = ((row["figure"], row["unit"], *_cells(row)) for row in rows)
    show_table(columns, cells, left=2, title="SIMULATED: measured on the virtual board, and its true values")


def _cells(row: dict[str, Any]) -> tuple[str, str, str, str]:
    """Return measured value, interval, true value and deviation of a row as text."""
    low, high = row["interval"] or (math.nan, math.nan)
    width = high - low
    digits = 5 if not width > 0 else max(0, min(6, 1 - math.floor(math.log10(width / 4))))
    measured, true = row["measured"], row["truth"]
    interval = f"{low:.{digits}f} .. {high:.{digits}f}" if width > 0 else ""
    if true is None:
        return f"{measured:.{digits}f}", interval, "", ""
    return f"{measured:.{digits}f}", interval, f"{true:.{digits}f}", f"{measured - true:+.{digits}f}"
