"""Endurance: a day's recording, a hundred connections, a consumer that blocks. Real pseudo-terminals."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState
from protocol.recording import dtype_from_description, open_recording, read_session
from tests.system import endurance

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="/proc and pseudo-terminals")

ROOT = Path(__file__).resolve().parents[2]


def memory_mb(process: int | str = "self") -> float:
    """Return the resident memory of a process, MB."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def recorded_indices(path: Path) -> np.ndarray:
    """Return every sample's index, in order."""
    with closing(open_recording(path)) as db:
        dtype = dtype_from_description(read_session(db)["sample_dtype"])
        blobs = db.execute("SELECT samples FROM block ORDER BY id")
        return np.concatenate([np.frombuffer(blob, dtype)["index"] for (blob,) in blobs])


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ({}, []),
        ({"memory_mb": [(0.5, 200.0), (1.0, 300.0), (2.0, 315.0)]}, []),
        ({"memory_mb": [(0.5, 200.0), (1.0, 300.0), (2.0, 315.2)]}, ["memory within 5 % of its first hour"]),
        ({"frame_worst_ms": 100.0}, []),
        ({"frame_worst_ms": 100.1}, ["no frame over 100 ms"]),
        ({"refresh_worst_ms": 100.1}, ["no frame over 100 ms"]),
        ({"samples": 999}, ["every sample recorded"]),
        ({"lost": 1}, ["every sample recorded"]),
        ({"gaps": 1}, ["every sample recorded"]),
        ({"difference": "chunk 3"}, ["the file is identical to its bytes"]),
    ],
)
def test_endurance_names_each_failed_criterion(change: dict, broken: list[str]) -> None:
    """Both sides of each criterion; the run itself takes a quarter of an hour and is started manually."""
    result = {
        "memory_mb": [(1.0, 300.0), (2.0, 301.0)], "frame_worst_ms": 50.0, "refresh_worst_ms": 20.0,
        "frame_cpu_worst_ms": 9.0, "frames": 9,
        "samples": 1000, "expected": 1000, "lost": 0, "gaps": 0, "difference": "",
    }  # fmt: skip
    assert [what for what, kept, _ in endurance.criteria_of({**result, **change}) if kept is False] == broken


def test_endurance_of_one_hour_leaves_growth_undetermined() -> None:
    """Growth is compared with the first hour: a run of one hour leaves it undetermined."""
    result = {
        "memory_mb": [(0.0, 300.0), (1.0, 400.0)], "frame_worst_ms": 50.0, "refresh_worst_ms": 20.0,
        "frame_cpu_worst_ms": 9.0, "frames": 9,
        "samples": 1000, "expected": 1000, "lost": 0, "gaps": 0, "difference": "",
    }  # fmt: skip
    assert [kept for _, kept, _ in endurance.criteria_of(result)] == [None, True, True, True]


@pytest.mark.parametrize("times", [6, pytest.param(100, marks=[pytest.mark.nightly, pytest.mark.timeout(900)])])
def test_repeated_connections_leak_nothing(times: int, tmp_path: Path) -> None:
    """One session, connected, recorded from and disconnected repeatedly: as many threads and open files as after the
    second time, and less than 5 MB more memory than after the fourth; every recording is closed.
    """
    session = Session(Settings(), UnitLibrary(tmp_path / "units"))
    seen: list[tuple[int, int, float]] = []
    with serve(BoardSettings(speed=20.0)) as board:
        for number in range(times):
            run = tmp_path / f"{number}.boat"
            session.connect(board.url, record_to=run)
            session.wait_connected()
            session.disconnect()
            assert session.wait(lambda s: s.link is LinkState.CLOSED, 20.0).link is LinkState.CLOSED
            assert summarise(run).status == "closed"
            gc.collect()
            seen.append((threading.active_count(), open_files(), memory_mb()))
    session.close()
    threads, files, memory = (list(column) for column in zip(*seen, strict=True))
    assert threads[-1] <= threads[1]
    assert files[-1] <= files[1]
    assert memory[-1] < memory[3] + 5.0  # numpy and the allocator have filled their caches by then
    assert "health log" not in {thread.name for thread in threading.enumerate()}


def open_files() -> int:
    """Return the fewest of twenty counts: the health log opens a file for an instant, once a second."""
    counts = []
    for _ in range(20):
        counts.append(len(list(Path("/proc/self/fd").iterdir())))
        time.sleep(0.005)
    return min(counts)


def busy(seconds: float) -> None:
    """Hold the interpreter, as a window that computes does."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        sum(range(1000))


@pytest.mark.nightly
@pytest.mark.parametrize("block", [time.sleep, busy], ids=["asleep", "busy"])
@pytest.mark.parametrize("on_reading_thread", [False, True], ids=["window", "sink"])
def test_consumer_blocked_for_ten_seconds_loses_no_sample(
    block: Callable[[float], None], on_reading_thread: bool, tmp_path: Path
) -> None:
    """The window's thread asleep or computing, or a sink on the reading thread: every sample is recorded."""
    session = Session(Settings(), UnitLibrary(tmp_path / "units"))
    run = tmp_path / "run.boat"
    with serve(BoardSettings(speed=4.0)) as board:
        session.connect(board.url, record_to=run)
        session.wait_connected()
        if on_reading_thread:
            once = threading.Event()

            def sink(_samples: object) -> None:
                if not once.is_set():
                    once.set()
                    block(10.0)

            session.live.add_sink(sink)
            time.sleep(12.0)
        else:
            block(10.0)
        seen = session.snapshot()
        assert seen.recorded_s > 25.0  # 40 less what a board at 4 times real time does not catch up
        session.close()
    indices = recorded_indices(run)
    assert np.array_equal(indices, np.arange(len(indices)))
    assert summarise(run).lost_samples == 0


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("hours", [1, 24])
def test_recording_of_a_day_is_complete_in_bounded_memory(hours: int, tmp_path: Path) -> None:
    """At 100 times real time: the exact count, nothing lost, memory within 5 % of its first hour's, and the file is
    identical to its bytes.
    """
    run = tmp_path / "day.boat"
    with serve(BoardSettings(speed=100.0)) as board:
        command = [sys.executable, "-m", "boat_daq", "record", "--port", board.url, "--out", str(run)]
        process = subprocess.Popen([*command, "--duration", str(hours * 3600)], cwd=ROOT, stderr=subprocess.DEVNULL)
        memory: list[float] = []
        while process.poll() is None:
            time.sleep(1.0)
            if process.poll() is None:
                memory.append(memory_mb(process.pid))
    assert process.returncode == 0
    indices = recorded_indices(run)
    assert np.array_equal(indices, np.arange(len(indices)))
    assert len(indices) >= hours * 360_000
    found = summarise(run)
    assert (found.lost_samples, found.gaps, found.crc_errors) == (0, 0, 0)
    first_hour = max(memory[: max(5, len(memory) // hours)])
    assert max(memory) < 1.05 * first_hour, (first_hour, max(memory))
    assert verify_recording(run).difference == ""
