"""What an analysis takes from the file of a unit or rig: contributions, the curve, the calibration in force.

Rules: a rig's file has the same tables as a unit's, [type_b.scale] and so on, and takes precedence. Simulated runs use
the library of simulated units.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from analysis.calibration.record import CalibrationRecord
from boat_daq.engine.settings import StoredCalibration, Unit, UnitLibrary
from boat_daq.engine.toml_values import BadValue, parse_toml, read_text
from protocol.base.errors import RequestError

if TYPE_CHECKING:
    from analysis.calibration.curve_choice import Degree
    from analysis.calibration.type_b import TypeBContribution
    from analysis.calibration_export.calibration_file import CalibrationFile
    from analysis.data.export import ConvertedElongation
    from analysis.data.recording import Recording
    from analysis.figures.sensor_analysis import Options


def stated_contributions(recording: Recording, rig: Path | None = None) -> tuple[TypeBContribution, ...]:
    """Return the type B contributions of a rig's file, else of the unit's; none without either."""
    from analysis.calibration.type_b import contributions

    if rig is not None:
        table = parse_toml(read_text(rig), str(rig)).get("type_b")
        if not isinstance(table, dict):
            raise BadValue(str(rig), "type_b", "is missing", "write [type_b.scale] and its keys below it")
        return contributions(table)
    unit = _unit(recording)
    return contributions(unit.type_b) if unit is not None else ()


def chosen_curve(recording: Recording, choice: str = "") -> Degree:
    """Return the curve of a calibration: the choice, else the one accepted with this recording, else the usual one."""
    from analysis.calibration.curve_choice import USUAL_DEGREE, degree_of

    unit = None if choice else _unit(recording)
    records = reversed(accepted_records(unit)) if unit is not None else ()
    accepted = (record.curve for record in records if record.recording_id == recording.identity)
    return degree_of(choice or next(accepted, "") or str(USUAL_DEGREE))


def record_of(unit: Unit, entry: StoredCalibration) -> CalibrationRecord:
    return CalibrationRecord.parse(
        entry.content, unit=unit.name, recording=entry.recording, calibrated_utc=entry.utc, operator=entry.operator,
        program_version=entry.program_version,
    )  # fmt: skip


def accepted_records(unit: Unit) -> list[CalibrationRecord]:
    """Return the accepted calibrations of a unit, oldest first, those that were withdrawn later included."""
    return [record_of(unit, entry) for entry in unit.history if entry.accepted]


def calibration_before(units: UnitLibrary, name: str, recording_id: str) -> CalibrationRecord | None:
    """Return the newest accepted calibration of a unit by another recording; None without one, or without a name."""
    accepted = reversed(accepted_records(units.load(name))) if name else ()
    return next((one for one in accepted if one.recording_id != recording_id), None)


def newest_calibration(units: UnitLibrary, name: str) -> CalibrationRecord | None:
    """Return the calibration of a unit in force; None where it has none, or no unit is named."""
    unit = units.load(name) if name else None
    return None if unit is None or unit.calibration is None else record_of(unit, unit.calibration)


class NotCalibrated(RequestError):
    """A unit has no accepted calibration; `first` is what else is missing, with its remedy."""

    def __init__(self, name: str, *, simulated: bool, first: tuple[str, str] = ("", "")) -> None:
        kind = "simulated unit" if simulated else "unit"
        cause = f"{kind} {name} has no accepted calibration" if name else "the unit is not named"
        super().__init__(
            f"{first[0]}{cause}",
            f"{first[1]}accept a calibration of this unit first",
            command="boat-daq twin accept RUN",
        )


def in_force(units: UnitLibrary, name: str) -> CalibrationRecord:
    found = newest_calibration(units, name)
    if found is None:
        raise NotCalibrated(name, simulated=units.simulated)
    if found.signal_unit != "mV":
        cause = f"the calibration of unit {name} is for signals in {found.signal_unit}, those of a board are in mV"
        raise RequestError(cause, "accept a calibration of this unit by the board first")
    return found


def calibration_in_force(recording: Recording) -> CalibrationFile | None:
    """Return the calibration that the unit of a recording was last accepted with; None where it has none."""
    from analysis.calibration_export.calibration_file import CalibrationFile

    unit = _unit(recording)
    if unit is None or unit.calibration is None:
        return None
    return CalibrationFile.of(record_of(unit, unit.calibration))


def exported_elongation(
    recording: Recording, options: Options, elongation: Path | None = None
) -> tuple[ConvertedElongation | None, str]:
    """Return the elongation of every sample by the run's own calibration, else by that of its unit; else None and why.

    `elongation`: CSV of elongations; None for the recording's own readings.
    """
    from analysis.calibration_export.conversion import convert_recording, own_elongation
    from protocol.base.errors import BoatDaqError

    try:
        return own_elongation(recording, options, elongation), ""
    except BoatDaqError as error:
        void = error.cause
    try:
        accepted = calibration_in_force(recording)
        if accepted is not None:
            return convert_recording(recording, accepted), ""
    except BoatDaqError as error:
        void = f"{void}; the calibration of the unit: {error.cause}"
    return None, void


def _unit(recording: Recording) -> Unit | None:
    """Return the stored unit of a recording; None where it names none or none is stored."""
    library = UnitLibrary(simulated=recording.simulated)
    return library.load(recording.unit) if recording.unit in library.names() else None
