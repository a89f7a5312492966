"""Recordings of older and newer programs: read as they are, upgraded with a backup, never damaged."""

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
from boat_daq.engine.recording.closed_run import append_reading
from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.upgrade import upgrade
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RecordingError, RequestError, StorageError
from protocol.recording import SCHEMA_VERSION, layout_version, open_recording, read_session
from tests.boat_daq.engine.recording_source import reading
from tests.faults.old_recordings import SCHEMAS, write_old_recording, write_recording

OLD = sorted(SCHEMAS)


@pytest.fixture(scope="module")
def layouts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write one recording of every older layout and one of today's; return their folder."""
    folder = tmp_path_factory.mktemp("layouts")
    for schema in OLD:
        write_old_recording(folder / f"{schema}.boat", schema)
    write_recording(folder / "now.boat")
    return folder


@pytest.fixture(params=OLD)
def old(request: pytest.FixtureRequest, layouts: Path, tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "run.boat"
    shutil.copy(layouts / f"{request.param}.boat", path)
    yield path


def test_every_layout_has_a_recording(layouts: Path) -> None:
    """The three layouts that were called version 1, as their commits laid them out, and today's."""
    assert len(OLD) == 3
    assert {layout_version(layouts / f"{name}.boat") for name in OLD} == {1}
    assert layout_version(layouts / "now.boat") == SCHEMA_VERSION == 2


def test_older_recording_is_read_unchanged(old: Path) -> None:
    """Every reader opens it, it verifies from its bytes, and no byte of it changes."""
    content = old.read_bytes()
    run = load_recording(old)
    assert run.n == summarise(old).samples == verify_recording(old).samples > 50
    assert verify_recording(old).identical
    assert recover(old).status == "closed"
    assert len(run.readings) == 1
    assert old.read_bytes() == content
    assert [entry.name for entry in old.parent.iterdir()] == ["run.boat"]


def test_upgrade_keeps_every_value_and_the_original(old: Path) -> None:
    """Same samples, today's layout, the original beside it byte for byte; a second upgrade changes nothing."""
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


def test_second_upgrade_makes_a_second_backup(old: Path, layouts: Path) -> None:
    """The same file upgraded twice under one name leaves two backups."""
    first = upgrade(old).backup
    shutil.copy(layouts / "1_first.boat", old)
    second = upgrade(old).backup
    assert first is not None
    assert second is not None
    assert first != second
    assert second.read_bytes() == (layouts / "1_first.boat").read_bytes()


@pytest.mark.parametrize("step", ["copyfile", "_add_columns", "_keep", "replace"])
def test_failed_upgrade_leaves_the_original(
    layouts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """Whichever step the disk refuses: the file is as it was, and no partial copy remains."""
    path = tmp_path / "run.boat"
    shutil.copy(layouts / "1_first.boat", path)
    content = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    where = {"copyfile": shutil, "replace": Path}.get(step, upgrading)
    monkeypatch.setattr(where, step, fail)
    with pytest.raises(StorageError, match="full"):
        upgrade(path)
    assert path.read_bytes() == content
    assert not list(tmp_path.glob("*.part"))
    assert not list(tmp_path.glob("*-lock"))


def test_interrupted_old_recording_is_recovered_before_upgrade(tmp_path: Path) -> None:
    """It is closed in place as any killed session, in its own layout; then it can be upgraded."""
    path = write_old_recording(tmp_path / "run.boat", "1_first", status="recording")
    with pytest.raises(RequestError, match="not closed"):
        upgrade(path)
    assert recover(path).status == "recovered"
    assert layout_version(path) == 1
    assert upgrade(path).status == "upgraded"
    assert verify_recording(path).identical


def test_recording_in_progress_is_not_upgraded(tmp_path: Path) -> None:
    """Its writer's lock refuses the upgrade."""
    path = write_old_recording(tmp_path / "run.boat", "1_decoder")
    held = RecordingFile.reopen(path)
    with pytest.raises(StorageError, match="being written"):
        upgrade(path)
    held.close()


@pytest.fixture
def newer(layouts: Path, tmp_path: Path) -> Path:
    """Return a recording as a newer program could write it, with one column more."""
    path = tmp_path / "run.boat"
    shutil.copy(layouts / "now.boat", path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("ALTER TABLE step ADD COLUMN later TEXT")
        db.execute(f"PRAGMA user_version={SCHEMA_VERSION + 1}")
    return path


def test_newer_recording_is_read_and_never_written(newer: Path) -> None:
    """Additive changes do not prevent reading; every writer refuses, naming both versions and the remedy."""
    content = newer.read_bytes()
    assert load_recording(newer).n > 50
    writers = (
        lambda: append_reading(newer, reading(1, 2.0)),
        lambda: store_result(newer, "note", {"a": 1}, {}, seed=None),
        lambda: recover(newer),
        lambda: upgrade(newer),
    )
    for write in writers:
        with pytest.raises(RecordingError, match=f"layout {SCHEMA_VERSION + 1}, this program writes") as refusal:
            write()
        assert "Update" in refusal.value.remedy
    assert newer.read_bytes() == content


def test_incompatible_newer_recording_is_refused(newer: Path) -> None:
    """Versions from 100 on are not additive."""
    with closing(sqlite3.connect(newer)) as db:
        db.execute("PRAGMA user_version=100")
    with pytest.raises(RecordingError, match="layout 100") as refusal:
        open_recording(newer)
    assert refusal.value.remedy == "Update boat-daq."


def test_missing_checksums_stay_missing(layouts: Path) -> None:
    """No checksum is invented for samples of an older program; their bytes still reveal damage."""
    with closing(open_recording(layouts / "1_decoder.boat")) as db:
        assert db.execute("SELECT count(*), count(crc32) FROM block").fetchone()[1] == 0
        assert read_session(db)["status"] == "closed"


def test_resuming_an_older_recording_upgrades_it_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """New rows need today's layout: the file is upgraded first, with a backup of the original."""
    from boat_daq.engine.recording import resumption

    path = write_old_recording(tmp_path / "run.boat", "1_first")
    content = path.read_bytes()
    broken = resumption.BrokenRun(path, {}, None, (), (), 1, 0, "killed")  # type: ignore[arg-type]
    monkeypatch.setattr(resumption, "read_broken_run", lambda _: broken)
    resumption.prepare_resumption(path)
    assert layout_version(path) == SCHEMA_VERSION
    assert path.with_name("run.boat.v1.bak").read_bytes() == content
