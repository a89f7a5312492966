"""Derive everything again from the raw bytes, and report `identical` or the first difference.

The chunks are checked against their checksums and decoded again by a link that begins in the state the recording's
began in; samples, gaps and the overview must come out bit for bit as they are stored. Memory stays bounded however long
the recording is. Results of analyses are derived again through a function of the caller's, because the engine does not
import the analysis; their numbers may differ by rounding, because processors' vector instructions add in other orders.
"""

from __future__ import annotations

import json
import math
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from itertools import chain, pairwise, zip_longest
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.opening import open_link
from boat_daq.engine.recording.rows import OverviewRows
from boat_daq.engine.sample_columns import mv_per_count
from protocol.base.errors import ProfileError
from protocol.link.bulk import decode_chunks
from protocol.link.events import Link, SampleGap, Samples
from protocol.recording import breaks_of, check_long_tables, open_recording, read_session, session_dtype
from protocol.recording.checks import DAMAGE
from protocol.recording.damaged_log import fault_of_log
from protocol.recording.missing import Missing, missing_before_recovery
from protocol.recording.writer_lock import is_being_written

Progress = Callable[[float, float], None]
_PIECE = 20_000  # samples compared at once
_ROUNDING = 1e-9  # relative, of a result; 1e-11 was seen between processors with AVX2 and with AVX-512
# A result of less than the whole run, or from before a reading was corrected or a video was stored, cannot be derived
# from the file. Compared as instants, to the millisecond: readings are in local time with its offset, results in UTC.
_STANDING_RESULTS = """
    SELECT id FROM result WHERE id > ?
    AND coalesce(julianday(utc) >= (SELECT max(julianday(utc)) FROM reading), 1)
    AND coalesce(julianday(utc) >= julianday(?), 1) ORDER BY id"""
_GONE = {"derived", "lab_figures"}  # keys of results of older programs
_WORDING = {"calibration_void", "definition", "note", "notes", "text", "void"}  # keys of a result that hold texts


@dataclass(frozen=True, slots=True)
class Verification:
    """The verdict; `difference` is empty when `identical`."""

    identical: bool
    difference: str
    samples: int
    chunks: int
    results: int
    seconds: float
    missing: Missing = field(default_factory=Missing)  # of a salvaged recording


@dataclass(frozen=True, slots=True)
class StoredResult:
    """A result as it is stored in the file."""

    id: int
    kind: str
    program_version: str
    seed: int | None
    parameters: dict[str, Any]
    content: dict[str, Any]


Reanalyse = Callable[[Path, StoredResult], dict[str, Any] | None]


class _Difference(Exception):
    """The first difference found."""


def verify_recording(
    path: Path, *, reanalyse: Reanalyse | None = None, code: str = "", progress: Progress | None = None
) -> Verification:
    """Derive a recording again from its raw bytes.

    `path`: a recording; one that is interrupted, or in progress, is checked up to its last commit. `reanalyse`:
    computes a stored result anew, or returns None for an unknown kind. `code`: state of the program that `reanalyse`
    computes with; a result names the one it was computed by.
    """
    started = time.monotonic()
    tally = {"samples": 0, "chunks": 0, "results": 0}
    difference, missing = "", Missing()
    fault = "" if is_being_written(path) else fault_of_log(path)
    with closing(open_recording(path)) as db:
        db.execute("BEGIN")  # one state of the file, whatever is recorded meanwhile
        try:
            if fault:
                raise _Difference(fault)
            missing = missing_before_recovery(path, db, read_session(db))
            if not missing.whole:
                raise _Difference(f"it was salvaged: {next(missing.lines())}")
            check_long_tables(path, db)
            _verify_stream(db, tally, progress)
            _verify_results(db, path, tally, reanalyse, code)
        except _Difference as found:
            difference = str(found)
        except DAMAGE as error:
            difference = f"the file is damaged: {error}"
    return Verification(not difference, difference, **tally, seconds=time.monotonic() - started, missing=missing)


def _resumed_link(meta: dict[str, Any], state: str | None, first: int) -> Link:
    """Return the link as it was before chunk `first`."""
    try:
        return open_link(meta, None if state is None else json.loads(state))
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError, ProfileError) as error:
        raise _Difference(f"the decoder's state before chunk {first} cannot be used: {error}") from error


def _verify_stream(db: sqlite3.Connection, tally: dict[str, int], progress: Progress | None) -> None:
    meta = read_session(db)
    dtype = session_dtype(meta)
    total = db.execute("SELECT coalesce(sum(n), 0) FROM block").fetchone()[0]
    if total and db.execute("SELECT id FROM chunk LIMIT 1").fetchone() is None:
        raise _Difference("there are no raw bytes to derive the samples from (the recording was imported)")
    derived = _pieces(_derived(db, meta, tally))
    stored = _pieces(_stored(db, dtype, OverviewRows(mv_per_count(meta))))
    for again, kept in zip_longest(derived, stored, fillvalue=np.empty(0, dtype)):
        n = min(len(again), len(kept))  # pieces are of one length, but for the last
        if n and (again.dtype != kept.dtype or again[:n].tobytes() != kept[:n].tobytes()):
            raise _Difference(_first_difference(kept[:n], again[:n], tally["samples"]))
        tally["samples"] += n
        if n and progress is not None:
            progress(tally["samples"], total)
        if len(again) != len(kept):
            more = "the bytes hold more samples than the file" if len(again) > n else "the file has more samples"
            raise _Difference(f"after sample {tally['samples']} {more}")


def _derived(db: sqlite3.Connection, meta: dict[str, Any], tally: dict[str, int]) -> Iterator[NDArray[np.void]]:
    """Give the samples that the bytes hold. Check the gaps between them on the way."""
    kept = db.execute("SELECT value, text, time_us FROM event WHERE kind = 'gap' AND source = 'host' ORDER BY id")
    gaps = 0
    begins = db.execute("SELECT first_chunk, decoder FROM segment WHERE decoder IS NOT NULL ORDER BY id")
    first_of_all = begins.fetchone() or (1, None)
    for (first, state), (after, _) in pairwise(chain([first_of_all], begins, [(1 << 62, None)])):
        link = _resumed_link(meta, state, first)
        for event in chain.from_iterable(decode_chunks(_chunks(db, first, after, tally), link)):
            if isinstance(event, Samples):
                yield event.array
            elif isinstance(event, SampleGap):
                gaps += 1
                _check_gap(gaps, kept.fetchone(), event)
    _check_gap(gaps + 1, kept.fetchone(), None)


def _chunks(db: sqlite3.Connection, first: int, after: int, tally: dict[str, int]) -> Iterator[tuple[int, bytes]]:
    """Give what came, each chunk checked; what was sent is checked and left out."""
    rows = db.execute(
        "SELECT id, host_ns, direction, raw, crc32 FROM chunk WHERE id >= ? AND id < ? ORDER BY id", (first, after)
    )
    for number, host_ns, direction, raw, checksum in rows:
        if number != tally["chunks"] + 1:
            raise _Difference(f"chunk {tally['chunks'] + 1} is missing")
        if crc32(raw) != checksum:
            raise _Difference(f"the raw bytes of chunk {number} do not match their checksum")
        tally["chunks"] = number
        if direction == 0:
            yield host_ns, raw


def _stored(db: sqlite3.Connection, dtype: np.dtype[np.void], overview: OverviewRows) -> Iterator[NDArray[np.void]]:
    """Give the samples that the file has. Check their rows and the overview on the way."""
    rows = db.execute("SELECT id, segment, n, first_time_us, last_time_us, samples FROM block ORDER BY id")
    kept = db.execute("SELECT * FROM overview ORDER BY id")
    for number, segment, n, first_us, last_us, blob in rows:
        if len(blob) != n * dtype.itemsize or not n:
            raise _Difference(f"block {number} is for {n} samples and holds {len(blob)} bytes")
        samples = np.frombuffer(blob, dtype)
        if (first_us, last_us) != (samples["time_us"][0], samples["time_us"][-1]):
            raise _Difference(f"the times of block {number} differ from those of its samples")
        for _, row in overview.add(number, segment, samples):
            if kept.fetchone() != row:
                raise _Difference(f"row {row[0]} of the overview differs from its samples")
        yield samples


def _pieces(arrays: Iterator[NDArray[np.void]]) -> Iterator[NDArray[np.void]]:
    """Give the same samples in pieces of `_PIECE`."""
    held: list[NDArray[np.void]] = []
    n = 0
    for array in arrays:
        held.append(array)
        n += len(array)
        while n >= _PIECE:
            joined = np.concatenate(held)
            yield joined[:_PIECE]
            held, n = [joined[_PIECE:]], n - _PIECE
    if n:
        yield np.concatenate(held)


def _first_difference(kept: NDArray[np.void], again: NDArray[np.void], done: int) -> str:
    if kept.dtype != again.dtype:
        return "the bytes give samples of another layout than the file has"
    at = int(np.flatnonzero([a.tobytes() != b.tobytes() for a, b in zip(kept, again, strict=True)])[0])
    names = kept.dtype.names or ()
    name = next(name for name in names if kept[at][name].tobytes() != again[at][name].tobytes())
    return f"sample {done + at + 1}: {name} is {kept[at][name]} in the file and {again[at][name]} from the bytes"


def _check_gap(number: int, row: tuple[Any, ...] | None, gap: SampleGap | None) -> None:
    again = None if gap is None else (gap.lost, f"before index {gap.before_index}", gap.time_us)
    if row != again:
        raise _Difference(f"gap {number} is {row} in the file and {again} from the bytes")


def _verify_results(
    db: sqlite3.Connection, path: Path, tally: dict[str, int], reanalyse: Reanalyse | None, code: str
) -> None:
    if reanalyse is None:
        return
    done: dict[tuple[str, str], dict[str, Any] | None] = {}  # one computation for equal parameters
    video_utc = (read_session(db).get("video") or {}).get("utc")
    for number in db.execute(
        _STANDING_RESULTS, (max((entry["last_result"] for entry in breaks_of(read_session(db))), default=0), video_utc)
    ).fetchall():
        stored = _stored_result(db, *number)
        asked = stored.kind, json.dumps({**stored.parameters, "code": code}, sort_keys=True)
        if asked not in done:
            done[asked] = reanalyse(path, stored)
        again = done[asked]
        if again is None:
            continue
        if stored.parameters.get("code") != code:
            again = _in_terms_of(stored.content, again)
        key = _first_other(stored.content, again)
        if key is not None:
            which = f"result {stored.id} ({stored.kind})"
            raise _Difference(f"{which}: {_by_whom(stored, code)}; the first is {key or 'the whole'}")
        tally["results"] += 1


def _stored_result(db: sqlite3.Connection, number: int) -> StoredResult:
    sql = "SELECT kind, program_version, seed, parameters, content FROM result WHERE id = ?"
    kind, version, seed, parameters, content = db.execute(sql, (number,)).fetchone()
    try:
        tables = [json.loads(parameters), json.loads(content)]
    except (ValueError, RecursionError) as error:
        raise _Difference(f"result {number} ({kind}) cannot be read: {error}") from error
    if not all(isinstance(table, dict) for table in tables):
        raise _Difference(f"result {number} ({kind}) is not a table of values")
    tables[1] = {key: value for key, value in tables[1].items() if key not in _GONE}
    return StoredResult(number, kind, version, seed, *tables)


def _by_whom(stored: StoredResult, code: str) -> str:
    """Return whether another program or a change of the file explains other numbers."""
    made = stored.parameters.get("code")
    if made == code:
        return "this program, which computed it, gives other numbers than are stored"
    known = f"code {made}" if made else "its code is not recorded"
    return (
        f"it was computed by another state of the program (version {stored.program_version}, {known}; this is code "
        f"{code}), and this one gives other numbers"
    )


def _in_terms_of(kept: Any, again: Any) -> Any:
    """Return a result with the keys and the wording of one that other code stored: keys are added, texts change."""
    if isinstance(kept, dict) and isinstance(again, dict):
        return {
            key: value if key in _WORDING else _in_terms_of(value, again[key])
            for key, value in kept.items()
            if key in again
        }
    if isinstance(kept, list) and isinstance(again, list) and len(kept) == len(again):
        return [_in_terms_of(one, other) for one, other in zip(kept, again, strict=True)]
    return again


def _same(kept: Any, again: Any) -> bool:
    if type(kept) is float and type(again) is float:
        return math.isclose(kept, again, rel_tol=_ROUNDING)
    return json.dumps(kept, sort_keys=True) == json.dumps(again, sort_keys=True)


def _first_other(kept: Any, again: Any, at: str = "") -> str | None:
    """Return the name of the first value that differs, as JSON; numbers may differ by their last digits.

    None where all are the same.
    """
    if isinstance(kept, dict) and isinstance(again, dict) and kept.keys() == again.keys():
        pairs = ((f"{at}.{key}".lstrip("."), kept[key], again[key]) for key in sorted(kept))
    elif isinstance(kept, list) and isinstance(again, list) and len(kept) == len(again):
        pairs = ((f"{at}[{i}]", *both) for i, both in enumerate(zip(kept, again, strict=True)))
    else:
        return None if _same(kept, again) else at
    found = (_first_other(one, other, name) for name, one, other in pairs)
    return next((name for name in found if name is not None), None)
