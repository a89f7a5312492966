"""A `.boat` file into a `Recording`, and results back into the file.

The file is opened read-only and decoded in one pass into one array of `sample_dtype`. Steps and readings become frames
in the board time of the samples. A damaged block is named and left out, the rest is read (fault 32). Nothing recorded
is ever changed; a result is added as a new row with the program's version, and only to a closed recording.
"""

from __future__ import annotations

import datetime
import itertools
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.data.camera_record import CameraRecord
from analysis.data.recording import READING_COLUMNS, STEP_COLUMNS, Gap, Recording
from analysis.numbers import finite
from analysis.version import program_version
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import FileError, RequestError, damaged
from protocol.base.regular_file import open_regular
from protocol.recording import metadata_of, schema
from protocol.recording.checks import DAMAGE, harden
from protocol.recording.damaged_log import fault_of_log
from protocol.recording.missing import missing_before_recovery
from protocol.recording.writer_lock import is_being_written

LATE_S = 0.5  # the counter is read a little before or after the samples that its row is laid to

SQLITE_MAGIC = b"SQLite format 3\x00"
LONGEST_US = 1 << 53  # 285 years: beyond, board times are damage, and their sums would not fit


def is_boat_file(path: Path) -> bool:
    """True where the file starts as SQLite files do."""
    with open_regular(path) as file:
        return file.read(16) == SQLITE_MAGIC


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a recording read-only, trusting nothing in it; damage met while reading becomes a `FileError`."""
    db = schema.open_recording(path)
    try:
        yield db
    except DAMAGE as error:
        cause = f"{path.name} cannot be read to its end: {error}"
        raise FileError(cause, "Recover the recording.", command=f"boat-daq recover {path}") from error
    finally:
        db.close()


def read_boat_file(path: str | Path) -> Recording:
    """Decode a `.boat` file into a `Recording`; raises FileError if it is none, or has no sample."""
    path = Path(path)
    with opened(path) as db:
        meta = schema.read_session(db)
        meta |= asdict(metadata_of(db, meta))
        _refuse_damaged_log(path, meta)
        if missing := missing_before_recovery(path, db, meta):
            meta["missing"] = asdict(missing)
        schema.check_long_tables(path, db)
        samples, segment, damaged = _samples(db, meta, path.name)
        clock = _lay_end_to_end(db, samples["time_us"], segment, float(meta.get("rate_hz") or 0.0))
        steps = _steps(db, clock)
        readings = pd.read_sql_query(f"SELECT {', '.join(READING_COLUMNS)} FROM reading ORDER BY id", db)  # noqa: S608
        failures = _crc_failures(db, clock)
        camera = _camera(schema.optional_rows(path, db, "camera"), clock.time_s, samples["host_ns"], segment)
        marks = db.execute(
            "SELECT segment, time_us, text FROM event WHERE kind = ? AND source = 'user' AND time_us IS NOT NULL",
            (schema.MARK_EVENT,),
        ).fetchall()
        meta["markers"] = sorted((clock.seconds(int(part or 0), at_us), text) for part, at_us, text in marks)
        if video := schema.optional_rows(path, db, "video"):
            camera, meta["camera"] = _video(video), meta.get("video") or {}
    if failures:
        meta["crc_errors"] = sum(failed.frames for failed in failures)
    if damaged:
        meta["damaged_blocks"] = damaged
    counts = "lit" in (samples.dtype.names or ())
    if counts:
        scale = float(meta["vref_mv"]) / 2.0 ** int(meta["adc_bits"])
        signal = (samples["lit"].astype(np.float64) - samples["dark"]) * scale
    else:
        signal = samples["signal_mv"].astype(np.float64)
    names = ["state", "flags", "index"]
    if counts:
        names += ["lit", "dark"]
    if meta.get("channels"):
        names.append("channel")
    kept: dict[str, Any] = {
        name: samples[name].copy() for name in names
    }  # a view would keep the whole samples in memory
    kept |= {"segment": segment, "target_kpa": target_from_steps(clock.time_s, steps), "steps": steps}
    pressure_kpa = samples["pressure_pa"] / 1000.0
    recording = Recording.from_arrays(
        clock.time_s, pressure_kpa, signal, **kept, readings=readings, meta=meta, source=str(path)
    )
    return replace(recording, gaps=tuple(_attributed(recording.gaps, failures)), camera=camera)


def _refuse_damaged_log(path: Path, meta: Mapping[str, Any]) -> None:
    """Raise where more than SQLite reads may be recovered, or where what it reads is another recording's."""
    if meta["status"] == "recording" and not is_being_written(path) and (fault := fault_of_log(path)):
        raise damaged(path, f"was not closed: {fault}")


def _camera(
    rows: list[tuple[Any, ...]], time_s: FloatArray, host_ns: IntArray, segment: IntArray
) -> CameraRecord | None:
    """Return a camera's readings in the time of the samples that arrived about each frame, and none outside."""
    if not rows:
        return None
    arrived, of, elongation, u, fault, dropped = zip(*rows, strict=True)
    frames_ns, of_segment = np.array(arrived, np.int64), np.array([-1 if s is None else s for s in of])
    at_s = np.full(frames_ns.size, np.nan)
    for number in np.unique(of_segment[of_segment >= 0]):
        own = np.flatnonzero(segment == number)
        if own.size < 2:
            continue
        last = own[np.append(np.flatnonzero(np.diff(host_ns[own])), own.size - 1)]  # of the samples of one arrival
        mine = of_segment == number
        start_ns = int(host_ns[last[0]])
        since_s = (host_ns[last] - start_ns) / 1e9
        at_s[mine] = np.interp((frames_ns[mine] - start_ns) / 1e9, since_s, time_s[last], np.nan, np.nan)
    kept = np.flatnonzero(np.isfinite(at_s) & (np.maximum.accumulate(np.nan_to_num(at_s, nan=-np.inf)) <= at_s))
    values, spread = (np.array([np.nan if v is None else v for v in column], float) for column in (elongation, u))
    return CameraRecord(at_s[kept], values[kept], spread[kept], np.array(fault, np.str_)[kept], int(sum(dropped)))


def _video(rows: list[tuple[Any, ...]]) -> CameraRecord:
    """Return the readings of a video, as `store_video` wrote them."""
    time_us, *values, fault, dropped = zip(*rows, strict=True)
    elongation, u = (np.array([np.nan if v is None else v for v in column], float) for column in values)
    at_s = np.maximum.accumulate(np.array(time_us, np.int64)) / 1e6
    return CameraRecord(at_s, elongation, u, np.array(fault, np.str_), int(sum(dropped)))


def target_from_steps(time_s: FloatArray, steps: pd.DataFrame) -> FloatArray:
    """Reconstruct the commanded pressure [n], kPa: each step's target from its start to its end, else NaN."""
    target = np.full(time_s.size, np.nan)
    firsts = np.searchsorted(time_s, steps["started_s"].to_numpy(dtype=float), side="left")
    ends = steps["ended_s"].to_numpy(dtype=float)
    lasts = np.where(np.isfinite(ends), np.searchsorted(time_s, ends, side="right"), time_s.size)
    for first, last, level in zip(firsts, lasts, steps["target_kpa"].to_numpy(dtype=float), strict=True):
        target[first:last] = level
    return target


@dataclass(frozen=True, slots=True)
class _Failed:
    """Frames that failed their check between two rows of the link's counter; samples in a good frame."""

    begin_s: float
    end_s: float
    frames: int
    samples_a_frame: float


def _crc_failures(db: sqlite3.Connection, clock: _Clock) -> list[_Failed]:
    """Return the frames that failed their check during the recording: the growth of the link's counter over its rows.

    The counter may hold what failed before the recording, so its first row is no growth; it starts again at zero when
    the link is opened anew.
    """
    rows = db.execute("SELECT segment, time_us, frames, samples, crc_errors FROM health ORDER BY id").fetchall()
    found = []
    for (_, before_us, *before), (segment, after_us, *after) in itertools.pairwise(rows):
        grown = [a - b for a, b in zip(after, before, strict=True)]
        frames, samples, failed = grown if min(grown) >= 0 else after
        if failed > 0:
            begin, end = (clock.seconds(int(segment or 0), t) for t in (before_us, after_us))
            found.append(_Failed(begin, end, failed, max(samples / frames, 1.0) if frames else 1.0))
    return found


def _attributed(gaps: Sequence[Gap], failures: Sequence[_Failed]) -> Iterator[Gap]:
    """Return the gaps with how many of their samples came in frames that failed: no more than those frames carried."""
    left = [round(failed.frames * failed.samples_a_frame) for failed in failures]
    for gap in gaps:
        carried = 0
        for k, failed in enumerate(failures):
            if left[k] and failed.begin_s - LATE_S <= gap.time_s <= failed.end_s + LATE_S:
                taken = min(left[k], gap.lost - carried)
                left[k] -= taken
                carried += taken
        yield replace(gap, crc_failed=carried)


@dataclass(frozen=True, slots=True)
class _Clock:
    time_s: FloatArray
    offset_us: Mapping[int, int]  # by segment: what is added to its board time

    def seconds(self, segment: int, time_us: float | None) -> float:
        if time_us is None or segment not in self.offset_us:
            return float("nan")
        return (time_us + self.offset_us[segment]) / 1e6


def _samples(db: sqlite3.Connection, meta: Mapping[str, Any], name: str) -> tuple[npt.NDArray[np.void], IntArray, int]:
    dtype = schema.session_dtype(meta)
    blobs: list[npt.NDArray[np.void]] = []
    segments: list[IntArray] = []
    damaged: list[str] = []
    for number, segment, n, blob, crc in db.execute("SELECT id, segment, n, samples, crc32 FROM block ORDER BY id"):
        if why := _misfit(n, blob, crc, dtype):
            damaged.append(f"block {number} {why}")
        else:
            blobs.append(np.frombuffer(blob, dtype))
            segments.append(np.full(n, segment, dtype=np.int64))
    if not blobs and damaged:
        raise FileError(
            f"{name} holds no readable samples: all of its {len(damaged)} blocks are damaged ({damaged[0]})",
            "Recover the recording; a copy of the file may be whole.",
            command=f"boat-daq recover {name}",
        )
    if not blobs and meta.get("missing"):
        raise FileError(f"{name} holds no samples; they may be missing", "Put its -wal and -shm beside it.")
    if not blobs:
        raise FileError(f"{name} holds no samples", "The session ended before the board sent any.")
    return np.concatenate(blobs), np.concatenate(segments), len(damaged)


def _misfit(n: int, blob: bytes, crc: int | None, dtype: np.dtype[np.void]) -> str:
    """Return why a block does not match its own head; empty where it does."""
    if not n or len(blob) != n * dtype.itemsize:
        return f"declares {n} samples and holds {len(blob)} bytes"
    if crc is not None and crc32(blob) != crc:
        return "does not match its checksum"
    time_us = np.frombuffer(blob, dtype)["time_us"]
    if np.abs(time_us // 2).max() > LONGEST_US // 2:  # halved: the least of all has no absolute value
        return "holds times beyond any session"
    return ""


def _lay_end_to_end(db: sqlite3.Connection, time_us: IntArray, segment: IntArray, rate_hz: float) -> _Clock:
    """Return board time over all segments: within one as the board sent it, between two as both clocks allow.

    A board that restarts its clock is placed after the end of the segment before, by the host's clock if that gives
    more than one sampling interval. A clock that continued (a pause) is left alone.
    """
    hosts = dict(db.execute("SELECT id, host_ns FROM segment"))
    edges = [0, *(np.flatnonzero(np.diff(segment)) + 1).tolist(), segment.size]
    interval_us = round(1e6 / rate_hz) if rate_hz > 0 else 10_000
    total = time_us.astype(np.int64).copy()
    offset, before = -int(time_us[0]), edges[0]
    offsets: dict[int, int] = {}
    for first, last in itertools.pairwise(edges):
        name, ended_us = int(segment[first]), int(time_us[first - 1])
        if first and int(time_us[first]) <= ended_us:
            waited_us = (hosts.get(name, 0) - hosts.get(int(segment[before]), 0)) // 1000
            ran_us = ended_us - int(time_us[before])
            offset = int(total[first - 1]) + max(interval_us, waited_us - ran_us) - int(time_us[first])
        offsets[name], before = offset, first
        total[first:last] += offset
    return _Clock(total / 1e6, offsets)


def _steps(db: sqlite3.Connection, clock: _Clock) -> pd.DataFrame:
    rows = db.execute(
        "SELECT id, segment, number, cycle, branch, target_kpa, ramp_kpa_per_s, started_us, arrived_us, settled_us,"
        " ended_us, status, detail FROM step ORDER BY id"
    ).fetchall()
    steps = pd.DataFrame(rows, columns=list(STEP_COLUMNS))
    for column in ("started_s", "arrived_s", "settled_s", "ended_s"):
        times = pd.to_numeric(steps[column], errors="coerce")
        steps[column] = [clock.seconds(int(s), float(t)) for s, t in zip(steps["segment"], times, strict=True)]
    return steps


def store_result(
    path: str | Path, kind: str, content: Mapping[str, Any], parameters: Mapping[str, Any], *, seed: int | None
) -> bool:
    """Add a result to a closed recording, with the program's version; False if it holds the same one already."""
    path = Path(path)
    _refuse_unfinished(path)
    text = json.dumps(content, sort_keys=True, allow_nan=False)
    parameter_text = json.dumps(parameters, sort_keys=True)
    with opened(path) as db:
        query = "SELECT 1 FROM result WHERE kind=? AND parameters=? AND content=? AND program_version=?"
        if db.execute(query, (kind, parameter_text, text, program_version())).fetchone():
            return False
    with _changing(path) as writer:
        writer.execute(
            "INSERT INTO result (utc, kind, program_version, seed, parameters, content) VALUES (?, ?, ?, ?, ?, ?)",
            (_now(), kind, program_version(), seed, parameter_text, text),
        )
    return True


def store_video(path: str | Path, record: CameraRecord, about: Mapping[str, Any]) -> str:
    """Keep the readings of a video in its closed recording; return the source of those they replace, or "".

    Raises as `store_result`. `record` is in the recording's time with its delay; `about` has `source`, `mark_mm`,
    `u_scale`.
    """
    path = Path(path)
    _refuse_unfinished(path)
    with opened(path) as db:
        before = (schema.read_session(db).get("video") or {}).get("source", "")
    described = json.dumps(finite({**about, "utc": _now()}), allow_nan=False)
    columns = np.rint(record.time_s * 1e6).astype(np.int64), record.elongation_mm, record.u_mm, record.fault
    rows = [
        (t, None if np.isnan(x) else x, None if np.isnan(u) else u, fault, record.dropped if n == 0 else 0)
        for n, (t, x, u, fault) in enumerate(zip(*(column.tolist() for column in columns), strict=True))
    ]
    with _changing(path) as writer:
        writer.execute("DROP TABLE IF EXISTS video")
        writer.execute(schema.VIDEO_TABLE)
        insert = "INSERT INTO video (time_us, elongation_mm, u_mm, fault, dropped) VALUES (?, ?, ?, ?, ?)"
        writer.executemany(insert, rows)
        writer.execute("INSERT OR REPLACE INTO session (key, value) VALUES ('video', ?)", (described,))
    return str(before)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat()


def _refuse_unfinished(path: Path) -> None:
    """Raise RequestError for a recording that is being made, or of an older layout."""
    schema.refuse_newer(path)
    if schema.layout_version(path) < schema.SCHEMA_VERSION:
        raise RequestError(
            f"{path.name} has the layout of an older program, to which no result is added",
            "Upgrade the recording; the original file is kept beside it.",
            command=f"boat-daq upgrade {path}",
        )
    with opened(path) as db:
        if schema.read_session(db).get("status") == "recording":
            raise RequestError(f"{path.name} is being recorded", "Wait for its end, or recover it.")


@contextmanager
def _changing(path: Path) -> Iterator[sqlite3.Connection]:
    """Give a connection that adds to a recording in one transaction; raises FileError if it cannot be written."""
    try:
        with closing(sqlite3.connect(path)) as writer, writer:
            harden(writer)
            writer.execute("BEGIN IMMEDIATE")  # what makes a table is in the transaction too
            yield writer
    except DAMAGE as error:
        raise FileError(f"the result cannot be written into {path.name}: {error}", "Is it read-only?") from error
