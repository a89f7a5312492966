"""The calibration page: a run is analysed in the background, shown, compared with the previous calibration, accepted.

Rules: nothing is computed on the window's threads. Plateaus are those of the plan; some were read, some of these are in
the curve.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from analysis.calibration.compare import Agreement, compare_fits
from analysis.calibration.curve_choice import AUTO, CURVES, SPLINE, USUAL_DEGREE
from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.calibration.type_b import Traceability
from analysis.fidelity import Fidelity, fidelity
from boat_daq.engine.recording.rename import companions
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.formatting import count, number
from boat_daq.viewmodels.common.notices import Notice, Severity, sentence
from boat_daq.viewmodels.common.services import Change, Services
from boat_daq.viewmodels.results.calibration_texts import (
    VERDICT_LOOKS,
    Cells,
    coefficient_row,
    curve_row,
    missing,
    readings_text,
    shown_text,
    verdict_text,
)
from boat_daq.viewmodels.results.certificates import CertificateModel
from boat_daq.viewmodels.results.metadata import MetadataModel
from boat_daq.viewmodels.results.run_result import CurveBands, RunResult, SensorResult, analyse_run, sample_run
from boat_daq.workflows.acceptance import (
    Obstacle,
    ReadingToCheck,
    RunVerdict,
    accept,
    accepted_record,
    change_readings,
    confirm_readings,
    missed_bounds,
    obstacle_to,
    withdraw,
)
from boat_daq.workflows.calibration_in_force import calibration_before, newest_calibration
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from boat_daq.workflows.run_files import export_calibration
from boat_daq.workflows.unit_control import prepare_control
from protocol.base.errors import BoatDaqError, RequestError
from protocol.base.units import NOTHING, STORED_UNITS, Quantity, ShownUnits, UnitText, as_text, in_shown_units
from protocol.recording.elongation_file import read_elongation_rows

ACCEPT, ANYWAY = "Accept", "Accept anyway"
WHOSE_U = "The U at the top is the largest over the range, of all sensors together; here each sensor is alone."
Action = Callable[[], None]
CURVE_CHOICES = (
    *((f"Degree {name}", name) for name in CURVES if name != SPLINE),
    ("Monotone spline", SPLINE),
    ("By cross-validation", AUTO),
)
"""The curves that can be chosen, as texts with their names."""


class CalibrationModel:
    """State of the page.

    Parameters
    ----------
    newest : returns the newest recording of simulated boards (True), real boards (False) or both (None).
    analysed : takes each new result.
    """

    def __init__(
        self,
        session: Session,
        units: UnitLibrary,
        jobs: JobRunner,
        services: Services,
        newest: Callable[[bool | None], Path | None] = lambda simulated: None,
        analysed: Callable[[RunResult], None] = lambda result: None,
    ) -> None:
        self.session, self.units, self.jobs = session, units, jobs
        self._services, self._newest, self._taken = services, newest, analysed
        self.fidelity: Fidelity = fidelity()  # of the next analyses and samples
        self.shown_units = STORED_UNITS
        self.result: RunResult | None = None
        self.before: CalibrationRecord | None = None  # the unit's newest one by another recording
        self.agreements: tuple[Agreement | None, ...] = ()
        self.posterior: tuple[CurveBands, ...] = ()
        self.failure: Any = None
        self.last_path: Path | None = None
        self.choice = ""  # that was chosen for the last recording; none: see `chosen_curve`
        self.accepted: CalibrationRecord | None = None
        self._failed: Notice | None = None  # why the last analysis has no result
        self._asked: Notice | None = None  # whether to accept what is out of tolerance
        self._replaced: tuple[Any, ...] = (None, None, (), (), None)  # by a first result
        self.revision = 0
        self.units_revision = 0  # grows whenever a unit's calibration in force changes

    @property
    def working(self) -> bool:
        return self.jobs.get("analysis") is not None

    def analyse_current(self) -> None:
        """Close the open recording and analyse it; without one, the last again, or the newest of this kind of board."""
        snapshot = self.session.snapshot()
        if snapshot.under_way:
            raise RequestError("a run is in progress", "Wait for its end, or stop it: complete cycles are analysed.")
        path = self._last_run(snapshot)
        if path is None:
            raise RequestError("there is no recording yet", "Run a plan, or open a recording on the page Recordings.")
        self.analyse(path if snapshot.recording is None else self.session.stop_recording() or path)

    def no_last_run(self) -> str:
        """Return why there is no last run to be analysed; empty where there is one."""
        snapshot = self.session.snapshot()
        if snapshot.under_way:
            return "A run is in progress: it can be analysed when it has ended."
        return "" if self._last_run(snapshot) else "There is no recording yet. Run the plan and type its readings."

    def _last_run(self, snapshot: SessionSnapshot) -> Path | None:
        up = snapshot.link is LinkState.UP
        if snapshot.recording is not None:
            return snapshot.recording
        other = up and self.result is not None and self.result.simulated is not snapshot.simulated
        return (None if other else self.last_path) or self._newest(snapshot.simulated if up else None)

    def analyse(self, path: Path) -> None:
        """Analyse a recording in the background; a new one with the curve that it was accepted with."""
        if path != self.last_path:
            self.last_path, self.choice, self.result = path, "", None
        self._start(path)

    def follow_change(self) -> None:
        """Analyse the recording again by what was changed."""
        if self.last_path is not None and self.result is not None:
            self._start(self.last_path)

    def _start(self, path: Path) -> None:
        self.failure = None
        self._services.notices.dismiss(self._failed)
        self.revision += 1
        job = Job(
            f"Analysing {path.name}", analyse_run, str(path), level=self.fidelity.level, curve=self.choice, compare=True
        )  # fmt: skip
        self.jobs.start("analysis", job, self._analysed, self._show_first)

    def certificate(self) -> CertificateModel:
        """Return the state of the certificate's panel for the run that is shown."""
        result = self.result
        if result is None or not result.calibrated:
            raise RequestError("there is no calibration to certify", "Analyse a run with readings first.")
        path, units = Path(result.path), self._units_of(result)
        stated = MetadataModel.of_recording(path, units, result.unit, self._services.undo)
        return CertificateModel(stated, path, self.choice, self.jobs, self._services)

    def uncertainty_text(self) -> str:
        """Return whose U is shown, whether an elongation is traceable, and why U is not given everywhere."""
        if self.result is None:
            return ""
        several = sum(u.size > 0 for u in self.result.u_elongation) > 1
        voids = enumerate(self.result.u_reason, 1)
        missing = [f"Sensor {number}: {why}." for number, why in voids if why]
        texts = WHOSE_U if several else "", traceability_text(self.result.traceability), *missing
        return "\n".join(filter(None, texts))

    @property
    def curve_shown(self) -> str:
        """Return the name of the curve that is chosen, else of the one that is shown."""
        return self.choice or (self.result.curve if self.result is not None else "") or str(USUAL_DEGREE)

    def choose_curve(self, name: str) -> None:
        path, before = self.last_path, self.choice
        if path is None:
            raise RequestError("no run is analysed", "Analyse a run with readings first.")

        def fit(curve: str) -> None:
            if self.last_path == path:
                self.choice = curve
                self.follow_change()

        if name != self.curve_shown:
            text = f"curve {next(text for text, of in CURVE_CHOICES if of == name)}"
            self._services.undo.push(Change(text, partial(fit, name), partial(fit, before)))

    def show_units(self, units: ShownUnits) -> None:
        self.shown_units = units
        self.revision += 1

    @property
    def units_of_run(self) -> ShownUnits:
        """The shown units, with that of the signals where it is not mV."""
        return self.shown_units.of_signals_in(self.result.signal_unit) if self.result is not None else self.shown_units

    def curve_headings(self) -> tuple[str, ...]:
        u, error = (as_text(self.units_of_run.shown(unit).symbol) for unit in ("mm", "mV"))
        return "Curve", "Verdict", f"U, {u}", f"Error, {error}"

    def curve_rows(self) -> list[tuple[Cells, str]]:
        """Return each sensor's curves as (name, verdict, U, error of prediction), with its tooltip."""
        if self.result is None:
            return []
        rows: list[tuple[Cells, str]] = []
        for sensor, candidates in zip(self.result.sensors, self.result.candidates, strict=False):
            chosen = sensor.record.fit.get("curve", "")
            rows.append(((sensor.label, "", "", ""), ""))
            rows += [curve_row(one, self.units_of_run, chosen=one.name == chosen) for one in candidates]
        return rows

    def follow_rename(self, old: Path, new: Path) -> None:
        """Keep the run that is shown under its new name."""
        if self.last_path == old:
            self.last_path = new
        if self.result is not None and Path(self.result.path) == old:
            self.result = replace(self.result, path=str(new))

    def take_readings(self, file: Path) -> None:
        """Keep a file of readings beside the recording, where every analysis finds it, and analyse again."""
        if self.last_path is None:
            return
        read_elongation_rows(file)
        beside = companions(self.last_path)[0]
        if file.resolve() != beside.resolve():
            shutil.copyfile(file, beside)
        self.analyse(self.last_path)

    def _show_first(self, result: RunResult) -> None:
        """Show the fit of an analysis whose intervals follow; what was shown before is kept for a cancelled one."""
        self._replaced = self.result, self.before, self.agreements, self.posterior, self.accepted
        self.show(result)

    def _analysed(self, job: Job) -> None:
        if job.state is JobState.CANCELLED:
            if self.result is not None and self.result.preliminary:
                self.result, self.before, self.agreements, self.posterior, self.accepted = self._replaced
            self.choice = self.result.curve if self.result is not None else self.choice
            self.revision += 1
            return
        if (failure := job.failure) is not None:
            add = self._services.notices.add
            self._failed = add(Severity.WARNING, failure.cause, failure.remedy, details=failure.details)
        self.failure = failure
        self.show(job.result)

    def show(self, result: RunResult | None) -> None:
        """Show a result and compare it with the unit's calibration before."""
        self.jobs.cancel("posterior")  # of the curve before
        self._services.notices.dismiss(self._asked)  # its button would accept this one
        self.result, self.before, self.agreements, self.posterior = result, None, (), ()
        self.accepted = self._own_in_force()
        self.revision += 1
        if result is None:
            return
        self.before = calibration_before(self._units_of(result), result.unit, result.recording_id)
        if self.before is not None and self.before.signal_unit == result.signal_unit:
            self.agreements = tuple(map(_agreement, result.sensors, self.before.sensors))
        self._taken(result)

    def _own_in_force(self) -> CalibrationRecord | None:
        """Return the calibration in force of the unit where it is the one that is shown."""
        result = self.result
        found = newest_calibration(self._units_of(result), result.unit) if result is not None else None
        if result is None or found is None or found.recording_id != result.recording_id:
            return None
        same = found.as_json()["sensors"] == accepted_record(result).as_json()["sensors"]
        return found if same and found.curve == result.curve else None

    def _units_of(self, result: RunResult) -> UnitLibrary:
        """Return the library that a run's calibration belongs to: that of simulated boards or of real ones."""
        return self.units.of(simulated=result.simulated)

    def sample(self) -> None:
        if self.result is None or not self.result.calibrated:
            raise RequestError("there is no calibration yet", "Analyse a run with readings first.")
        if not self.samples():
            raise RequestError("a spline has no uncertainty bands", "Choose a degree for the curve.")
        sensors = [sensor.record for sensor in self.result.sensors]
        job = Job("Computing uncertainty bands", sample_run, sensors, self.fidelity.level)
        self.jobs.start("posterior", job, self._sampled)

    def exports(self) -> bool:
        return self.result is not None and self.result.calibrated and not self.working

    def export(self, target: Path) -> None:
        """Write the calibration that is shown as data or code, by the suffix of `target`, in the background."""
        if self.result is None or not self.exports():
            raise RequestError("there is no calibration yet", "Analyse a run with readings first.")
        run, notices = Path(self.result.path), self._services.notices
        label = f"Exporting the calibration of {run.name}"
        job = Job(label, export_calibration, run, target, curve=self.result.curve)
        job.target = target
        self.jobs.start(f"calibration export {target}", job, notices.ended(lambda _: notices.inform_saved(target)))

    def prepare_control(self, path: Path) -> None:
        """Identify a run's unit for the control of its elongation, or tune it by a step test, in the background."""
        notices = self._services.notices

        def done(found: object) -> None:
            self.units_revision += 1  # predicted signals are shown from now on
            notices.inform(str(found))

        self.jobs.start(
            "control", Job(f"Identifying from {path.name}", prepare_control, path, self.units), notices.ended(done)
        )

    def samples(self) -> bool:
        """Return whether the posterior of the curves that are shown can be sampled: a spline has none."""
        if self.result is None or not self.result.calibrated:
            return False
        return all(sensor.record.fit["curve"] != SPLINE for sensor in self.result.sensors)

    def _sampled(self, job: Job) -> None:
        def done(found: Any) -> None:
            self.posterior = found

        self._services.notices.ended(done)(job)  # a failure is of the bands alone: the calibration stays as it is
        self.revision += 1

    def headline(self) -> str:
        """Return unit, cycles and readings of the run in a line; the remedy of a failure."""
        result = self.result
        if self.failure is not None:
            return str(self.failure.remedy)
        if result is None:
            return self.last_path.name if self.working and self.last_path is not None else ""
        parts = [
            result.unit_text,
            count(result.cycles, "complete cycle") + (f", {result.partial} partial left out" if result.partial else ""),
            readings_text(result),
        ]
        return "   ".join(filter(None, parts))

    def out_of_tolerance(self) -> tuple[str, ...]:
        """Return the figures out of tolerance of a calibration that could be accepted, a sentence a sensor."""
        if self.result is None or obstacle_to(self.result) is not None:
            return ()
        return missed_bounds(self.result, self._sampler())

    def acceptance_warnings(self) -> tuple[str, ...]:
        """Return what prevents acceptance of the curves, then the figures out of tolerance."""
        if self.result is None or missing(self.result) is not None or self.to_check():
            return ()
        obstacle, found = obstacle_to(self.result), self.result.verdict or RunVerdict()
        lines = missed_bounds(self.result, self._sampler(), beside=found.headline)
        return lines if obstacle is None else (str(obstacle), *lines)

    def to_check(self) -> tuple[ReadingToCheck, ...]:
        """Return the readings that must be corrected, left out or confirmed before the calibration is accepted."""
        found = self.result.verdict if self.result is not None else None
        return found.readings if found is not None else ()

    def check_lines(self) -> tuple[str, ...]:
        texts = (in_shown_units(one.text, self.shown_units) for one in self.to_check())
        return tuple(f"Before accepting, check {shown_text(text)}." for text in texts)

    def leave_out_readings(self) -> None:
        """Withdraw the readings to be checked, undoably, and analyse the run again."""
        path, steps = self.last_path, [one.step for one in self.to_check() if one.step is not None]
        if path is None or not steps:
            raise RequestError("the readings are in a file", "Delete their lines there, then analyse again.")
        before: dict[int, float | None] = {}

        def change(values: Mapping[int, float | None]) -> None:
            before.update(change_readings(path, values))
            if self.last_path == path:
                self._start(path)

        text = f"leaving out {count(len(steps), 'reading')}"
        out = dict.fromkeys(steps)
        self._services.undo.push(Change(text, lambda: change(out), lambda: change(dict(before))))

    def obstacle(self) -> Obstacle | None:
        """Return why the calibration cannot be accepted; None when it can."""
        return Obstacle("The run is being analysed") if self.working else obstacle_to(self.result)

    def verdict(self) -> tuple[str, str]:
        """Return (state, text) for the top of the page: what the calibration may be used for."""
        if self.failure is not None:
            return "warning", f"\u25b2 {self.failure.cause}"
        if self.result is None:
            return "", "Analysing \u2026" if self.working else ""
        found = self.result.verdict or RunVerdict()
        headline = in_shown_units(found.headline, self.shown_units)
        if self.working:
            return "", f"\u25cb {shown_text(headline)}"
        state, text = verdict_text(found.state, headline)
        return state, f"\u2713 Accepted: {shown_text(headline)}" if self.accepted is not None else text

    def detail(self) -> str:
        """Return the line under the verdict: what is still computed, where it is used, or the limits."""
        if self.result is None:
            return ""
        found = self.result.verdict or RunVerdict()
        said = found.limits_text.casefold() == found.headline.casefold()
        limits = "" if said else sentence(shown_text(found.limits_text))
        if self.working:
            return "Intervals follow \u2026" if self.result.preliminary else "Analysing again \u2026"
        if self.accepted is not None:
            return f"{'Used on virtual boards' if self.result.simulated else 'Used live'}. {limits}".strip()
        return limits

    def limits_state(self) -> str:
        """Return how the detail is shown: limits that are not kept are no detail."""
        found = self.result.verdict if self.result is not None and not self.working else None
        state = VERDICT_LOOKS[found.limits_state][0] if found is not None and self.detail() else ""
        return "" if state == "ok" else state

    def _sampler(self) -> list[Mapping[str, Any]]:
        return [bands.sampler for bands in self.posterior]

    def curve(self, index: int) -> CurveBands | None:
        """Return a sensor's curve with its bands: the mean of the posterior where it is sampled, else the fit."""
        assert self.result is not None
        return self.posterior[index] if index < len(self.posterior) else self.result.sensors[index].fit

    def agreement(self, index: int) -> Agreement | None:
        """Return the comparison of a sensor with the unit's previous calibration; None where there is none."""
        return self.agreements[index] if index < len(self.agreements) else None

    def comparison(self) -> str:
        """Return the largest difference from the unit's previous calibration, a line a sensor."""
        if self.result is None or not self.result.calibrated:
            return ""
        if self.before is None:
            unit = f"The simulated {self.result.unit}" if self.result.simulated else self.result.unit or "The unit"
            return f"{unit} has no earlier calibration to compare with."
        lines = [f"Compared with the calibration of {self.before.calibrated_utc[:16].replace('T', ' ')} UTC"]
        for i, sensor in enumerate(self.result.sensors):
            found = self.agreement(i)
            if found is None:
                lines.append(f"{sensor.label}: cannot be compared")
                continue
            at = found.worst
            x, apart = Quantity(found.grid[at], "mm", "+.1f"), Quantity(found.difference_mv[at], "mV", "+.1f")
            size = UnitText(apart, " (", Quantity(abs(found.difference_mm[at]), "mm", ".2f"), ") at ", x)
            mark = {True: "\u25cf agrees", False: "\u25b2 differs", None: NOTHING}[found.agrees]
            lines.append(
                f"{sensor.label}: {mark}, E\u2099 = {number(float(found.e_n[at]), 2, sign=True)}: "
                + shown_text(in_shown_units(size, self.units_of_run))
            )
        return "\n".join(lines)

    def coefficient_rows(self) -> list[tuple[Cells, str]]:
        """Return each sensor's coefficients as (name, this calibration, the previous one, E_n), with its tooltip."""
        rows: list[tuple[Cells, str]] = []
        for sensor, found in zip(self.result.sensors if self.result is not None else (), self.agreements, strict=False):
            if found is not None:
                rows.append(((sensor.label, "", "", ""), ""))
                rows += [coefficient_row(sensor.label, c, self.units_of_run) for c in found.coefficients]
        return rows

    def request_acceptance(self, *, anyway: bool = False) -> None:
        """Accept the calibration; one out of tolerance only with `anyway`, which is then offered."""
        missed, notices = self.out_of_tolerance(), self._services.notices
        notices.dismiss(self._asked)
        if missed and not anyway:
            self._asked = notices.add(
                Severity.WARNING,
                f"this calibration is out of tolerance. {'. '.join(missed)}",
                "Check its readings, or accept it as it is.",
                action=(ANYWAY, partial(self.request_acceptance, anyway=True)),
            )
            return
        suffix = " out of tolerance" if missed else ""
        simulated = self.result is not None and self.result.simulated
        use = "virtual boards show elongation" if simulated else "the page Measure shows elongation"
        notices.attempt(self.accept, done=f"Calibration accepted{suffix}; {use}")

    def confirm_readings(self, reason: str) -> None:
        """Keep the readings to be checked, with the reason, and analyse the run again."""
        if self.result is not None and confirm_readings(self.result, reason):
            self.follow_change()

    def accept(self) -> None:
        """Store the calibration with its unit; undo puts the one before into force again."""
        obstacle = self.obstacle()
        if obstacle is not None or self.result is None:
            remedy = "See the warnings, and read or record what is missing."
            raise RequestError(f"this calibration cannot be accepted: {obstacle}".rstrip("."), remedy)
        if self.last_path is not None and not self.last_path.exists():  # the calibration could never be verified
            raise RequestError(f"{self.last_path} is gone", "Put the recording back, or analyse another one.")
        record = accepted_record(self.result, self._sampler())
        text = f"acceptance of {record.unit} by {Path(self.result.path).name}"
        self._services.undo.push(Change(text, *self._acceptance(self.result, record)))

    def _acceptance(self, result: RunResult, record: CalibrationRecord) -> tuple[Action, Action]:
        """Return acceptance and its reversal; both only add to the unit's history."""
        units = self._units_of(result)
        before = units.load(record.unit).calibration

        def redo() -> None:
            accept(units, replace(record, recording=Path(result.path).name))
            self._in_force()

        def undo() -> None:
            withdraw(units, record.unit, before)
            self._in_force()

        return redo, undo

    def _in_force(self) -> None:
        self.accepted = self._own_in_force()
        self.units_revision += 1
        self.revision += 1


def _agreement(sensor: SensorResult, before: SensorRecord) -> Agreement | None:
    """Return the comparison of two fits of a sensor; None without a fit or a shared range."""
    if sensor.void:
        return None
    try:
        return compare_fits(sensor.record.fit, before.fit)
    except (BoatDaqError, KeyError):
        return None


def traceability_text(found: Traceability | None) -> str:
    """Return whether an elongation is traceable, as a sentence with its mark; empty where it is not known."""
    if found is not None and found.missing:
        return f"\u25b2 Not traceable: enter the uncertainty of {', '.join(found.missing)}."
    mark = "\u25cf" if found is not None and found.traceable else "\u25b2"
    return f"{mark} An elongation is {found.text}." if found is not None else ""
