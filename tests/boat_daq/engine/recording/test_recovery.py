"""What a killed session or a bad disk leaves behind, made by cutting, zeroing and flipping real recordings."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.recovery import find_interrupted, recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RecordingError, StorageError
from protocol.recording import SESSION_KEYS, RunEnd, open_recording, read_session
from protocol.simulator.board import VirtualBoard
from tests.boat_daq.engine.board_link import meta_of, record_run
from tests.boat_daq.engine.recording_source import Source

PAGE = 4096


@pytest.fixture(scope="module")
def killed(tmp_path_factory) -> Path:
    """A folder as a killed session leaves it: the file, and its log, taken while the writer lived."""
    folder = tmp_path_factory.mktemp("killed")
    source = Source()
    recorder = Recorder(folder / "live.boat", meta_of(source.link))
    recorder.attached(source.link.decoder_state())
    for number in range(12):
        recorder(source.next(200_000))
        if number == 5:
            recorder.event("user", "mark", text="half")
        assert recorder.flush()
    shutil.copy(folder / "live.boat", folder / "run.boat")
    shutil.copy(folder / "live.boat-wal", folder / "run.boat-wal")
    recorder.close(RunEnd.STOPPED)
    (folder / "live.boat").unlink()
    return folder


@pytest.fixture
def left(killed, tmp_path) -> Path:
    """A copy of it to work on."""
    for file in killed.iterdir():
        shutil.copy(file, tmp_path / file.name)
    return tmp_path / "run.boat"


@pytest.fixture(scope="module")
def closed(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("closed") / "run.boat"
    record_run(path, VirtualBoard(seed=2), 40.0)
    return path


def test_a_killed_session_is_found_and_closed_into_one_file(left):
    """Marked as recovered, ended at its last byte, verified identical, and closed: no log beside it."""
    assert find_interrupted(left.parent) == [left]
    assert summarise(left).status == "interrupted"
    before = verify_recording(left)
    recovery = recover(left)
    assert (recovery.status, recovery.path, recovery.damaged) == ("recovered", left, ())
    assert recovery.samples == before.samples > 200
    assert [entry.name for entry in left.parent.iterdir()] == ["run.boat"]
    db = open_recording(left)
    meta = read_session(db)
    last_ns = db.execute("SELECT max(host_ns) FROM chunk").fetchone()[0]
    in_overview = db.execute("SELECT sum(n) FROM overview").fetchone()[0]
    db.close()
    assert (meta["status"], meta["stop_reason"]) == ("recovered", "interrupted")
    assert meta["ended_host_ns"] == last_ns
    assert meta["ended_utc"] > meta["started_utc"]
    assert in_overview == recovery.samples
    assert verify_recording(left).identical
    assert find_interrupted(left.parent) == []


def test_recovering_twice_changes_nothing(left):
    """The second call finds a closed recording and leaves every byte as it is."""
    recover(left)
    content = left.read_bytes()
    assert recover(left).status == "recovered"
    assert left.read_bytes() == content


def test_a_closed_recording_is_left_alone(closed):
    """There is nothing to do, and not a byte is touched."""
    content = closed.read_bytes()
    assert recover(closed).status == "closed"
    assert closed.read_bytes() == content


@pytest.mark.fault(31, how="the log cut, or zeroed, from bytes of its last pages on (each byte at night)", times=100)
@pytest.mark.parametrize("step", [499, pytest.param(1, marks=[pytest.mark.nightly, pytest.mark.timeout(1800)])])
@pytest.mark.parametrize("damage", ["cut", "zero"])
def test_a_torn_log_opens_on_its_last_good_state(killed, tmp_path, damage, step):
    """Cut from any byte of its last pages on: what was committed before is there. Zeroed: more may be missing."""
    log = (killed / "run.boat-wal").read_bytes()
    path, counts = tmp_path / "run.boat", []
    for end in range(len(log) - 6 * PAGE, len(log), step):
        shutil.copy(killed / "run.boat", path)
        (tmp_path / "run.boat-wal").write_bytes(log[:end] + (b"" if damage == "cut" else bytes(len(log) - end)))
        verdict = verify_recording(path)
        assert verdict.identical == (damage == "cut"), verdict.difference
        if damage == "cut":
            counts.append(verdict.samples)
        if damage == "zero" or end % 7 == 0:
            recovery = recover(path)
        if damage == "zero":  # as many samples as are named, and more may have been recorded
            assert (recovery.status, recovery.missing.samples[-1].before_index) == ("salvaged", None)
            counts.append(recovery.samples)
        elif end % 7 == 0:
            assert (recovery.status, recovery.samples, recovery.damaged) == ("recovered", counts[-1], ())
        for file in tmp_path.iterdir():
            file.unlink()
    assert counts == sorted(counts)
    assert 0 < counts[0] < counts[-1]


@pytest.mark.fault(33, how="`recover` on a recording in progress", times=1)
def test_a_running_writer_is_left_alone(tmp_path):
    """Nothing is recovered while a program records."""
    source = Source()
    recorder = Recorder(tmp_path / "run.boat", meta_of(source.link))
    with pytest.raises(StorageError, match="being written"):
        recover(tmp_path / "run.boat")
    assert find_interrupted(tmp_path) == []
    recorder.close(RunEnd.STOPPED)


@pytest.mark.fault(32, how="one bit flipped in a chunk", times=1)
def test_bit_rot_in_the_bytes_is_named_and_the_rest_is_readable(closed, tmp_path):
    """One flipped bit in a chunk: found by its checksum, named by its number; the file is not touched."""
    path = tmp_path / "run.boat"
    shutil.copy(closed, path)
    db = sqlite3.connect(path)
    raw = bytearray(db.execute("SELECT raw FROM chunk WHERE id = 77").fetchone()[0])
    db.close()
    content = path.read_bytes()
    assert content.count(bytes(raw)) == 1
    rotten = bytes([raw[0] ^ 1]) + bytes(raw[1:])
    path.write_bytes(content.replace(bytes(raw), rotten))
    recovery = recover(path)
    assert recovery.status == "closed"
    assert recovery.damaged == ("the raw bytes of chunk 77 do not match their checksum",)
    assert recovery.samples > 3_600


def damaged_copy(closed: Path, tmp_path: Path, first_page: int, pages: int, how: str) -> Path:
    path = tmp_path / "run.boat"
    content = bytearray(closed.read_bytes())
    start, end = first_page * PAGE, (first_page + pages) * PAGE
    if how == "cut":
        del content[start:]
    else:
        content[start:end] = bytes(min(end, len(content)) - start)
    path.write_bytes(content)
    return path


@pytest.mark.fault(31, 32, how="pages zeroed, or the file cut off", times=5)
@pytest.mark.parametrize(
    ("where", "pages", "how"), [(0.5, 1, "zero"), (0.5, 8, "zero"), (0.9, 1, "zero"), (0.95, 0, "cut"), (0.6, 0, "cut")]
)
def test_what_is_readable_of_a_damaged_file_is_saved_beside_it(closed, tmp_path, where, pages, how):
    """Pages lost or cut off: the original stays, the readable rows are in a new, sound file, the rest is named."""
    n_pages = closed.stat().st_size // PAGE
    path = damaged_copy(closed, tmp_path, int(where * n_pages), pages, how)
    content = path.read_bytes()
    recovery = recover(path)
    assert path.read_bytes() == content
    assert recovery.damaged
    if recovery.status == "closed":  # the page was inside one value: its row alone is damaged, and named
        assert how == "zero"
        assert pages == 1
        return
    assert recovery.status == "salvaged"
    assert recovery.path == tmp_path / "run.salvaged.boat"
    whole = summarise(closed)
    with closing(sqlite3.connect(closed)) as db:
        (chunks,) = db.execute("SELECT count(*) FROM chunk").fetchone()
    assert recovery.chunks > 0.4 * chunks
    summary = summarise(recovery.path)
    assert summary.status == "recovered"
    assert 0 < summary.samples <= whole.samples
    db = open_recording(recovery.path)
    assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    assert set(SESSION_KEYS) <= set(read_session(db))
    db.close()


def test_a_second_rescue_gets_a_name_of_its_own(closed, tmp_path):
    """Nothing that was saved before is overwritten."""
    path = damaged_copy(closed, tmp_path, 40, 2, "zero")
    assert recover(path).path.name == "run.salvaged.boat"
    assert recover(path).path.name == "run.salvaged2.boat"


@pytest.mark.fault(36, how="0 bytes, a text, a header alone, NULs", times=4)
@pytest.mark.parametrize("content", [b"", b"hello", b"SQLite format 3\0" + bytes(200), bytes(5000)])
def test_a_file_that_is_not_a_recording_is_refused(tmp_path, content):
    """An empty file, a text, a header without a database: refused by what they are, and left as they are."""
    path = tmp_path / "run.boat"
    path.write_bytes(content)
    with pytest.raises(RecordingError):
        recover(path)
    assert path.read_bytes() == content
    assert find_interrupted(tmp_path) == []


def test_another_programs_database_is_refused(tmp_path):
    """Any SQLite file is not a recording."""
    path = tmp_path / "run.boat"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE chunk (id INTEGER)")
    db.commit()
    db.close()
    with pytest.raises(RecordingError, match="another program"):
        recover(path)


def test_a_forged_count_is_reported_and_not_used(closed, tmp_path):
    """A block that claims 4e14 samples: the number reported is of the samples that are there."""
    path = tmp_path / "forged.boat"
    shutil.copy(closed, path)
    with closing(sqlite3.connect(path)) as db, db:
        there = db.execute("SELECT sum(n) FROM block").fetchone()[0]
        db.execute("UPDATE block SET n = 400000000000000 WHERE id = 2")
        db.execute("UPDATE overview SET n = 400000000000000 WHERE id = 1")
    found = recover(path)
    assert found.samples == there
    assert any("block 2 is for" in text for text in found.damaged)
    with pytest.raises(RecordingError, match="more samples than"):
        summarise(path)


def test_recovery_can_be_cancelled(closed, tmp_path):
    """Raising from progress stops it, and leaves no half file behind."""
    path = damaged_copy(closed, tmp_path, 40, 2, "zero")

    def cancel(_done: float, _total: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(path, progress=cancel)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.boat"]
