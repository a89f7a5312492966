"""The recorder: what it acknowledges is in the file, bit for bit."""

from __future__ import annotations

import dataclasses
import math
import os
import sys
import threading
import time

import numpy as np
import pytest

from boat_daq.engine.link.block import Block
from boat_daq.engine.link.reader import URGENT_NICE
from boat_daq.engine.plan import StepMark
from boat_daq.engine.qualification.drill_rig import slow_commits
from boat_daq.engine.recording.closed_run import append_reading
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.rows import (
    INSERT_BLOCK,
    INSERT_EVENT,
    INSERT_OVERVIEW,
    INSERT_SEGMENT,
    RowMaker,
    reading_row,
    step_row,
)
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.snapshot import CameraReading
from protocol import CommandDone, Connection, Samples, SetPressure, Start
from protocol.base.errors import RequestError, StorageError
from protocol.link.events import BoardEventReceived, BoardRestarted, ClockWentBack, SampleGap
from protocol.link.messages import AckStatus, BoardEvent, EventCode
from protocol.recording import (
    APPLICATION_ID,
    SESSION_KEYS,
    RunEnd,
    describe_dtype,
    open_recording,
    read_session,
    sample_dtype,
)
from tests.boat_daq.engine.board_link import meta_of, urgent_nice
from tests.boat_daq.engine.recording_source import Source, add_step, begin, reading, rows, stored_samples
from tests.protocol.link.streams import HELLO


def test_samples_and_bytes_are_in_the_file_as_they_came(recorder, source, path):
    """The documented reader gives the very samples the link gave, and the chunks are the very bytes."""
    for _ in range(40):
        recorder(source.next())
    recorder.close(RunEnd.FINISHED)
    assert stored_samples(path) == np.concatenate(source.samples).tobytes()
    assert b"".join(row[0] for row in rows(path, "SELECT raw FROM chunk ORDER BY id")) == b"".join(source.raw)
    assert verify_recording(path).identical


def test_reading_of_a_camera_is_kept_with_its_segment(recorder, source, path):
    """In the second segment, where the newest sample is; not with that sample's time."""
    recorder(source.next())
    recorder.new_segment("paused", paused=True)
    recorder(source.next())
    recorder.camera(CameraReading(time.monotonic_ns(), 0.5, 0.004))
    recorder.close(RunEnd.FINISHED)
    (last,) = rows(path, "SELECT max(id) FROM segment")
    assert rows(path, "SELECT segment, elongation_mm FROM camera") == [(last[0], 0.5)]


def test_what_a_crash_would_cost_is_measured(recorder, source):
    """The commit interval and the slowest commit; that commit twice where it is longer than the interval."""
    recorder(source.next())
    assert recorder.flush()
    assert recorder.at_risk_ms > 100
    with slow_commits(0.15):
        recorder(source.next())
        assert recorder.flush()
    assert 150 + 150 <= recorder.at_risk_ms < 150 + 150 + 800
    assert recorder.at_risk_ms >= recorder.lag_ms


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a thread's priority cannot be read")
def test_writer_runs_first_where_the_system_allows_it(recorder, path):
    recorder.flush()
    (writer,) = [thread for thread in threading.enumerate() if thread.name == f"recorder {path.name}"]
    assert writer.native_id is not None
    assert os.getpriority(os.PRIO_PROCESS, writer.native_id) == urgent_nice()
    assert os.getpriority(os.PRIO_PROCESS, os.getpid()) > URGENT_NICE


def test_a_closed_recording_is_one_plain_file_that_names_itself(recorder, source, path):
    """No -wal, no lock; SQLite's own header identifies it; every key of the session is there."""
    recorder(source.next())
    recorder.close(RunEnd.FINISHED)
    assert [entry.name for entry in path.parent.iterdir()] == ["run.boat"]
    db = open_recording(path)
    assert db.execute("PRAGMA application_id").fetchone() == (APPLICATION_ID,)
    assert db.execute("PRAGMA journal_mode").fetchone() == ("delete",)
    assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    meta = read_session(db)
    db.close()
    assert set(SESSION_KEYS) <= set(meta)
    assert (meta["status"], meta["stop_reason"]) == ("closed", "finished")
    assert meta["ended_host_ns"] > meta["started_host_ns"]


def test_acknowledged_is_in_the_file_while_it_is_written(recorder, source, path):
    """Another program reads, at any time, at least what was acknowledged."""
    for _ in range(5):
        recorder(source.next())
        assert recorder.flush()
        acknowledged = recorder.acknowledged
        assert acknowledged.samples == sum(map(len, source.samples)) > 0
        assert rows(path, "SELECT sum(n) FROM block") == [(acknowledged.samples,)]
        assert rows(path, "SELECT count(*), sum(length(raw)) FROM chunk") == [(acknowledged.chunks, acknowledged.bytes)]
    assert recorder.lag_ms < 1000


def test_a_commit_is_complete_or_absent(recorder, source, path):
    """Bytes and the samples decoded from them are in one transaction: no reader ever sees one without the other."""
    stop = threading.Event()

    def feed():
        while not stop.is_set():
            recorder(source.next(20_000))
            time.sleep(0.002)

    feeder = threading.Thread(target=feed)
    feeder.start()
    looks = []
    for _ in range(60):
        looks += rows(path, "SELECT (SELECT max(last_chunk) FROM block), (SELECT max(id) FROM chunk)")
        time.sleep(0.01)
    stop.set()
    feeder.join()
    assert all(block_end == chunk_end for block_end, chunk_end in looks)
    assert len(set(looks)) > 3


def test_the_log_is_on_and_safe(path, source):
    """WAL with synchronous FULL, read back from the connection that writes."""
    recorder = Recorder(path, meta_of(source.link))
    connection = recorder._file._connection
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert connection.execute("PRAGMA synchronous").fetchone() == (2,)
    recorder.close(RunEnd.STOPPED)


def test_segments_begin_with_the_link_at_start_and_on_request(recorder, source, path):
    """Each segment has the reason it began; steps and events carry the segment they belong to."""
    source._send(Start(100))
    recorder(source.next())
    recorder.event("user", "mark", text="before")
    recorder.new_segment("paused", paused=True)
    recorder(source.next())
    recorder.event("user", "mark", text="after")
    recorder.close(RunEnd.FINISHED)
    assert rows(path, "SELECT id, reason, paused FROM segment") == [
        (1, "opened", 0),
        (2, "started", 0),
        (3, "paused", 1),
    ]
    assert rows(path, "SELECT text, segment FROM event WHERE kind = 'mark'") == [("before", 2), ("after", 3)]
    assert rows(path, "SELECT DISTINCT segment FROM block WHERE segment > 1") == [(2,), (3,)]


def test_a_start_answered_late_begins_its_segment_with_its_first_sample(path):
    """Samples before their START's answer are of that segment; the stream that ran before it keeps its own."""
    source = Source()
    recorder = begin(path, source)
    recorder(source.next(100_000))  # 10 samples of the stream that runs already
    start = source.link.send(Start(100), time.monotonic_ns())
    source.board.receive(start)
    recorder(Block(time.monotonic_ns(), start, sent=True))
    late = source.next(100_000)
    answer = next(event for event in late.events if isinstance(event, CommandDone))
    recorder(Block(late.host_ns, late.raw, events=tuple(event for event in late.events if event is not answer)))
    recorder.flush()
    recorder(Block(late.host_ns, b"", events=(answer,)))
    recorder(source.next(100_000))
    recorder.close(RunEnd.FINISHED)
    acknowledged = recorder.acknowledged.samples
    assert rows(path, "SELECT id, reason FROM segment") == [(1, "opened"), (2, "started")]
    assert rows(path, "SELECT segment, sum(n) FROM block GROUP BY segment") == [(1, 10), (2, acknowledged - 10)]
    assert rows(path, "SELECT count(*) FROM event WHERE kind = 'start_hz'") == [(1,)]
    assert verify_recording(path).identical


class Stream:
    """Row maker of one link, fed with the events of blocks of one byte, and the rows that it gave."""

    def __init__(self) -> None:
        self.dtype = sample_dtype(2, "counts")
        meta = {**meta_of(Source().link), "sample_dtype": describe_dtype(self.dtype)}
        self.maker, self.rows = RowMaker(meta), []
        self.time_us = 0

    def __call__(self, *events, raw: bytes = b"x", sent: bool = False) -> None:
        self.rows += self.maker.block(Block(7, raw, sent=sent, events=events))

    def samples(self, *index: int) -> Samples:
        found = np.zeros(len(index), self.dtype)
        found["index"] = index
        found["time_us"] = self.time_us + 10 * np.arange(1, len(index) + 1)
        self.time_us += 10 * len(index)
        return Samples(found)

    def of(self, statement: str) -> list[tuple]:
        return [values for sql, values in self.rows if sql == statement]


def test_segments_begin_in_the_chunk_of_their_first_sample() -> None:
    """After a restart, a clock that went back, and a START that is answered late, once each."""
    of = Stream()
    of(of.samples(4, 5))
    of(BoardRestarted(None))
    of(of.samples(0, 1))
    of(ClockWentBack(50), of.samples(2))
    of(raw=Connection().send(Start(100), 0), sent=True)
    of(of.samples(3, 4, 0, 1))
    of(of.samples(0, 1))  # no second START: no second segment
    of(CommandDone(Start(100), 0, AckStatus.DONE))
    of.rows += of.maker.flush(last=True)
    found = [(segment, chunk, reason) for segment, _, chunk, reason, *_ in of.of(INSERT_SEGMENT)]
    assert found == [(1, 1, "opened"), (2, 2, "board restarted"), (3, 4, "clock went back"), (4, 6, "started")]
    kept = [(segment, n, first_us, last_us) for _, segment, _, n, first_us, last_us, *_ in of.of(INSERT_BLOCK)]
    assert kept == [(1, 2, 10, 20), (2, 2, 30, 40), (3, 3, 50, 70), (4, 4, 80, 110)]
    shown = [(segment, n, first_us, last_us) for _, segment, _, _, n, first_us, last_us, *_ in of.of(INSERT_OVERVIEW)]
    assert shown == kept  # no row of two segments
    assert of.maker.samples == 11


def test_a_restart_ends_the_start_before_it() -> None:
    """A board that restarts between START and its answer: its samples from 0 are of the restart's segment."""
    of = Stream()
    of(of.samples(4, 5))
    of(raw=Connection().send(Start(100), 0), sent=True)
    of(BoardRestarted(HELLO))
    of(of.samples(0, 1))
    of(CommandDone(Start(100), 0, AckStatus.DONE))
    assert [row[3] for row in of.of(INSERT_SEGMENT)] == ["opened", "board restarted", "started"]


def test_the_overview_has_a_row_of_each_thousand_samples() -> None:
    of = Stream()
    for n in range(5):
        of(of.samples(*range(500 * n, 500 * n + 500)))
        of.rows += of.maker.flush()
    assert [row[2:7] for row in of.of(INSERT_OVERVIEW)] == [(1, 2, 1000, 10, 10_000), (3, 4, 1000, 10_010, 20_000)]


def test_events_have_their_value_and_time() -> None:
    """Sensors count from 1; what happened at no sample of its own is given the newest one's time."""
    of = Stream()
    of(of.samples(0, 1))
    of(SampleGap(3, 9, 15), BoardEventReceived(BoardEvent(1, EventCode.SENSOR_SATURATED, 0), 12))
    of(BoardEventReceived(BoardEvent(1, EventCode.OVER_PRESSURE, 60_000), 13))
    of(CommandDone(SetPressure(5_000, 0), 1, AckStatus.DONE))
    of(CommandDone(SetPressure(9_000, 0), 1, AckStatus.OUT_OF_LIMITS))
    of(BoardRestarted(dataclasses.replace(HELLO, boot_reason=2)))
    found = [(kind, value, time_us) for _, _, _, time_us, _, kind, value, _ in of.of(INSERT_EVENT)]
    assert found == [
        ("gap", 3, 15), ("sensor_saturated", 1, 12), ("over_pressure_pa", 60_000, 13), ("set_pressure_pa", 5_000, 20),
        ("refused", AckStatus.OUT_OF_LIMITS, 20), ("restarted", 2, None),
    ]  # fmt: skip


def test_steps_grow_and_readings_are_corrected_by_newer_ones(recorder, source, path):
    """A step keeps what is known of it; a corrected reading stays in the file's history."""
    recorder(source.next())
    mark = add_step(recorder, 1, "unloading")
    arrived = dataclasses.replace(mark, arrived_us=20)
    recorder.step(arrived, new=False)
    recorder.step(dataclasses.replace(arrived, settled_us=30, status="reached", detail={"drift": 0.1}), new=False)
    recorder.reading(reading(1, 3.5))
    recorder.reading(reading(1, 3.0, note="misread"))
    recorder.update_meta(note="a – note")
    recorder.close(RunEnd.FINISHED)
    sql = "SELECT id, segment, number, cycle, branch, arrived_us, settled_us, ended_us, status, detail FROM step"
    assert rows(path, sql) == [(1, 1, 1, 1, "unloading", 20, 30, None, "reached", '{"drift": 0.1}')]
    assert rows(path, "SELECT elongation_mm, note FROM reading ORDER BY id") == [(3.5, ""), (3.0, "misread")]
    assert rows(path, "SELECT value FROM session WHERE key = 'note'") == [('"a – note"',)]
    with pytest.raises(RequestError, match="branch"):
        step_row(StepMark(1, 1, "sideways", 0.0, 0.0, 0), 1, new=True)
    with pytest.raises(RequestError, match="not an elongation"):
        recorder.reading(reading(1, float("nan")))


@pytest.mark.parametrize(
    ("mm", "resolution_mm", "refused"),
    [
        (1000.0, 0.5, False), (-1000.0, 0.5, False), (1000.1, 0.5, True), (-1000.1, 0.5, True), (math.inf, 0.5, True),
        (1.0, 1000.0, False), (1.0, 1000.1, True), (1.0, 0.0, True), (1.0, -0.5, True), (1.0, None, False),
    ],
)  # fmt: skip
def test_only_a_length_that_a_unit_can_have_is_a_reading(mm, resolution_mm, refused):
    """Both signs up to 1 m, and a positive resolution."""
    taken = reading(1, mm, resolution_mm=resolution_mm)
    if refused:
        with pytest.raises(RequestError, match="elongation in mm" if resolution_mm == 0.5 else "resolution"):
            reading_row(taken)
    else:
        assert reading_row(taken)[1][2:4] == (mm, resolution_mm)


def test_a_closed_recording_takes_later_readings(recorder, source, path):
    """What is entered afterwards is added, never changed, and leaves one plain file."""
    recorder(source.next())
    add_step(recorder, 1, "loading")
    assert recorder.flush()
    with pytest.raises(StorageError, match="being written"):
        append_reading(path, reading(1, 1.0))
    recorder.close(RunEnd.FINISHED)
    append_reading(path, reading(1, 1.0))
    append_reading(path, reading(1, 1.5))
    assert rows(path, "SELECT elongation_mm FROM reading ORDER BY id") == [(1.0,), (1.5,)]
    with pytest.raises(RequestError, match="no step 99"):
        append_reading(path, reading(99, 1.0))
    assert [entry.name for entry in path.parent.iterdir()] == ["run.boat"]


def test_health_is_kept_each_second(path, source):
    """The file holds the link's counters as they grew."""
    from boat_daq.engine.link.health import LinkHealth

    health = LinkHealth(lambda: source.link.statistics, asked_hz=100)
    recorder = Recorder(path, meta_of(source.link), health=health.snapshot)
    end = time.monotonic() + 2.3
    while time.monotonic() < end:
        block = source.next(10_000)
        recorder(block)
        health(block)
        time.sleep(0.02)
    recorder.close(RunEnd.FINISHED)
    samples = [row[0] for row in rows(path, "SELECT samples FROM health ORDER BY id")]
    assert 2 <= len(samples) <= 4
    assert samples == sorted(samples)
    assert samples[-1] > 50
