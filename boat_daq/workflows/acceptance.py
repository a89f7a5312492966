"""Put the calibration of a run into force for its unit: what prevents it, what is out of tolerance, what is stored.

Rules: an accepted calibration is a new entry of the unit's history, which is never changed; a withdrawal is a newer
one. A curve that turns inside its range cannot be accepted, nor one with a reading to be checked: that is corrected,
left out, or confirmed with a reason, which is kept as the note of a newer reading of the same value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.warning import Warning
from boat_daq.engine.recording.closed_run import ClosedRun
from boat_daq.engine.settings import StoredCalibration, UnitLibrary
from boat_daq.engine.snapshot import Reading
from boat_daq.formatting import count, sensor_words
from boat_daq.workflows.calibration_in_force import record_of
from boat_daq.workflows.run_analysis import analysed_run, count_plateaus
from protocol.base.errors import BoatDaqError, RequestError
from protocol.recording.elongation_file import CONFIRMED

if TYPE_CHECKING:
    from analysis.figures.pipeline import Analysis

CHECK_FIRST = "correct it, leave it out, or confirm it with a reason"
TWO_ELONGATIONS = "one signal would give two elongations"


class Lack(Enum):
    """What a run without any curve lacks first."""

    CYCLES = "cycles"
    PLATEAUS = "plateaus"
    READINGS = "readings"


class Obstacle(NamedTuple):
    """Why a calibration cannot be accepted, with its consequence where it needs one."""

    cause: str
    consequence: str = ""

    def __str__(self) -> str:
        """Return both as a sentence."""
        return f"{self.cause}{f': {self.consequence}' if self.consequence else ''}."


@dataclass(frozen=True, slots=True)
class ReadingToCheck:
    """A reading to be checked; `step` is that of the recording, None for one of a file."""

    step: int | None
    text: str


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """The verdict of a run as texts and codes: the window takes it from a helper process without SciPy and pandas.

    `code` and `state` are those of `analysis.calibration_export.verdict`.
    """

    code: str = "limits"
    state: str = "none"
    headline: str = ""
    check_count: str = ""
    check_text: str = ""
    limits_text: str = ""
    readings: tuple[ReadingToCheck, ...] = ()
    limits_state: str = "none"

    @classmethod
    def of(cls, found: Analysis) -> RunVerdict:
        from analysis.calibration_export.verdict import verdict_of

        v = verdict_of(found)
        readings = tuple(ReadingToCheck(one.step, one.text) for one in v.readings)
        texts = v.headline, v.check_count, v.check_text, v.limits_text
        return cls(str(v.code), str(v.state), *texts, readings, str(v.limits_state))


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorCalibration:
    """The calibration of a sensor, and its figures out of tolerance."""

    record: SensorRecord
    out_of_tolerance: tuple[Warning, ...] = ()

    @property
    def label(self) -> str:
        return sensor_words(self.record.name)

    @property
    def void(self) -> str:
        """Why there is no curve; empty where there is one."""
        return self.record.void


@dataclass(frozen=True, slots=True, kw_only=True)
class RunCalibration:
    """The calibration of a run before it is accepted.

    `plateaus`, `read`: number of plateaus to be read, and of those that were read.
    """

    path: str
    unit: str
    simulated: bool
    cycles: int
    sensors: tuple[SensorCalibration, ...]
    plateaus: int = 0
    read: int = 0
    stepped: bool = True  # whether the plateaus are steps of a plan, at which readings are typed
    recording_id: str = ""
    curve: str = ""  # the choice that was fitted
    verdict: RunVerdict | None = None
    signal_unit: str = "mV"

    @property
    def calibrated(self) -> bool:
        """Whether every sensor has a calibration."""
        return bool(self.sensors) and not any(sensor.void for sensor in self.sensors)


def run_calibration(found: Analysis, path: Path) -> RunCalibration:
    """Return the calibration of an analysed run."""
    from analysis.calibration_export.run_record import sensor_record
    from analysis.figures.acceptance import out_of_tolerance

    sensors = []
    for number, sensor in enumerate(found.sensors):
        record = replace(sensor_record(found, number), fitted=None)  # it is stored, or sent from a helper process
        missed = () if record.void else tuple(out_of_tolerance(sensor, found.reading_sd_mm))
        sensors.append(SensorCalibration(record=record, out_of_tolerance=missed))
    plateaus, read = count_plateaus(found)
    recording = found.recording
    return RunCalibration(
        path=str(path),
        unit=recording.unit,
        simulated=recording.simulated,
        cycles=found.loops.n_cycles,
        sensors=tuple(sensors),
        plateaus=plateaus,
        read=read,
        stepped=bool(len(recording.steps)),
        recording_id=recording.identity,
        curve=str(found.options.degree),
        verdict=RunVerdict.of(found),
        signal_unit=recording.signal_unit,
    )


def lacking(run: RunCalibration) -> Lack | None:
    """Return what is missing for a curve of any sensor; None where there is one."""
    if not all(sensor.void for sensor in run.sensors):
        return None
    if not run.cycles:
        return Lack.CYCLES
    return Lack.READINGS if run.plateaus else Lack.PLATEAUS


def lack_text(run: RunCalibration, lack: Lack) -> str:
    if lack is Lack.CYCLES:
        return "This run has no complete cycle"
    if lack is Lack.PLATEAUS:
        return "This run has no plateaus"
    if run.read == run.plateaus:
        return run.sensors[0].void[:1].upper() + run.sensors[0].void[1:]
    read = f"Only {run.read}" if run.read else "None"
    return f"{read} of {count(run.plateaus, 'plateau')} {'has' if run.read <= 1 else 'have'} a reading"


def obstacle_to(run: RunCalibration | None) -> Obstacle | None:
    """Return why the calibration of a run cannot be accepted; None when it can."""
    if run is None:
        return Obstacle("Nothing is analysed yet")
    lack = lacking(run)
    for sensor in run.sensors:
        if sensor.void:
            return Obstacle(lack_text(run, lack) if lack is not None else f"{sensor.label}: {sensor.void}")
    if run.verdict is not None and run.verdict.readings:
        return Obstacle(run.verdict.check_text, CHECK_FIRST)
    for sensor in run.sensors:
        if not sensor.record.fit["monotone"]:
            return Obstacle(f"{sensor.label}: the curve turns inside its range", TWO_ELONGATIONS)
    return None if run.sensors else Obstacle("The run has no sensor")


def confirm_readings(run: RunCalibration, reason: str, *, reader: str = "") -> tuple[Reading, ...]:
    """Keep the readings to be checked as they are, with the reason; return them as they were before."""
    if not reason.strip():
        raise RequestError("a reading is confirmed with a reason", "Enter how it was checked, such as 'read again'.")
    readings = run.verdict.readings if run.verdict is not None else ()
    if any(one.step is None for one in readings):
        remedy = "Write the reason beside the reading, in a column 'confirmed' of that file."
        raise RequestError(f"the readings of {Path(run.path).name} are in a file", remedy)
    stored = ClosedRun(Path(run.path))
    latest = {reading.step_id: reading for reading in stored.readings()}
    before = tuple(latest[one.step] for one in readings if one.step is not None)
    for one in before:
        _keep(stored, replace(one, reader=reader, note=f"{CONFIRMED}{reason.strip()}"))
    return before


def _keep(stored: ClosedRun, one: Reading) -> None:
    """Add a reading that is kept as it is, with its reader and note."""
    stored.add_reading(
        one.step_id, one.elongation_mm, one.source, resolution_mm=one.resolution_mm, reader=one.reader, note=one.note
    )


def change_readings(path: Path, values: Mapping[int, float | None]) -> dict[int, float | None]:
    """Store newer readings of a closed recording, by step, None to withdraw one; return those before."""
    stored = ClosedRun(path)
    latest = {reading.step_id: reading for reading in stored.readings()}
    for step, mm in values.items():
        before = latest[step]
        stored.add_reading(step, mm, before.source, resolution_mm=before.resolution_mm)
    return {step: latest[step].elongation_mm for step in values}


def missed_bounds(
    run: RunCalibration, posterior: Sequence[Mapping[str, Any]] = (), *, beside: str = ""
) -> tuple[str, ...]:
    """Return which figures are out of tolerance, a sentence for each sensor that has one.

    `posterior`: figures of each sensor's sampled curve; none where it was not sampled. `beside`: a text that is shown
    too, whose reason of an unknown U is not repeated.
    """
    lines = []
    for i, sensor in enumerate(run.sensors):
        parts = [warning.text for warning in sensor.out_of_tolerance]
        if sensor.record.u_reason and sensor.record.u_reason not in beside:
            parts.append(f"U is not known: {sensor.record.u_reason}")
        if sensor.record.u_stand_in:
            parts.append(sensor.record.u_stand_in)
        if i < len(posterior) and not posterior[i].get("converged", True):
            parts.append("uncertainty bands not converged")
        if parts:
            lines.append(f"{sensor.label}: {', '.join(parts)}")
    return tuple(lines)


def accepted_record(run: RunCalibration, posterior: Sequence[Mapping[str, Any]] = ()) -> CalibrationRecord:
    return CalibrationRecord(
        sensors=tuple(sensor.record for sensor in run.sensors if not sensor.void),
        simulated=run.simulated,
        unit=run.unit,
        recording=Path(run.path).name,
        recording_id=run.recording_id,
        curve=run.curve,
        cycles=run.cycles,
        signal_unit=run.signal_unit,
        posterior=tuple(posterior),
        out_of_tolerance=missed_bounds(run, posterior),
    )


def accept(units: UnitLibrary, record: CalibrationRecord, *, operator: str = "") -> CalibrationRecord:
    """Put a calibration into force for its unit, and return it with the time of its acceptance."""
    unit = units.add_calibration(record.unit, record.as_json(), recording=record.recording, operator=operator)
    return record_of(unit, unit.history[-1])


def withdraw(units: UnitLibrary, name: str, before: StoredCalibration | None) -> None:
    """Put the calibration before the newest one into force again; none where there was none."""
    if before is None:
        units.add_calibration(name, {"simulated": units.simulated}, accepted=False, note="acceptance undone")
    else:
        units.add_calibration(name, before.content, recording=before.recording, note="in force again")


def accept_run(
    path: Path,
    units: UnitLibrary,
    *,
    elongation: Path | None = None,
    anyway: bool = False,
    operator: str = "",
    confirm: str = "",
) -> CalibrationRecord:
    """Analyse a run and put its calibration into force; one out of tolerance only with `anyway`.

    `elongation`: file of readings, in place of those of the recording; `confirm`: the reason with which the readings to
    be checked are kept.
    """
    run = read = run_calibration(analysed_run(path, elongation=elongation), path)
    if confirm and run.verdict is not None:  # the reason is stored once nothing else prevents acceptance
        run = replace(run, verdict=replace(run.verdict, readings=()))
    obstacle, missed = obstacle_to(run), missed_bounds(run)
    if obstacle is not None or not run.unit:
        cause = f"this calibration cannot be accepted: {obstacle.cause if obstacle else 'the recording names no unit'}"
        if run.verdict is not None and run.verdict.readings:
            raise RequestError(cause, CHECK_FIRST, command="boat-daq twin accept RUN --confirm REASON")
        remedy = "record a calibration run of a named unit"
        if obstacle is not None and lacking(run) is Lack.READINGS:
            remedy = "give its readings with --elongation FILE.csv, or type them in the window"
        raise RequestError(cause, remedy)
    if missed and not anyway:
        cause = f"this calibration is out of tolerance: {'. '.join(missed)}"
        raise RequestError(cause, "check its readings, or accept it as it is", command="add --anyway")
    before = confirm_readings(read, confirm, reader=operator) if confirm else ()
    try:
        return accept(units.of(simulated=run.simulated), accepted_record(run), operator=operator)
    except BoatDaqError:
        for one in before:  # a reading is never changed: the newer one has no reason
            _keep(ClosedRun(path), one)
        raise
