"""Small recordings of the virtual board in every layout that the program has ever written."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from boat_daq.engine.recording.recorder import Recorder
from protocol.recording import APPLICATION_ID, TABLE_NAMES, RunEnd
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import Source

SCHEMAS = {path.stem: path for path in sorted((Path(__file__).parent / "schemas").glob("*.sql"))}


def write_recording(path: Path, *, blocks: int = 4) -> Path:
    """Record `blocks` blocks of 200 ms of board time with a marker, a reading and a result, and return the path."""
    source = Source()
    recorder = Recorder(path, meta_of(source.link))
    recorder.attached(source.link.decoder_state())
    for number in range(blocks):
        recorder(source.next(200_000))
        if number == 1:
            recorder.event("user", "mark", text="here")
        assert recorder.flush()
    recorder.close(RunEnd.FINISHED)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("INSERT INTO step VALUES (1, 1, 1, 1, 'unloading', 20.0, 5.0, 0, 1, 2, 3, 'reached', '{}')")
        db.execute("INSERT INTO reading VALUES (1, '2026-01-01T00:00:00+00:00', 1, 1.5, 0.5, 'typed', '', '')")
        db.execute("INSERT INTO result VALUES (1, '2026-01-01T00:00:00+00:00', 'note', '0', 1, '{}', '{}')")
    return path


def write_old_recording(path: Path, schema: str, *, status: str = "closed") -> Path:
    """Write the same session in an older layout, without the columns that it lacks, and return the path."""
    new = write_recording(path.with_name("new.boat"))
    with closing(sqlite3.connect(path)) as db:
        db.executescript(SCHEMAS[schema].read_text(encoding="utf-8"))
        db.execute(f"PRAGMA application_id={APPLICATION_ID}")
        db.execute(f"PRAGMA user_version={schema.split('_')[0]}")
        db.execute("ATTACH ? AS new", (str(new),))
        with db:
            for table in TABLE_NAMES:
                columns = ", ".join(row[1] for row in db.execute(f"PRAGMA main.table_info({table})"))
                db.execute(f"INSERT INTO {table} ({columns}) SELECT {columns} FROM new.{table}")
            db.execute("UPDATE session SET value = ? WHERE key = 'status'", (f'"{status}"',))
    new.unlink()
    return path
