"""A result of a helper process: started and stopped by one button, stored in a file, restored at the next start."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from boat_daq.engine.toml_values import read_json
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from protocol.base.errors import RequestError
from protocol.base.whole_file import write_whole

RESULT_MAX_BYTES = 4_000_000  # a hundred times the largest


class MeasuredResult(ABC):
    """State of one kind of result; the last one is kept in a JSON file."""

    name: str
    """The job's name in the runner."""
    noun: str
    """Name of the result in messages."""
    again: str
    """Remedy when the stored one cannot be read."""

    def __init__(self, jobs: JobRunner, path: Path) -> None:
        self.jobs, self.path = jobs, path
        self.content: dict[str, Any] | None = None
        self.problem = ""
        self.revision = 0
        try:
            if path.exists():
                self.take(read_json(path, RESULT_MAX_BYTES))
        except RequestError:
            self.problem = f"the last {self.noun} could not be read; {self.again}"

    @abstractmethod
    def _read(self, content: Any) -> None:
        """Read a result for the page."""

    @abstractmethod
    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        """Return a new result, merged with the one before."""

    @property
    def job(self) -> Job | None:
        """Return the running job."""
        return self.jobs.get(self.name)

    def _toggle(self, job: Job) -> None:
        """Start a job, or stop the running one."""
        if self.job is not None:
            self.jobs.cancel(self.name)
            return
        self.jobs.start(self.name, job, self._ended)
        self.problem = ""
        self.revision += 1

    def _ended(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.take(self._joined(job.result))
            self._store()
        elif job.failure is not None:
            self.problem = job.failure.text
        self.revision += 1

    def take(self, content: Any) -> None:
        """Show a result."""
        self._read(content)
        self.content = content
        self.problem = ""
        self.revision += 1

    def _store(self) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._write_json(self.path)
        except OSError as error:
            self.problem = f"the {self.noun} could not be stored for the next start: {error.strerror}"

    def _write_json(self, path: Path) -> None:
        write_whole(path, json.dumps(self.content, indent=1, ensure_ascii=False))

    def _progress_text(self, what: str = "") -> str:
        """Return the progress of the job, or the problem; empty without either."""
        job = self.job
        if job is not None:
            return f"{what or job.label} \u2026 {round(100 * (job.fraction or 0.0))} %"
        return f"\u25b2 {self.problem}" if self.problem else ""
