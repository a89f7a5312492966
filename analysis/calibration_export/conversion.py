"""Signals into elongation by a calibration: what `convert` writes and what an export adds to the samples.

Signals of a virtual board need a calibration of a virtual board, real ones a real one. A sample that may not enter a
figure has no elongation.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.calibration_export.calibration_file import CalibrationFile
from analysis.data.export import ConvertedElongation
from analysis.data.recording import Recording
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, RequestError
from protocol.base.units import COVERAGE_FACTOR, in_a_name
from protocol.recording import NOT_FOR_FIGURES, SampleFlag

if TYPE_CHECKING:
    from analysis.figures.sensor_analysis import Options


def convert_signals(calibration: CalibrationFile, signal_mv: FloatArray, flags: npt.ArrayLike) -> ConvertedElongation:
    """Return the fused elongation of signals [n, sensors]; samples whose flag [n] says no measurement are left out."""
    unusable = (np.asarray(flags) & int(NOT_FOR_FIGURES & ~SampleFlag.PRESSURE_INVALID)) != 0
    known = np.isfinite(signal_mv) & ~unusable[:, None]
    found = calibration.reader().evaluate(np.where(known, signal_mv, np.nan))
    valid = np.asarray(np.isfinite(found.elongation_mm) & ~found.disagreement, dtype=bool)
    expanded = COVERAGE_FACTOR * found.standard_uncertainty_mm
    return ConvertedElongation(found.elongation_mm, expanded, valid, described(calibration))


def convert_recording(recording: Recording, calibration: CalibrationFile) -> ConvertedElongation:
    """Return the elongation of every sample of a recording; raises as `check_signals` and `convert_signals`."""
    check_signals(calibration, recording.n_sensors, recording.signal_unit, simulated=recording.simulated)
    return convert_signals(calibration, recording.signal_mv, recording.flags)


def own_elongation(recording: Recording, options: Options, elongation: str | Path | None = None) -> ConvertedElongation:
    """Return the elongation of a calibration run's samples by its own calibration; readings from a CSV if given."""
    from analysis.figures.pipeline import analyse

    check_read(recording, elongation)
    return convert_recording(recording, CalibrationFile.of_run(analyse(recording, elongation, options=options)))


def check_read(recording: Recording, elongation: str | Path | None = None) -> None:
    """Refuse a run without any reading of elongation."""
    measured = len(recording.readings) or recording.camera is not None or recording.meta.get("elongation_channel")
    if elongation is None and not measured:
        raise DataError("no elongation was read in this run", "Give a calibration of its unit.")


def check_signals(calibration: CalibrationFile, sensors: int, unit: str = "mV", *, simulated: bool) -> None:
    """Refuse a calibration for other signals. RequestError: virtual and real, numbers of sensors, or units differ."""
    if calibration.signal_unit != unit:
        cause = f"the signals are in {unit}, the calibration is for signals in {calibration.signal_unit}"
        raise RequestError(cause, "Give a calibration for such signals.")
    if bool(calibration.head["simulated"]) is not simulated:
        kinds = ("a real board", "a virtual board")
        cause = f"signals of {kinds[simulated]} are not converted by a calibration of {kinds[not simulated]}"
        raise RequestError(cause, f"Give a calibration of {kinds[simulated]}.")
    if len(calibration.sensors) != sensors:
        cause = f"the signals are those of {sensors} sensors, the calibration is of {len(calibration.sensors)}"
        raise RequestError(cause, "Give the calibration of this unit.")


def other_unit(calibration: CalibrationFile, unit: str) -> tuple[str, ...]:
    """Return a warning where the signals name another unit than the calibration; none where either names none."""
    own = str(calibration.head["unit"])
    return (
        (f"warning: the signals are of unit {unit}, the calibration is of {own}",)
        if own and unit not in ("", own)
        else ()
    )


def described(calibration: CalibrationFile) -> dict[str, Any]:
    """Return what a file of converted samples states of its calibration."""
    keys = ("simulated", "unit", "recording", "recording_id", "calibrated_utc", "traceability", "program_version")
    stated = {"notes": list(calibration.remarks), "u_mm": "U, k = 2", "u_stand_in": calibration.reader().u_stand_in}
    return {key: calibration.head[key] for key in keys} | stated


def heading(calibration: CalibrationFile) -> list[str]:
    """Return the comment lines at the head of converted signals."""
    lines = ["SIMULATED"] if calibration.head["simulated"] else []
    source = Path(calibration.head["recording"]).name
    lines += [f"converted by: {calibration.title}, recording {source}", *calibration.remarks]
    lines.append("u_mm is the expanded uncertainty of one reading, k = 2")
    lines.append("valid is 0 where elongation_mm is not known, or the sensors disagree")
    return [f"# {' '.join(line.replace(',', ';').split())}" for line in lines]


def converted_rows(
    time_s: FloatArray, signal_mv: FloatArray, converted: ConvertedElongation, unit: str = "mV"
) -> pd.DataFrame:
    """Return the rows of `convert`: time, signals [n, sensors], elongation, U, valid, and the mark of U."""
    names = {f"s{number + 1}_{in_a_name(unit)}": column for number, column in enumerate(signal_mv.T)}
    columns = {"time_s": time_s, **names, "elongation_mm": converted.elongation_mm, "u_mm": converted.u_mm}
    return pd.DataFrame(columns | {"valid": converted.valid.astype(np.uint8)} | converted.marks)
