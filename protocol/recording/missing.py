"""What a recording lacks: a salvaged one by its session's `missing`, one that was not closed by its log."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from protocol.recording.damaged_log import end_may_be_missing
from protocol.recording.schema import session_dtype
from protocol.recording.writer_lock import is_being_written


@dataclass(frozen=True, slots=True)
class Hole:
    """Where samples are missing, between two that are kept; times are the board's."""

    segment: int
    after_index: int | None  # None before the first sample that is kept
    after_s: float | None
    before_index: int | None  # None behind the last one: there samples may be missing
    before_s: float | None
    samples: int | None  # None where it is unknown how many

    def __str__(self) -> str:
        after, before = f"index {self.after_index} ({_s(self.after_s)})", f"index {self.before_index}"
        if self.before_index is None:
            return f"samples after {after if self.after_index is not None else 'the start'} may be missing"
        before += f" ({_s(self.before_s)})"
        count = "an unknown number of samples" if self.samples is None else f"{self.samples} samples"
        if self.after_index is None:
            return f"{count} before {before} are missing"
        return f"{count} between {after} and {before} are missing"


@dataclass(frozen=True, slots=True)
class Missing:
    """Samples and rows that a recovery did not find."""

    samples: tuple[Hole, ...] = ()
    rows: tuple[tuple[str, int, int], ...] = ()  # table, first and last id; of blocks without those derived again

    def __bool__(self) -> bool:
        return bool(self.samples or self.rows)

    @property
    def counted(self) -> int:
        """Samples that are known to be missing."""
        return sum(hole.samples or 0 for hole in self.samples)

    @property
    def exact(self) -> bool:
        """Whether `counted` is all of them."""
        return all(hole.samples is not None for hole in self.samples)

    @property
    def whole(self) -> bool:
        """Whether all that is known to have been recorded is there; more may have been."""
        return not self.rows and all(hole.before_index is None for hole in self.samples)

    def lines(self) -> Iterator[str]:
        yield from map(str, self.samples)
        for table, first, last in self.rows:
            name = "raw bytes of chunk" if table == "chunk" else f"row of {table}"
            yield f"{name} {first} is missing" if first == last else f"{name} {first} to {last} are missing"


def missing_of(meta: Mapping[str, Any]) -> Missing:
    """Return what the recording of a session is known to lack."""
    stored = meta.get("missing") or {"samples": [], "rows": []}
    holes = (Hole(**{name: hole[name] for name in Hole.__dataclass_fields__}) for hole in stored["samples"])
    return Missing(tuple(holes), tuple((table, first, last) for table, first, last in stored["rows"]))


def missing_before_recovery(path: Path, db: sqlite3.Connection, meta: Mapping[str, Any]) -> Missing:
    """Return what a recording is known to lack, and whether samples may be missing at its end."""
    stored = missing_of(meta)
    if meta["status"] != "recording" or is_being_written(path) or not end_may_be_missing(path):
        return stored
    return Missing((*stored.samples, end_hole(db, meta)), stored.rows)


def end_hole(db: sqlite3.Connection, meta: Mapping[str, Any]) -> Hole:
    """Return the hole behind the last sample that is stored."""
    last = db.execute("SELECT segment, samples FROM block WHERE n > 0 ORDER BY id DESC LIMIT 1").fetchone()
    if last is None:
        return Hole(0, None, None, None, None, None)
    sample = np.frombuffer(last[1], session_dtype(meta))[-1]
    return Hole(last[0], int(sample["index"]), int(sample["time_us"]) / 1e6, None, None, None)


def _s(time_s: float | None) -> str:
    return "unknown time" if time_s is None else f"{time_s:.3f} s"
