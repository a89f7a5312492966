"""Blocks of a virtual board without thread, port or clock, a recording of them, and what the file holds."""

from __future__ import annotations

import json
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from boat_daq.engine.link.block import Block
from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.file import now_utc
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.snapshot import Reading
from protocol import Connection, Identify, Samples, Start
from protocol.recording import open_recording
from protocol.simulator.board import VirtualBoard
from protocol.simulator.faults import parse_fault
from tests.boat_daq.engine.board_link import meta_of


class Source:
    """Blocks of a virtual board, made on request; no thread, no port."""

    def __init__(self, *faults: str, seed: int = 0, rate_hz: int = 100) -> None:
        self.board = VirtualBoard(seed=seed, faults=map(parse_fault, faults))
        self.link = Connection()
        self._send(Identify())
        self.samples: list[np.ndarray] = []
        self.raw: list[bytes] = []
        self.next(1)
        self._send(Start(rate_hz))
        self.next(1)

    def _send(self, command) -> None:
        self.board.receive(self.link.send(command, time.monotonic_ns()))

    def next(self, dt_us: int = 50_000) -> Block:
        data, now_ns = self.board.advance(dt_us), time.monotonic_ns()
        events = tuple(self.link.receive(data, now_ns))
        self.samples += [event.array for event in events if isinstance(event, Samples)]
        self.raw.append(data)
        return Block(now_ns, data, events=events)


def begin(path: Path, source: Source, **options: Any) -> Recorder:
    """Begin a recording at the source's present state; what the source gave before is discarded."""
    recorder = Recorder(path, meta_of(source.link), **options)
    recorder.attached(source.link.decoder_state())
    source.samples.clear()
    source.raw.clear()
    return recorder


def add_step(recorder: Recorder, cycle: int, branch: str, **known: Any) -> StepMark:
    """Keep the start of the recording's next step."""
    mark = StepMark(recorder._steps + 1, cycle, branch, 0.0, 10.0, 0, **known)
    recorder.step(mark, new=True)
    return mark


def reading(step_id: int, elongation_mm: float | None, **more: Any) -> Reading:
    """A reading taken now."""
    return Reading(step_id, elongation_mm, **{"resolution_mm": 0.5, "source": "typed", "utc": now_utc(), **more})


def add_result(path: Path, kind: str, parameters: dict[str, Any], content: dict[str, Any]) -> None:
    """Store the result of an analysis."""
    row = ("2026-11-01T12:00:00+00:00", kind, "0.1.0", json.dumps(parameters), json.dumps(content))
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("INSERT INTO result VALUES (NULL, ?, ?, ?, NULL, ?, ?)", row)


def stored_samples(path: Path) -> bytes:
    """The lines at the start of `protocol/recording/schema.py`, which any language can follow."""
    db = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)
    meta = {key: json.loads(value) for key, value in db.execute("SELECT key, value FROM session")}
    dtype = np.dtype([(name, code, *([tuple(shape)] if shape else [])) for name, code, shape in meta["sample_dtype"]])
    rows = db.execute("SELECT samples FROM block ORDER BY id")
    samples = np.concatenate([np.frombuffer(blob, dtype) for (blob,) in rows])
    db.close()
    return samples.tobytes()


def rows(path: Path, sql: str) -> list[tuple]:
    db = open_recording(path)
    found = db.execute(sql).fetchall()
    db.close()
    return found
