"""The calibration of a run in its stored form (`analysis.calibration.record`), and the elongation by it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.calibration.inverse import Fusion
from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.calibration.type_b import counted
from analysis.data import load
from analysis.data.recording import Recording
from analysis.figures.pipeline import analyse
from analysis.figures.sensor_analysis import AnalysedRun
from analysis.figures.uncertainty import signal_parts
from analysis.version import program_version


def calibration_record(analysis: AnalysedRun) -> CalibrationRecord:
    """Return the calibration of a run; a sensor without a curve has the reason in its place."""
    recording = analysis.recording
    return CalibrationRecord(
        sensors=tuple(sensor_record(analysis, number) for number in range(len(analysis.sensors))),
        simulated=recording.simulated,
        unit=recording.unit,
        recording=Path(recording.source).name,
        recording_id=recording.identity,
        calibrated_utc=recording.started_utc,
        operator=str(recording.meta.get("operator") or ""),
        program_version=program_version(),
        curve=str(analysis.options.degree),
        cycles=analysis.loops.n_cycles,
        signal_unit=recording.signal_unit,
    )


def sensor_record(analysis: AnalysedRun, number: int) -> SensorRecord:
    """Return the calibration of one sensor, counted from 0."""
    sensor, given = analysis.sensors[number], analysis.options.type_b
    parts = signal_parts(analysis, number)
    type_b = {one.name: one.as_table() for one in counted(given, parts.missing)}
    if sensor.calibration is None:
        return SensorRecord(sensor.name, type_b=type_b, void=sensor.calibration_void)
    points = sensor.point_plateau.astype(np.int64)
    ambient = analysis.ambient_mv[number][points]
    return SensorRecord(
        name=sensor.name,
        fit=sensor.calibration.as_json(),
        elongation_mm=sensor.calibration.x,
        signal_mv=sensor.calibration.y,
        positions=analysis.position_of(points),
        branches=analysis.branch_of(points),
        ambient_mv=ambient if ambient.any() else None,
        reading_sd_mm=analysis.reading_sd_mm,
        noise_mv=parts.independent_over_x,
        between_cycles_mv=parts.between_cycles,
        half_loop_mv=parts.half_loop,
        u_reason=parts.void,
        u_stand_in=parts.stand_in,
        type_b=type_b,
        figures={key: figure.value for key, figure in sensor.figures.items() if np.isfinite(figure.value)},
        fitted=sensor.calibration,
    )


def elongation_reader(analysis: AnalysedRun) -> Fusion:
    """Return the fusion of a run's sensors with the u of its budget. BoatDaqError: a sensor gives no elongation."""
    return calibration_record(analysis).fusion()


def load_recording(path: str | Path, **import_options: Any) -> Recording:
    """Load a run from a `.boat` file, or from a table by the options of `csv_import.import_csv`; the file is only read.

    Its `to_frame` has the elongation by its own readings. Raises FileError if it does not exist, or is of another kind;
    RequestError for a column map of a recording.
    """
    return replace(load.load_recording(path, **import_options), calibrator=_own_reader)


def _own_reader(recording: Recording) -> Fusion:
    return elongation_reader(analyse(recording, mcmc=False))
