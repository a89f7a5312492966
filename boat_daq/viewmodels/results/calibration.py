"""The calibration page: a run is analysed in the background, looked at, compared, accepted.

Rules: nothing is computed on the window's own threads. What is accepted is stored with the unit, as a new entry that is
never changed, together with the points it rests on, and is used live at once. A curve that turns inside its range, or a
simulated run for a real unit, is never accepted quietly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import FloatArray
from analysis.calibration.compare import Agreement, compare_fits
from analysis.errors import AnalysisError
from analysis.fidelity import Fidelity, fidelity
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import StoredCalibration, UnitLibrary
from boat_daq.engine.snapshot import SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.formatting import NOTHING, count, duration, number, sensor_words
from boat_daq.viewmodels.common.jobs import Job, JobRunner, JobState
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.common.undo import Change
from boat_daq.viewmodels.results.acceptance import Missing, missing, poor, remarks, rests_on
from boat_daq.viewmodels.results.analysis_view import Band, PosteriorResult, RunResult, SensorResult
from boat_daq.viewmodels.results.calibration_jobs import analyse_run, sample_run

TURNS = "the curve turns inside its range, so that one signal would stand for two elongations."
BUSY = (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING)


@dataclass(frozen=True, slots=True)
class CurveShown:
    """One sensor's curve with the bands that belong to it, and the residuals about it, mV.

    `source` is "least squares", or "posterior" once it is sampled: its mean curve is then the one drawn. `last` is the
    unit's last calibration over the shared range: grid, its curve, its curve less this fit; None where there is none.
    """

    source: str
    grid: FloatArray
    curve: FloatArray
    band_68: Band
    band_95: Band
    new_reading_95: Band | None
    residuals: FloatArray
    last: tuple[FloatArray, FloatArray, FloatArray] | None


@dataclass(frozen=True, slots=True)
class CoefficientRow:
    """A coefficient side by side: name, this calibration, the last one, E_n."""

    cells: tuple[str, str, str, str]
    hover: str


class CalibrationModel:
    """State of the page.

    Parameters
    ----------
    session : its recording is closed before it is analysed.
    units : where calibrations are kept.
    jobs : where the work is done.
    services : of the window.
    newest : returns the newest recording, also of an earlier start.
    """

    def __init__(
        self,
        session: Session,
        units: UnitLibrary,
        jobs: JobRunner,
        services: Services,
        newest: Callable[[], Path | None] = lambda: None,
    ) -> None:
        self.session, self.units, self.jobs = session, units, jobs
        self._services, self._newest = services, newest
        self.fidelity: Fidelity = fidelity()
        self.result: RunResult | None = None
        self.before: StoredCalibration | None = None  # the unit's calibration in force when the run was analysed
        self.agreements: tuple[Agreement | None, ...] = ()
        self.posterior: tuple[PosteriorResult, ...] = ()
        self.failure: Any = None
        self.last_path: Path | None = None
        self.accepted: StoredCalibration | None = None
        self.revision = 0
        self.units_revision = 0  # grows whenever a unit's calibration in force changes

    @property
    def working(self) -> bool:
        """Whether an analysis is under way."""
        return self.jobs.get("analysis") is not None

    def analyse_current(self) -> None:
        """Close the recording that runs and analyse it; the last one where none runs, of an earlier start too.

        Raises
        ------
        OperatorError : a sequence runs, or there is no recording.
        """
        snapshot = self.session.snapshot()
        if snapshot.state in BUSY:
            raise OperatorError("the sequence still runs", "Wait for its end, or stop it; its whole cycles count.")
        if snapshot.recording is not None:
            self.last_path = self.session.stop_recording() or snapshot.recording
        self.last_path = self.last_path or self._newest()
        if self.last_path is None:
            raise OperatorError("nothing has been recorded yet", "Run a plan, or open a recording on the Runs page.")
        self.analyse(self.last_path)

    def analyse(self, path: Path) -> None:
        """Analyse a recording in the background."""
        self.last_path, self.result, self.posterior, self.failure, self.accepted = path, None, (), None, None
        self.before, self.agreements = None, ()
        self.revision += 1
        self.jobs.start(
            "analysis",
            Job(f"Analysing {path.name}", analyse_run, str(path), level=self.fidelity.level),
            self._analysed,
        )

    def _analysed(self, job: Job) -> None:
        self.failure = job.failure
        self.show(job.result)

    def show(self, result: RunResult | None) -> None:
        """Show a result, beside the unit's calibration in force.

        Raises
        ------
        OperatorError : the unit's file is refused.
        """
        self.result = result
        self.revision += 1
        self.before = self.units.load(result.unit).calibration if result is not None and result.unit else None
        if result is not None and self.before is not None:
            self.agreements = tuple(map(_agreement, result.sensors, self.before.content.get("sensors", [])))

    def set_fidelity(self, level: Fidelity) -> None:
        """Analyse and sample as finely as this from now on."""
        self.fidelity = level

    def sample(self) -> None:
        """Sample the posterior in the background.

        Raises
        ------
        OperatorError : there is no calibration to sample.
        """
        if self.result is None or not self.result.calibrated:
            raise OperatorError("there is no calibration yet", "Analyse a run with readings first.")
        contents = [s.content or {} for s in self.result.sensors]
        points = [(c["elongation_mm"], c["signal_mv"], int(c["fit"]["degree"]), c.get("positions")) for c in contents]
        job = Job(
            "Computing uncertainty bands",
            sample_run,
            points,
            self.result.reading_sd_mm,
            max_steps=self.fidelity.posterior_steps,
        )
        self.jobs.start("posterior", job, self._sampled)

    def _sampled(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.posterior = job.result
        elif job.state is JobState.FAILED:
            self.failure = job.failure
        self.revision += 1

    # ---- what the page says --------------------------------------------------------------------------------------

    def headline(self) -> str:
        """Return run and size in a line; the remedy of what failed."""
        result = self.result
        if self.failure is not None:
            return str(self.failure.remedy)
        if result is None:
            return self.last_path.name if self.working and self.last_path is not None else ""
        parts = [
            result.unit or "no unit",
            count(result.cycles, "complete cycle") + (f", {result.partial} partial left out" if result.partial else ""),
            rests_on(result),
            duration(result.duration_s),
        ]
        return "   ".join(filter(None, parts))

    def poor(self) -> tuple[str, ...]:
        """Return what is poor about the calibration that could be accepted, a sentence a sensor."""
        if self.result is None or self.obstacle():
            return ()
        return poor(self.result, self.posterior)

    def against(self) -> tuple[str, ...]:
        """Return all that speaks against the curves that there are: what refuses it, then what is poor."""
        if self.result is None or self.missing() is not None:
            return ()
        obstacle = self.obstacle()
        return (*([obstacle] if obstacle else []), *poor(self.result, self.posterior))

    def remarks(self) -> tuple[str, ...]:
        """Return the flags of the run."""
        return () if self.result is None else remarks(self.result)

    def missing(self) -> Missing | None:
        """Return what is missing for a curve; None where there is one, or nothing is analysed."""
        return None if self.result is None else missing(self.result)

    def obstacle(self) -> str:
        """Return why the calibration cannot be accepted; empty when it can."""
        if self.result is None:
            return "Nothing is analysed yet."
        for sensor in self.result.sensors:
            if sensor.content is None:
                return self._void(sensor)
            if not sensor.content["fit"]["monotone"]:
                return f"{sensor_words(sensor.name)}: {TURNS}"
        return "" if self.result.sensors else "The run has no sensor."

    def _void(self, sensor: SensorResult) -> str:
        lacking = self.missing()
        return f"{lacking.title}." if lacking is not None else f"{sensor_words(sensor.name)}: {sensor.void}."

    def verdict(self) -> tuple[str, str]:
        """Return (state, words) for the top of the page."""
        if self.failure is not None:
            return "fault", f"\u25a0 {self.failure.cause}"
        if self.result is None:
            return "", "Analysing \u2026" if self.working else ""
        if self.accepted is not None:
            though = " though poor" if self.poor() else ""
            return "warning" if though else "ok", f"\u2713 Accepted{though}: stored with the unit and used live"
        obstacle = self.obstacle()
        if obstacle:
            return "warning", f"\u25b2 Not a calibration: {_short(obstacle)}"
        if self.poor():
            return "warning", "\u25b2 A poor calibration: figures miss their bounds"
        fits = "   ".join(
            f"{sensor_words(s.name)}: R\u00b2 = {number((s.content or {})['fit']['r2'], 5)}"
            for s in self.result.sensors
        )
        return "ok", f"\u25cf {fits}"

    def shown(self, index: int) -> CurveShown:
        """Return what is drawn of a sensor: the posterior's mean curve with its bands, or the fit with its own."""
        assert self.result is not None
        sensor, agreement = self.result.sensors[index], self.agreement(index)
        last = None if agreement is None else (agreement.grid, agreement.before_mv, -agreement.difference_mv)
        if index >= len(self.posterior):
            bands = (sensor.band_68, sensor.band_95, None)
            return CurveShown("least squares", sensor.grid, sensor.curve, *bands, sensor.residuals, last)
        found = self.posterior[index]
        bands_of = (found.curve_68, found.curve_95, found.new_reading_95)
        residuals = sensor.y - np.interp(sensor.x, found.grid, found.mean)
        return CurveShown("posterior", found.grid, found.mean, *bands_of, residuals, last)

    def agreement(self, index: int) -> Agreement | None:
        """Return how a sensor compares with the unit's last calibration; None where there is nothing to compare."""
        return self.agreements[index] if index < len(self.agreements) else None

    def comparison(self) -> str:
        """Return how this calibration differs from the unit's last, a line a sensor."""
        if self.result is None or not self.result.calibrated:
            return ""
        if self.before is None:
            return f"{self.result.unit or 'The unit'} has no earlier calibration to compare with."
        lines = [f"Against the calibration of {self.before.utc[:16].replace('T', ' ')} UTC"]
        for i, sensor in enumerate(self.result.sensors):
            found, name = self.agreement(i), sensor_words(sensor.name)
            if found is None:
                lines.append(f"{name}: cannot be compared")
                continue
            at = found.worst
            x, apart, mm = (float(v[at]) for v in (found.grid, found.difference_mv, found.difference_mm))
            mark = {True: "\u25cf agrees", False: "\u25b2 differs", None: NOTHING}[found.agrees]
            lines.append(
                f"{name}: {mark}, E\u2099 = {number(float(found.e_n[at]), 2, sign=True)}: "
                f"{number(apart, 1, sign=True)} mV ({number(abs(mm), 2)} mm) at {number(x, 1, sign=True)} mm"
            )
        return "\n".join(lines)

    def coefficient_rows(self) -> tuple[CoefficientRow, ...]:
        """Return the coefficients of every sensor, this calibration's and the last one's."""
        rows = []
        for i, sensor in enumerate(self.result.sensors if self.result is not None else ()):
            found = self.agreement(i)
            for c in found.coefficients if found is not None else ():
                apart, spread = c.value - c.value_before, 2 * float(np.hypot(c.std_error, c.std_error_before))
                name = f"b{_SUBSCRIPTS[c.power]}, {sensor_words(sensor.name).removeprefix('Sensor ')}"
                cells = (
                    name, measured(c.value, c.std_error), measured(c.value_before, c.std_error_before),
                    number(apart / spread, 2, sign=True) if spread > 0 else NOTHING,
                )  # fmt: skip
                unit = f"mV/mm{_superscript(c.power)}" if c.power else "mV"
                rows.append(
                    CoefficientRow(
                        cells,
                        f"{sensor_words(sensor.name)}: coefficient of x{_superscript(c.power)}, {unit}, with its "
                        "standard error; E\u2099 = difference / (2 \u00b7 root of the sum of their squares)",
                    )
                )
        return tuple(rows)

    def request_acceptance(self, *, anyway: bool = False) -> None:
        """Accept the calibration; one below its bounds only with `anyway`, which is offered."""
        poor, notices = self.poor(), self._services.notices
        if poor and not anyway:
            notices.say(
                Severity.WARNING,
                f"this calibration is poor. {'. '.join(poor)}",
                "Look at its readings, or accept it as it is.",
                action_text="Accept anyway",
                action=partial(self.request_acceptance, anyway=True),
            )
            return
        done = f"Calibration accepted{' though poor' if poor else ''}; the elongation is shown on the Live page"
        notices.attempt(self.accept, done=done)

    def accept(self, operator: str = "") -> dict[str, Any]:
        """Store the calibration with its unit, undoably; returns what was stored.

        Undo adds a newer entry: the calibration before it comes back into force, or none is.

        Raises
        ------
        OperatorError : what stands in the way.
        StorageError : the unit's file cannot be written.
        """
        obstacle = self.obstacle()
        if obstacle or self.result is None:
            raise OperatorError(
                f"this cannot be accepted: {obstacle}", "See the flags, and read or record what is missing."
            )
        content: dict[str, Any] = {
            "sensors": [dict(s.content or {}) for s in self.result.sensors],
            "simulated": self.result.simulated,
            "cycles": self.result.cycles,
            "posterior": [dict(p.content) for p in self.posterior],
            "poor": list(self.poor()),
        }
        self._services.undo.push(Change("acceptance", *self._acceptance(self.result, finite(content), operator)))
        return content

    def _acceptance(
        self, result: RunResult, content: dict[str, Any], operator: str
    ) -> tuple[Callable[[], None], Callable[[], None]]:
        """Return the deed and its way back; both only add to the unit's history."""
        name, before = result.unit, self.units.load(result.unit).calibration

        def redo() -> None:
            recording = Path(result.path).name
            unit = self.units.add_calibration(name, content, recording=recording, operator=operator)
            self._in_force(result, unit.calibration)

        def undo() -> None:
            if before is None:
                self.units.add_calibration(name, {}, accepted=False, operator=operator, note="acceptance undone")
            else:
                self.units.add_calibration(
                    name, before.content, recording=before.recording, operator=operator, note="in force again"
                )
            self._in_force(result, None)

        return redo, undo

    def _in_force(self, result: RunResult, accepted: StoredCalibration | None) -> None:
        if self.result is result:
            self.accepted = accepted
        self.units_revision += 1
        self.revision += 1


def _short(obstacle: str) -> str:
    """Return an obstacle as the verdict says it, without its reason."""
    return obstacle.partition(", so that")[0]


def measured(value: float, std_error: float) -> str:
    """Return a value with its standard error in parentheses, in units of the last digit: `39.34(12)`."""
    if not (np.isfinite(value) and np.isfinite(std_error) and std_error > 0):
        return number(value, 3)
    places = max(0, 1 - int(np.floor(np.log10(float(f"{std_error:.1e}")))))
    return f"{number(value, places)}({round(std_error * 10**places)})"


_SUBSCRIPTS = "\u2080\u2081\u2082\u2083\u2084\u2085\u2086\u2087\u2088\u2089"


def _superscript(power: int) -> str:
    digits = "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
    return "" if power == 1 else "".join(digits[int(d)] for d in f"{power}")


def _agreement(sensor: SensorResult, before: Mapping[str, Any]) -> Agreement | None:
    """Return how two fits of a sensor compare; None where there is no fit, or no shared range."""
    if sensor.content is None:
        return None
    try:
        return compare_fits(sensor.content["fit"], before["fit"])
    except (AnalysisError, KeyError):
        return None


def finite(value: Any) -> Any:
    """Return a JSON value with null where a number is not finite, which JSON cannot say."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
