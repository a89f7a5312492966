"""Computations in helper processes, with progress and cancel: VENT never waits for a computation.

A job's function runs in a spawned interpreter, so that neither its CPU time nor its interpreter lock is the window's.
It is a function of a module, passed by reference; modules of jobs import their libraries inside the
functions, so that the window starts without them. Only picklable values cross. Nothing here calls back; the window
calls `poll()` from its one timer.
"""

from __future__ import annotations

import inspect
import multiprocessing
import os
import sys
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from time import monotonic
from typing import Any, Generic, ParamSpec, TypeVar

from protocol.base.errors import cause_and_remedy
from protocol.base.whole_file import remove_unfinished

P = ParamSpec("P")
T = TypeVar("T")
_SPAWN = multiprocessing.get_context("spawn")
REPORT_EVERY_S = 0.05
_LOWEST_NICE = 19


class JobState(Enum):
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class JobFailure:
    """Why a job failed: cause and remedy for the status strip, details on request."""

    cause: str
    remedy: str
    details: str

    @property
    def text(self) -> str:
        return f"{self.cause}. {self.remedy}".strip()


@dataclass(frozen=True, slots=True)
class First:
    """A result that a job sends before its last one."""

    result: object


def _yield_to_acquisition() -> None:
    """Give this process the lowest priority, and leave one core to the threads that read, record and control."""
    if sys.platform == "win32":
        import ctypes

        ctypes.windll.kernel32.SetPriorityClass(ctypes.windll.kernel32.GetCurrentProcess(), 0x40)  # IDLE_PRIORITY_CLASS
    else:
        os.setpriority(os.PRIO_PROCESS, 0, _LOWEST_NICE)
    if sys.platform == "linux" and len(cores := sorted(os.sched_getaffinity(0))) > 1:
        os.sched_setaffinity(0, cores[1:])


def _run(pipe: Connection, function: Callable[..., object], args: tuple[Any, ...], kwargs: dict[str, Any]) -> None:
    """Run in the helper process: send (RUNNING, fraction), then (DONE, result) or (FAILED, JobFailure)."""
    _yield_to_acquisition()
    last = 0.0

    def progress(done: float, total: float, /) -> None:
        nonlocal last
        if monotonic() - last >= REPORT_EVERY_S or done >= total:
            last = monotonic()
            pipe.send((JobState.RUNNING, (float(done), float(total))))

    try:
        parameters = inspect.signature(function).parameters
        if "progress" in parameters:
            kwargs = {**kwargs, "progress": progress}
        if "first" in parameters:
            kwargs = {**kwargs, "first": lambda result: pipe.send((JobState.RUNNING, First(result)))}
        pipe.send((JobState.DONE, function(*args, **kwargs)))
    except BaseException as error:  # noqa: BLE001 - the window decides; nothing may be lost on the way
        known = cause_and_remedy(error) or (f"{type(error).__name__}: {error}", "")
        with suppress(OSError):  # the window is gone
            pipe.send((JobState.FAILED, JobFailure(*known, traceback.format_exc())))
    finally:
        pipe.close()


_prepared: list[tuple[Connection, SpawnProcess]] = []  # at most one helper that waits for a job


def _wait_and_run(pipe: Connection, load: Callable[[], object]) -> None:
    """Load libraries in the helper process, then run the job that comes."""
    _yield_to_acquisition()
    load()
    with suppress(EOFError):  # the window is gone
        _run(pipe, *pipe.recv())


def prepare(load: Callable[[], object]) -> None:
    """Start the helper of the next job now, and have it load its libraries while nobody waits for it."""
    if not _prepared:
        pipe, child = _SPAWN.Pipe()
        process = _SPAWN.Process(target=_wait_and_run, args=(child, load), daemon=True)
        process.start()
        child.close()
        _prepared.append((pipe, process))


class Job:
    """A function of a module that runs in its own process.

    Its parameters `progress` and `first`, if any, take (done, total) and a result that is shown before the last one.
    """

    def __init__(self, label: str, function: Callable[P, object], /, *args: P.args, **kwargs: P.kwargs) -> None:
        self.label = label
        self.counts = ""  # plural of what its progress is counted in, if that is shown
        self.counted = ""
        self.state = JobState.RUNNING
        self.fraction: float | None = None
        self.result: Any = None
        self.first: Any = None
        self.failure: JobFailure | None = None
        self.target: Path | None = None  # that it writes: no part of it is left where it is cancelled
        if _prepared:
            self._pipe, self._process = _prepared.pop()
            with suppress(OSError):  # it has died since
                self._pipe.send((function, args, kwargs))
                return
        self._pipe, child = _SPAWN.Pipe(duplex=False)
        self._process = _SPAWN.Process(target=_run, args=(child, function, args, kwargs), daemon=True)
        self._process.start()
        child.close()

    @property
    def permille(self) -> int:
        """Return the progress in thousandths."""
        return round(1000 * (self.fraction or 0.0))

    def poll(self) -> JobState:
        """Take what the process has sent and return the state; never block."""
        while self.state is JobState.RUNNING and self._pipe.poll():
            try:
                state, value = self._pipe.recv()
            except (EOFError, OSError):  # a reset, where it died with the job unread
                self._process.join(0.2)
                details = f"exit code {self._process.exitcode}"
                cause = f"{self.label}: the process ended without a result"
                state, value = JobState.FAILED, JobFailure(cause, "Start it again.", details)
            if isinstance(value, First):
                self.first = value.result
                continue
            if state is JobState.RUNNING:
                done, total = value
                self.fraction = done / total if total else None
                self.counted = f"{self.label}: {done:.0f} of {total:.0f} {self.counts}" if self.counts else ""
                continue
            self.result, self.failure = (value, None) if state is JobState.DONE else (None, value)
            self._finish(state)
        return self.state

    def cancel(self) -> None:
        """End the process and discard what it has computed."""
        if self.state is JobState.RUNNING:
            self._process.terminate()
            self._finish(JobState.CANCELLED)
            if self.target is not None:
                remove_unfinished(self.target)

    def _finish(self, state: JobState) -> None:
        self.state = state
        self._pipe.close()
        self._process.join(0.5)


class JobRunner:
    """The running jobs by name, with the file that one writes; starting one again cancels the one before."""

    def __init__(self) -> None:
        self._running: dict[str, tuple[Job, Callable[[Job], None]]] = {}
        self._first: dict[str, Callable[[Any], None]] = {}

    def start(
        self, name: str, job: Job, then: Callable[[Job], None], first: Callable[[Any], None] | None = None
    ) -> Job:
        """Run `job` under `name`; `poll` calls `then` with the ended job, and `first` with its first result."""
        self.cancel(name)
        self._running[name] = (job, then)
        self._first.pop(name, None)
        if first is not None:
            self._first[name] = first
        return job

    def get(self, name: str) -> Job | None:
        return self._running.get(name, (None, None))[0]

    def running(self) -> list[Job]:
        """Return the running jobs, oldest first."""
        return [job for job, _ in self._running.values()]

    def poll(self) -> None:
        """Take what has arrived; call `then` of each job that has ended."""
        for name, (job, then) in list(self._running.items()):
            ended = job.poll() is not JobState.RUNNING
            if not ended and name in self._first and job.first is not None:
                self._first.pop(name)(job.first)
            if ended:
                if self.get(name) is job:
                    del self._running[name]
                then(job)

    def cancel(self, name: str) -> None:
        job = self.get(name)
        if job is not None:
            job.cancel()

    def close(self) -> None:
        for name in self._running:
            self.cancel(name)
        self._running.clear()
        for pipe, process in _prepared:
            process.terminate()
            pipe.close()
        _prepared.clear()


class Background(Generic[T]):
    """Calls on a helper thread, one after the other; their results are taken in order."""

    def __init__(self, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=name)
        self.pending: list[Future[T]] = []

    def call(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> None:
        """Call `function` after those that were submitted before."""
        self.pending.append(self._pool.submit(function, *args, **kwargs))

    def take(self) -> T | None:
        """Return the oldest result once, or raise its error; None while it is computed, or without one."""
        return self.pending.pop(0).result() if self.pending and self.pending[0].done() else None

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
