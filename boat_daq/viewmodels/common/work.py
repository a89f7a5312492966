"""Heavy work in a process of its own, with progress and cancel: VENT never waits for a computation.

The function runs in a spawned interpreter, so that neither its CPU time nor its interpreter lock is the window's. It is
named, "package.module:function", and imported there alone: the window starts without what only its helpers need. Only
picklable values cross. Nothing here calls back; the window asks `poll()` from its one timer.
"""

from __future__ import annotations

import importlib
import multiprocessing
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any

_SPAWN = multiprocessing.get_context("spawn")


class WorkState(Enum):
    """Where a piece of work stands."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a piece of work ended badly: cause and remedy for the strip, details for a click."""

    cause: str
    remedy: str
    details: str


def _run(pipe: Connection, function: str, args: tuple[Any, ...], kwargs: dict[str, Any], report: bool) -> None:
    """Run in the child: send ("progress", done, total), then ("done", result) or ("failed", Failure)."""
    last = 0.0

    def progress(done: float, total: float, /) -> None:
        nonlocal last
        if monotonic() - last >= 0.05 or done >= total:
            last = monotonic()
            pipe.send(("progress", float(done), float(total)))

    try:
        module, _, name = function.partition(":")
        deed = getattr(importlib.import_module(module), name)
        result = deed(*args, **kwargs, **({"progress": progress} if report else {}))
        pipe.send(("done", result))
    except BaseException as error:  # noqa: BLE001 - the other side decides; nothing may be lost on the way
        cause = str(getattr(error, "cause", "")) or f"{type(error).__name__}: {error}"
        with suppress(OSError):  # the window is gone: nobody is left to tell
            pipe.send(("failed", Failure(cause, str(getattr(error, "remedy", "")), traceback.format_exc())))
    finally:
        pipe.close()


class Work:
    """One function at work in its own process.

    Parameters
    ----------
    label : what is being done, in the lab's words, e.g. "Sampling the posterior".
    function : what to call, "package.module:function".
    args, kwargs : of the call; picklable.
    report : whether `function` takes `progress`.
    """

    def __init__(self, label: str, function: str, *args: Any, report: bool = False, **kwargs: Any) -> None:
        self.label = label
        self.state = WorkState.RUNNING
        self.fraction: float | None = None
        self.result: Any = None
        self.failure: Failure | None = None
        self.started_s = monotonic()
        self._pipe, child = _SPAWN.Pipe(duplex=False)
        self._process = _SPAWN.Process(target=_run, args=(child, function, args, kwargs, report), daemon=True)
        self._process.start()
        child.close()

    @property
    def permille(self) -> int:
        """Return the progress in thousandths."""
        return round(1000 * (self.fraction or 0.0))

    def poll(self) -> WorkState:
        """Take what the process has sent; return where the work stands. Never blocks."""
        while self.state is WorkState.RUNNING and self._pipe.poll():
            try:
                self._take(self._pipe.recv())
            except EOFError:
                self._fail()
        return self.state

    def cancel(self) -> None:
        """End the process; what it had computed is dropped."""
        if self.state is WorkState.RUNNING:
            self._process.terminate()
            self._finish(WorkState.CANCELLED)

    def _take(self, message: tuple[Any, ...]) -> None:
        kind, *rest = message
        if kind == "progress":
            self.fraction = rest[0] / rest[1] if rest[1] else None
        elif kind == "done":
            self.result = rest[0]
            self._finish(WorkState.DONE)
        else:
            self.failure = rest[0]
            self._finish(WorkState.FAILED)

    def _fail(self) -> None:
        self._process.join(0.2)
        details = f"exit code {self._process.exitcode}"
        self.failure = Failure(f"{self.label}: the process ended before its result", "Start it again.", details)
        self._finish(WorkState.FAILED)

    def _finish(self, state: WorkState) -> None:
        self.state = state
        self._pipe.close()
        self._process.join(0.5)


class JobRunner:
    """The pieces of work under way, by name: starting one again cancels the one before."""

    def __init__(self) -> None:
        self._running: dict[str, tuple[Work, Callable[[Work], None]]] = {}

    def start(self, name: str, work: Work, then: Callable[[Work], None]) -> Work:
        """Keep `work` under `name`; `then(work)` is called from `poll` once it has ended."""
        self.cancel(name)
        self._running[name] = (work, then)
        return work

    def get(self, name: str) -> Work | None:
        """Return the running work of that name."""
        return self._running.get(name, (None, None))[0]

    def running(self) -> list[Work]:
        """Return the pieces under way, oldest first."""
        return [work for work, _ in self._running.values()]

    def poll(self) -> None:
        """Take what has come; call `then` of what has ended."""
        for name, (work, then) in list(self._running.items()):
            if work.poll() is not WorkState.RUNNING:
                if self._running.get(name, (None, None))[0] is work:
                    del self._running[name]
                then(work)

    def cancel(self, name: str) -> None:
        """Cancel the work of that name, if it runs."""
        found = self._running.get(name)
        if found:
            found[0].cancel()

    def close(self) -> None:
        """Cancel all."""
        for name in list(self._running):
            self.cancel(name)
        self._running.clear()
