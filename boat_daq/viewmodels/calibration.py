"""The calibration page: a run is analysed in the background, looked at, compared, accepted.

Rules: nothing is computed on the window's own threads. What is accepted is stored with the unit, as a new entry that is
never changed, together with the points it rests on, and is used live at once. A curve that turns inside its range, or a
simulated run for a real unit, is never accepted quietly.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from boat_daq.engine.session import Session, SessionState
from boat_daq.engine.settings import StoredCalibration, UnitLibrary
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.formatting import count, duration, number
from boat_daq.viewmodels.results import PosteriorResult, RunResult
from boat_daq.viewmodels.work import Bench, Work, WorkState

ANALYSIS = "boat_daq.viewmodels.calibration_work:analyse_run"
POSTERIOR = "boat_daq.viewmodels.calibration_work:sample_run"
BUSY = (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING)


class CalibrationModel:
    """State of the page.

    Parameters
    ----------
    session : its recording is closed before it is analysed.
    units : where calibrations are kept.
    bench : where the work is done.
    """

    def __init__(self, session: Session, units: UnitLibrary, bench: Bench) -> None:
        self.session, self.units, self.bench = session, units, bench
        self.result: RunResult | None = None
        self.posterior: tuple[PosteriorResult, ...] = ()
        self.failure: Any = None
        self.last_path: Path | None = None
        self.accepted: StoredCalibration | None = None
        self.revision = 0

    @property
    def working(self) -> bool:
        """Whether an analysis is under way."""
        return self.bench.get("analysis") is not None

    def analyse_current(self) -> None:
        """Close the recording that runs and analyse it; the last one where none runs.

        Raises
        ------
        OperatorError : a sequence runs, or there is no recording.
        """
        snapshot = self.session.snapshot()
        if snapshot.state in BUSY:
            raise OperatorError("the sequence still runs", "Wait for its end, or stop it; its whole cycles count.")
        if snapshot.recording is not None:
            self.last_path = self.session.stop_recording() or snapshot.recording
        if self.last_path is None:
            raise OperatorError("nothing has been recorded yet", "Run a plan, or open a recording on the Runs page.")
        self.analyse(self.last_path)

    def analyse(self, path: Path) -> None:
        """Analyse a recording in the background."""
        self.last_path, self.result, self.posterior, self.failure, self.accepted = path, None, (), None, None
        self.revision += 1
        self.bench.start("analysis", Work(f"Analysing {path.name}", ANALYSIS, str(path), report=True), self._analysed)

    def _analysed(self, work: Work) -> None:
        self.result, self.failure = work.result, work.failure
        self.revision += 1

    def sample(self) -> None:
        """Sample the posterior in the background.

        Raises
        ------
        OperatorError : there is no calibration to sample.
        """
        if self.result is None or not self.result.calibrated:
            raise OperatorError("there is no calibration yet", "Analyse a run with readings first.")
        points = [(s.x.tolist(), s.y.tolist(), int((s.content or {})["fit"]["degree"])) for s in self.result.sensors]
        work = Work("Sampling the posterior", POSTERIOR, points, self.result.reading_sd_mm, report=True)
        self.bench.start("posterior", work, self._sampled)

    def _sampled(self, work: Work) -> None:
        if work.state is WorkState.DONE:
            self.posterior = work.result
        elif work.state is WorkState.FAILED:
            self.failure = work.failure
        self.revision += 1

    # ---- what the page says --------------------------------------------------------------------------------------

    def headline(self) -> str:
        """Return run and size in a line."""
        result = self.result
        if result is None:
            return "Analysing …" if self.working else ""
        parts = [result.unit or "no unit", count(result.cycles, "complete cycle"), duration(result.duration_s)]
        if result.partial:
            parts.insert(2, f"{result.partial} partial, left out")
        return "   ".join(parts)

    def obstacle(self) -> str:
        """Return why the calibration cannot be accepted; empty when it can."""
        if self.result is None:
            return "Nothing is analysed yet."
        for sensor in self.result.sensors:
            if sensor.content is None:
                return f"{sensor_words(sensor.name)}: {sensor.void}."
            if not sensor.content["fit"]["monotone"]:
                return f"{sensor_words(sensor.name)}: the curve turns inside its range, so it has no inverse."
        return "" if self.result.sensors else "The run has no sensor."

    def verdict(self) -> tuple[str, str]:
        """Return (state, words) for the top of the page."""
        if self.failure is not None:
            return "fault", f"{self.failure.cause}. {self.failure.remedy}".strip()
        if self.result is None:
            return "", ""
        if self.accepted is not None:
            return "ok", "\u2713 Accepted: stored with the unit and used live"
        obstacle = self.obstacle()
        if obstacle:
            return "warning", f"\u25b2 Not a calibration: {obstacle}"
        fits = "   ".join(
            f"{sensor_words(s.name)}: R\u00b2 = {number((s.content or {})['fit']['r2'], 5)}"
            for s in self.result.sensors
        )
        return "ok", f"\u25cf {fits}"

    def previous(self) -> StoredCalibration | None:
        """Return the unit's calibration in force before this one."""
        if self.result is None or not self.result.unit:
            return None
        history = [entry for entry in self.units.load(self.result.unit).history if entry.accepted]
        if self.accepted is not None and history:
            history = history[:-1]
        return history[-1] if history else None

    def comparison(self) -> str:
        """Return how this calibration differs from the unit's last, in a line."""
        if self.result is None or not self.result.calibrated:
            return ""
        before = self.previous()
        if before is None:
            return f"{self.result.unit or 'The unit'} has no earlier calibration to compare with."
        parts = []
        for sensor, old in zip(self.result.sensors, before.content.get("sensors", []), strict=False):
            apart = np.polynomial.polynomial.polyval(sensor.grid, old["fit"]["coefficients"]) - sensor.curve
            worst = int(np.argmax(np.abs(apart)))
            mm = abs(apart[worst] / sensor.slope[worst]) if sensor.slope[worst] else float("nan")
            parts.append(
                f"{sensor_words(sensor.name)} {number(float(-apart[worst]), 1, sign=True)} mV "
                f"({number(float(mm), 2)} mm) at {number(float(sensor.grid[worst]), 1, sign=True)} mm"
            )
        return f"Against the calibration of {before.utc[:10]}, at most: " + ",   ".join(parts)

    def previous_curve(self, index: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]] | None:
        """Return the unit's last curve of a sensor over the present range; None where there is none."""
        before = self.previous()
        if self.result is None or before is None or index >= len(before.content.get("sensors", [])):
            return None
        grid = self.result.sensors[index].grid
        old = before.content["sensors"][index]["fit"]["coefficients"]
        return grid, np.asarray(np.polynomial.polynomial.polyval(grid, old))

    def accept(self, operator: str = "") -> dict[str, Any]:
        """Store the calibration with its unit; returns what was stored.

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
        }
        recording = Path(self.result.path).name
        unit = self.units.add_calibration(self.result.unit, finite(content), recording=recording, operator=operator)
        self.accepted = unit.calibration
        self.revision += 1
        return content


def sensor_words(name: str) -> str:
    """Return `s1` or `s1_mv` as `Sensor 1`."""
    digits = "".join(c for c in name if c.isdigit())
    return f"Sensor {digits}" if digits else name


def finite(value: Any) -> Any:
    """Return a JSON value with null where a number is not finite, which JSON cannot say."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
