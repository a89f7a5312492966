"""Resuming the recording of a broken run, without ports: keys, clocks, refusals, and the file after each."""

from __future__ import annotations

import dataclasses
import json
import shutil
import sqlite3
import time
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from boat_daq.commands.recordings import reanalyse
from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.resumption import prepare_resumption, read_broken_run
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RecordingError, RequestError, StorageError
from protocol.recording import RunEnd, breaks_of, open_recording, read_session
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import Source, add_result, add_step

PLAN = Plan(name="two turns", kind="continuous", cycles=4)


def part(recorder: Recorder, source: Source, cycles: list[int], *, broken: bool = True) -> None:
    """Record whole cycles, and then, where it is to break, the first half of another."""
    recorder.attached(source.link.decoder_state())
    for cycle in [*cycles, *([cycles[-1] + 1] if broken else [])]:
        for branch in ("unloading", "loading"):
            mark = add_step(recorder, cycle, branch)
            recorder(source.next(400_000))
            if broken and cycle > cycles[-1]:
                break
            recorder.step(dataclasses.replace(mark, status="reached", ended_us=1), new=False)
    assert recorder.flush()


def meta(source: Source, **more: Any) -> dict[str, Any]:
    return meta_of(source.link, unit="SA1", plan=dataclasses.asdict(PLAN), board_id="SIMULATED-SA1", **more)


@pytest.fixture
def left(tmp_path: Path) -> Path:
    """What a killed session leaves: two whole cycles and half of the third, the log beside the file."""
    source = Source()
    live, path = tmp_path / "live.boat", tmp_path / "run.boat"
    recorder = Recorder(live, meta(source))
    part(recorder, source, [1, 2])
    for suffix in ("", "-wal"):
        shutil.copy(tmp_path / f"live.boat{suffix}", tmp_path / f"run.boat{suffix}")
    recorder.close(RunEnd.STOPPED)
    live.unlink()
    return path


def tables(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Every row of every table that is appended to."""
    with closing(open_recording(path)) as db:
        names = ("chunk", "segment", "block", "overview", "event", "health", "step", "reading", "result")
        return {name: db.execute(f"SELECT * FROM {name} ORDER BY id").fetchall() for name in names}


def append_cycles(path: Path, cycles: list[int], *, broken: bool = False) -> None:
    """Resume a recording with another link."""
    source = Source(seed=1)
    run = prepare_resumption(path)
    recorder = Recorder(path, {**meta(source), "operator": "Ada", "note": "n"}, resumes=run)
    part(recorder, source, cycles, broken=broken)
    recorder.close(RunEnd.FINISHED)


def test_nothing_recorded_is_altered_and_everything_is_appended(left: Path) -> None:
    """Each table begins with exactly what it held; the whole is identical to its bytes; the break is recorded."""
    broken = read_broken_run(left)
    assert (broken.cause, broken.first_cycle, broken.complete_cycles) == ("interrupted", 4, 2)
    recover(left)
    before = tables(left)
    append_cycles(left, [4, 5])
    after = tables(left)
    for name, rows in before.items():
        assert after[name][: len(rows)] == rows, name
    assert verify_recording(left).difference == ""
    (found,) = summarise(left).breaks
    assert (found.complete_cycles, found.first_cycle, found.operator, found.note) == (2, 4, "Ada", "n")
    assert found.first_segment == len(before["segment"]) + 1
    assert [row[3] for row in after["segment"]][-1] == "resumed after a break"
    assert [row[6] for row in after["event"] if row[5] == "break_s"] == [found.break_s]
    assert summarise(left).cycles.complete == 4


def test_a_run_may_break_more_than_once(left: Path) -> None:
    """Twice broken, twice gone on with: two breaks in order, all cycles, identical."""
    append_cycles(left, [4], broken=True)
    assert read_broken_run(left).first_cycle == 6
    append_cycles(left, [6])
    assert [found.first_cycle for found in summarise(left).breaks] == [4, 6]
    assert summarise(left).cycles.complete == 4
    assert verify_recording(left).difference == ""
    with pytest.raises(RequestError, match="all its 4 cycles"):
        read_broken_run(left)


def test_a_result_of_a_part_is_not_compared_with_the_whole(left: Path) -> None:
    """A result stored before the run resumed is of fewer cycles: verify omits it, and derives later ones."""
    recover(left)
    options = {"options": {"plateau": {}}}
    add_result(left, "analysis", options, {"cycles": 2})
    append_cycles(left, [4, 5])
    verdict = verify_recording(left, reanalyse=reanalyse)
    assert (verdict.identical, verdict.results) == (True, 0)


def test_a_break_in_a_recording_that_stayed_open_is_kept_too(tmp_path: Path) -> None:
    """The board was unplugged, the program was not: the same entry, event and segment."""
    source, path = Source(), tmp_path / "run.boat"
    recorder = Recorder(path, meta(source))
    part(recorder, source, [1, 2])
    recorder.run_resumed("aborted: the port is gone", first_cycle=4, complete_cycles=2)
    for cycle in (4, 5):
        for branch in ("unloading", "loading"):
            mark = add_step(recorder, cycle, branch)
            recorder(source.next(400_000))
            recorder.step(dataclasses.replace(mark, status="reached", ended_us=1), new=False)
    recorder.close(RunEnd.FINISHED)
    with closing(open_recording(path)) as db:
        (entry,) = breaks_of(read_session(db))
        first = db.execute("SELECT segment FROM step WHERE id = ?", (entry["first_step"],)).fetchone()[0]
        chunk = db.execute("SELECT first_chunk FROM segment WHERE id = ?", (first,)).fetchone()[0]
    assert (entry["cause"], entry["first_cycle"], entry["complete_cycles"]) == ("aborted: the port is gone", 4, 2)
    assert (first, chunk) == (entry["first_segment"], entry["first_chunk"])
    assert verify_recording(path).difference == ""


def test_the_end_is_computed_by_the_last_breaks_own_clock(left: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The computer was restarted over the break: its monotonic clock restarted, and the end is still within a minute
    of now, not days away.
    """
    real = time.monotonic_ns
    append_cycles(left, [4], broken=True)
    monkeypatch.setattr(time, "monotonic_ns", lambda: real() // 1000)
    source = Source(seed=2)
    recorder = Recorder(left, meta(source), resumes=prepare_resumption(left))
    part(recorder, source, [6])
    for suffix in ("", "-wal"):
        shutil.copy(f"{left}{suffix}", f"{left.with_suffix('')}2.boat{suffix}")
    recorder.close(RunEnd.STOPPED)
    again = left.with_name("run2.boat")
    recover(again)
    found = summarise(again)
    assert found.ended_utc is not None
    after = datetime.fromisoformat(found.ended_utc) - datetime.fromisoformat(found.breaks[-1].utc)
    assert abs(after.total_seconds()) < 60


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"board_id": "SIMULATED-SA2"}, "board SIMULATED-SA1; now it is SIMULATED-SA2"),
        ({"unit": "SA2"}, "unit SA1; now it is SA2"),
        ({"vref_mv": 5000}, "reference voltage"),
        ({"polarity": 1}, "polarity"),
        ({"profile": "x = 1"}, "profile"),
    ],
)
def test_what_is_not_the_same_is_refused_by_name(left: Path, change: dict[str, Any], text: str) -> None:
    """Board, unit, firmware and rate; the same again is not refused."""
    broken = read_broken_run(left)
    broken.check_same(broken.meta)
    with pytest.raises(RequestError, match=text):
        broken.check_same({**broken.meta, **change})
    with pytest.raises(RequestError, match="read-only link"):
        broken.check_same(broken.meta, can_command=False)


def test_a_run_that_cannot_resume_is_refused_and_not_changed(left: Path, tmp_path: Path) -> None:
    """In progress in another program, without a plan, damaged, or with unusable breaks."""
    source = Source()
    recorder = Recorder(tmp_path / "live.boat", meta(source))
    with pytest.raises(StorageError, match="being written"):
        read_broken_run(tmp_path / "live.boat")
    recorder.update_meta(plan=None)
    recorder.close(RunEnd.STOPPED)
    with pytest.raises(RequestError, match="no run to resume"):
        read_broken_run(tmp_path / "live.boat")
    recover(left)
    for version, refused, text in ((1, RequestError, "older program"), (99, RecordingError, "layout 99")):
        other = shutil.copy(left, tmp_path / f"version{version}.boat")
        with closing(sqlite3.connect(other)) as db:
            db.execute(f"PRAGMA user_version={version}")
        with pytest.raises(refused, match=text):
            prepare_resumption(Path(other))
    content = bytearray(left.read_bytes())
    with closing(open_recording(left)) as db:
        raw = bytes(db.execute("SELECT raw FROM chunk WHERE direction = 0 AND length(raw) > 200").fetchone()[0])
    at = bytes(content).index(raw[:200])
    content[at + 50] ^= 0xFF
    left.write_bytes(content)
    with pytest.raises(StorageError, match="is damaged"):
        prepare_resumption(left)
    assert left.read_bytes() == content
    with pytest.raises(RecordingError, match="resumptions"):
        breaks_of({"resumptions": json.loads('[{"utc": 3}]')})
