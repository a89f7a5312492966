"""The recording's schema: its records, and files that come from anywhere."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.base.errors import RecordingError
from protocol.recording import (
    APPLICATION_ID,
    SCHEMA_VERSION,
    SESSION_KEYS,
    TABLES,
    RunEnd,
    describe_dtype,
    dtype_from_description,
    open_recording,
    read_session,
    run_end_of,
    sample_dtype,
)


@given(st.integers(1, 4), st.sampled_from(["counts", "signal"]))
def test_a_sample_type_survives_its_description(n_sensors, kind):
    """The stored description gives the same packed little-endian record back, through JSON."""
    dtype = sample_dtype(n_sensors, kind)
    again = dtype_from_description(json.loads(json.dumps(describe_dtype(dtype))))
    assert again == dtype
    assert again.itemsize == 31 + (4 if kind == "counts" else 8) * n_sensors


@pytest.mark.fault(50, how="samples declared as objects and texts", times=5)
@pytest.mark.parametrize(
    "row", [["x", "|O", []], ["x", "<U4", []], ["x", "<f8", [0]], ["x", "<f8", [65]], ["x", "|V8", []]]
)
def test_objects_and_texts_are_refused_as_samples(row):
    """A description can name plain numbers and nothing else."""
    with pytest.raises(ValueError, match="unusable"):
        dtype_from_description([row])


@pytest.fixture
def path(tmp_path) -> Path:
    path = tmp_path / "a #1 %20 é.boat"
    db = sqlite3.connect(path)
    db.executescript(TABLES)
    db.execute(f"PRAGMA application_id={APPLICATION_ID}")
    db.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
    db.executemany("INSERT INTO session VALUES (?, ?)", [(key, "null") for key in SESSION_KEYS])
    db.commit()
    db.close()
    return path


def change(path: Path, *statements: str) -> None:
    db = sqlite3.connect(path)
    for statement in statements:
        db.execute(statement)
    db.commit()
    db.close()


def test_a_recording_opens_for_reading_only(path):
    """Whatever the reader does, the file stays as it is."""
    content = path.read_bytes()
    db = open_recording(path)
    assert set(read_session(db)) == set(SESSION_KEYS)
    with pytest.raises(sqlite3.OperationalError, match=r"readonly|query_only"):
        db.execute("DELETE FROM session")
    db.close()
    assert path.read_bytes() == content


def test_a_newer_recording_with_more_in_it_opens(path):
    """Changes are additive: a column or a table more is no reason to refuse."""
    change(path, "ALTER TABLE step ADD COLUMN mood TEXT", "CREATE TABLE more (id INTEGER)", "PRAGMA user_version=9")
    with closing(open_recording(path)) as db:
        assert db.execute("PRAGMA user_version").fetchone() == (9,)


@pytest.mark.parametrize(
    ("statements", "cause"),
    [
        (["CREATE VIEW v AS SELECT 1"], "would run"),
        (["CREATE TRIGGER t AFTER INSERT ON chunk BEGIN DELETE FROM chunk; END"], "would run"),
        (["DROP TABLE block", "CREATE VIEW block AS SELECT * FROM chunk"], "would run"),
        (["CREATE VIRTUAL TABLE f USING fts5(x)"], "would run"),
        (["DROP TABLE block"], "no table 'block'"),
        (["ALTER TABLE block DROP COLUMN samples"], "no column 'samples'"),
        (["PRAGMA application_id=7"], "another program"),
    ],
)
def test_foreign_schema_is_refused_before_it_is_read(path, statements, cause):
    """Views, triggers and virtual tables run code of the file's maker; a missing table is no recording."""
    change(path, *statements)
    with pytest.raises(RecordingError, match=cause):
        open_recording(path)


@pytest.mark.fault(52, how="a value of 80 MB, and one of 9 MB, in a recording", times=2)
@pytest.mark.parametrize(("size", "why"), [(80_000_000, "too big"), (9_000_000, "8388608 bytes")])
def test_a_giant_value_is_not_read(path, size, why):
    """A text beyond the bound of SQLite's own values, or of what becomes JSON, is refused when the file is opened."""
    change(path, f"INSERT INTO result VALUES (1, '', '', '', 0, '', CAST(zeroblob({size}) AS TEXT))")
    with pytest.raises(RecordingError, match=why):
        open_recording(path)


@pytest.mark.parametrize("value", ["not json", "[" * 100_000, ""])
def test_description_that_is_not_json_is_refused(path, value):
    """No traceback from a hand-edited file."""
    change(path, f"UPDATE session SET value = '{value}' WHERE key = 'note'")
    db = open_recording(path)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_session(db)
    db.close()


def test_a_missing_key_is_named(path):
    """Every recording has all keys."""
    change(path, "DELETE FROM session WHERE key = 'plan'")
    db = open_recording(path)
    with pytest.raises(RecordingError, match="no 'plan'"):
        read_session(db)
    db.close()


@given(st.binary(max_size=300))
def test_arbitrary_bytes_are_refused(tmp_path_factory, content):
    """Any file is either a recording or an error of the program."""
    path = tmp_path_factory.getbasetemp() / "any.boat"
    for head in (b"", b"SQLite format 3\0"):
        path.write_bytes(head + content)
        with pytest.raises(RecordingError):
            open_recording(path)


def test_the_state_and_flag_bytes_fit_the_record():
    """The host's flags are above the board's byte, and fit the record's field."""
    dtype = sample_dtype(2)
    assert dtype["flags"] == np.dtype("<u2")
    assert dtype["state"] == np.dtype("u1")


@pytest.mark.parametrize(
    ("meta", "end"),
    [
        ({"stop_reason": "finished"}, RunEnd.FINISHED),
        ({"stop_reason": "disconnected"}, RunEnd.STOPPED),
        ({"stop_reason": "aborted: the cable: unplugged"}, RunEnd.ABORTED),
        ({"stop_reason": "interrupted"}, RunEnd.INTERRUPTED),
        ({"stop_reason": None}, None),
        ({"stop_reason": "in other words", "run_end": "fault"}, RunEnd.FAULT),
        ({"stop_reason": None, "run_end": None}, None),
    ],
)
def test_run_end_is_the_code_or_an_old_files_reason(meta: dict[str, str | None], end: RunEnd | None) -> None:
    """A file without the code is read by the spellings that programs wrote before; with it the text is free."""
    assert run_end_of(meta) is end
