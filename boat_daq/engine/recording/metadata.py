"""State the metadata of a recording, remember them for its unit, keep templates of them.

Rules: what is stated is a newer event of the recording, so what was stated before stays, and samples are not touched.
A recording has one writer: while it is in progress, another program leaves what it states in a file beside it, which
the session that records takes within two seconds.
A unit's file remembers what stays the same (operator, customer, item, serial number, free fields) for its next
recording; ambient conditions and notes are of one recording. A template is a small TOML file with the same keys.
"""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import tomli_w

from boat_daq.engine.file_names import path_in
from boat_daq.engine.recording.file import RecordingFile, is_being_written
from boat_daq.engine.recording.rows import INSERT_EVENT
from boat_daq.engine.settings import UnitLibrary, home
from boat_daq.engine.stored_file import write_stored
from boat_daq.engine.toml_values import BadValue, parse_toml, read_json, read_text
from boat_daq.errors import OperatorError, StorageError
from protocol.recording import METADATA_EVENT, NOTE_EVENT, Metadata, metadata_of, open_recording, read_session
from protocol.recording.metadata import MOST
from protocol.whole_file import write_whole

REQUEST_S = 5.0  # for the program that records, which looks once a second
COMMITTED_S = 1.0  # then, for its next commit
POLL_S = 0.05


def read_metadata(path: Path) -> Metadata:
    """Return the metadata of a recording.

    Raises
    ------
    RecordingError : it cannot be read.
    """
    with closing(open_recording(path)) as db:
        return metadata_of(db, read_session(db))


def state_metadata(path: Path, metadata: Metadata) -> None:
    """Add metadata to a recording; the newest count. One in progress is requested to take them.

    Raises
    ------
    StorageError : the recording cannot be written, or its program does not answer. RecordingError : not a recording.
    """
    with closing(open_recording(path)) as db:
        before = metadata_of(db, read_session(db))
        number, last_ns = db.execute("SELECT coalesce(max(id), 0) + 1, coalesce(max(host_ns), 0) FROM event").fetchone()
    texts = statements(before, metadata)
    if not texts:
        return
    if is_being_written(path):
        _request(path, before, metadata)
        return
    file = RecordingFile.reopen(path)
    try:
        rows = enumerate(texts.items(), number)
        file.commit([(INSERT_EVENT, (k, last_ns, None, None, "user", kind, None, text)) for k, (kind, text) in rows])
    finally:
        file.abandon()


def statements(before: Metadata, after: Metadata) -> dict[str, str]:
    """Return the events that state what has changed, text by kind; the note is an event of its own."""
    table = {key: value for key, value in after.as_json().items() if key != "note"}
    texts = {METADATA_EVENT: json.dumps(table, ensure_ascii=False)}
    return (texts if dataclasses.replace(after, note=before.note) != before else {}) | (
        {NOTE_EVENT: after.note} if after.note != before.note else {}
    )


def with_changes_of(current: Metadata, before: Metadata, after: Metadata) -> Metadata:
    """Return metadata with what differs between two others, as `after` has it."""
    values = {key: value for key, value in after.as_json().items() if value != getattr(before, key)}
    fields = {key: text for key, text in current.fields.items() if after.fields.get(key) == before.fields.get(key)}
    fields |= {key: text for key, text in after.fields.items() if before.fields.get(key) != text}
    return dataclasses.replace(current, **{**values, "fields": fields})


def take_request(path: Path) -> tuple[Metadata, Metadata] | None:
    """Return what another program wants changed of a recording in progress, once; None where nothing is.

    The metadata that it has read, and those that it wants: others may have been stated since.

    Raises
    ------
    OperatorError : the request is refused.
    """
    request = _request_path(path)
    if not request.exists():
        return None
    try:
        tables = read_json(request)
    finally:
        request.unlink(missing_ok=True)
    if not isinstance(tables, list) or len(tables) != 2 or not all(isinstance(table, dict) for table in tables):
        raise OperatorError(f"{request} holds no metadata", "State them again.")
    before, after = (_checked(table, str(request)) for table in tables)
    return before, after


def _request(path: Path, before: Metadata, after: Metadata) -> None:
    """Leave a change of metadata for the session that records `path`, and wait until it has stated it.

    Raises
    ------
    StorageError : they cannot be left there, or are not taken.
    """
    request = _request_path(path)
    try:
        write_whole(request, json.dumps([before.as_json(), after.as_json()]))
        taken = _holds(lambda: not request.exists(), REQUEST_S)
        request.unlink(missing_ok=True)
    except OSError as error:
        raise StorageError(
            f"{request} cannot be written: {error.strerror}", "Check the folder and the disk."
        ) from error
    if not taken:
        cause = f"the program that records {path.name} does not take metadata"
        raise StorageError(cause, "State them there, or when the recording is closed.")
    _holds(lambda: (now := read_metadata(path)) == with_changes_of(now, before, after), COMMITTED_S)


def _holds(condition: Callable[[], bool], timeout_s: float) -> bool:
    """Return whether a condition holds before the time is over."""
    end_s = time.monotonic() + timeout_s
    while not (met := condition()) and time.monotonic() < end_s:
        time.sleep(POLL_S)
    return met


def _request_path(path: Path) -> Path:
    return path.with_name(f"{path.name}-metadata")


def remembered(units: UnitLibrary, unit: str) -> Metadata:
    """Return what a unit's file remembers for its next recording; nothing where none is named.

    Raises
    ------
    OperatorError : the file is refused, by key.
    """
    return _checked(units.load(unit).metadata, f"unit {unit}") if unit else Metadata()


def remember(units: UnitLibrary, unit: str, metadata: Metadata) -> None:
    """Keep in a unit's file what its next recording states, too.

    Raises
    ------
    OperatorError : the file is refused. StorageError : it cannot be written.
    """
    kept, stored = _stated(metadata.of_unit()), units.load(unit) if unit else None
    if stored is not None and kept != stored.metadata:
        units.save(dataclasses.replace(stored, metadata=kept))


def template_names(folder: Path | None = None) -> list[str]:
    """Return the names of the templates, sorted."""
    return sorted(path.stem for path in _templates(folder).glob("[!.]*.toml"))


def load_template(name: str, folder: Path | None = None) -> Metadata:
    """Return the metadata of a template: the name of a stored one, or the path of a TOML file.

    Raises
    ------
    OperatorError : there is none of that name, or the file is refused, by key.
    """
    path = Path(name) if name.endswith(".toml") else path_in(_templates(folder), f"{name}.toml")
    if not path.exists():
        known = ", ".join(template_names(folder)) or "none"
        raise OperatorError(f"there is no template {name!r:.60}", f"Templates: {known}.")
    return _checked(parse_toml(read_text(path), str(path)), str(path))


def save_template(name: str, metadata: Metadata, folder: Path | None = None) -> Path:
    """Store metadata as a template, without note and ambient conditions; return its file.

    Raises
    ------
    OperatorError : the name cannot be used. StorageError : it cannot be written.
    """
    path = path_in(_templates(folder), f"{name}.toml")
    write_stored(path, tomli_w.dumps(_stated(metadata.of_unit())))
    return path


def _templates(folder: Path | None) -> Path:
    return (folder or home()) / "templates"


def _stated(metadata: Metadata) -> dict[str, Any]:
    return {key: value for key, value in metadata.as_json().items() if value not in ("", None, {})}


def _checked(table: Mapping[str, Any], where: str) -> Metadata:
    known = [field.name for field in dataclasses.fields(Metadata)]
    for key in table:
        if key not in known:
            remedy = f"Known: {', '.join(known)}; others belong into [fields]."
            raise BadValue(where, key, "is not a known key", remedy)
    try:
        return Metadata.of(table, MOST)
    except ValueError as error:
        raise OperatorError(f"{where}: {error}", "Correct the value.") from error
