"""A run under pressure on a busy computer, while each page of the window is opened: `play`, in a process of its own.

    python -m tests.system.busy_computer RATE_HZ [RUNS]

Window, helper processes, board and eight processes that compute without end share two cores. The virtual board, which
stands for one with a processor of its own, has a raised priority where the system allows it.
"""

from __future__ import annotations

import json
import os
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, closing, suppress
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
BUSY = 8
PAGE_S = 0.7  # on each page, in which it computes
UNDER_PRESSURE = "under pressure"
RUN_S = 300
BOARD_NICE = -10


def play(rate_hz: int, folder: Path) -> dict[str, object]:
    """Return the result of one run: how often it vented and why, how many pages were opened."""
    with ExitStack() as ends:
        board = ends.enter_context(_process(["-m", "boat_daq", "board", "--pty", "--speed", "1"], folder))
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, board.pid, BOARD_NICE)
        port = _port(board)
        window = ends.enter_context(
            _process(["-m", "tests.system.busy_computer", "window", port, str(rate_hz)], folder)
        )
        assert window.stdout is not None
        if window.stdout.readline().strip() == UNDER_PRESSURE:
            for _ in range(BUSY):
                ends.enter_context(_process(["-c", "while True: pass"], folder))
        out, errors = window.communicate("go\n", timeout=RUN_S)
        if window.returncode:
            raise RuntimeError(errors[-2000:])
    return {**json.loads(out.splitlines()[-1]), "longest_unfed_s": _longest_unfed_s(folder / "run.boat")}


def _longest_unfed_s(path: Path) -> float:
    """Return the longest time between two commands to the board: each feeds its watchdog."""
    with closing(sqlite3.connect(path)) as db:
        sent_ns = [ns for (ns,) in db.execute("SELECT host_ns FROM chunk WHERE direction = 1 ORDER BY id")]
    return round(max(after - before for before, after in pairwise(sent_ns)) / 1e9, 2)


class _process(subprocess.Popen[str]):
    """A program on two cores that is killed at the end."""

    def __init__(self, words: list[str], home: Path) -> None:
        env = os.environ | {"QT_QPA_PLATFORM": "offscreen", "BOAT_DAQ_HOME": str(home), "PYTHONPATH": str(ROOT)}
        super().__init__(
            [sys.executable, *words], env=env, cwd=home, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(self.pid, sorted(os.sched_getaffinity(0))[:2])

    def __exit__(self, *error: object) -> None:
        self.kill()
        super().__exit__(*error)


def _port(board: subprocess.Popen[str]) -> str:
    assert board.stdout is not None
    for line in board.stdout:
        if line.startswith("/dev/"):
            return line.strip()
    raise RuntimeError("the board named no port")


def _window(port: str, rate_hz: int) -> None:
    """Hold a pressure in the real window, open every page and tab, and print what came of it."""
    from PySide6.QtTest import QTest

    from boat_daq.engine.link.reader import raise_priority
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.snapshot import LinkState, SessionState
    from boat_daq.gui.app import make_application, make_window
    from boat_daq.viewmodels.common.services import TABS, Page

    raise_priority()  # as `run` does
    application = make_application()
    window = make_window(rate_hz)
    window.show()
    window.model.compile_ahead()
    session = window.model.session
    window.model.connection.connect(port)

    def wait(condition, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end_s, [message.cause for message in session.snapshot().messages]
            QTest.qWait(20)

    wait(lambda: session.snapshot().link is LinkState.UP, 60)
    session.start_recording(Path("run.boat").absolute())
    session.arm(Plan("busy", "staircase", 1, step_kpa=45.0, ramp_kpa_per_s=20.0, min_dwell_s=200.0, max_dwell_s=300.0))
    session.start()
    wait(lambda: session.snapshot().last.pressure_kpa > 40.0, 60)
    print(UNDER_PRESSURE, flush=True)
    sys.stdin.readline()
    opened = 0
    for page in Page:
        for place in TABS.get(page, (page,)):
            window.go(place)
            opened += 1
            QTest.qWait(round(1000 * PAGE_S))
    seen = session.snapshot()
    found = {
        "pages": opened,
        "running": seen.state is SessionState.RUNNING,
        "lost": seen.health.statistics.lost if seen.health else None,
        "pressure_kpa": round(seen.last.pressure_kpa, 1),
        "errors": [message.cause for message in seen.messages if message.level == "error"],
    }
    session.vent()
    window.close()
    application.processEvents()
    print(json.dumps(found), flush=True)
    os._exit(0)  # the interpreter's own end is no part of it


def main() -> None:
    """Play runs and print a line for each."""
    if sys.argv[1] == "window":
        _window(sys.argv[2], int(sys.argv[3]))
    for number in range(int(sys.argv[2]) if len(sys.argv) > 2 else 1):
        with tempfile.TemporaryDirectory() as folder:
            print(number + 1, play(int(sys.argv[1]), Path(folder)), flush=True)


if __name__ == "__main__":
    main()
