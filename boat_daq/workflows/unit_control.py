"""A unit under control: its file beside the unit's, and the regulator made from it and the calibration in force.

Rules: without an accepted calibration of this unit, on this kind of board, there is no regulator; nor with one that the
unit was not identified with. The file is NAME.twin.json in the folder of the unit library.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from boat_daq.engine.control.elongation import LoopStop, Point, Regulated, Regulator, Signals
from boat_daq.engine.file_names import path_in
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import MessageKind
from boat_daq.workflows.calibration_in_force import in_force
from protocol.base.errors import RequestError, StorageError

if TYPE_CHECKING:
    from analysis.calibration.inverse import Fusion
    from analysis.data.recording import Recording
    from analysis.elongation_control.controller import ElongationController
    from analysis.elongation_control.dynamic_figures import DynamicCalibration
    from analysis.elongation_control.sensor_loop import SensorLoops
    from analysis.elongation_control.unit_file import TwinFile
    from analysis.signal_prediction.light_table import LightTable
    from analysis.signal_prediction.prediction import LivePrediction, SensorPrediction


def fusion_of(units: UnitLibrary, name: str) -> Fusion:
    """Return what turns the signals of a unit into elongation, by its calibration in force."""
    return in_force(units, name).fusion()


def dynamics_of(units: UnitLibrary, path: Path) -> DynamicCalibration:
    from analysis import load_recording
    from analysis.elongation_control.run_response import dynamic_calibration

    recording = load_recording(path)
    units = units.of(simulated=recording.simulated)
    name, fusion = recording.unit, fusion_of(units, recording.unit)
    loops, utc = sensor_loops(units, name, fusion), in_force(units, name).calibrated_utc
    return dynamic_calibration(recording, fusion, loops=loops, calibration_utc=utc)


def held_elongation(units: UnitLibrary, recording: Recording, seconds: float) -> dict[str, float]:
    """Return mean, U (k = 2), mean deviation and rms deviation of the last segment's elongation, mm."""
    import numpy as np

    from analysis.elongation_control.run_response import recorded_segments, run_elongation

    fusion = fusion_of(units, recording.unit)
    elongation, u_mm = run_elongation(recording, fusion, sensor_loops(units, recording.unit, fusion))
    last = recorded_segments(recording)[-1]
    rows = slice(*np.searchsorted(recording.time_s, [last.end_s - seconds, last.end_s]).tolist())
    x, away = elongation[rows], elongation[rows] - last.segment.target
    return {
        "elongation_mm": float(np.nanmean(x)),
        "u_mm": float(np.nanmean(u_mm[rows])),
        "deviation_mm": float(np.nanmean(away)),
        "rms_mm": float(np.sqrt(np.nanmean(away**2))),
    }


def twin_path(units: UnitLibrary, name: str) -> Path:
    return path_in(units.folder, f"{name}.twin.json")


class NotIdentified(RequestError):
    """The hysteresis of a unit is not identified with its calibration in force."""


def load_twin(units: UnitLibrary, name: str) -> TwinFile:
    """Return the file of a unit under control."""
    from analysis.elongation_control.unit_file import read_twin

    stored = in_force(units, name)
    twin = read_twin(twin_path(units, name))
    command, remedy = "boat-daq twin identify RUN", "prepare the control of elongation from its calibration run"
    if twin is None:
        raise NotIdentified(f"the hysteresis of unit {name} is not identified", remedy, command=command)
    if twin.calibration_utc != stored.calibrated_utc:
        cause = f"unit {name} has had another calibration since its hysteresis was identified"
        raise NotIdentified(cause, remedy, command=command)
    return twin


def identify_unit(recording: Recording, units: UnitLibrary) -> TwinFile:
    """Identify the hysteresis of a recording's unit by its calibration in force, and store it.

    Gains, and the actuator that its signals are predicted by, are kept.
    """
    from analysis.elongation_control.run_response import identify_run
    from analysis.elongation_control.unit_file import TwinFile, read_twin

    stored = in_force(units, recording.unit)
    before = read_twin(twin_path(units, recording.unit))
    model = identify_run(recording, fusion_of(units, recording.unit))
    name = Path(recording.source).name
    twin = TwinFile(recording.unit, units.simulated, stored.calibrated_utc, name, model)
    if before is not None:
        twin = replace(twin, tuning=before.tuning, actuator=before.actuator, face=before.face)
    store_twin(units, twin)
    return twin


def tune_unit(recording: Recording, units: UnitLibrary) -> TwinFile:
    """Take the gains of a recording's unit from its step test, and store them."""
    from analysis.elongation_control.run_response import tune_run

    twin = load_twin(units, recording.unit)
    twin = twin.tuned(tune_run(recording, fusion_of(units, recording.unit), twin.model))
    store_twin(units, twin)
    return twin


def predicted_sensors(units: UnitLibrary, name: str, light: LightTable) -> tuple[SensorPrediction, ...]:
    """Return the forward models of a unit's signals, fitted to the readings of its calibration in force."""
    from analysis.signal_prediction.prediction import predict_sensors

    record = in_force(units, name)
    return predict_sensors([(one.elongation_mm, one.signal_mv) for one in record.sensors], light, cycles=record.cycles)


def live_prediction_of(units: UnitLibrary, name: str, fusion: Fusion) -> LivePrediction | None:
    """Return what predicts a unit's live signals.

    None where the unit is not identified with its calibration in force, or the light of its actuator is not kept.
    """
    from analysis.elongation_control.unit_file import read_twin
    from analysis.signal_prediction.light_table import light_of
    from analysis.signal_prediction.prediction import live_prediction

    twin = read_twin(twin_path(units, name))
    if twin is None or twin.calibration_utc != in_force(units, name).calibrated_utc:
        return None
    light = light_of(twin.actuator, twin.face, build=False)
    return None if light is None else live_prediction(twin.model, fusion, predicted_sensors(units, name, light))


def prepare_control(path: Path, units: UnitLibrary) -> str:
    """Identify a unit from a calibration run, or take its gains from a step test; return what was done."""
    from analysis.data.load import load_recording
    from analysis.elongation_control.run_response import recorded_segments

    recording = load_recording(path)
    library = units.of(simulated=recording.simulated)
    if not any("segment" in str(detail) for detail in recording.steps["detail"]):
        model = identify_unit(recording, library).model
        return f"unit {recording.unit} identified: R\u00b2 {model.r2:.4f}. A run of the plan step-test gives its gains"
    recorded_segments(recording)
    tuning = tune_unit(recording, library).tuning
    assert tuning is not None
    margins = tuning.margins
    return (
        f"unit {recording.unit} tuned: gain {tuning.integral_per_s:.2f} /s, margins {margins.gain_db:.1f} dB, "
        f"{margins.phase_deg:.0f}\u00b0 and {1000 * margins.delay_s:.0f} ms"
    )


def store_twin(units: UnitLibrary, twin: TwinFile) -> None:
    path = twin_path(units, twin.unit)
    try:
        twin.write(path)
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror}", "check the folder and the disk") from error


def regulator_of(
    units: UnitLibrary,
    name: str,
    *,
    fusion: Fusion | None = None,
    step_mv: float = 0.0,
    max_u_mm: float | None = None,
) -> Regulator:
    """Return the regulator of a unit.

    Parameters
    ----------
    step_mv : signal of one count of the board's converter.
    max_u_mm : U (k = 2) of the elongation that stops the control; None for the usual bound.
    """
    from analysis.elongation_control.controller import Bounds, ElongationController, Tuning

    twin = load_twin(units, name)
    fusion = fusion or fusion_of(units, name)
    tuning = twin.tuning or Tuning.cautious()
    loops = sensor_loops(units, name, fusion)
    bounds = Bounds() if max_u_mm is None else Bounds(u_mm=max_u_mm)
    return as_regulator(
        ElongationController(twin.model, fusion, tuning, bounds, unit=name, step_mv=step_mv, loops=loops)
    )


def check_setpoint(units: UnitLibrary, name: str, mm: float) -> None:
    """Refuse an elongation that a unit cannot hold, before a board is connected and a recording begun.

    Whether the board is simulated is known only afterwards: either of the unit's calibrations may cover it.
    """
    missing: list[RequestError] = []
    refused: list[RequestError] = []
    for simulated in (False, True):
        try:
            regulator = regulator_of(units.of(simulated=simulated), name)
        except RequestError as error:
            missing.append(error)
            continue
        try:
            return regulator.check(mm)
        except RequestError as error:
            refused.append(error)
    raise (refused or missing)[0]


def as_regulator(controller: ElongationController) -> Regulator:
    from analysis.elongation_control.controller import StopCode

    kinds = {
        StopCode.DISAGREEMENT: MessageKind.SENSORS_DISAGREE,
        StopCode.UNKNOWN: MessageKind.ELONGATION_UNKNOWN,
        StopCode.UNCERTAIN: MessageKind.ELONGATION_UNCERTAIN,
        StopCode.NOT_FOLLOWING: MessageKind.NOT_FOLLOWING,
    }

    def advance(
        time_s: float, sampled_s: float, point: Point, signal_mv: Signals, limits_kpa: tuple[float, float], shaped: bool
    ) -> Regulated:
        found = controller.advance(time_s, sampled_s, point, signal_mv, limits_kpa, shaped=shaped)
        stop = None if found.stop is None else LoopStop(kinds[found.stop], found.cause, found.remedy)
        measured = (found.setpoint_mm, found.elongation_mm, found.u_mm, found.saturated, found.lost)
        return Regulated(found.pressure_kpa, found.ramp_kpa_per_s, *measured, stop)

    return Regulator(
        controller.unit, controller.period_s, controller.delay_margin_s, controller.check, controller.begin, advance
    )


def sensor_loops(units: UnitLibrary, name: str, fusion: Fusion) -> SensorLoops | None:
    """Return the hysteresis loops of a unit's sensors, from the readings of its calibration; None without any."""
    import numpy as np

    from analysis.elongation_control.sensor_loop import find_loops

    points = [(one.elongation_mm, one.signal_mv) for one in in_force(units, name).sensors]
    same = all(np.array_equal(x, points[0][0]) for x, _ in points)
    curves = [inverse.calibration for inverse in fusion.inverses]
    if not same or any(curve is None for curve in curves):
        return None
    residuals = [y - curve.predict(x) for (x, y), curve in zip(points, curves, strict=True) if curve is not None]
    return find_loops(points[0][0], residuals)
