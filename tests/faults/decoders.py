"""Everything that reads bytes from outside, in one table: called by the fuzzers and the tests of hostile files.

An entry takes bytes and either uses them or raises an error of one of the three families; anything else that
is raised is a finding. Where two ways of decoding must agree, the entry compares them.
"""

from __future__ import annotations

import atexit
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np

from analysis.data.boat_writer import write_boat_file
from analysis.data.csv_import import import_csv, preview
from analysis.data.csv_import import load_profile as load_column_map
from analysis.data.load import load_recording
from analysis.data.recording import Recording
from analysis.optics.scene.curve_file import read_curves
from analysis.optics.sweep.sweep_file import SweepFile
from analysis.segmentation.plateau_readings import read_elongation_file
from analysis.shadow.fem.mesh_files import read_mesh
from analysis.shadow.fem.parameters import read_parameters
from analysis.shadow.model.modulus import effective_modulus, read_compression_test
from analysis.shadow.model.table import read_table as read_shadow_table
from boat_daq.engine.plan import load_plan
from boat_daq.engine.recording.recovery import find_interrupted, recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.settings import UnitLibrary, load_settings
from protocol.base.errors import BoatDaqError
from protocol.link.bulk import decode_samples
from protocol.link.connection import Connection
from protocol.link.events import Samples
from protocol.link.framing import COLLECT_MAX, Frame, FrameReader, encode_frame
from protocol.link.messages import decode_command, decode_message
from protocol.recording.elongation_file import read_elongation_rows
from protocol.simulator.board import VirtualBoard
from protocol.text.connection import TextConnection
from protocol.text.packets import parse_format
from protocol.text.profile import load_profile
from tests.faults.old_recordings import write_recording
from tests.protocol.link.streams import HELLO, START_DONE, stream

ROOT = Path(__file__).resolve().parents[2]
REFUSALS = BoatDaqError
Decoder = Callable[[bytes], object]


@cache
def folder() -> Path:
    """Return a folder for the files of one process, in memory where the system has such a folder."""
    shared = Path("/dev/shm")
    made = Path(tempfile.mkdtemp(prefix="boat-fuzz-", dir=shared if shared.is_dir() else None))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


def kept(data: bytes, name: str) -> Path:
    """Write the bytes to a file and return its path; files of an earlier input are removed."""
    shutil.rmtree(folder(), ignore_errors=True)
    folder().mkdir()
    path = folder() / name
    path.write_bytes(data)
    return path


def attempt(read: Callable[[], object]) -> object:
    """Return what a reader returns, None where it raised an error that has a cause."""
    try:
        return read()
    except REFUSALS as refusal:
        assert refusal.cause
        return None


# ---- bytes of the link ---------------------------------------------------------------------------------------------


def framing(data: bytes) -> None:
    """Frames and counters do not depend on where the stream is cut, and memory is bounded."""
    whole, pieces = FrameReader(), FrameReader()
    frames = whole.receive(data)
    at = data[0] if data else 0
    assert frames == [*pieces.receive(data[:at]), *pieces.receive(data[at:])]
    assert [getattr(whole, name) for name in ("bytes", "frames", "crc_errors", "malformed", "oversize")] == [
        getattr(pieces, name) for name in ("bytes", "frames", "crc_errors", "malformed", "oversize")
    ]
    assert len(whole.state()["rest"]) <= 2 * COLLECT_MAX


def messages(data: bytes) -> None:
    """Any type and payload behind a good checksum, to either side."""
    frame = Frame(data[0] if data else 0, 0, data[1:195])
    for n_sensors in range(1, 5):
        attempt(lambda n=n_sensors: decode_message(frame, n))
    attempt(lambda: decode_command(frame))


def good_frames(data: bytes) -> bytes:
    """The bytes as payloads of good frames: each begins with its type and its length."""
    out, at = bytearray(), 0
    while at + 2 <= len(data):
        type_, size = data[at] % 8, data[at + 1] % 64
        out += encode_frame(type_, at, data[at + 2 : at + 2 + size])
        at += 2 + size
    return bytes(out)


def samples(data: bytes) -> None:
    """Good frames with any content: the sample stream, in one go and frame by frame, through the bulk decoder too."""
    bytes_ = stream(HELLO, START_DONE) + good_frames(data)
    link, slow = Connection(), Connection()
    events = link.receive(bytes_, 0)
    for run in bytes_.split(b"\0"):
        slow.receive(run + b"\0", 0)
    assert link.statistics.samples == slow.statistics.samples
    assert link.statistics.lost == slow.statistics.lost
    arrays = [event.array for event in events if isinstance(event, Samples)]
    total = sum(map(len, arrays))
    assert total == link.statistics.samples
    bulk = decode_samples(bytes_, Connection())
    assert len(bulk.samples) == total
    if arrays and len({array.dtype for array in arrays}) == 1:
        assert np.concatenate(arrays).tobytes() == bulk.samples.tobytes()


def bulk(data: bytes) -> None:
    """Any bytes at all through link and bulk decoder: the same samples."""
    link = Connection(n_sensors=2, adc_bits=12)
    events = link.receive(data, 0)
    again = decode_samples(data, Connection(n_sensors=2, adc_bits=12))
    assert sum(len(event.array) for event in events if isinstance(event, Samples)) == len(again.samples)


def board(data: bytes) -> None:
    """The board's own decoder: any good frames of a host; the pressure stays within the hard limits."""
    virtual = VirtualBoard()
    for at in range(0, len(data), 16):
        piece = data[at : at + 16]
        virtual.receive(encode_frame(0x80 | piece[0] % 12, at, piece[1:]))
        virtual.advance(300_000)
        assert HELLO.pressure_min_pa - 2_500 <= virtual.pressure_kpa * 1000 <= HELLO.pressure_max_pa + 2_500


def _text(name: str) -> Decoder:
    profile = load_profile(ROOT / "protocol" / "profiles" / name)

    def decode(data: bytes) -> None:
        whole, pieces = TextConnection(profile), TextConnection(profile)
        at = data[0] if data else 0
        rows = [e.array for e in whole.receive(data, 0) if isinstance(e, Samples)]
        cut = [e.array for part in (data[:at], data[at:]) for e in pieces.receive(part, 0) if isinstance(e, Samples)]
        assert sum(map(len, rows)) == sum(map(len, cut))
        assert whole.statistics == pieces.statistics

    return decode


def rx8_format(data: bytes) -> None:
    attempt(lambda: parse_format(data.decode("utf-8", "replace")))


# ---- files ---------------------------------------------------------------------------------------------------------


def recording(data: bytes) -> None:
    """A file with a recording's suffix, through every function that opens one."""
    path = kept(data, "run.boat")
    before = path.read_bytes()
    for read in (load_recording, summarise, verify_recording):
        attempt(lambda read=read: read(path))
    find_interrupted(path.parent)
    assert path.read_bytes() == before
    attempt(lambda: recover(path))


_CELLS: tuple[object, ...] = (None, 0, 1, -1, 2**62, -(2**63), 1e308, -0.5, "", "x", "0", "{}", "[]", b"", b"\0" * 9)
_JSON = ("null", "0", "-1", "1e400", '"x"', "[]", "{}", "[[]]", "true", '[["a","<f8",[]]]', "NaN", "2", "64", '{"a":1}')


@cache
def _small_recording() -> bytes:
    return write_recording(kept(b"", "none").with_name("small.boat")).read_bytes()


def cells(data: bytes) -> None:
    """A valid recording in which some cells hold another type, giant numbers or unexpected JSON."""
    path = kept(_small_recording(), "run.boat")
    with closing(sqlite3.connect(path)) as db:
        tables = [row[0] for row in db.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name")]
        for at in range(0, len(data) - 3, 4):
            table = tables[data[at] % len(tables)]
            columns = [row[1] for row in db.execute(f"PRAGMA table_info({table})")]
            column = columns[data[at + 1] % len(columns)]
            value = _JSON[data[at + 3] % len(_JSON)] if table == "session" else _CELLS[data[at + 3] % len(_CELLS)]
            order = "key" if table == "session" else "id"
            if column == order:
                continue
            where = f"{order} IN (SELECT {order} FROM {table} ORDER BY {order} LIMIT 1 OFFSET ?)"
            count = db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
            try:
                db.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (value, data[at + 2] % max(count, 1)))
            except sqlite3.IntegrityError:
                continue
        db.commit()
    recording(path.read_bytes())


def csv(data: bytes) -> None:
    path = kept(data, "table.csv")
    attempt(lambda: preview(path))
    run = attempt(lambda: import_csv(path))
    if isinstance(run, Recording):
        made = path.with_suffix(".boat")
        attempt(lambda: write_boat_file(made, run, original=path))
        assert not made.exists() or load_recording(made).n == run.n
    attempt(lambda: import_csv(path, columns={"s1_mv": "2", "pressure_kpa": "1"}, rate_hz=100.0))


def column_map(data: bytes) -> None:
    attempt(lambda: load_column_map(kept(data, "map.json")))


def elongation(data: bytes) -> None:
    path = kept(data, "readings.csv")
    attempt(lambda: read_elongation_file(path))
    attempt(lambda: read_elongation_rows(path))


def compression(data: bytes) -> None:
    path = kept(data, "specimen.csv")
    attempt(lambda: effective_modulus([read_compression_test(path, 20.0, 400.0)]))


def curves(data: bytes) -> None:
    attempt(lambda: read_curves(kept(data, "curves.csv")))


def plan(data: bytes) -> None:
    attempt(lambda: load_plan(str(kept(data, "plan.toml"))))


def unit(data: bytes) -> None:
    attempt(lambda: UnitLibrary(kept(data, "SA1.toml").parent).load("SA1"))


def settings(data: bytes) -> None:
    attempt(lambda: load_settings(kept(data, "settings.toml").parent))


def profile(data: bytes) -> None:
    attempt(lambda: load_profile(kept(data, "profile.toml")))


def shadow_parameters(data: bytes) -> None:
    attempt(lambda: read_parameters(kept(data, "actuator.toml")))


def shadow_table(data: bytes) -> None:
    assert read_shadow_table(kept(data, "table.npz")) is None


def mesh(data: bytes) -> None:
    for name in ("mesh.vtu", "mesh.msh"):
        attempt(lambda name=name: read_mesh(kept(data, name)))


def sweep(data: bytes) -> None:
    path = kept(data, "sweep.sqlite")
    attempt(lambda: SweepFile(path, {"rays": 1}).read(15))


DECODERS: dict[str, Decoder] = {
    "framing": framing,
    "messages": messages,
    "samples": samples,
    "bulk": bulk,
    "board": board,
    "text lines": _text("delimited_lines.toml"),
    "rx8 packets": _text("bridge_control_panel.toml"),
    "rx8 format": rx8_format,
    "profile": profile,
    "recording": recording,
    "cells": cells,
    "csv": csv,
    "column map": column_map,
    "elongation": elongation,
    "compression": compression,
    "curves": curves,
    "plan": plan,
    "unit": unit,
    "settings": settings,
    "shadow parameters": shadow_parameters,
    "shadow table": shadow_table,
    "mesh": mesh,
    "sweep": sweep,
}
