"""Recordings of older and newer programs: read as they are, upgraded beside a backup, never harmed."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from analysis.data.boat_file import store_result
from analysis.data.load import load_recording
from boat_daq.engine.recording import upgrade as upgrading
from boat_daq.engine.recording.append import append_reading, append_result
from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.upgrade import upgrade
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.errors import OperatorError, StorageError
from protocol.errors import RecordingError
from protocol.recording import SCHEMA_VERSION, layout_version, open_recording, read_session
from tests.faults.old_recordings import SCHEMAS, write_old_recording, write_recording

OLD = sorted(SCHEMAS)


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One recording of every layout, and today's."""
    folder = tmp_path_factory.mktemp("shelf")
    for schema in OLD:
        write_old_recording(folder / f"{schema}.boat", schema)
    write_recording(folder / "now.boat")
    return folder


@pytest.fixture(params=OLD)
def old(request: pytest.FixtureRequest, shelf: Path, tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "run.boat"
    shutil.copy(shelf / f"{request.param}.boat", path)
    yield path


def test_there_is_a_recording_of_every_layout(shelf: Path) -> None:
    """The three layouts that were called version 1, as their commits laid them out, and today's."""
    assert len(OLD) == 3
    assert {layout_version(shelf / f"{name}.boat") for name in OLD} == {1}
    assert layout_version(shelf / "now.boat") == SCHEMA_VERSION == 2


def test_an_older_recording_is_read_as_it_is(old: Path) -> None:
    """Every reader takes it, verifies it from its bytes, and leaves each byte of it alone."""
    content = old.read_bytes()
    run = load_recording(old)
    assert run.n == summarise(old).samples == verify_recording(old).samples > 50
    assert verify_recording(old).identical
    assert recover(old).status == "closed"
    assert len(run.readings) == 1
    assert old.read_bytes() == content
    assert [entry.name for entry in old.parent.iterdir()] == ["run.boat"]


def test_an_upgrade_keeps_every_value_and_the_original(old: Path) -> None:
    """Same samples, today's layout, and the file as it was beside it, to the last byte; a second time does nothing."""
    content, before = old.read_bytes(), load_recording(old)
    done = upgrade(old)
    assert (done.status, done.version_before, done.version) == ("upgraded", 1, SCHEMA_VERSION)
    assert done.backup is not None
    assert done.backup.read_bytes() == content
    assert layout_version(old) == SCHEMA_VERSION
    after = load_recording(old)
    assert (after.time_s == before.time_s).all()
    assert (after.signal_mv == before.signal_mv).all()
    assert verify_recording(old).identical
    upgraded = old.read_bytes()
    assert upgrade(old).status == "current"
    assert old.read_bytes() == upgraded
    assert sorted(entry.name for entry in old.parent.iterdir()) == ["run.boat", done.backup.name]
    RecordingFile.reopen(old).close()


def test_no_backup_is_overwritten(old: Path, shelf: Path) -> None:
    """The same file upgraded twice under one name leaves two backups."""
    first = upgrade(old).backup
    shutil.copy(shelf / "1_first.boat", old)
    second = upgrade(old).backup
    assert first is not None
    assert second is not None
    assert first != second
    assert second.read_bytes() == (shelf / "1_first.boat").read_bytes()


@pytest.mark.parametrize("step", ["copyfile", "_add_columns", "_keep", "replace"])
def test_an_upgrade_that_breaks_off_leaves_the_original(
    shelf: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Whichever step the disk refuses: the name still leads to the file as it was, and no half copy stays."""
    path = tmp_path / "run.boat"
    shutil.copy(shelf / "1_first.boat", path)
    content = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    where = {"copyfile": shutil, "replace": Path}.get(step, upgrading)
    monkeypatch.setattr(where, step, fail)
    with pytest.raises(StorageError, match="full"):
        upgrade(path)
    assert path.read_bytes() == content
    assert not list(tmp_path.glob("*.upgrade"))
    assert not list(tmp_path.glob("*-lock"))


def test_an_interrupted_old_session_is_recovered_first(tmp_path: Path) -> None:
    """Closed in place as any killed session, still in its own layout; then it can be upgraded."""
    path = write_old_recording(tmp_path / "run.boat", "1_first", status="recording")
    with pytest.raises(OperatorError, match="not closed"):
        upgrade(path)
    assert recover(path).status == "recovered"
    assert layout_version(path) == 1
    assert upgrade(path).status == "upgraded"
    assert verify_recording(path).identical


def test_a_recording_under_way_is_left_alone(tmp_path: Path) -> None:
    """Its writer's lock refuses the upgrade."""
    path = write_old_recording(tmp_path / "run.boat", "1_decoder")
    held = RecordingFile.reopen(path)
    with pytest.raises(StorageError, match="being written"):
        upgrade(path)
    held.close()


@pytest.fixture
def newer(shelf: Path, tmp_path: Path) -> Path:
    """As a newer program could make it: a column and a table more."""
    path = tmp_path / "run.boat"
    shutil.copy(shelf / "now.boat", path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("ALTER TABLE step ADD COLUMN mood TEXT")
        db.execute(f"PRAGMA user_version={SCHEMA_VERSION + 1}")
    return path


def test_a_newer_recording_is_read_and_never_written(newer: Path) -> None:
    """Additive changes do not hinder reading; whatever would write says which versions, and to update."""
    content = newer.read_bytes()
    assert load_recording(newer).n > 50
    writers = (
        lambda: append_reading(newer, 1, 2.0, source="typed"),
        lambda: append_result(newer, "note", parameters={}, content={}),
        lambda: store_result(newer, "note", {"a": 1}, {}, seed=None),
        lambda: recover(newer),
        lambda: upgrade(newer),
    )
    for write in writers:
        with pytest.raises(RecordingError, match=f"layout {SCHEMA_VERSION + 1}, this program writes") as refusal:
            write()
        assert "Update" in refusal.value.remedy
    assert newer.read_bytes() == content


def test_a_newer_recording_that_broke_with_ours_is_refused(newer: Path) -> None:
    """Versions from 100 on say that they are no longer additive."""
    with closing(sqlite3.connect(newer)) as db:
        db.execute("PRAGMA user_version=100")
    with pytest.raises(RecordingError, match="layout 100") as refusal:
        open_recording(newer)
    assert refusal.value.remedy == "Update boat-daq."


def test_what_an_older_program_did_not_keep_stays_unknown(shelf: Path) -> None:
    """No checksum is made up for samples of an older program; damage in them is found by their bytes all the same."""
    with closing(open_recording(shelf / "1_decoder.boat")) as db:
        assert db.execute("SELECT count(*), count(crc32) FROM block").fetchone()[1] == 0
        assert read_session(db)["status"] == "closed"


def test_a_broken_run_of_an_older_program_goes_on_in_todays_layout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is written into it from now on would not fit: it is upgraded first, and its backup is the file as it was."""
    from boat_daq.engine.recording import resumption

    path = write_old_recording(tmp_path / "run.boat", "1_first")
    content = path.read_bytes()
    broken = resumption.BrokenRun(path, {}, None, (), (), 1, 0, "killed")  # type: ignore[arg-type]
    monkeypatch.setattr(resumption, "read_broken_run", lambda _: broken)
    resumption.prepare_resumption(path)
    assert layout_version(path) == SCHEMA_VERSION
    assert path.with_name("run.boat.v1.bak").read_bytes() == content
