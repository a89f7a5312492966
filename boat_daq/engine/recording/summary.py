"""Summarise a recording: who, when, how long, what was lost. Read from the overview, not from the samples.

So a day of 8.6 million samples takes a fraction of a second; only what a killed session left without an overview is
counted from its blocks.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from protocol.base.errors import BoatDaqError, damaged
from protocol.recording import ExtraChannel, Metadata, metadata_of, schema, session_channels
from protocol.recording.checks import DAMAGE, bytes_of
from protocol.recording.missing import Missing, missing_before_recovery
from protocol.recording.writer_lock import is_being_written


@dataclass(frozen=True, slots=True)
class SegmentSummary:
    """One stretch of unbroken board time that has samples."""

    number: int
    reason: str
    paused: bool
    samples: int
    duration_s: float
    rate_hz: float | None


@dataclass(frozen=True, slots=True)
class CycleCounts:
    """CycleCounts by the sequencer's own marks."""

    complete: int
    partial: int


@dataclass(frozen=True, slots=True)
class BreakSummary:
    """A break of a run (`resumption`). Why it had ended, for how long, and with which cycle it resumed."""

    utc: str
    cause: str
    break_s: float | None
    complete_cycles: int
    first_cycle: int
    first_segment: int
    operator: str | None = None
    note: str | None = None


@dataclass(frozen=True, slots=True)
class Summary:
    """What `boat-daq info` shows; units are in the names."""

    path: Path
    status: str  # "recording" (in progress), "interrupted", "closed", "recovered"
    simulated: bool
    operator: str | None
    unit: str | None
    note: str | None
    port: str | None
    board_id: str | None
    program_version: str
    started_utc: str  # "" where it is not known
    ended_utc: str | None
    stop_reason: str | None
    run_end: schema.RunEnd | None  # the code of it; None while it is in progress, or was interrupted
    duration_s: float  # board time of all segments
    rate_hz: float | None  # samples that came for each second of it
    rate_sampled_hz: float | None  # those lost on the way counted too: the board's own rate
    rate_asked_hz: float | None
    samples: int
    gaps: int
    lost_samples: int
    crc_errors: int
    damaged_frames: int  # these, the malformed and the oversize ones
    pressure_min_kpa: float | None
    pressure_max_kpa: float | None
    segments: tuple[SegmentSummary, ...]
    steps: int
    cycles: CycleCounts
    readings: int  # plateaus that were read
    results: int
    size_bytes: int
    layout: int  # version of the file's tables
    breaks: tuple[BreakSummary, ...] = ()
    metadata: Metadata = field(default_factory=Metadata)
    uuid: str | None = None  # stays where the file is renamed
    channels: tuple[ExtraChannel, ...] = ()  # beside pressure and sensors
    missing: Missing = field(default_factory=Missing)  # of a salvaged one; counted as gaps and lost samples, too


def summarise(path: Path) -> Summary:
    """Return the summary of a recording. RecordingError: not a recording, or damaged."""
    with closing(schema.open_recording(path)) as db:
        try:
            return _summarise(path, db)
        except DAMAGE as error:
            raise damaged(path, f"cannot be read: {error}") from error


def pressure_outline(path: Path, points: int) -> tuple[tuple[float, float, float], ...]:
    """Return the course of the pressure in the unit square: time, lowest and highest pressure of each point.

    None with fewer than two. `points`: their number, which may be exceeded by less than its double.
    """
    with closing(schema.open_recording(path)) as db:
        rows = db.execute(
            "SELECT pressure_min_kpa, pressure_max_kpa FROM overview WHERE pressure_min_kpa IS NOT NULL ORDER BY id"
        ).fetchall()
    starts = np.arange(0, len(rows), max(1, len(rows) // points))
    if len(starts) < 2:
        return ()
    low, high = np.array(rows, dtype=float).T
    least, span = low.min(), np.ptp([low.min(), high.max()]) or 1.0
    ends = np.minimum.reduceat(low, starts), np.maximum.reduceat(high, starts)
    return tuple(zip(np.linspace(0, 1, len(starts)).tolist(), *((v - least) / span for v in ends), strict=True))


def is_simulated(path: Path) -> bool | None:
    """Return whether a recording is of a simulated board; None where it cannot be read."""
    try:
        with closing(schema.open_recording(path)) as db:
            return bool(schema.read_session(db)["simulated"])
    except (BoatDaqError, OSError, sqlite3.Error, KeyError):
        return None


def _summarise(path: Path, db: sqlite3.Connection) -> Summary:
    meta = schema.read_session(db)
    segments = tuple(_segments(db))
    samples = sum(segment.samples for segment in segments)
    if samples * schema.session_dtype(meta).itemsize > bytes_of(path):
        raise damaged(path, f"claims {samples} samples, more samples than its size can hold")
    duration_s = sum(segment.duration_s for segment in segments)
    status = meta["status"]
    if status == "recording" and not is_being_written(path):
        status = "interrupted"
    missing = missing_before_recovery(path, db, meta)
    gaps, lost = _one(db, "SELECT count(*), coalesce(sum(value), 0) FROM event WHERE kind = 'gap'")
    gaps, lost = gaps + len(missing.samples), int(lost) + missing.counted
    low, high = _one(db, "SELECT min(pressure_min_kpa), max(pressure_max_kpa) FROM overview")
    counts = [_one(db, f"SELECT count(*) FROM {table}")[0] for table in ("step", "result")]  # noqa: S608
    stated = metadata_of(db, meta)
    stored = ("uuid", "unit", "port", "board_id", "program_version", "started_utc", "ended_utc")
    return Summary(
        path=path,
        status=status,
        simulated=bool(meta["simulated"]),
        operator=stated.operator or meta["operator"],
        note=stated.note or schema.note_of(db, meta),
        metadata=stated,
        **{key: meta[key] for key in (*stored, "stop_reason")} | {"started_utc": meta["started_utc"] or ""},
        run_end=schema.run_end_of(meta),
        duration_s=duration_s,
        rate_hz=_rate(samples, len(segments), duration_s),
        rate_sampled_hz=_rate(samples + lost, len(segments), duration_s),
        rate_asked_hz=meta["rate_hz"],
        samples=samples,
        gaps=gaps,
        lost_samples=lost,
        crc_errors=_counted(db, "crc_errors"),
        damaged_frames=_counted(db, "crc_errors + malformed + oversize"),
        pressure_min_kpa=low,
        pressure_max_kpa=high,
        segments=segments,
        steps=counts[0],
        cycles=_cycles(db),
        readings=_readings(db),
        results=counts[1],
        size_bytes=path.stat().st_size,
        layout=schema.layout_version(path),
        breaks=tuple(_break(entry) for entry in schema.breaks_of(meta)),
        channels=session_channels(meta),
        missing=missing,
    )


def _break(entry: dict[str, Any]) -> BreakSummary:
    return BreakSummary(**{key: entry.get(key) for key in BreakSummary.__dataclass_fields__})  # type: ignore[arg-type]


def _one(db: sqlite3.Connection, sql: str) -> Any:
    return db.execute(sql).fetchone()


def _counted(db: sqlite3.Connection, counter: str) -> int:
    """Return the sum of a counter of `health` over all links; each begins at zero."""
    sql = f"""
        SELECT {counter}, bytes <= lead(bytes) OVER (ORDER BY id) AS goes_on FROM health ORDER BY id"""  # noqa: S608
    return sum(count for count, goes_on in db.execute(sql) if not goes_on)


def _segments(db: sqlite3.Connection) -> list[SegmentSummary]:
    """Return the segments with samples, from the overview and the blocks behind it."""
    last_block = _one(db, "SELECT coalesce(max(last_block), 0) FROM overview")[0]
    sql = """
        SELECT segment.id, reason, paused, sum(n), min(first_time_us), max(last_time_us)
        FROM (SELECT segment, n, first_time_us, last_time_us FROM overview
              UNION ALL SELECT segment, n, first_time_us, last_time_us FROM block WHERE id > ?) AS part
        JOIN segment ON segment.id = part.segment GROUP BY segment.id ORDER BY segment.id"""
    found = []
    for number, reason, paused, n, first_us, last_us in db.execute(sql, (last_block,)):
        duration_s = (last_us - first_us) * 1e-6
        found.append(SegmentSummary(number, reason, bool(paused), n, duration_s, _rate(n, 1, duration_s)))
    return found


def _rate(samples: int, segments: int, duration_s: float) -> float | None:
    """Return samples for each second; the first of each segment ends no interval."""
    return (samples - segments) / duration_s if duration_s > 0 else None


def _readings(db: sqlite3.Connection) -> int:
    """Count the plateaus that were read: a correction counts no plateau again, a withdrawal takes its plateau away."""
    sql = "SELECT elongation_mm, max(id) FROM reading GROUP BY coalesce(step, -id)"  # the newest row of each
    return sum(mm is not None for mm, _ in db.execute(sql))


def _cycles(db: sqlite3.Connection) -> CycleCounts:
    """Count cycles; complete are those with the most steps, all reached, and of a sweep both branches.

    The segments of a profile may end where they begin: then all are of one branch.
    """
    sql = """
        SELECT count(*), sum(status = 'reached'), count(DISTINCT branch),
            max(CASE WHEN json_valid(detail) THEN json_type(detail, '$.segment') = 'object' END) FROM step
        WHERE cycle > 0 AND branch IN ('unloading', 'loading') GROUP BY cycle"""
    cycles = db.execute(sql).fetchall()
    most = max((row[0] for row in cycles), default=0)
    complete = sum(
        steps == most == reached and bool(branches == 2 or profile) for steps, reached, branches, profile in cycles
    )
    return CycleCounts(complete, len(cycles) - complete)
