"""Derive lost blocks of a salvaged recording from its raw bytes, and say which samples remain missing."""

from __future__ import annotations

import json
import re
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.opening import open_link
from boat_daq.engine.recording.file import Statement
from boat_daq.engine.recording.rows import BLOCK_SAMPLES_MAX, INSERT_BLOCK
from protocol.base.errors import ProfileError
from protocol.link.events import BoardRestarted, ClockWentBack, Link, Samples
from protocol.recording import SampleFlag, fitted, session_dtype
from protocol.recording.missing import Hole

Array = NDArray[np.void]
_NO_KEY = 1 << 62


@dataclass(slots=True)
class _Block:
    id: int
    segment: int
    last_chunk: int
    samples: Array


@dataclass(slots=True)
class _Gap:
    """Keys of blocks that are not kept, between two that are, and what is derived for them."""

    before: _Block | None
    after: _Block | None
    derived: list[tuple[int, int, Array]] = field(default_factory=list)  # (chunk, segment, samples)
    ended: bool = False

    def take(self, chunk: int, parts: list[tuple[int, Array]]) -> None:
        """Keep the samples of a chunk, apart by segment, that are not in the blocks beside it."""
        if self.ended or (self.before is not None and chunk < self.before.last_chunk):
            return
        samples = np.concatenate([part for _, part in parts])
        begin, end = 0, len(samples)
        if self.before is not None and chunk == self.before.last_chunk:
            begin = _position(samples, self.before.samples[-1]) + 1
        if self.after is not None and begin < end and samples["host_ns"][0] in self.after.samples["host_ns"]:
            end, self.ended = max(_position(samples, self.after.samples[0]), 0), True
        low = 1 if self.before is None else self.before.segment
        high = _NO_KEY if self.after is None else self.after.segment
        at = 0
        for segment, part in parts:
            if len(kept := part[max(begin - at, 0) : max(end - at, 0)]):
                self.derived.append((chunk, min(max(segment, low), high), kept))
            at += len(part)


def _position(samples: Array, wanted: Any) -> int:
    """Return where a sample is, -1 where it is not."""
    same = (samples["index"] == wanted["index"]) & (samples["time_us"] == wanted["time_us"])
    found = np.flatnonzero(same)
    return int(found[0]) if len(found) else -1


def _split(chunk: int, segments: list[tuple[int, int]], samples: Array, later: int) -> Iterator[tuple[int, Array]]:
    """Give samples with their segments; one that begins in this chunk with a START begins where the index does."""
    number, first_chunk = max(((s, first) for s, first in segments if first <= chunk), default=(1, 0))
    number -= later if first_chunk == chunk else 0
    at = int(np.argmin(samples["index"])) if first_chunk == chunk else 0
    if at:
        yield number - 1, samples[:at]
    yield number, samples[at:]


def derive_missing(
    db: sqlite3.Connection, meta: dict[str, Any], *, end_known: bool
) -> tuple[list[Statement], list[Hole], list[tuple[int, int]]]:
    """Return the rows of the blocks that the raw bytes give, the samples that remain missing, and their keys."""
    dtype = session_dtype(meta)
    gaps = list(_gaps(db, dtype))
    segments = db.execute("SELECT id, first_chunk FROM segment ORDER BY id").fetchall()
    if gaps:
        _derive(db, meta, dtype, gaps, segments)
    chunks = {number for (number,) in db.execute("SELECT id FROM chunk")}
    lost = db.execute("SELECT text, value FROM event WHERE kind = 'gap' AND source = 'host'").fetchall()
    matches = ((re.fullmatch(r"before index (\d+)", text), value) for text, value in lost)
    on_the_way = {int(match[1]): int(value or 0) for match, value in matches if match}
    statements: list[Statement] = []
    holes: list[Hole] = []
    keys: list[tuple[int, int]] = []
    for gap in gaps:
        _clear_flags(gap)
        added = list(_block_rows(gap))
        statements += added
        left = list(_holes(gap, chunks, on_the_way, end_known))
        holes += left
        first = len(added) + (1 if gap.before is None else gap.before.id + 1)
        if left and gap.after is not None and first < gap.after.id:
            keys.append((first, gap.after.id - 1))
    return statements, holes, keys


def _gaps(db: sqlite3.Connection, dtype: np.dtype[np.void]) -> Iterator[_Gap]:
    """Give where keys are missing, and the end."""
    before = None
    for number, segment, last_chunk, blob in db.execute(
        "SELECT id, segment, last_chunk, samples FROM block ORDER BY id"
    ):
        block = _Block(number, segment, last_chunk, np.frombuffer(blob, dtype))
        if number > (0 if before is None else before.id) + 1:
            yield _Gap(before, block)
        before = block
    yield _Gap(before, None)


def _derive(
    db: sqlite3.Connection,
    meta: dict[str, Any],
    dtype: np.dtype[np.void],
    gaps: list[_Gap],
    segments: list[tuple[int, int]],
) -> None:
    begins = db.execute("SELECT first_chunk, decoder FROM segment WHERE decoder IS NOT NULL ORDER BY id").fetchall()
    begins = begins if begins and begins[0][0] == 1 else [(1, None), *begins]
    for (first, state), (after, _) in pairwise([*begins, (_NO_KEY, None)]):
        if (link := _link(meta, state)) is None:
            continue
        sql = "SELECT id, host_ns, raw FROM chunk WHERE id >= ? AND id < ? AND direction = 0 ORDER BY id"
        for chunk, host_ns, raw in db.execute(sql, (first, after)):
            runs: dict[int, list[Array]] = {}  # of the chunk's samples, by how many segments begin behind them in it
            events = link.receive(raw, host_ns)
            for at, event in enumerate(events):
                samples = fitted(event.array, dtype) if isinstance(event, Samples) else np.empty(0, dtype)
                if samples.dtype == dtype and len(samples):
                    later = sum(isinstance(other, ClockWentBack | BoardRestarted) for other in events[at:])
                    runs.setdefault(later, []).append(samples)
            parts = [p for later, run in runs.items() for p in _split(chunk, segments, np.concatenate(run), later)]
            for gap in gaps if parts else ():
                if gap.after is None or chunk <= gap.after.last_chunk:
                    gap.take(chunk, parts)


def _link(meta: dict[str, Any], state: str | None) -> Link | None:
    with suppress(ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError, ProfileError):
        return open_link(meta, None if state is None else json.loads(state))
    return None


def _clear_flags(gap: _Gap) -> None:
    """Take the mark of a gap from a sample whose predecessor is kept, though the bytes of that one are not."""
    last = None if gap.before is None else gap.before.samples[-1]["index"]
    for number, (chunk, segment, samples) in enumerate(gap.derived):
        if last is not None and samples["index"][0] == last + 1:
            samples = samples.copy()
            samples["flags"][0] &= ~np.uint16(SampleFlag.GAP_BEFORE)
            gap.derived[number] = chunk, segment, samples
        last = samples["index"][-1]


def _block_rows(gap: _Gap) -> Iterator[Statement]:
    """Give the rows of the derived samples, a key for each segment's part while keys are free."""
    number = 1 if gap.before is None else gap.before.id + 1
    upto = _NO_KEY if gap.after is None else gap.after.id
    groups: list[list[tuple[int, int, Array]]] = []
    for part in gap.derived:
        fits = groups and groups[-1][-1][1] == part[1]
        if fits and sum(len(samples) for _, _, samples in groups[-1]) + len(part[2]) <= BLOCK_SAMPLES_MAX:
            groups[-1].append(part)
        else:
            groups.append([part])
    groups = groups[: upto - number]
    gap.derived = list(chain.from_iterable(groups))
    for group in groups:
        samples = np.concatenate([part for _, _, part in group])
        content = samples.tobytes()
        times = int(samples["time_us"][0]), int(samples["time_us"][-1])
        yield INSERT_BLOCK, (number, group[0][1], group[-1][0], len(samples), *times, content, crc32(content))
        number += 1


def _holes(gap: _Gap, chunks: set[int], on_the_way: dict[int, int], end_known: bool) -> Iterator[Hole]:
    before, after = gap.before, gap.after
    parts = [(segment, samples) for _, segment, samples in gap.derived]
    whole = [] if before is None else [(before.segment, before.samples)]
    whole += parts + ([] if after is None else [(after.segment, after.samples)])
    upto = max(chunks, default=0) if after is None else after.last_chunk
    complete = all(number in chunks for number in range(1 if before is None else before.last_chunk, upto + 1))
    if before is None and whole and not complete and whole[0][1]["index"][0]:
        yield Hole(whole[0][0], None, None, *_at(whole[0][1][0]), None)
    for (old, earlier), (segment, later) in pairwise(whole):
        x, y = earlier[-1], later[0]
        if old != segment:
            if not complete:
                yield Hole(segment, *_at(x), *_at(y), None)
            continue
        n = (int(y["index"]) - int(x["index"]) - 1) % (1 << 32)
        if 0 < n < 1 << 31 and (n := n - sum(v for k, v in on_the_way.items() if x["index"] < k <= y["index"])) > 0:
            yield Hole(segment, *_at(x), *_at(y), n)
    if after is None and not end_known:
        index, time_s = _at(whole[-1][1][-1]) if whole else (None, None)
        yield Hole(whole[-1][0] if whole else 0, index, time_s, None, None, None)


def _at(sample: Any) -> tuple[int, float]:
    return int(sample["index"]), int(sample["time_us"]) / 1e6
