"""`boat-daq analyze`, `strokes` and `report`: the figures of a run, and its report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, complete_cycles, emit_json, notify, progress_bar, show, show_table
from boat_daq.commands.options import (
    DegreeOption,
    FidelityOption,
    LeaveOutOption,
    LimitOption,
    MapOption,
    NoMcmcOption,
    NoShadowOption,
    ReadingsOption,
    RunArgument,
    SeedOption,
    TypeBOption,
    XResolutionOption,
    limits_of,
)

if TYPE_CHECKING:
    from analysis.data.recording import Recording
    from analysis.figures.pipeline import Analysis
    from analysis.reports.document import Report


VideoOption = Annotated[
    str | None,
    typer.Option(
        metavar="VIDEO|FILE.toml",
        help="Video of the marks during this run, or a file with source (the video), mark_mm, u_mark_mm and lens.",
    ),
]
SettledWithinOption = Annotated[
    float, typer.Option(min=0.01, metavar="KPA", help="A plateau is settled within this pressure deviation.")
]


def analyze(
    run: RunArgument,
    elongation: ReadingsOption = None,
    video: VideoOption = None,
    mapping: MapOption = None,
    seed: SeedOption = 0,
    no_mcmc: NoMcmcOption = False,
    degree: DegreeOption = "3",
    x_resolution: XResolutionOption = None,
    settled_within: SettledWithinOption = 1.0,
    settling: Annotated[float, typer.Option(min=0.0, metavar="S", help="Start of each hold that is left out.")] = 0.5,
    limit: LimitOption = None,
    type_b: TypeBOption = None,
    leave_out: LeaveOutOption = False,
    no_shadow: NoShadowOption = False,
    no_store: Annotated[bool, typer.Option("--no-store", help="Do not store the result in the recording.")] = False,
    fidelity: FidelityOption = "normal",
    as_json: JsonOption = False,
) -> None:
    """Compute every figure of a run: calibration, posterior, sensitivity, hysteresis, SNR, repeatability, drift.

    The result is stored in the recording, with the program's version.

    Example: boat-daq analyze run.boat --elongation readings.csv --seed 1 --json
    """
    from analysis import Options, PlateauSettings, analyse, load_recording
    from analysis.calibration.curve_choice import degree_of
    from analysis.calibration_export.verdict import verdict_of
    from analysis.figures.acceptance import conformity_json
    from analysis.segmentation.plateaus import shorter_settling_s
    from boat_daq.commands.importing import column_map
    from boat_daq.workflows.calibration_in_force import stated_contributions

    limits = limits_of(limit)
    recording = load_recording(run, columns=column_map(mapping) or None)
    if video is not None:
        recording, stored = _filmed(recording, run, video, store=not no_store)
        no_store |= not stored
    with progress_bar("Analysing") as advance:
        options = Options(
            degree_of(degree), seed=seed, mcmc=not no_mcmc, x_resolution_mm=x_resolution,
            plateau=PlateauSettings(settled_within, settling), fidelity=fidelity, leave_out=leave_out,
            type_b=stated_contributions(recording, type_b),
        )  # fmt: skip
        analysis = analyse(recording, elongation, options=options, progress=advance)
    conformity = conformity_json(analysis, limits)
    if not no_store:
        _store(run, analysis, elongation)
    verdict = verdict_of(analysis, limits)
    shadow = None if no_shadow else _shadow(analysis)
    if settling_s := shorter_settling_s(analysis.plateaus, options.plateau):
        notify(f"the holds are short; to use them: --settling {settling_s:g}")
    if as_json:
        budgets = None if analysis.budgets is None else analysis.budgets.as_json()
        added = {"shadow": shadow, "conformity": conformity, "elongation_budget": budgets, "verdict": verdict.as_json()}
        emit_json(analysis.to_json() | added)
        return
    _show(analysis, limits, verdict.sentence)
    if shadow is not None:
        _show_shadow(shadow)


def _store(run: Path, analysis: Analysis, elongation: Path | None) -> None:
    """Store a result in its recording, or print why it is not stored."""
    from analysis.figures.stored_results import store_analysis

    if reason := store_analysis(run, analysis, elongation):
        notify(reason)


def _shadow(analysis: Analysis) -> dict[str, Any] | None:
    """Return a calibration run compared with the digital shadow; None for other runs."""
    if analysis.kind != "calibration":
        return None
    from analysis.figures.against_shadow import against_shadow

    with progress_bar("Building the shadow") as advance:
        return against_shadow(analysis, progress=advance).as_json()


def _filmed(recording: Recording, run: Path, video: str, *, store: bool) -> tuple[Recording, bool]:
    """Return a recording with the elongations of a video of its run, and whether they are stored in it."""
    from analysis import load_recording
    from analysis.data.boat_file import is_boat_file, store_video
    from boat_daq.workflows.camera_tracking import camera_choice, film
    from protocol.base.errors import BoatDaqError

    choice = camera_choice(video, recording.unit)
    with progress_bar("Tracking") as advance:
        seen = film(recording, choice, advance)
    assert seen.camera is not None
    if not store or not is_boat_file(run):
        notify("the result is not stored, nor are the readings of the video")
        return seen, False
    try:
        before = store_video(run, seen.camera, seen.meta["camera"])
    except BoatDaqError as error:
        notify(f"the readings of the video are not stored: {error.cause}. {error.remedy}")
        return seen, False
    if before or recording.camera is not None:
        replaced = f"the video {before}, whose readings they replace" if before else "the camera, which stay stored"
        notify(f"from now on the readings of {choice.source} count before those of {replaced}")
    return load_recording(run), True


def _show_shadow(shadow: Mapping[str, Any]) -> None:
    if shadow["void"]:
        notify(f"shadow: not compared: {shadow['void']}")
        return
    show(
        f"shadow: {shadow['deviation_mean_mm']:+z.3f} mm from nominal on average, "
        f"{shadow['deviation_rms_mm']:.3f} mm rms, {len(shadow['alarms'])} alarms"
    )
    for alarm in shadow["alarms"]:
        notify(f"alarm in cycle {alarm['cycle']}: {alarm['sentence']}")


def _show(analysis: Analysis, limits: Mapping[str, float], verdict: str) -> None:
    from analysis.figures.acceptance import judge
    from analysis.figures.figure import void_sentences, with_interval
    from protocol.base.units import as_text, in_a_name

    content, sensors = analysis.to_json(), analysis.sensors
    cycles, ending = content["cycles"], f"_{in_a_name(content['signal_unit'])}"
    show(verdict)
    show(
        f"{'SIMULATED  ' if content['simulated'] else ''}{analysis.recording.source}: "
        f"{content['duration_s']:.1f} s at {content['rate_hz']:.1f} Hz, "
        f"{complete_cycles(cycles['complete'])}, {cycles['partial']} partial, {content['lost_samples']} samples lost"
    )
    show_table(
        ["figure [95 % interval]", *(sensor.name for sensor in sensors)],
        (
            [
                name.replace("_mv", ending),
                *(with_interval(sensor.figures[name]).removesuffix(f" {first.unit}") for sensor in sensors),
            ]
            for name, first in sensors[0].figures.items()  # their names end in the unit
        ),
    )
    for sentence in void_sentences([*((s.name, s.figures) for s in sensors), ("system", analysis.system_figures)]):
        show(sentence)
    _show_sensors(analysis)
    if analysis.camera is not None:
        _show_camera(analysis.camera.as_json(), as_text(content["signal_unit"]))
    for one in judge(sensors, limits):
        show(f"{one.conformity.label}: {one.text}")
    for warning in analysis.warnings:
        notify(f"{warning.code}: {warning.sentence}")


def _show_sensors(analysis: Analysis) -> None:
    """Print the curves, their budgets, and what else acts on the signals."""
    from analysis.figures.warnings import influence_text
    from analysis.numbers import with_uncertainty

    sensors = analysis.sensors
    for sensor in sensors:
        if sensor.calibration is not None:
            pairs = enumerate(
                zip(sensor.calibration.coefficients, sensor.calibration.std_errors_with_reading, strict=True)
            )
            terms = ", ".join(f"b{i} = {with_uncertainty(float(b), float(u))}" for i, (b, u) in pairs) or "spline"
            show(f"{sensor.name}: {terms}, R2 = {sensor.calibration.r2:.5f}")
            show(f"{sensor.name}: curve {sensor.figures['lack_of_fit_percent_fso'].note or 'not tested'}")
    for sensor, budget in zip(sensors, analysis.budgets.budgets if analysis.budgets else (), strict=False):
        assert analysis.budgets is not None
        at = f"at {analysis.budgets.x_mm:+z.2f} mm"
        mark = ", with a stated value" if budget.stand_in else ""
        known = f"U = {1000 * budget.expanded:.0f} µm (k = 2{mark}) {at}"
        expanded = f"U is not known: {budget.void}" if budget.void else known
        show(f"{sensor.name}: {expanded}")
    budgets = analysis.budgets.budgets if analysis.budgets else ()
    for text in dict.fromkeys(one.traceability.text for one in budgets if one.traceability is not None):
        show(f"An elongation is {text}")
    for sensor in sensors:
        for found in sensor.influences:
            show(f"{sensor.name}: {f'{found.name}: {found.void}' if found.void else influence_text(found)}")


def _show_camera(camera: Mapping[str, Any], unit: str) -> None:
    delay = "not found" if camera["delay_s"] is None else f"{1e3 * camera['delay_s']:+z.1f} ms"
    u_delay = "" if camera["delay_s"] is None else f" ± {1e3 * camera['u_delay_s']:.1f} ms"
    drift = "" if camera["delay_s"] is None else f", drift {camera['drift_ppm']:+z.0f} ppm"
    frames = f"{camera['valid']} of {camera['frames']} frames, {camera['dropped']} missing"
    show(f"camera: {frames}, u {camera['u_mm']:.4f} mm")
    show(f"camera: delay {delay}{u_delay}{drift}; scale u {camera['u_scale_percent']:.2f} %")
    for number, sensor in enumerate(camera["sensors"], 1):
        if sensor["calibration"] is None:
            show(f"s{number} on the continuous record: {sensor['calibration_void']}")
            continue
        loop = sensor["hysteresis_percent_fso"]
        show(
            f"s{number} on the continuous record: {sensor['sensitivity_mv_per_mm']:.4g} {unit}/mm, "
            f"R2 = {sensor['r2']:.5f}, "
            f"hysteresis {loop['mean']:.2f} % FSO, "
            f"dynamic error {sensor['dynamic_mv_per_mm_per_s']:+.2g} {unit} per mm/s, "
            f"{sensor['from_plateaus_percent_fso']:.2f} % FSO from the plateaus' curve"
        )


def strokes(
    run: RunArgument,
    mapping: MapOption = None,
    min_speed: Annotated[
        float, typer.Option(min=0.0, metavar="KPA_PER_S", help="Slower samples are omitted from the half width.")
    ] = 0.0,
    as_json: JsonOption = False,
) -> None:
    """Measure the strokes of a continuous run: span and period, and each sensor's friction, half width and loop area.

    The half width is that of the loop of signal over pressure; the friction is the same along the pressure,
    in kPa. Mean and standard deviation are over the cycles; no calibration is needed.

    Example: boat-daq strokes repeatability.boat --json
    """
    from analysis import load_recording
    from analysis.segmentation.strokes import stroke_figures
    from boat_daq.commands.importing import column_map
    from protocol.base.units import in_a_name

    recording = load_recording(run, columns=column_map(mapping) or None)
    figures = stroke_figures(recording, min_speed_kpa_per_s=min_speed)
    if as_json:
        emit_json({"simulated": recording.simulated, "signal_unit": recording.signal_unit, **figures})
        return
    show(
        f"{'SIMULATED  ' if recording.simulated else ''}{recording.source}: {figures['cycles']} cycles, "
        f"{figures['strokes_up']} strokes up, {figures['strokes_down']} down"
    )
    sensors = figures.pop("sensors")
    pressures = ((name, _text(value)) for name, value in figures.items() if name.endswith(("_kpa", "_s")))
    show_table(("pressure", ""), pressures)
    ending = f"_{in_a_name(recording.signal_unit)}"
    rows = (
        [name.replace("_mv", ending), *(_text(sensor[name]) for sensor in sensors)]
        for name in sensors[0]
        if name != "name"
    )
    show_table(("loop", *(sensor["name"] for sensor in sensors)), rows)


def _text(value: Any) -> str:
    """Return a value, or a mean with its standard deviation, which a single cycle does not have."""
    if not isinstance(value, dict):
        return f"{value:.4g}"
    spread = f" ± {value['sd']:.2g}" if math.isfinite(value["sd"]) else ""
    return f"{value['mean']:.4g}{spread}"


def report(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="One run, or several to compare.")],
    to: Annotated[Path, typer.Option("--out", metavar="FILE.html|FILE.pdf", help="File to write.")],
    elongation: Annotated[
        list[Path] | None, typer.Option(help="CSV of elongation readings; repeat it for each run, in order.")
    ] = None,
    degree: DegreeOption = "3",
    limit: LimitOption = None,
    leave_out: LeaveOutOption = False,
    seed: SeedOption = 0,
    no_mcmc: NoMcmcOption = False,
    no_shadow: NoShadowOption = False,
    fidelity: FidelityOption = "normal",
    units: Annotated[
        str, typer.Option(metavar="UNIT,...", help="Units of the report, such as bar,V,% (elongation over 75 mm).")
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Write a calibration or repeatability report, by the kind of the run; several runs are compared.

    Example: boat-daq report run.boat --out run.pdf --limit hysteresis=6 --limit repeatability=0.5
    """
    if to.suffix.lower() not in (".html", ".pdf"):
        raise typer.BadParameter("must end in .html or .pdf", param_hint="--out")
    if elongation and len(elongation) not in (1, len(runs)):
        raise typer.BadParameter(f"{len(elongation)} files for {len(runs)} runs", param_hint="--elongation")
    from analysis import Options, analyse, load_recording, write_report
    from analysis.calibration.curve_choice import degree_of
    from analysis.figures.against_shadow import against_shadow
    from analysis.progress import part_of
    from boat_daq.workflows.calibration_in_force import stated_contributions
    from protocol.base.units import ShownUnits

    try:
        shown = ShownUnits.of(units)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--units") from error
    options = Options(degree_of(degree), seed=seed, mcmc=not no_mcmc, fidelity=fidelity, leave_out=leave_out)
    limits = limits_of(limit)
    files: list[Path | None] = [*elongation] if elongation else [None]
    with progress_bar("Reporting") as advance:
        analyses = []
        for number, run in enumerate(runs):
            recording = load_recording(run)
            stated = replace(options, type_b=stated_contributions(recording))
            part = part_of(advance, number, 1, len(runs) + 1)
            analyses.append(analyse(recording, files[number % len(files)], options=stated, progress=part))
        compared = len(analyses) == 1 and analyses[0].kind == "calibration" and not no_shadow
        shadow = against_shadow(analyses[0]) if compared else None
        setting = part_of(advance, len(runs), 1, len(runs) + 1)
        content = write_report(analyses, to, limits, shadow, units=shown, progress=setting)
    if as_json:
        _emit_report(content, to, analyses, limits)
    else:
        notify(f"wrote {to}: {content.title}. {content.verdict}")


def _emit_report(content: Report, file: Path, analyses: list[Analysis], limits: Mapping[str, float]) -> None:
    """Print what a report says as JSON; lists of each run where several are compared."""
    from analysis.figures.acceptance import conformity_json

    conformity = [conformity_json(analysis, limits) for analysis in analyses]
    single = len(analyses) == 1
    emit_json(
        {
            "file": file,
            "title": content.title,
            "verdict": content.verdict,
            "simulated": content.simulated,
            "conformity": conformity[0] if single else conformity,
        }
    )
