"""`boat-daq analyze`: every figure of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar, say
from boat_daq.commands.fidelity import FidelityOption, level_of

if TYPE_CHECKING:
    from analysis.figures.pipeline import Analysis


def analyze(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A .boat file, or a CSV that `import` understands.")],
    elongation: Annotated[Path | None, typer.Option(help="CSV of read elongations, by plateau.")] = None,
    mapping: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="NAME=COLUMN[:UNIT]", help="Of a CSV, as `import` takes it."),
    ] = None,
    rate: Annotated[float | None, typer.Option(min=0.001, metavar="HZ", help="Of a CSV without time.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the intervals and the posterior.")] = 0,
    no_mcmc: Annotated[bool, typer.Option("--no-mcmc", help="Leave the posterior out.")] = False,
    x_resolution: Annotated[
        float | None, typer.Option(min=0.0, metavar="MM", help="Grid of the readings; 0 = read exactly.")
    ] = None,
    tolerance: Annotated[float, typer.Option(min=0.01, metavar="KPA", help="A plateau has settled within it.")] = 1.0,
    settling: Annotated[float, typer.Option(min=0.0, metavar="S", help="Time left out after arriving.")] = 0.5,
    no_shadow: Annotated[bool, typer.Option("--no-shadow", help="Leave the digital shadow out.")] = False,
    no_store: Annotated[bool, typer.Option("--no-store", help="Do not keep the result in the recording.")] = False,
    fidelity: FidelityOption = "normal",
    json: JsonOption = False,
) -> None:
    """Every figure of a run: calibration, posterior, sensitivity, hysteresis, SNR, repeatability, drift.

    The result is kept in the recording, with the program's version. Example:

        boat-daq analyze run.boat --elongation readings.csv --seed 1 --json
    """
    from analysis import Options, PlateauSettings, analyse, load_recording
    from analysis.figures.stored_results import store_analysis
    from boat_daq.commands.importing import column_map

    options = Options(
        seed=seed, mcmc=not no_mcmc, x_resolution_mm=x_resolution, plateau=PlateauSettings(tolerance, settling),
        fidelity=level_of(fidelity),
    )  # fmt: skip
    with progress_bar("Analysing") as advance:
        source = load_recording(run, columns=column_map(mapping), rate_hz=rate) if mapping or rate else run
        analysis = analyse(source, elongation, options=options, progress=advance)
    if not no_store:
        said = store_analysis(run, analysis, elongation)
        if said:
            say(said)
    shadow = None
    if analysis.kind == "calibration" and not no_shadow:
        from analysis.figures.against_shadow import against_shadow

        with progress_bar("Building the shadow") as advance:
            shadow = against_shadow(analysis, progress=advance).as_json()
    if json:
        emit_json(analysis.to_json() | {"shadow": shadow})
    else:
        _print(analysis)
        _print_shadow(shadow)


def _print_shadow(shadow: Mapping[str, Any] | None) -> None:
    if shadow is None:
        return
    if shadow["void"]:
        say(f"shadow: not compared: {shadow['void']}")
        return
    out.print(
        f"shadow: {shadow['deviation_mean_mm']:+.3f} mm from nominal on average, "
        f"{shadow['deviation_rms_mm']:.3f} mm rms, "
        f"{shadow['inside_band_percent']:.0f} % inside the band, {len(shadow['alarms'])} alarms",
        highlight=False,
    )
    for alarm in shadow["alarms"]:
        say(f"alarm in cycle {alarm['cycle']}: {alarm['sentence']}")


def _print(analysis: Analysis) -> None:
    from rich.table import Table

    from analysis.figures.figure import with_interval

    content = analysis.to_json()
    cycles = content["cycles"]
    title = "SIMULATED  " if content["simulated"] else ""
    out.print(
        f"{title}{analysis.recording.source}: {content['duration_s']:.1f} s at {content['rate_hz']:.1f} Hz, "
        f"{cycles['complete']} complete cycles, {cycles['partial']} partial, {content['lost_samples']} samples lost",
        highlight=False,
    )
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("figure [95 % interval]", no_wrap=True)
    for sensor in analysis.sensors:
        table.add_column(sensor.name, justify="right", no_wrap=True)
    for name, first in analysis.sensors[0].figures.items():  # the unit stands in the name
        table.add_row(
            name, *(with_interval(sensor.figures[name]).removesuffix(f" {first.unit}") for sensor in analysis.sensors)
        )
    out.print(table)
    for sensor in analysis.sensors:
        if sensor.calibration is not None:
            terms = ", ".join(f"b{i} = {b:.6g}" for i, b in enumerate(sensor.calibration.coefficients))
            out.print(f"{sensor.name}: {terms}, R2 = {sensor.calibration.r2:.5f}", highlight=False)
    for warning in analysis.warnings:
        say(f"{warning.code}: {warning.sentence}")
