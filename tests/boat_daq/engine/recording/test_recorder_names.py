"""A recording's name and place: any script, nothing overwritten, one writer."""

from __future__ import annotations

import sys

import pytest

from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RequestError, StorageError
from protocol.recording import RunEnd, open_recording, read_session, writer_lock
from protocol.recording.writer_lock import WriterLock, is_being_written, lock_path
from protocol.simulator.board import VirtualBoard
from tests.boat_daq.engine.board_link import meta_of, record_run
from tests.boat_daq.engine.recording_source import rows


@pytest.mark.fault(36, how="names with signs of many scripts and uses", times=4)
@pytest.mark.parametrize(
    "name", ["läuft 中文 \U0001f6a4.boat", "with space.boat", "a'b#c%d;e.boat", "x" * 235 + ".boat"]
)
def test_names_of_any_script_work(tmp_path, source, name):
    """Unicode, spaces, signs that mean something to a URI, and the longest name."""
    path = tmp_path / name
    record_run(path, VirtualBoard(), 1.0)
    assert verify_recording(path).samples > 50


@pytest.mark.fault(36, how="reserved, too long, or with characters that Windows refuses", times=9)
@pytest.mark.parametrize(
    "name",
    ["CON.boat", "nul.boat", "lpt1.x.boat", "a:b.boat", "a?.boat", "a\n.boat", "x" * 236 + ".boat", "run.db", ".boat"],
)
def test_names_that_some_system_cannot_hold_are_refused(tmp_path, source, name):
    """Refused before anything is written, with the reason."""
    with pytest.raises(RequestError) as refusal:
        Recorder(tmp_path / name, meta_of(source.link))
    assert refusal.value.remedy
    assert not list(tmp_path.iterdir())


def test_an_existing_file_is_never_overwritten(path, source):
    """Nothing recorded is ever lost."""
    path.write_bytes(b"precious")
    with pytest.raises(RequestError, match="exists already"):
        Recorder(path, meta_of(source.link))
    assert path.read_bytes() == b"precious"
    assert not lock_path(path).exists()


def test_a_folder_that_is_not_there_is_refused(tmp_path, source):
    """Before the start, with a reason."""
    with pytest.raises(StorageError, match="no folder"):
        Recorder(tmp_path / "none" / "run.boat", meta_of(source.link))


@pytest.mark.fault(33, how="a second recorder on the file", times=1)
def test_a_second_writer_is_refused_and_may_read(recorder, source, path):
    """Two programs on one recording: the second reads only."""
    recorder(source.next())
    recorder.flush()
    assert is_being_written(path)
    with pytest.raises(StorageError, match="being written"):
        recover(path)
    assert rows(path, "SELECT count(*) FROM chunk") == [(1,)]


def test_lock_of_a_removed_file_is_no_lock(path, monkeypatch):
    """A second writer opens the lock file, the first closes and removes it, a third locks a new one: not both."""
    first, third = WriterLock(path), []
    try_lock = writer_lock._try_lock

    def late(descriptor):
        if not third:
            third.append(None)
            first.close()
            third[0] = WriterLock(path)
        return try_lock(descriptor)

    monkeypatch.setattr(writer_lock, "_try_lock", late)
    with pytest.raises(StorageError, match="being written"):
        WriterLock(path)
    third[0].close()
    assert not lock_path(path).exists()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a lock can only be tried, not looked at")
def test_looking_for_a_writer_refuses_no_writer(path, monkeypatch):
    """`is_being_written` never takes the lock, not even for a moment."""
    lock = WriterLock(path)
    monkeypatch.setattr(writer_lock, "_try_lock", lambda descriptor: pytest.fail("took the lock"))
    assert is_being_written(path)
    lock.close()
    lock_path(path).touch()  # left by a program that was killed
    assert not is_being_written(path)


def test_a_reader_left_open_does_not_keep_a_recording_from_closing(recorder, source, path):
    """The file is whole and marked closed; only its log stays beside it until the reader is gone."""
    recorder(source.next())
    recorder.flush()
    reader = open_recording(path)
    reader.execute("SELECT count(*) FROM chunk").fetchone()
    recorder.close(RunEnd.FINISHED)
    assert "another program" in recorder.warning
    assert read_session(reader)["status"] == "closed"
    reader.close()
    assert recover(path).status == "closed"
    assert [entry.name for entry in path.parent.iterdir()] == ["run.boat"]
