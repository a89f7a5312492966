"""The dynamics of a run under control: its steps and sines of elongation. For a window and a report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from boat_daq.engine.settings import UnitLibrary
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.common.tolerance import TypedTolerance, tolerance_choice
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from boat_daq.workflows.unit_control import SETTLED_MM, dynamics_of, report_dynamics

if TYPE_CHECKING:
    from analysis.elongation_control.dynamic_figures import DynamicCalibration


SUGGESTED = tuple(TypedTolerance(mm, "mm") for mm in (0.02, SETTLED_MM, 0.1))


class DynamicsModel:
    """State of the window of a run's dynamics."""

    def __init__(self, units: UnitLibrary, path: Path, jobs: JobRunner, services: Services) -> None:
        self.path, self._units, self._jobs, self._notices = path, units, jobs, services.notices
        self.found: DynamicCalibration | None = None
        self.failed = ""
        self.settling = tolerance_choice(services, "the tolerance of settling", SUGGESTED, self._compute)
        if self.settling.value is None:  # else it is computed already
            self._compute(None)

    def _compute(self, tolerance: TypedTolerance | None) -> None:
        """Compute the dynamics by a tolerance of settling, the usual one for None."""
        within_mm, self.failed = SETTLED_MM if tolerance is None else tolerance.value, ""
        job = Job(f"Computing the dynamics of {self.path.name}", dynamics_of, self._units, self.path, within_mm)
        self._start("dynamics", job, self._take)

    def _take(self, found: DynamicCalibration) -> None:
        self.found = found

    def report(self, target: Path) -> None:
        """Write the report, HTML or PDF, in the background; the dynamics are computed."""
        assert self.found is not None
        job = Job(f"Making the report of {self.path.name}", report_dynamics, self.found, target)
        job.target = target
        self._start("dynamics report", job, lambda _: self._notices.inform_saved(target))

    def _start(self, slot: str, job: Job, done: Callable[[Any], None]) -> None:
        def ended(job: Job) -> None:
            if job.failure is not None:
                self.failed = job.failure.cause
                self._notices.add(Severity.WARNING, job.failure.cause, job.failure.remedy, details=job.failure.details)
            elif job.state is JobState.DONE:
                done(job.result)

        self._jobs.start(slot, job, ended)
