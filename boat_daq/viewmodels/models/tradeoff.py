"""Speed and accuracy: time and error of each method's default, as shipped or as measured on this computer.

The shipped measurement is shown until this computer has one of its own, which is kept beside the window's preferences.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.studies.tradeoff.references import load
from boat_daq.engine.toml_values import read_json
from boat_daq.workflows import measured_methods
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from protocol.base.errors import RequestError
from protocol.base.whole_file import write_whole

METHOD_NAMES = {
    "tracer": "Ray tracer",
    "ranking": "Ranking of designs",
    "full-fem": "Full actuator model",
    "reduced-fem": "Fast actuator model",
    "posterior": "Posterior sampling",
    "inverse": "Signal to elongation",
    "segmentation": "Plateaus and cycles",
    "bootstrap": "Intervals (bootstrap)",
    "tracking": "Camera",
    "calibration": "Job: calibration",
    "report": "Job: report",
    "sweep": "Job: paper's sweep",
}
"""Every method that can be measured, by its name in the command; a test compares it with the command's list."""
JOB_NAMES = ("calibration", "report", "sweep")
"""Methods that are whole jobs, from the input to the result."""
_JOB = "tradeoff"
RESULT_MAX_BYTES = 4_000_000  # a hundred times the largest


@dataclass(frozen=True, slots=True)
class Default:
    """The default of one method: processor time (s) of a call and error, NaN where it was not measured or failed."""

    name: str
    setting: str = "not measured"
    seconds: float = math.nan
    per: str = ""
    error: float = math.nan
    tolerance: float = math.nan
    unit: str = ""
    explanation: str = ""

    @property
    def measured(self) -> bool:
        """Whether it has a place in the chart."""
        return math.isfinite(self.error) and self.seconds > 0

    @property
    def share(self) -> float:
        """Its error divided by the tolerance; NaN without a measurement, never zero."""
        return self.error / self.tolerance


def read_report(content: Any) -> list[Default]:
    try:
        found = {str(m["name"]): _default(m) for m in content["methods"]}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RequestError("this file is not a measured trade-off", "Measure this computer again.") from error
    return [found.get(name, Default(name)) for name in METHOD_NAMES]


def _default(m: Mapping[str, Any]) -> Default:
    points = {str(p["setting"]): p for p in m["points"]}
    setting, chosen = str(m["default"]), m["chosen"]
    p = points.get(setting)
    choice = "" if chosen == setting else f"\nHere {chosen or 'no setting'} would be the fastest that is exact enough."
    tolerance = f"Tolerance: {m['consumer']} ({m['tolerance']:.2g} {m['unit']})"
    per = f"Time for {m['per']}.\n" if p is not None else ""
    explanation = f"{per}{tolerance}.\nMeasured against {m['reference']}.{choice}"
    seconds, error = (math.nan, None) if p is None else (float(p["cpu_seconds"]), p["error"])
    return Default(
        str(m["name"]), setting, seconds, str(m["per"]), math.nan if error is None else float(error),
        float(m["tolerance"]), str(m["unit"]), explanation,
    )  # fmt: skip


class TradeoffModel:
    """State of the page; `defaults` are those of `METHOD_NAMES`, in its order."""

    def __init__(self, jobs: JobRunner, folder: Path) -> None:
        self.jobs, self.path = jobs, folder / "tradeoff.json"
        self.revision = 0
        self.problem = ""
        self.own = False
        try:
            if self.path.exists():
                self.take(read_json(self.path, RESULT_MAX_BYTES), own=True)
        except RequestError:
            self.problem = "the last result could not be read; measure again"
        if not self.own:
            self.take(load("measured"), own=False)

    @property
    def job(self) -> Job | None:
        return self.jobs.get(_JOB)

    def toggle(self) -> None:
        if self.job is not None:
            self.jobs.cancel(_JOB)
            return
        self.jobs.start(_JOB, Job("Measuring this computer", measured_methods.measure_methods), self._ended)
        self.problem = ""

    def _ended(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.take(job.result, own=True)
            self._store(job.result)
        elif job.failure is not None:
            self.problem = job.failure.text

    def take(self, content: Any, *, own: bool) -> None:
        self.defaults, self.own = read_report(content), own
        machine = content.get("machine", {})
        whose = "This computer" if own else "Shipped measurement"
        self.measured = f"{whose}: {machine.get('processor')}, {str(machine.get('date_utc'))[:10]}"
        self.revision += 1

    def _store(self, content: Any) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.path, json.dumps(content, indent=1, ensure_ascii=False))
        except OSError as error:
            self.problem = f"the result could not be stored for the next start: {error.strerror}"

    def status(self) -> str:
        """Return what went wrong, in a line."""
        return f"\u25b2 {self.problem}" if self.problem else ""
