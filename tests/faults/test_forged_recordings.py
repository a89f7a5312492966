"""Forged recordings: refused by every reader, in bounded memory and time, and nothing in them is executed."""

from __future__ import annotations

import shutil
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing, nullcontext, suppress
from pathlib import Path

import pytest

from analysis.data.boat_file import store_result
from analysis.data.boat_writer import write_boat_file
from analysis.data.csv_import import import_csv
from analysis.data.load import load_recording
from analysis.optics.sweep.sweep_file import SweepFile
from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.recovery import find_interrupted, recover
from boat_daq.engine.recording.upgrade import upgrade
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import FileError, RecordingError
from protocol.recording import checks
from tests.faults.decoders import REFUSALS
from tests.faults.forged_sqlite import journal_that_names
from tests.faults.old_recordings import write_recording


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("sound") / "run.boat")


# ---- forged recordings -----------------------------------------------------------------------------------------------

ENDLESS = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS key, x AS value FROM n"
BREAK = (
    '{"utc": "2026-01-01T00:00:00+00:00", "cause": "stopped", "break_s": "x", "host_ns": 1, "first_segment": 1,'
    ' "first_chunk": 1, "first_step": 1, "first_cycle": 1, "complete_cycles": 1, "last_result": 0}'
)
FORGED = {
    "a view in a table's place": ["DROP TABLE session", f"CREATE VIEW session AS {ENDLESS}"],
    "a view that never ends": ["DROP TABLE block", f"CREATE VIEW block AS {ENDLESS}"],
    "a trigger": ["CREATE TRIGGER t AFTER INSERT ON reading BEGIN DELETE FROM chunk; END"],
    "a virtual table": ["CREATE VIRTUAL TABLE found USING fts5(x)"],
    "a generated column": [
        "ALTER TABLE block RENAME TO kept",
        "CREATE TABLE block (id INTEGER PRIMARY KEY, segment INTEGER, last_chunk INTEGER, n INTEGER,"
        " first_time_us INTEGER, last_time_us INTEGER, crc32 INTEGER, samples BLOB AS (zeroblob(900000000)))",
    ],
    "text for numbers": ["UPDATE block SET n = 'many'"],
    "a number for bytes": ["UPDATE block SET samples = 7"],
    "times beyond any measure": ["UPDATE event SET host_ns = 9223372036854775807"],
    "an infinite figure": ["UPDATE step SET target_kpa = 9e999"],
    "samples that are objects": ["""UPDATE session SET value = '[["index","|O",[]]]' WHERE key = 'sample_dtype'"""],
    "samples without a time": ["""UPDATE session SET value = '[["index","<u4",[]]]' WHERE key = 'sample_dtype'"""],
    "a year that no calendar has": ["UPDATE session SET value = '\"99999-01-01\"' WHERE key = 'started_utc'"],
    "a converter of 10^9 bits": ["UPDATE session SET value = '1000000000' WHERE key = 'adc_bits'"],
    "a break of no length": [f"INSERT INTO session VALUES ('resumptions', '[{BREAK}]')"],
    "a number of 400 digits": [f"UPDATE session SET value = '1{'0' * 400}' WHERE key = 'vref_mv'"],
    "nested JSON": [f"UPDATE session SET value = '{'[' * 50_000}' WHERE key = 'note'"],
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(FORGED))
def test_forged_recording_is_refused_by_every_reader(sound: Path, tmp_path: Path, name: str) -> None:
    """Every reader refuses it with a cause, executes nothing in it and leaves the file as it is."""
    path = tmp_path / "run.boat"
    shutil.copy(sound, path)
    with closing(sqlite3.connect(path)) as db:
        for statement in FORGED[name]:
            db.execute(statement)
        db.commit()
    content = path.read_bytes()
    with pytest.raises(REFUSALS):
        load_recording(path)
    for read in (RecordingFile.reopen, upgrade):
        try:
            found = read(path)  # type: ignore[operator]
        except REFUSALS:
            continue
        if isinstance(found, RecordingFile):
            found.abandon()
    assert find_interrupted(tmp_path) == []
    try:
        recovery = recover(path)
    except REFUSALS as refusal:
        assert refusal.cause
    else:
        assert recovery.damaged or recovery.status == "closed"
    assert path.read_bytes() == content


@pytest.mark.fault(52, how="more steps, readings, segments and results than any session makes", times=4)
@pytest.mark.parametrize("table", checks.MAX_ROWS)
def test_more_rows_than_a_session_makes_are_refused(
    sound: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, table: str
) -> None:
    """A million readings took half a gigabyte."""
    path = tmp_path / "run.boat"
    shutil.copy(sound, path)
    with closing(sqlite3.connect(path)) as db:
        rows = db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
    for most, refused in ((rows, False), (rows - 1, True)):
        monkeypatch.setitem(checks.MAX_ROWS, table, most)
        with pytest.raises(RecordingError, match=f"table '{table}' has more than") if refused else nullcontext():
            load_recording(path)


def test_cyclic_pages_are_refused(sound: Path, tmp_path: Path) -> None:
    """A B-tree in which a page is its own child is refused, not followed without end."""
    content = bytearray(sound.read_bytes())
    with closing(sqlite3.connect(sound)) as db:
        pages = dict(db.execute("SELECT name, rootpage FROM sqlite_schema WHERE type = 'table'"))
    root = pages["event"]
    at = (root - 1) * 4096
    cells = 300
    page = bytearray(4096)
    page[:12] = struct.pack(">BHHHBI", 5, 0, cells, 4096 - 8 * cells, 0, root)
    for cell in range(cells):
        where = 4096 - 8 * (cell + 1)
        page[12 + 2 * cell : 14 + 2 * cell] = struct.pack(">H", where)
        page[where : where + 5] = struct.pack(">IB", root, cell % 127 + 1)
    content[at : at + 4096] = page
    path = tmp_path / "run.boat"
    path.write_bytes(content)
    with pytest.raises(REFUSALS):
        load_recording(path)
    recovery = recover(path)
    assert recovery.status == "salvaged"
    assert any("event" in text for text in recovery.damaged)
    assert recovery.samples > 50


def test_sweep_file_with_a_view_is_refused(tmp_path: Path) -> None:
    """The results file of a sweep is the other kind of SQLite file that the program opens."""
    SweepFile(tmp_path / "sweep.sqlite", {"rays": 1})
    with closing(sqlite3.connect(tmp_path / "sweep.sqlite")) as db:
        db.execute("CREATE VIEW v AS SELECT 1")
    with pytest.raises(REFUSALS, match="has a view or trigger"):
        SweepFile(tmp_path / "sweep.sqlite", {"rays": 1})


@pytest.mark.parametrize("name", ["closed", "unknown"])
def test_file_of_another_kind_is_refused(tmp_path: Path, name: str) -> None:
    """A text file with the right suffix, a database of another program."""
    path = tmp_path / f"{name}.boat"
    if name == "closed":
        path.write_text("time,pressure\n1,2\n", encoding="utf-8")
    else:
        with closing(sqlite3.connect(path)) as db:
            db.execute("CREATE TABLE chunk (id INTEGER)")
    with pytest.raises((RecordingError, REFUSALS)):
        load_recording(path)


@pytest.mark.parametrize("time_s", ["1e31", "-1e13"])
def test_time_beyond_64_bits_is_refused_without_a_file(tmp_path: Path, time_s: str) -> None:
    """More microseconds than 64 bits hold would wrap into another time."""
    path = tmp_path / "table.csv"
    first, second = sorted(["0", time_s], key=float)
    path.write_text(f"time_s,pressure_kpa,s1_mv\n{first},1,2\n{second},3,4\n", encoding="utf-8")
    with pytest.raises(FileError, match="is out of range"):
        write_boat_file(tmp_path / "run.boat", import_csv(path), original=path)
    assert list(tmp_path.iterdir()) == [path]


# ---- what lies beside a recording ------------------------------------------------------------------------------------

READERS = {
    "load": load_recording,
    "verify": verify_recording,
    "recover": recover,
    "reopen": RecordingFile.reopen,
    "store": lambda path: store_result(path, "analysis", {}, {}, seed=1),
    "upgrade": upgrade,
}


@pytest.mark.fault(51, how="a journal beside a recording that names another file, which SQLite would delete", times=6)
@pytest.mark.parametrize("reader", sorted(READERS))
def test_forged_journal_deletes_no_other_file(sound: Path, tmp_path: Path, reader: str) -> None:
    """Every reader refuses the recording and the other file is unchanged; SQLite 3.40 would delete it."""
    path, other = tmp_path / "run.boat", tmp_path / "precious.txt"
    shutil.copy(sound, path)
    other.write_text("precious", encoding="utf-8")
    journal_that_names(path, other)
    with pytest.raises(REFUSALS):
        READERS[reader](path)  # type: ignore[operator]
    assert other.read_text(encoding="utf-8") == "precious"
    if reader == "recover" and sqlite3.sqlite_version_info < (3, 41):  # shows that the forged journal is effective
        with closing(sqlite3.connect(path)) as db:
            db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
        assert not other.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="symbolic links need a right there")
@pytest.mark.fault(51, how="links to another file in the place of a recording's log, journal and lock", times=8)
@pytest.mark.parametrize("suffix", ["-wal", "-shm", "-journal", "-lock"])
@pytest.mark.parametrize("status", ["closed", "recording"])
def test_link_beside_a_recording_is_not_followed_by_writes(
    sound: Path, tmp_path: Path, suffix: str, status: str
) -> None:
    """The recording is used or refused; the target of the link is unchanged."""
    path, other = tmp_path / "run.boat", tmp_path / "precious.txt"
    shutil.copy(sound, path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("UPDATE session SET value = ? WHERE key = 'status'", (f'"{status}"',))
        db.execute(f"PRAGMA journal_mode={'WAL' if status == 'recording' else 'DELETE'}")
        db.commit()
    other.write_text("precious", encoding="utf-8")
    path.with_name(path.name + suffix).symlink_to(other)
    for read in READERS.values():
        with suppress(REFUSALS):
            found = read(path)  # type: ignore[operator]
            if isinstance(found, RecordingFile):
                found.close()
    assert other.read_text(encoding="utf-8") == "precious"


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
@pytest.mark.fault(30, how="a program killed with -9 while it adds a result to a closed recording", times=1)
def test_recover_rolls_back_a_killed_analysis(sound: Path, tmp_path: Path) -> None:
    """Every reader refuses the recording because of the journal that is left; `recover` rolls it back."""
    path = tmp_path / "run.boat"
    shutil.copy(sound, path)
    subprocess.run([sys.executable, "-c", HALF_ADDED, str(path)], check=False, timeout=60)
    assert path.with_name("run.boat-journal").exists()
    with pytest.raises(RecordingError, match="middle of a change") as refusal:
        load_recording(path)
    assert refusal.value.command == f"boat-daq recover {path}"
    assert recover(path).damaged == ()
    assert verify_recording(path).identical
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT count(*) FROM result WHERE id >= 1000").fetchone() == (0,)
    assert path.read_bytes() == sound.read_bytes()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["run.boat"]


HALF_ADDED = """
import os, signal, sqlite3, sys
db = sqlite3.connect(sys.argv[1], isolation_level=None)
db.execute("PRAGMA cache_size=2")  # so that pages reach the disk before the commit
db.execute("BEGIN")
for number in range(200):
    db.execute("INSERT INTO result VALUES (?, '', 'x', '', 1, ?, ?)", (number + 1000, "y" * 3000, "z" * 3000))
os.kill(os.getpid(), signal.SIGKILL)
"""
