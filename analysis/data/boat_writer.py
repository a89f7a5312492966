"""An imported run written as a `.boat` file, by the schema of `protocol.recording`, and derived again from that file.

The original bytes are kept in `chunk`, the column map in the session, so that the import can be done again: the samples
must come out bit for bit. The file appears under its name only when it is whole.
"""

from __future__ import annotations

import datetime
import itertools
import json
import sqlite3
import tempfile
import uuid
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.data.boat_file import opened
from analysis.data.csv_import import import_csv, import_two
from analysis.data.recording import Recording
from analysis.version import program_version
from protocol.base.errors import FileError, RecordingError, StorageError, writing
from protocol.base.whole_file import written_whole
from protocol.recording import schema
from protocol.recording.checks import check_session

CHUNK_BYTES = 1 << 20
_CHUNK = "id, host_ns, direction, raw, crc32"
_BLOCK = "segment, last_chunk, n, first_time_us, last_time_us, samples, crc32"
_OVERVIEW = (
    "segment, first_block, last_block, n, first_time_us, last_time_us, pressure_min_kpa, pressure_max_kpa, "
    "signal_min_mv, signal_max_mv, flags"
)
BLOCK_ROWS = 1_000  # as many as a row of the overview
LATEST_S = 1e12  # 30,000 years; more microseconds than 64 bits hold are no time


def write_boat_file(
    path: str | Path, recording: Recording, *, original: str | Path, second: Path | None = None
) -> None:
    """Write an imported recording with the bytes of its original, or of two; FileError if it exists or is refused."""
    path = Path(path)
    if second is not None:
        about = {**recording.meta, "import_bytes": Path(original).stat().st_size}
        recording = replace(recording, meta=about)
    if path.exists():
        raise FileError(f"{path} exists already", "Choose another name: a recording is never overwritten.")
    try:
        with writing(path), written_whole(path) as unfinished, closing(sqlite3.connect(unfinished)) as db, db:
            _write(db, recording, [Path(original), *([second] if second is not None else [])])
    except sqlite3.Error as error:
        raise StorageError(f"{path} cannot be written: {error}", "Choose another disk.") from error


def _write(db: sqlite3.Connection, recording: Recording, originals: list[Path]) -> None:
    db.execute(f"PRAGMA application_id={schema.APPLICATION_ID}")
    db.execute(f"PRAGMA user_version={schema.SCHEMA_VERSION}")
    db.executescript(schema.TABLES)
    samples = packed_samples(recording)
    for key, value in _session(recording, samples).items():
        _insert(db, "session", "key, value", (key, json.dumps(value)))
    last_chunk = _keep_originals(db, originals)
    meta = recording.meta
    scale_mv = float(meta.get("vref_mv") or 0.0) / 2.0 ** int(meta.get("adc_bits") or 0)
    edges = [0, *(np.flatnonzero(np.diff(recording.segment)) + 1).tolist(), recording.n]
    for number, (first, last) in enumerate(itertools.pairwise(edges), 1):
        _insert(db, "segment", "id, host_ns, first_chunk, reason", (number, 0, 1, "import"))
        _write_blocks(db, samples[first:last], number, last_chunk, scale_mv)


def packed_samples(recording: Recording) -> npt.NDArray[np.void]:
    """Return the samples as records of `sample_dtype`, gaps flagged; FileError for a time that does not fit."""
    if not (np.abs(recording.time_s) < LATEST_S).all():
        text = f"a time of {np.abs(recording.time_s).max():g} s is out of range"
        raise FileError(text, "Check the time column and its unit.")
    counts = recording.lit is not None and recording.dark is not None and {"vref_mv", "adc_bits"} <= set(recording.meta)
    samples = np.zeros(recording.n, _dtype(recording, counts=counts))
    samples["index"] = _running_index(recording)
    samples["time_us"] = np.round(recording.time_s * 1e6)
    samples["pressure_pa"] = recording.pressure_kpa * 1000.0
    samples["state"], samples["flags"] = recording.state, recording.flags
    for gap in recording.gaps:
        samples["flags"][gap.row + 1] |= int(schema.SampleFlag.GAP_BEFORE)
    if counts:
        samples["lit"], samples["dark"] = recording.lit, recording.dark
    else:
        samples["signal_mv"] = recording.signal_mv
    if recording.channel is not None:
        samples["channel"] = recording.channel
    return samples


def _dtype(recording: Recording, *, counts: bool) -> np.dtype[np.void]:
    return schema.sample_dtype(recording.n_sensors, "counts" if counts else "signal", len(recording.channels))


def _running_index(recording: Recording) -> npt.NDArray[np.int64]:
    """The index as it was, or one that jumps where samples are missing."""
    if not np.array_equal(recording.index, np.arange(recording.n)):
        return np.asarray(recording.index)
    jump = np.zeros(recording.n, dtype=np.int64)
    for gap in recording.gaps:
        jump[gap.row + 1] = gap.lost
    return np.arange(recording.n) + np.cumsum(jump)


def _session(recording: Recording, samples: npt.NDArray[np.void]) -> dict[str, Any]:
    assert samples.dtype.names is not None
    values: dict[str, Any] = dict.fromkeys(schema.SESSION_KEYS)
    values |= {key: value for key, value in recording.meta.items() if key != "sample_dtype"}
    started = recording.meta.get("started_utc") or None  # the time of the import says nothing of the run
    values |= {
        "uuid": str(uuid.uuid4()), "status": "closed", "simulated": recording.simulated,
        "program_version": program_version(), "started_utc": started,
        "started_host_ns": 0, "ended_utc": _ended(started, recording.duration_s), "ended_host_ns": 0,
        "stop_reason": "finished",
        "port": f"import:{recording.meta.get('imported_from', '')}", "n_sensors": recording.n_sensors,
        "sample_kind": "counts" if "lit" in samples.dtype.names else "signal",
        "sample_dtype": schema.describe_dtype(samples.dtype),
        "rate_hz": recording.meta.get("rate_hz") or (1.0 / recording.interval_s if recording.n > 1 else 0.0),
        "settings": {}, **{key: str(recording.meta.get(key) or "") for key in ("operator", "unit", "note")},
        "metadata": asdict(recording.metadata),
    }  # fmt: skip
    try:
        check_session(values)
    except RecordingError as error:
        cause = f"{error.cause}, in a comment line of the file"
        raise FileError(cause, "Correct the comment lines of the file.") from error
    return values


def _ended(started: object, duration_s: float) -> str | None:
    """Return the time of the last sample, ISO 8601; None where that of the first is not known."""
    try:
        begun = datetime.datetime.fromisoformat(str(started))
        return (begun + datetime.timedelta(seconds=duration_s)).isoformat()
    except (ValueError, OverflowError):
        return None


def _keep_originals(db: sqlite3.Connection, originals: list[Path]) -> int:
    number = 0
    for original in originals:
        with original.open("rb") as file:
            while raw := file.read(CHUNK_BYTES):
                number += 1
                _insert(db, "chunk", _CHUNK, (number, 0, 0, raw, zlib.crc32(raw)))
    return number


def _write_blocks(
    db: sqlite3.Connection, samples: npt.NDArray[np.void], segment: int, last_chunk: int, scale_mv: float
) -> None:
    """Write a segment's samples: a block of a thousand, and its row of the overview."""
    for first in range(0, samples.size, BLOCK_ROWS):
        part = samples[first : first + BLOCK_ROWS]
        times = (int(part["time_us"][0]), int(part["time_us"][-1]))
        raw = part.tobytes()
        block = _insert(db, "block", _BLOCK, (segment, last_chunk, part.size, *times, raw, zlib.crc32(raw)))
        extremes = schema.overview_extremes(part, scale_mv)
        _insert(db, "overview", _OVERVIEW, (segment, block, block, part.size, *times, *extremes))


def _insert(db: sqlite3.Connection, table: str, columns: str, values: tuple[Any, ...]) -> int | None:
    """Add a row; return its number."""
    marks = ", ".join("?" * len(values))
    return db.execute(f"INSERT INTO {table} ({columns}) VALUES ({marks})", values).lastrowid  # noqa: S608


def _again(file: Path, original: bytes, meta: dict[str, Any], options: dict[str, Any]) -> Recording:
    """Return the run of the kept bytes of one file, or of two that follow each other."""
    if not meta.get("import_files"):
        columns = meta.get("import_columns", meta["import_map"])  # older recordings have the map alone
        return import_csv(file, columns=columns, stated=meta, **options)
    length = int(meta["import_bytes"])
    files = [file.with_name(f"{n}.table") for n in (1, 2)]
    for path, raw in zip(files, (original[:length], original[length:]), strict=True):
        path.write_bytes(raw)
    return import_two(files[0], files[1], columns=meta["import_columns"], offset_s=meta["import_offset_s"])


def first_difference(path: str | Path, captured: Callable[[Path, str], Recording] | None = None) -> str:
    """Import the kept bytes again and return the first difference of the samples, or "".

    `captured` imports a captured text by a text profile.

    Raises FileError if the recording was not imported.
    """
    path = Path(path)
    with opened(path) as db:
        meta = schema.read_session(db)
        if not str(meta.get("port") or "").startswith("import:"):
            raise FileError(f"{path.name} was not imported", "Use `boat-daq verify`.")
        original = b"".join(raw for (raw,) in db.execute("SELECT raw FROM chunk WHERE direction = 0 ORDER BY id"))
        blobs = [blob for (blob,) in db.execute("SELECT samples FROM block ORDER BY id")]
    kept = np.frombuffer(b"".join(blobs), schema.dtype_from_description(meta["sample_dtype"]))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "original.csv"
        file.write_bytes(original)
        kept_options = ("rate_hz", "separator", "skip")
        options: dict[str, Any] = {name: meta.get(f"import_{name}") for name in kept_options}
        if captured is not None and meta.get("import_text_profile"):
            again = packed_samples(captured(file, meta["import_text_profile"]))
        else:
            again = packed_samples(_again(file, original, meta, options))
        again = schema.fitted(again, kept.dtype)  # an older recording has no channels
    if again.dtype != kept.dtype or again.size != kept.size:
        return f"the file gives {again.size} samples where {kept.size} are kept"
    rows = [np.frombuffer(part.tobytes(), np.uint8).reshape(part.size, -1) for part in (again, kept)]  # NaN equals NaN
    different = np.flatnonzero((rows[0] != rows[1]).any(axis=1))
    return f"sample {int(different[0])} differs from the file it was imported from" if different.size else ""
