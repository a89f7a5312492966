"""The recorder on a disk that is full, gone or slow: reported once, the file an unbroken beginning."""

from __future__ import annotations

import shutil
import time
from types import SimpleNamespace

import numpy as np
import pytest

from boat_daq.engine.link.block import Block
from boat_daq.engine.recording import recorder as recorder_module
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import StorageError
from protocol.recording import RunEnd
from protocol.recording.writer_lock import is_being_written
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import begin, rows, stored_samples


def limit_pages(recorder: Recorder, pages: int) -> None:
    """Make SQLite report a full disk beyond so many pages, at a chosen write."""
    recorder._file._connection.execute(f"PRAGMA max_page_count = {pages}")


@pytest.mark.fault(28, how="SQLite's page limit reached at several pages, then lifted", times=5)
@pytest.mark.parametrize("pages", [14, 15, 17, 20, 30])
def test_a_full_disk_is_reported_once_and_loses_nothing_once_freed(path, source, pages):
    """Full at any write: reported once, what is written stays sound, and the rest is written once space is free."""
    errors = []
    recorder = begin(path, source, on_error=errors.append)
    limit_pages(recorder, pages)
    deadline = time.monotonic() + 10
    while not errors and time.monotonic() < deadline:
        recorder(source.next(500_000))
        time.sleep(0.01)
    assert [type(error) for error in errors] == [StorageError]
    assert "full" in errors[0].cause
    assert recorder.failure == errors[0].cause
    kept = rows(path, "SELECT coalesce(sum(n), 0) FROM block")[0][0]
    assert kept == recorder.acknowledged.samples < sum(map(len, source.samples))
    assert rows(path, "PRAGMA quick_check") == [("ok",)]
    limit_pages(recorder, 1_000_000)
    assert recorder.flush(5.0)
    assert recorder.failure == ""
    recorder.close(RunEnd.FINISHED)
    assert len(errors) == 1
    assert stored_samples(path) == np.concatenate(source.samples).tobytes()


@pytest.mark.fault(28, how="SQLite's page limit reached for good", times=1)
def test_a_disk_that_stays_full_ends_in_an_error_and_a_readable_beginning(path, source):
    """Closing reports that the rest was not written; what is there opens, verifies, and can be recovered."""
    errors = []
    recorder = begin(path, source, on_error=errors.append)
    for _ in range(10):
        recorder(source.next())
    recorder.flush()
    kept = recorder.acknowledged.samples
    limit_pages(recorder, 1)
    for _ in range(40):
        recorder(source.next(500_000))
    with pytest.raises(StorageError, match="full"):
        recorder.close(RunEnd.FINISHED)
    assert not is_being_written(path)
    assert verify_recording(path).samples == kept > 0
    assert recover(path).status == "recovered"
    assert verify_recording(path).identical


@pytest.mark.fault(35, how="a disk that takes nothing while samples arrive", times=1)
def test_memory_is_bounded_and_the_file_an_unbroken_beginning(path, source, monkeypatch):
    """Once what waits would outgrow its bound no later byte is taken, also when the disk has space again."""
    monkeypatch.setattr(recorder_module, "MEMORY_BYTES_MAX", 50_000)
    errors = []
    recorder = begin(path, source, on_error=errors.append)
    limit_pages(recorder, 1)
    for _ in range(100):
        recorder(source.next(100_000))
    limit_pages(recorder, 1_000_000)
    assert recorder.flush(5.0)
    recorder(source.next())
    recorder.close(RunEnd.FINISHED)
    stored, all_of_it = stored_samples(path), np.concatenate(source.samples).tobytes()
    assert 0 < len(stored) < len(all_of_it)
    assert all_of_it.startswith(stored)
    assert rows(path, "SELECT count(*) FROM event WHERE kind = 'recording_full'") == [(1,)]
    assert verify_recording(path).identical


def test_a_fault_of_the_program_is_reported_and_ends_the_recording(path, source, monkeypatch):
    """The writing thread never ends without an error, and writes no later byte behind a hole."""
    errors = []
    recorder = begin(path, source, on_error=errors.append)
    recorder(source.next())
    assert recorder.flush()
    kept = recorder.acknowledged.samples
    monkeypatch.setattr(recorder._rows, "block", lambda _block: 1 / 0)
    recorder(source.next())
    deadline = time.monotonic() + 5
    while not errors and time.monotonic() < deadline:
        time.sleep(0.02)
    monkeypatch.undo()
    recorder(source.next())
    recorder.close(RunEnd.ABORTED, "fault")
    assert "ZeroDivisionError" in errors[0].cause
    assert rows(path, "SELECT sum(n) FROM block") == [(kept,)]
    assert verify_recording(path).identical


@pytest.mark.fault(29, how="the file removed while it is recorded", times=1)
def test_a_removed_folder_is_detected(path, source):
    """Writing reports no error: the file's name is looked up every second."""
    folder = path.parent / "stick"
    folder.mkdir()
    errors = []
    recorder = Recorder(folder / "run.boat", meta_of(source.link), on_error=errors.append)
    recorder(source.next())
    recorder.flush()
    shutil.rmtree(folder)
    deadline = time.monotonic() + 4
    while not errors and time.monotonic() < deadline:
        recorder(source.next())
        time.sleep(0.02)
    assert "moved or removed" in errors[0].cause
    assert recorder.failure == errors[0].cause
    with pytest.raises(StorageError, match="moved or removed"):  # it was "what is recorded so far is kept"
        recorder.close(RunEnd.ABORTED)


def test_a_nearly_full_disk_is_reported_while_closing_is_possible(path, source, monkeypatch):
    """Below the floor of free bytes the session is notified, and the recording still closes properly."""
    monkeypatch.setattr("boat_daq.engine.recording.file.SPACE_FLOOR_BYTES", 1 << 60)
    errors = []
    recorder = Recorder(path, meta_of(source.link), on_error=errors.append)
    recorder(source.next())
    recorder.flush()
    recorder.close(RunEnd.ABORTED, "disk")
    assert ["MB left" in error.cause for error in errors] == [True]
    assert verify_recording(path).identical


def test_a_disk_that_takes_nothing_is_waited_for_with_up_to_128_mib(path, source):
    """Blocks of 0.5 MiB count twice: 127 of them wait (decision 0017), the next is refused with a message."""
    errors = []
    recorder = begin(path, source, on_error=errors.append)
    limit_pages(recorder, 1)
    block = Block(0, bytes(2**19))
    for _ in range(127):
        recorder(block)
    assert recorder._refusing is None
    recorder(block)
    assert recorder._refusing.cause.endswith("is written too slowly")
    with pytest.raises(StorageError):
        recorder.close(RunEnd.ABORTED)


@pytest.mark.parametrize(("free_mib", "reported"), [(33, False), (31, True)])
def test_a_recording_ends_below_32_mib_of_free_disk(path, source, monkeypatch, free_mib, reported):
    """The space that closing a recording may need."""
    recorder = begin(path, source)
    free = SimpleNamespace(free=free_mib * 2**20)
    monkeypatch.setattr("boat_daq.engine.recording.file.shutil.disk_usage", lambda _: free)
    if reported:
        with pytest.raises(StorageError, match="MB left"):
            recorder._file.check_space()
    else:
        recorder._file.check_space()
    monkeypatch.undo()
    recorder.close(RunEnd.FINISHED)
