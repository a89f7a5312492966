"""State the metadata of a recording, and remember them for its unit.

Rules: what is stated is a newer event of the recording, so what was stated before stays, and samples are not touched.
A recording has one writer: while it is in progress, only the session that records it can state metadata.
A unit's file remembers what stays the same (operator, customer, item, serial number, free fields) for its next
recording; ambient conditions and notes are of one recording.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.rows import INSERT_EVENT
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.toml_values import BadValue
from protocol.base.errors import RequestError
from protocol.recording import METADATA_EVENT, NOTE_EVENT, Metadata, metadata_of, open_recording, read_session
from protocol.recording.metadata import MOST


def read_metadata(path: Path) -> Metadata:
    """Return the metadata of a recording. RecordingError: it cannot be read."""
    with closing(open_recording(path)) as db:
        return metadata_of(db, read_session(db))


def state_metadata(path: Path, metadata: Metadata) -> None:
    """Add metadata to a closed recording; the newest count."""
    with closing(open_recording(path)) as db:
        before = metadata_of(db, read_session(db))
        number, last_ns = db.execute("SELECT coalesce(max(id), 0) + 1, coalesce(max(host_ns), 0) FROM event").fetchone()
    texts = statements(before, metadata)
    if not texts:
        return
    file = RecordingFile.reopen(path)
    try:
        rows = enumerate(texts.items(), number)
        file.commit([(INSERT_EVENT, (k, last_ns, None, None, "user", kind, None, text)) for k, (kind, text) in rows])
    finally:
        file.abandon()


def statements(before: Metadata, after: Metadata) -> dict[str, str]:
    """Return the events that state what has changed, text by kind; the note is an event of its own."""
    table = {key: value for key, value in dataclasses.asdict(after).items() if key != "note"}
    texts = {METADATA_EVENT: json.dumps(table, ensure_ascii=False)}
    return (texts if dataclasses.replace(after, note=before.note) != before else {}) | (
        {NOTE_EVENT: after.note} if after.note != before.note else {}
    )


def remembered(units: UnitLibrary, unit: str) -> Metadata:
    """Return what a unit's file remembers for its next recording; nothing where none is named."""
    return _checked(units.load(unit).metadata, f"unit {unit}") if unit else Metadata()


def remember(units: UnitLibrary, unit: str, metadata: Metadata) -> None:
    """Keep in a unit's file what its next recording states, too."""
    kept, stored = _stated(metadata.of_unit()), units.load(unit) if unit else None
    if stored is not None and kept != stored.metadata:
        units.save(dataclasses.replace(stored, metadata=kept))


def _stated(metadata: Metadata) -> dict[str, Any]:
    return {key: value for key, value in dataclasses.asdict(metadata).items() if value not in ("", None, {})}


def _checked(table: Mapping[str, Any], where: str) -> Metadata:
    known = [field.name for field in dataclasses.fields(Metadata)]
    for key in table:
        if key not in known:
            remedy = f"Known: {', '.join(known)}; others belong into [fields]."
            raise BadValue(where, key, "is not a known key", remedy)
    try:
        return Metadata.of(table, MOST)
    except ValueError as error:
        raise RequestError(f"{where}: {error}", "Correct the value.") from error
