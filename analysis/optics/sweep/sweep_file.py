"""The results of a sweep in one SQLite file, written as they arrive, so that a stopped sweep resumes where it was.

Schema (additive only): `meta(key, value)` has the parameters as JSON, the program's version and the start time;
`simulation` has one row per design and state, from which every figure can be derived again. Rows of a version without
the changes of power along the fan are simulated again. A file belongs to one set of parameters; another is rejected.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from analysis.optics.scene.parameters import Design
from analysis.optics.tracer.tally import COUNTS, ENERGY, LEDGER
from analysis.version import program_version
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import FileError, RequestError

USER_VERSION = 1
COUNT_NAMES = (*LEDGER, "hits", "secondaries", "refused")
_KEYS = ("cavities", "width_mm", "depth_mm", "spacing_mm", "face", "state")
_ADDED = "power_changes"
_COLUMNS = (*_KEYS, *COUNT_NAMES, *(f"{name}_power" for name in ENERGY), "changes", _ADDED)
_INSERT = f"insert or replace into simulation values ({','.join('?' * len(_COLUMNS))})"  # noqa: S608
_SCHEMA = f"""
create table meta (key text primary key, value text not null);
create table simulation ({", ".join(f"{c} not null" for c in _COLUMNS)}, primary key ({", ".join(_KEYS)}));
pragma user_version = {USER_VERSION};
"""


class SweepFile:
    """A sweep's results on disk.

    `path`: the file; created where it does not exist. `parameters`: everything that determines a simulation's result,
    JSON's own types.
    Raises FileError: the file is not a sweep's. RequestError : it belongs to another sweep.
    """

    def __init__(self, path: Path, parameters: dict[str, object]) -> None:
        self.path = path
        text = json.dumps(parameters, sort_keys=True)
        try:
            with self._open() as db:
                if db.execute("pragma user_version").fetchone()[0] == 0:
                    db.executescript(_SCHEMA)
                    began = datetime.now(UTC).isoformat(timespec="seconds")
                    about = {"parameters": text, "version": program_version(), "began": began}
                    db.executemany("insert into meta values (?, ?)", about.items())
                kept = dict(db.execute("select key, value from meta"))["parameters"]
                if _ADDED not in {row[1] for row in db.execute("pragma table_info(simulation)")}:
                    db.execute(f"alter table simulation add column {_ADDED}")
        except (sqlite3.Error, UnicodeDecodeError, MemoryError, KeyError) as error:
            cause = f"{path} cannot be used as a sweep's results: {error}"
            raise FileError(cause, "choose another folder") from error
        if kept != text:
            remedy = "choose another folder, or remove the file to start over"
            raise RequestError(f"{path} is of a sweep with other parameters", remedy)

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        db = sqlite3.connect(self.path, timeout=10)
        try:
            for pragma in ("trusted_schema=off", "cell_size_check=on", "mmap_size=0"):
                db.execute(f"pragma {pragma}")
            if db.execute("select 1 from sqlite_schema where type in ('view', 'trigger')").fetchone():
                raise FileError(f"{self.path} has a view or trigger", "boat-daq did not write it: choose another")
            with db:
                yield db
        finally:
            db.close()

    def write(self, designs: Sequence[Design], counts: IntArray, energy: FloatArray, changes: FloatArray) -> None:
        """Add the results of whole designs in one transaction.

        `designs`: (d,). `counts`, `energy`, `changes`: (d, s, 10), (d, s, 4) and (d, s, 2).
        """
        rows = [
            (*asdict(d).values(), s, *counts[i, s].tolist(), *energy[i, s].tolist(), *changes[i, s].tolist())
            for i, d in enumerate(designs)
            for s in range(counts.shape[1])
        ]
        with self._open() as db:
            db.executemany(_INSERT, rows)

    def read(self, states: int) -> dict[Design, tuple[IntArray, FloatArray, FloatArray]]:
        """Return every design that has all its states: counts (s, 10), energy (s, 4), changes (s, 2).

        Raises FileError: the file is damaged. RequestError : it has an impossible design.
        """
        sql = f"select {', '.join(_COLUMNS)} from simulation where {_ADDED} is not null order by {', '.join(_KEYS)}"  # noqa: S608
        try:
            with self._open() as db:
                rows = db.execute(sql).fetchall()
            done: dict[Design, list[tuple[float, ...]]] = {}
            for row in rows:
                done.setdefault(Design(int(row[0]), *row[1:5]), []).append(row[6:])
            return {design: _arrays(values) for design, values in done.items() if len(values) == states}
        except (sqlite3.Error, MemoryError, ValueError, TypeError, OverflowError) as error:
            raise FileError(f"{self.path} is damaged: {error}", "remove it to start the sweep over") from error


def _arrays(rows: list[tuple[float, ...]]) -> tuple[IntArray, FloatArray, FloatArray]:
    table = np.array(rows, dtype=float)
    return table[:, :COUNTS].astype(np.int64), table[:, COUNTS:-2], table[:, -2:]
