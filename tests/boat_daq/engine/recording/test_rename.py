"""Renaming a closed recording with its companions, and notes on it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from analysis import load_recording
from boat_daq.engine.recording.rename import add_note, companions, rename
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RequestError, StorageError
from protocol.recording.writer_lock import WriterLock

SAMPLE = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.fixture
def closed(tmp_path):
    """A closed recording with a file of readings beside it."""
    path = Path(shutil.copy(SAMPLE, tmp_path / "old.boat"))
    companions(path)[0].write_text("pressure_kpa,elongation_mm\n0,0\n")
    return path


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_companions_are_renamed_with_the_recording(closed, tmp_path):
    """Both have the new name, nothing else is left, and the bytes are those of before."""
    before = closed.read_bytes()
    path = rename(closed, "new.boat")
    assert names(tmp_path) == ["new.boat", "new.elongation.csv"]
    assert path.read_bytes() == before


@pytest.mark.parametrize("taken", ["new.boat", "new.elongation.csv"])
def test_no_file_is_overwritten(closed, tmp_path, taken):
    """A name in use, of the recording or a companion, is refused, and all keep their names."""
    (tmp_path / taken).write_text("mine")
    with pytest.raises(RequestError, match="exists already"):
        rename(closed, "new.boat")
    assert names(tmp_path) == sorted([taken, "old.boat", "old.elongation.csv"])
    assert (tmp_path / taken).read_text() == "mine"


def test_failed_rename_is_reversed(closed, tmp_path, monkeypatch):
    """Where a companion cannot be renamed, the recording gets its name back."""
    renamed = Path.rename

    def fail(self, target):
        if self.suffix == ".csv":
            raise PermissionError(13, "Permission denied")
        return renamed(self, target)

    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(StorageError):
        rename(closed, "new.boat")
    assert names(tmp_path) == ["old.boat", "old.elongation.csv"]


@pytest.mark.parametrize("name", ["../x.boat", "x.csv", "a:b.boat", " .boat"])
def test_unusable_names_are_refused(closed, tmp_path, name):
    """A name that leaves the folder, of another kind, or that some system cannot hold."""
    with pytest.raises(RequestError):
        rename(closed, name)
    assert "old.boat" in names(tmp_path)


def test_recording_in_use_keeps_its_name(closed):
    """What another program writes is not renamed."""
    lock = WriterLock(closed)
    with pytest.raises(StorageError):
        rename(closed, "new.boat")
    lock.close()


def test_newest_note_counts_and_the_recording_still_verifies(closed):
    """Notes are added, never changed; an empty one withdraws; samples, gaps and readings are untouched."""
    before = summarise(closed)
    add_note(closed, "tube replaced")
    add_note(closed, "tube replaced, zero checked")
    assert summarise(closed).note == load_recording(closed).meta["note"] == "tube replaced, zero checked"
    assert verify_recording(closed).identical
    add_note(closed, "")
    after = summarise(closed)
    assert after.note == ""
    assert (after.gaps, after.samples, after.readings) == (before.gaps, before.samples, before.readings)
    with pytest.raises(RequestError, match="longer"):
        add_note(closed, "x" * 3000)
