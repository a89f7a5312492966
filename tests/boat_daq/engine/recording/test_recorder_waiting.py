"""What waits in the recorder: its age, its memory, and when it is tried again, on a clock that is passed in."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest

from boat_daq.engine.link.block import Block
from boat_daq.engine.recording import recorder as recorder_module
from boat_daq.engine.recording.recorder import COMMIT_S, Recorder
from boat_daq.engine.recording.resumption import RESUMED
from protocol.base.errors import StorageError
from protocol.recording import RunEnd
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import add_step, begin, rows

NOW_NS = 5_000_000_000


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.001)
    assert condition()


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stop the recorder's clock at 5 s."""
    stopped = SimpleNamespace(monotonic=time.monotonic, monotonic_ns=lambda: NOW_NS)
    monkeypatch.setattr(recorder_module, "time", stopped)


@pytest.fixture
def idle(path, source, clock, monkeypatch) -> Iterator[Recorder]:
    """A recorder that commits once a minute: what it takes waits."""
    monkeypatch.setattr(recorder_module, "COMMIT_S", 60.0)
    recorder = Recorder(path, meta_of(source.link))
    yield recorder
    recorder.close(RunEnd.STOPPED)


def test_age_is_that_of_the_first_in_the_queue(idle: Recorder) -> None:
    """Nothing waits: 0. Of blocks of 4.0 and 4.5 s, at 5 s, the first is 1,000 ms old; one of the future has no age."""
    assert (idle.lag_ms, idle.queued) == (0.0, 0)
    idle(Block(4_000_000_000, b""))
    idle(Block(4_500_000_000, b""))
    assert (idle.lag_ms, idle.queued) == (1000.0, 2)


def test_block_from_ahead_of_the_clock_has_no_age(idle: Recorder) -> None:
    """The reading thread may stamp a block after the clock was looked at."""
    idle(Block(NOW_NS + 7, b""))
    assert idle.lag_ms == 0.0


@pytest.mark.parametrize(
    ("commits_ms", "waits_ms", "cost_ms"),
    [((), 0, 100.0), ((30.0,), 0, 130.0), ((20.0, 150.0), 0, 300.0), ((150.0, 20.0), 0, 300.0), ((30.0,), 900, 900.0)],
)
def test_cost_of_a_crash(path, source, clock, monkeypatch, commits_ms, waits_ms, cost_ms) -> None:
    """The interval of 100 ms, or a commit as slow, and the slowest of ten seconds; what waits where that is more."""
    recorder = Recorder(path, meta_of(source.link))
    assert recorder._latencies_ms.maxlen == round(10.0 / COMMIT_S)
    assert recorder._thread.daemon  # a program that ends without closing it is not held up
    monkeypatch.setattr(recorder._file, "commit", lambda _: None)
    recorder._latencies_ms.extend(commits_ms)
    recorder._oldest_ns = NOW_NS - 1_000_000 * waits_ms if waits_ms else None
    assert recorder.at_risk_ms == pytest.approx(cost_ms)
    recorder.close(RunEnd.STOPPED)


def test_latency_of_a_commit_is_measured_in_ms(path, source, monkeypatch) -> None:
    """From 10.0 to 10.25 s; the writing thread has ended."""
    recorder = Recorder(path, meta_of(source.link))
    recorder.close(RunEnd.STOPPED)
    times = iter([10.0, 10.25])
    monkeypatch.setattr(recorder_module, "time", SimpleNamespace(monotonic=lambda: next(times)))
    monkeypatch.setattr(recorder._file, "commit", lambda _: None)
    recorder._latencies_ms.clear()
    recorder._write()
    assert list(recorder._latencies_ms) == [250.0]


@pytest.fixture
def gate(path, source, clock, monkeypatch) -> Iterator[tuple[Recorder, threading.Semaphore, list[int]]]:
    """A recorder whose commits wait for a semaphore, and how many have begun."""
    monkeypatch.setattr(recorder_module, "COMMIT_S", 0.002)
    recorder = Recorder(path, meta_of(source.link))
    may, begun, commit = threading.Semaphore(0), [], recorder._file.commit

    def wait(statements) -> None:
        begun.append(len(statements))
        may.acquire()
        commit(statements)

    monkeypatch.setattr(recorder._file, "commit", wait)
    yield recorder, may, begun
    may.release(1_000)
    recorder.close(RunEnd.STOPPED)


def test_age_during_a_commit_is_that_of_its_first(gate) -> None:
    """A commit that hangs keeps the age of what it writes; the next one that of the first that came meanwhile."""
    recorder, may, begun = gate
    recorder(Block(4_000_000_000, bytes(3)))
    wait_for(lambda: len(begun) == 1)
    assert recorder.lag_ms == 1000.0
    recorder(Block(4_500_000_000, bytes(3)))
    recorder(Block(4_700_000_000, bytes(3)))
    assert recorder.lag_ms == 1000.0
    assert (recorder._held_bytes, recorder.queued) == (3 * (6 + 400), 2 + begun[0])
    may.release()
    wait_for(lambda: len(begun) == 2)
    assert recorder.lag_ms == 500.0
    assert recorder._held_bytes == 2 * (6 + 400)
    may.release()
    assert recorder.flush()
    assert (recorder.lag_ms, recorder._held_bytes, recorder.queued) == (0.0, 0, 0)


@pytest.mark.parametrize(("most", "taken"), [(1000, 1), (1199, 1), (1200, 2)])
def test_memory_counts_bytes_twice_and_400_a_block(idle: Recorder, monkeypatch, most: int, taken: int) -> None:
    """Blocks of 100 bytes cost 600 each; the limit itself is still taken."""
    monkeypatch.setattr(recorder_module, "MEMORY_BYTES_MAX", most)
    for _ in range(taken):
        idle(Block(NOW_NS, bytes(100)))
    assert idle._refusing is None
    idle(Block(NOW_NS, bytes(100)))
    assert idle._refusing is not None
    waiting = idle.queued
    idle(Block(NOW_NS, b""))
    assert idle.queued == waiting == taken + 1  # the event that says so


def test_failed_commit_is_tried_again_after_a_while_and_when_closing(path, source, monkeypatch) -> None:
    """A second later, not at every interval: the disk is slow already."""
    monkeypatch.setattr(recorder_module, "COMMIT_S", 0.002)
    reported, tries = [], []
    recorder = begin(path, source, on_error=reported.append)
    assert recorder.flush()

    def fail(_) -> None:
        tries.append(time.monotonic())
        raise StorageError("full", "")

    monkeypatch.setattr(recorder._file, "commit", fail)
    recorder(source.next())
    wait_for(lambda: bool(tries))
    wait_for(lambda: recorder._next_try_s > 0)
    assert recorder._next_try_s - tries[0] == pytest.approx(1.0, abs=0.5)
    recorder._next_try_s += 1e6
    time.sleep(0.05)
    assert len(tries) == 1
    with pytest.raises(StorageError, match="full"):
        recorder.close(RunEnd.STOPPED)
    assert (len(tries), [error.cause for error in reported]) == (2, ["full"])


def test_break_of_a_run_that_resumes_while_it_is_recorded(recorder, source, path) -> None:
    """Its entry: the next step, cycle, segment and chunk; a second break is a second entry."""
    for _ in range(3):
        recorder(source.next())
        add_step(recorder, 1, "unloading")
    recorder.run_resumed("unplugged", first_cycle=2, complete_cycles=0)
    recorder(source.next())
    recorder.run_resumed("again", first_cycle=5, complete_cycles=3)
    assert recorder.flush()
    recorder.close(RunEnd.FINISHED)
    assert recorder.warning == ""
    ((text,),) = rows(path, "SELECT value FROM session WHERE key = 'resumptions'")
    first, second = json.loads(text)
    keys = ("cause", "break_s", "first_step", "first_cycle", "complete_cycles", "first_chunk", "last_result")
    assert [first[key] for key in keys] == ["unplugged", None, 4, 2, 0, 4, 0]
    assert [second[key] for key in keys] == ["again", None, 4, 5, 3, 5, 0]
    segments = rows(path, "SELECT id, reason, paused FROM segment ORDER BY id DESC LIMIT 2")
    assert segments == [(second["first_segment"], RESUMED, 0), (first["first_segment"], RESUMED, 0)]


def test_recording_that_was_opened_to_be_resumed_has_its_break(recorder, source, path) -> None:
    """It is kept once: the first that is reported is that one, the second another."""
    recorder._break_kept = True
    for cause in ("the one that is kept", "another"):
        recorder(source.next())
        recorder.run_resumed(cause, first_cycle=2, complete_cycles=1)
    assert recorder.flush()
    ((text,),) = rows(path, "SELECT value FROM session WHERE key = 'resumptions'")
    assert [entry["cause"] for entry in json.loads(text)] == ["another"]


def test_segment_is_not_of_a_pause_unless_stated(recorder, source, path) -> None:
    """`paused` of "resumed" is 0."""
    recorder(source.next())
    recorder.new_segment("resumed")
    assert recorder.flush()
    assert rows(path, "SELECT paused FROM segment WHERE reason = 'resumed'") == [(0,)]
