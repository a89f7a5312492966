"""`boat-daq twin`: elongation as a setpoint. Accept, identify, tune, hold, and the dynamics of a run."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, load, notify, present, progress_bar, show, show_table
from boat_daq.commands.options import PortOption, ReadingsOption, RecordingArgument
from boat_daq.commands.shadow_model import ParametersOption
from boat_daq.engine.settings import UnitLibrary, load_settings

if TYPE_CHECKING:
    from analysis.data.recording import Recording
    from analysis.elongation_control.dynamic_figures import DynamicFigure
    from analysis.elongation_control.unit_file import TwinFile
    from analysis.signal_prediction.light_table import LightTable
    from analysis.signal_prediction.prediction import SensorPrediction

_UNITS = {"s": "s", "percent": "%", "hz": "Hz", "deg": "°"}  # by the last part of a figure's key

app = typer.Typer(no_args_is_help=True, help="Control the elongation of a unit, and find its dynamics.")


@app.command()
def accept(
    run: RecordingArgument,
    elongation: ReadingsOption = None,
    anyway: Annotated[bool, typer.Option("--anyway", help="Accept figures out of tolerance.")] = False,
    confirm: Annotated[
        str, typer.Option(metavar="REASON", help="Keep the readings to be checked, with this reason; it is printed.")
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """Accept the calibration of a run for its unit.

    Example: boat-daq twin accept SA1.boat
    """
    load("boat_daq.workflows.acceptance")
    from boat_daq.workflows.acceptance import accept_run

    with progress_bar("calibrating"):
        record = accept_run(
            run,
            UnitLibrary(),
            elongation=elongation,
            anyway=anyway,
            operator=load_settings().operator,
            confirm=confirm,
        )
    present(
        {"unit": record.unit, "calibrated_utc": record.calibrated_utc, "simulated": record.simulated},
        f"unit {record.unit}: calibration of {run.name} in force since {record.calibrated_utc}",
        as_json=as_json,
    )


@app.command()
def identify(
    run: RecordingArgument,
    parameters: ParametersOption = None,
    face: Annotated[
        str | None,
        typer.Option(
            help="Place of the cavities: outer, inner, both or midline; default that of the last call, else outer."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Identify the hysteresis of a unit from a run.

    A generalised Prandtl-Ishlinskii model, by the calibration in force.

    For another actuator or other cavities the light is traced once, which takes some minutes; a stopped call
    (Ctrl-C) continues. The model then predicts the signals of the unit.

    Example: boat-daq twin identify SA1.boat
    """
    load("boat_daq.workflows.unit_control")
    from dataclasses import replace

    from analysis.optics.scene.parameters import PAPER_OPTIMUM
    from analysis.shadow.fem.parameters import read_parameters
    from boat_daq.workflows.unit_control import identify_unit, store_twin

    chosen: dict[str, Any] = {} if parameters is None else {"actuator": read_parameters(parameters)}
    chosen |= {} if face is None else {"face": replace(PAPER_OPTIMUM, face=face).face}  # type: ignore[arg-type]  # checked
    recording, units = _recording(run)
    with progress_bar("identifying"):
        twin = replace(identify_unit(recording, units), **chosen)
    _light(twin)
    if chosen:
        store_twin(units, twin)
    model = twin.model
    _present(
        twin,
        f"R² {model.r2:.5f}, rms {model.rms_mm:.3f} mm over {model.pressure_range_kpa[0]:+z.0f} to "
        f"{model.pressure_range_kpa[1]:+z.0f} kPa",
        as_json=as_json,
    )
    if twin.tuning is None:
        notify("without a step test the gains are slow: record the plan step-test, then boat-daq twin tune RUN")


@app.command()
def tune(run: RecordingArgument, as_json: JsonOption = False) -> None:
    """Take the gains of the control from a step-test run.

    Example: boat-daq twin tune step-test.boat
    """
    load("analysis.elongation_control.dynamics", "analysis.data.boat_file", "boat_daq.workflows.unit_control")
    from analysis.elongation_control.dynamics import lag_figures
    from boat_daq.workflows.unit_control import tune_unit

    recording, units = _recording(run)
    with progress_bar("identifying"):
        twin = tune_unit(recording, units)
    tuning = twin.tuning
    assert tuning is not None and tuning.lag is not None
    figures, margins = lag_figures(tuning.lag), tuning.margins
    if as_json:
        emit_json(twin.as_json() | {"step_response": dataclasses.asdict(figures)})
        return
    _present(
        twin,
        f"delay {1000 * tuning.lag.delay_s:.0f} ms, natural frequency {tuning.lag.omega_rad_per_s:.2f} rad/s, "
        f"damping {tuning.lag.damping:.2f}",
        f"integral gain {tuning.integral_per_s:.2f} /s, lead {tuning.lead_s:.3f} s, "
        f"ramp {tuning.ramp_kpa_per_s:g} kPa/s",
        f"gain margin {margins.gain_db:.1f} dB, phase margin {margins.phase_deg:.0f}°, delay margin "
        f"{1000 * margins.delay_s:.0f} ms, crossover {margins.crossover_hz:.2f} Hz",
        as_json=False,
    )
    _show_figures({"step of pressure": {name: getattr(figures, name) for name in figures.__dataclass_fields__}})


@app.command()
def hold(
    port: PortOption,
    unit: Annotated[str, typer.Option(help="Name of the unit.")],
    mm: Annotated[float, typer.Option(help="Elongation to hold, mm.")],
    seconds: Annotated[float, typer.Option(min=0.1, help="Time to hold, s.")] = 10.0,
    on_stop_hold: Annotated[
        bool, typer.Option("--hold", help="Hold the pressure where the control stops by itself; default: vent.")
    ] = False,
    max_u: Annotated[
        float | None, typer.Option(min=0.001, metavar="MM", help="U (k = 2) that stops the control; default 0.8.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Recording to write; default a dated name.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Hold an elongation, record it, and vent.

    Example: boat-daq twin hold --port /dev/ttyACM0 --unit SA1 --mm 1.5 --seconds 20
    """
    load("analysis.elongation_control.controller", "boat_daq.workflows.run_session")
    from boat_daq.commands.record import dated_name
    from boat_daq.engine.plan import Plan
    from boat_daq.workflows.run_session import SessionRequest, run_session
    from boat_daq.workflows.unit_control import check_setpoint, held_elongation
    from protocol.recording import Segment

    check_setpoint(UnitLibrary(), unit, mm)
    segment = Segment("step", mm, hold_s=seconds)
    plan = Plan("hold", "profile", 1, quantity="mm", min_dwell_s=3.0, segments=(segment,))
    request = SessionRequest(
        port, out or dated_name(unit), plan, unit=unit, metadata={"unit": unit}, hold=on_stop_hold, max_u_mm=max_u
    )
    summary, failure, _ = run_session(request, notify=notify, progress_bar=progress_bar)
    recording, units = _recording(summary.path)
    held = dict.fromkeys(("elongation_mm", "u_mm", "deviation_mm", "rms_mm"), float("nan"))
    if not failure:
        held = held_elongation(units, recording, seconds / 2)
    content = {
        "recording": str(summary.path), "setpoint_mm": mm, **held, "simulated": recording.simulated,
        "failed": bool(failure), "failure": failure,
    }  # fmt: skip
    lines = [str(summary.path)] if failure else [
        f"{summary.path}: {held['elongation_mm']:+z.3f} mm over the last {seconds / 2:g} s, setpoint {mm:+g} mm",
        f"deviation {held['deviation_mm']:+z.3f} mm, rms {held['rms_mm']:.3f} mm; "
        f"U of a sample {held['u_mm']:.3f} mm (k = 2)",
    ]  # fmt: skip
    present(content, *lines, as_json=as_json)
    if failure:
        notify(f"the control ended early: {failure}")
        raise typer.Exit(1)


@app.command()
def dynamics(run: RecordingArgument, as_json: JsonOption = False) -> None:
    """Compute the dynamics of a run of steps or sines.

    Rise, settling and overshoot; bandwidth and phase.

    Example: boat-daq twin dynamics steps.boat
    """
    load("boat_daq.workflows.unit_control")
    from analysis.elongation_control.dynamic_figures import BODE_HEADINGS
    from boat_daq.workflows.unit_control import dynamics_of

    with progress_bar("computing"):
        found = dynamics_of(UnitLibrary(), run)
    if as_json:
        emit_json(found.as_json())
        return
    if found.simulated:
        show("SIMULATED")
    show(f"{found.unit}: {found.verdict}")
    if found.steps:
        _show_figures({f"{size:g} mm": figures for size, figures in found.steps.items()})
    if found.bode:
        show("elongation over setpoint, with U (k = 2):")
        show_table(BODE_HEADINGS, found.bode_rows())


@app.command()
def predict(
    run: RecordingArgument,
    out: Annotated[Path | None, typer.Option(help="CSV of measured and predicted signals, a row a sample.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Predict the signals of a run from its pressure.

    By the chain from pressure to light, fitted to the calibration in force.

    Prints what the chain explains of the calibration and of the paper's published curves, beside a line and a parabola,
    and what disagrees in the run: mechanics (elongation against pressure), optics (one signal) or electronics (all).

    Example: boat-daq twin predict SA1.boat --out predicted.csv
    """
    load("analysis.signal_prediction.prediction", "boat_daq.workflows.unit_control")
    from analysis.signal_prediction.prediction import predict_run, published_prediction
    from boat_daq.workflows.unit_control import fusion_of, load_twin, predicted_sensors
    from protocol.base.errors import writing
    from protocol.base.whole_file import written_whole

    recording, units = _recording(run)
    name = recording.unit
    twin, published = load_twin(units, name), published_prediction()
    light = _light(twin)
    with progress_bar("predicting"):
        sensors = predicted_sensors(units, name, light)
        found = predict_run(recording, twin.model, fusion_of(units, name), sensors)
    if out is not None:
        with writing(out), written_whole(out) as part:
            found.frame.to_csv(part, index=False)
        notify(f"wrote {out}")
    content = {
        "unit": name, "simulated": recording.simulated, "sensors": [one.as_json() for one in sensors],
        "published": [one.as_json() for one in published], "disagreement_percent": dict(found.words),
    }  # fmt: skip
    if as_json:
        emit_json(content)
        return
    if recording.simulated:
        show("SIMULATED")
    groups = (("run", sensors), ("paper", published))
    rows = [row for kind, fits in groups for n, one in enumerate(fits, 1) for row in _fit_rows(f"{kind} {n}", one)]
    heads = ("sensor", "fitted", "R²", "% FSO", "held out", "mV/%", "dB/cm")
    show("the model's light, a line and a parabola in elongation: R², rms in % FSO, rms of cycles left out in mV,")
    show("gain, loss of the guide" + (" (at its bound)" if any(one.after.at_bound for one in sensors) else "") + ":")
    show_table(heads, rows, left=2)
    better = all(one.beats_parabola for one in sensors)
    show(
        "the model's light " + ("predicts cycles left out better than a parabola in elongation" if better else
        "predicts cycles left out no better than a parabola in elongation: it is of no use for this unit")
    )  # fmt: skip
    words = ", ".join(f"{word} {share:.0f} %" for word, share in found.words.items())
    show(f"what disagrees with the calibration, by time: {words} (the model's light is not used)")


def _fit_rows(curve: str, one: SensorPrediction) -> list[tuple[str, ...]]:
    """Return the rows of one sensor: the model's light, and what needs no optics."""
    light = [("light", one.before, ""),
             ("light, loss", one.after, f"{one.held_out_rms_mv:.2f}")]  # fmt: skip
    plain = [("line", one.line), ("parabola", one.parabola)]
    return [
        *((curve, name, f"{fit.r2:.4f}", f"{fit.rms_percent_fso:.2f}", held, f"{fit.gain_mv_per_percent:+z.1f}",
           f"{fit.loss_db_per_cm:.2f}{', bound' if fit.at_bound else ''}") for name, fit, held in light),
        *((curve, name, f"{fit.r2:.4f}", f"{fit.rms_percent_fso:.2f}", f"{fit.held_out_rms_mv:.2f}", "", "")
          for name, fit in plain),
    ]  # fmt: skip


def _light(twin: TwinFile) -> LightTable:
    """Return the light of a unit's actuator, traced where it is not kept."""
    from analysis.signal_prediction.light_table import light_of

    with progress_bar("tracing the light of this actuator") as advance:
        light = light_of(twin.actuator, twin.face, progress=advance)
    assert light is not None  # it may be traced
    return light


def _recording(run: Path) -> tuple[Recording, UnitLibrary]:
    """Return a recording and the units of its kind of board."""
    from analysis import load_recording

    recording = load_recording(run)
    return recording, UnitLibrary().of(simulated=recording.simulated)


def _present(twin: TwinFile, *lines: str, as_json: bool) -> None:
    head = f"unit {twin.unit}, identified from {twin.recording}"
    present(twin.as_json(), *(["SIMULATED"] if twin.simulated else []), head, *lines, as_json=as_json)


def _show_figures(groups: dict[str, dict[str, DynamicFigure]]) -> None:
    rows = [
        (group, name.replace("_", " "), _UNITS[unit], f"{figure.value:.3g}",
         f"{figure.low:.3g} .. {figure.high:.3g}" if math.isfinite(figure.low) else "not repeated")
        for group, figures in groups.items()
        for (name, _, unit), figure in ((key.rpartition("_"), value) for key, value in figures.items())
    ]  # fmt: skip
    show_table(("step", "figure", "unit", "value", "95 % interval"), rows, left=3)
