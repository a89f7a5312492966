"""One health line a second into the log while a session runs, on a thread of its own."""

from __future__ import annotations

import contextlib
import shutil
import threading
from collections.abc import Callable

from boat_daq.engine.log import memory_mb, note, note_failure
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.snapshot import HealthSnapshot

EVERY_S = 1.0


class HealthLog:
    """Writes the lines from `start` to `stop`; may be started again."""

    def __init__(self, line: Callable[[], str]) -> None:
        self._line = line
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Begin; a second call changes nothing."""
        if self._thread is None:
            self._stop.clear()
            self._thread = threading.Thread(target=self._run, name="health log", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End; waits for the thread."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._stop.set()
            thread.join()

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            try:
                note("info", self._line())
            except Exception as error:  # noqa: BLE001 - a line of the log must not end a session
                note_failure("no health line", error)


def health_line(link: str, run: str, health: HealthSnapshot | None, recorder: Recorder | None) -> str:
    """Return a line of the log."""
    parts = [f"health link={link} run={run}"]
    if health is not None:
        s = health.statistics
        rate = "-" if health.rate_hz is None else f"{health.rate_hz:.2f}"
        parts.append(f"rate_hz={rate} samples={s.samples} lost={s.lost} crc={s.crc_errors} lag_ms={health.lag_ms:.0f}")
        parts.append(f"at_risk_ms={health.at_risk_ms:.0f}")
    parts.append(f"queue={recorder.queued if recorder else 0}")
    if recorder is not None:
        with contextlib.suppress(OSError):
            parts.append(f"disk_free_mb={shutil.disk_usage(recorder.path.parent).free / 1e6:.0f}")
    memory = memory_mb()
    parts.append(f"memory_mb={'-' if memory is None else f'{memory:.0f}'} threads={threading.active_count()}")
    return " ".join(parts)
