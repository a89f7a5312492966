"""The log: what the program did, in a file of bounded size, for the analysis of a fault.

Rules: `note` only puts a line into a bounded queue; a thread of the log's own writes it. A queue that is full drops the
line and counts it, so that neither the reader nor the recorder ever waits for a disk here. A process has a log of its
own, named by its start, in the platform's folder (or BOAT_DAQ_HOME/log); it rotates at `FILE_BYTES`, and logs beyond
`FOLDER_BYTES` are removed, the oldest first. Tracebacks are written here and nowhere else. Before `start_log`, and in a
script that never calls it, every note is discarded.
"""

from __future__ import annotations

import atexit
import logging
import os
import platform
import queue
import re
import threading
import time
from datetime import UTC, datetime
from io import FileIO, TextIOWrapper
from logging.handlers import QueueHandler, QueueListener, RotatingFileHandler
from pathlib import Path

import platformdirs

from boat_daq import __version__

FILE_BYTES = 1_000_000
FILES = 3  # of one process: the newest megabytes
FOLDER_BYTES = 20_000_000
LINES_MAX = 10_000  # waiting to be written
RECORDING = "recording: "  # begins the line that names a recording as it begins; bug reports search for it
_PASSWORD = re.compile(r"(\w://[^/\s:@]*:)[^\s/]*@")
_LEVELS = {"info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}

_logger = logging.getLogger("boat_daq")
_logger.addHandler(logging.NullHandler())
_logger.propagate = False


class _Queue(QueueHandler):
    """Never waits, and notes with the next line how many it dropped."""

    def __init__(self, lines: queue.Queue[logging.LogRecord]) -> None:
        super().__init__(lines)
        self.dropped = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        """Put a line into the queue, or count it."""
        if self.dropped:
            record.msg = f"{record.msg}   (before this, {self.dropped} lines were dropped)"
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1
        else:
            self.dropped = 0


def without_password(text: str) -> str:
    """Return a text without the passwords of addresses, which follow the user's name and a colon."""
    return _PASSWORD.sub(r"\1[password]@", text)


class _Formatter(logging.Formatter):
    """Writes no password."""

    converter = time.gmtime  # type: ignore[assignment]

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, and a traceback where there is one."""
        return without_password(super().format(record))


class _File(RotatingFileHandler):
    """Leaves lines out while the disk fails, without a traceback for each; other users cannot read it."""

    def _open(self) -> TextIOWrapper:
        handle = os.open(self.baseFilename, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)
        return TextIOWrapper(FileIO(handle, "a"), encoding=self.encoding, errors=self.errors, write_through=True)

    def handleError(self, record: logging.LogRecord) -> None:
        """Leave the line out."""


class _Log:
    """The running log, one a process."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.queue = _Queue(queue.Queue(LINES_MAX))
        self.file = _File(path, maxBytes=FILE_BYTES, backupCount=FILES - 1, encoding="utf-8", errors="replace")
        formatter = _Formatter("%(asctime)s.%(msecs)03dZ %(levelname)-7s [%(threadName)s] %(message)s")
        formatter.default_time_format = formatter.datefmt = "%Y-%m-%dT%H:%M:%S"
        self.file.setFormatter(formatter)
        self.listener = QueueListener(self.queue.queue, self.file)
        self.listener.start()
        _logger.addHandler(self.queue)
        _logger.setLevel(logging.INFO)

    def stop(self) -> None:
        _logger.removeHandler(self.queue)
        self.listener.stop()
        self.file.close()


_running: _Log | None = None
_lock = threading.Lock()


def log_folder() -> Path:
    home = os.environ.get("BOAT_DAQ_HOME")
    return Path(home) / "log" if home else platformdirs.user_log_path("boat-daq", appauthor=False)


def start_log(command: str = "") -> Path | None:
    """Begin this process's log; a second call changes nothing.

    Return its file, or None where the folder cannot be written: the program works without a log.
    """
    global _running  # noqa: PLW0603 - one log a process
    with _lock:
        if _running is None:
            try:
                folder = log_folder()
                folder.mkdir(parents=True, exist_ok=True)
                _prune(folder)
                _running = _Log(folder / f"{datetime.now(UTC):%Y-%m-%d_%H%M%S}_{os.getpid()}.log")
            except OSError:
                return None
            atexit.register(stop_log)
            threading.excepthook = _thread_failed
            python = f"Python {platform.python_version()}, {platform.system()} {platform.release()}"
            note("info", f"boat-daq {__version__} {command}, {python}")
        return _running.path


def stop_log() -> None:
    """Write what waits and close the log; may be called twice."""
    global _running
    with _lock:
        log, _running = _running, None
    if log is not None:
        log.stop()
        atexit.unregister(stop_log)
        threading.excepthook = threading.__excepthook__


def note(level: str, text: str) -> None:
    """Note a line ("info", "warning" or "error"); returns at once, from any thread."""
    _logger.log(_LEVELS.get(level, logging.INFO), "%s", " ".join(text.splitlines()))


def note_failure(text: str, error: BaseException) -> None:
    """Note a failure with its traceback; returns at once, from any thread."""
    _logger.error("%s", text, exc_info=(type(error), error, error.__traceback__))


def _thread_failed(failed: threading.ExceptHookArgs) -> None:
    """Note a thread that ended by an error, and report it as Python does."""
    if failed.exc_value is not None:
        note_failure(f"thread {failed.thread.name if failed.thread else '?'} failed", failed.exc_value)
    threading.__excepthook__(failed)


def _prune(folder: Path) -> None:
    """Keep the newest logs that together stay below `FOLDER_BYTES` with the new one."""
    bytes_left = FOLDER_BYTES - FILES * FILE_BYTES
    for path in sorted(folder.glob("*.log*"), key=lambda p: p.name, reverse=True):
        bytes_left -= path.stat().st_size
        if bytes_left < 0:
            path.unlink(missing_ok=True)


def memory_mb() -> float | None:
    """Return the resident memory of this process, MB. Its peak where only that is known; None where neither is."""
    pages = Path("/proc/self/statm")
    if pages.exists():
        return int(pages.read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6  # bytes on macOS, the one system left
