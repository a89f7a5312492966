"""Hosts killed at random instants under pressure, over a real pseudo-terminal: the board vents every time."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import pytest

from boat_daq.engine.recording.recovery import find_interrupted, recover
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from tests.faults.drill import ROOT, needs_pty
from tests.faults.nightly_counts import few_and_many

pytestmark = needs_pty

SPEED = 10.0
PRESSED_KPA = 5.0

HOSTS = """
import os, sys, time
from pathlib import Path
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from tests.faults.drill import SHORT
import dataclasses

def unlatched(seen):
    return not seen.latched

def host(url, path):
    session = Session(Settings(), UnitLibrary(Path(path).parent / "units"))
    session.connect(url)
    seen = session.wait_connected()
    while seen.latched:  # an answer that a busy machine brings after its time counts as lost: press again
        session.clear_fault()
        seen = session.wait(unlatched, 2)
    session.start_recording(Path(path))
    session.arm(dataclasses.replace(SHORT, cycles=50))
    session.start()
    print(os.getpid(), flush=True)
    time.sleep(600)

for line in sys.stdin:  # imports are paid once; each host is a process of its own
    url, path = line.rstrip().split(" ", 1)
    child = os.fork()
    if not child:
        host(url, path)
    os.waitpid(child, 0)
    print("end", flush=True)
"""


class Truth:
    """The board's own pressure, read as its file grows."""

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self._rest = ""
        self.pressure_kpa = 0.0
        self.peak_kpa = 0.0

    def look(self) -> float:
        """Read what was added and return the newest pressure, kPa."""
        *lines, self._rest = (self._rest + self._file.read()).split("\n")
        for line in lines:
            cells = line.split(",")
            if len(cells) >= 5 and cells[0].replace(".", "").isdigit():
                self.pressure_kpa = float(cells[3])
                self.peak_kpa = max(self.peak_kpa, abs(self.pressure_kpa))
        return self.pressure_kpa

    def until(self, condition: object, seconds: float) -> bool:
        """Return whether `condition(pressure)` became true within that time."""
        deadline = time.monotonic() + seconds
        while not condition(self.look()):  # type: ignore[operator]
            if time.monotonic() > deadline:
                return False
            time.sleep(0.02)
        return True


@pytest.fixture
def hosts() -> Iterator[subprocess.Popen[str]]:
    """A process that starts a host for each line it reads."""
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", HOSTS], stdin=pipe, stdout=pipe, text=True, cwd=ROOT) as process:
        yield process
        process.kill()


@pytest.mark.parametrize(
    "times",
    few_and_many(18, "a host killed with -9 at random instants under pressure, over a pty", 1, 200, timeout_s=3600),
)
def test_board_vents_whenever_its_host_is_killed(tmp_path: Path, hosts: subprocess.Popen[str], times: int) -> None:
    """Vented within its watchdog's time; the next session reports the cause, and the file recovers identical."""
    assert hosts.stdin is not None
    assert hosts.stdout is not None
    instants = random.Random(times)
    path = tmp_path / "truth.csv"
    with serve(BoardSettings(speed=SPEED, truth=str(path))) as board, path.open(encoding="utf-8") as file:
        truth = Truth(file)
        for number in range(times):
            path = tmp_path / f"{number}.boat"
            print(board.url, path, file=hosts.stdin, flush=True)
            child = int(hosts.stdout.readline())
            assert truth.until(lambda kpa: abs(kpa) > PRESSED_KPA, 60.0)
            time.sleep(instants.uniform(0.0, 1.5))
            truth.until(lambda kpa: abs(kpa) > PRESSED_KPA, 60.0)
            os.kill(child, signal.SIGKILL)
            assert hosts.stdout.readline() == "end\n"
            assert truth.until(lambda kpa: abs(kpa) < 1.0, 30.0), f"kill {number}: still at {truth.pressure_kpa} kPa"
            assert find_interrupted(tmp_path) == [path]
            assert recover(path).status == "recovered"
            assert verify_recording(path).identical
            path.unlink()
            assert_next_session_reports_it(board.url, tmp_path)
        assert truth.peak_kpa < 55.0


def assert_next_session_reports_it(url: str, folder: Path) -> None:
    """The next session finds a vented board and reports the cause."""
    session = Session(Settings(), UnitLibrary(folder / "units"))
    try:
        session.connect(url)
        seen = session.wait_connected()
        causes = [seen.latched, *(message.cause for message in seen.messages)]
        assert any("host may have failed" in cause for cause in causes), causes
        assert seen.last is None or abs(seen.last.pressure_kpa) < 1.0
    finally:
        session.close()
