"""Damage in the file and the log of a killed recording: what is intact is kept, what is missing is named exactly."""

from __future__ import annotations

import bisect
import itertools
import json
import random
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from analysis.data.boat_file import read_boat_file
from boat_daq.commands.recordings import info, verify
from boat_daq.commands.recordings import recover as recover_command
from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.recovery import Recovery, recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import FileError, RecordingError, StorageError
from protocol.recording import RunEnd, open_recording, read_session, session_dtype
from protocol.recording.damaged_log import read_log
from protocol.recording.missing import missing_of
from tests.boat_daq.engine.recording_source import Source, begin, stored_samples
from tests.conftest import ROOT, mostly_at_night
from tests.faults.nightly_counts import few_and_many

EXAMPLE = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"
PAGE = 4096
FRAME = PAGE + 24


@dataclass(frozen=True)
class Killed:
    """A recording as a killed program leaves it, and what was committed."""

    database: bytes
    log: bytes
    shared: bytes  # -shm
    samples: np.ndarray  # in order; their `index` counts from the first
    blocks: dict[int, list[set[int]]]  # id -> the pages in which each piece of its samples lies
    chunks: dict[int, list[set[int]]]  # host_ns -> the same of its raw bytes
    block_of: dict[int, int]  # index of a sample -> id


@pytest.fixture(scope="module", params=mostly_at_night("1 kHz", "checkpoints", "100 Hz", by_day=2))
def killed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Killed:
    """Rows longer than a page; short ones in a log that began again over older frames; and in one that did not."""
    folder = tmp_path_factory.mktemp("killed")
    source = Source(rate_hz=1000 if request.param == "1 kHz" else 100)
    recorder = begin(folder / "run.boat", source)
    if request.param == "checkpoints":
        recorder._file._connection.execute("PRAGMA wal_autocheckpoint=40")
    for number in range(30):
        if number % 7 == 3:
            recorder.event("user", "mark", text="x" * 300)
        recorder(source.next(100_000 if request.param == "1 kHz" else 330_000))
        assert recorder.flush()
    content = [(folder / name).read_bytes() for name in ("run.boat", "run.boat-wal", "run.boat-shm")]
    with closing(open_recording(folder / "run.boat")) as db:
        blocks = dict(db.execute("SELECT id, samples FROM block").fetchall())
        chunks = dict(db.execute("SELECT host_ns, raw FROM chunk").fetchall())
    recorder.close(RunEnd.STOPPED)
    samples, pages = np.concatenate(source.samples), pages_of(*content[:2])
    block_of = {int(i): n for n, blob in blocks.items() for i in np.frombuffer(blob, samples.dtype)["index"]}
    where = [{key: places(value, pages) for key, value in table.items()} for table in (blocks, chunks)]
    return Killed(*content, samples, *where, block_of)


def invoke(command: Callable[..., None], *arguments: str) -> Result:
    app = typer.Typer()
    app.command()(command)
    return CliRunner().invoke(app, list(arguments))


def left(folder: Path, database: bytes, log: bytes, shared: bytes = b"") -> Path:
    for file in folder.iterdir():
        file.unlink()
    (folder / "run.boat").write_bytes(database)
    (folder / "run.boat-wal").write_bytes(log)
    if shared:
        (folder / "run.boat-shm").write_bytes(shared)
    return folder / "run.boat"


def pages_of(database: bytes, log: bytes) -> list[bytes]:
    """Return the frames of a log and the pages of a file."""
    frames = [log[at : at + FRAME] for at in range(32, len(log) - FRAME + 1, FRAME)]
    return frames + [database[at : at + PAGE] for at in range(0, len(database), PAGE)]


def places(content: bytes, pages: list[bytes]) -> list[set[int]]:
    """Return where each piece of a value lies, without those that lie across the end of a page."""
    whole, ends = b"".join(pages), list(itertools.accumulate(map(len, pages)))
    found = []
    for piece in (content[at : at + 48] for at in range(0, len(content) - 47, 48)):
        where, at = set(), whole.find(piece)
        while at >= 0:
            n = bisect.bisect_right(ends, at)
            where |= {n} if at + len(piece) <= ends[n] else set()
            at = whole.find(piece, max(at + 1, ends[n] - len(piece) + 1))
        found.append(where)
    return [where for where in found if where]


def check(killed: Killed, folder: Path, database: bytes, log: bytes) -> Recovery | None:
    """Recover a damaged copy, and compare it with what was committed. None: refused, for the file's first pages."""
    path = left(folder, database, log, killed.shared)
    try:
        recovery = recover(path)
    except RecordingError:
        assert database[: 5 * PAGE] != killed.database[: 5 * PAGE]
        return None
    whole = killed.samples
    with closing(open_recording(recovery.path)) as db:
        stored = np.frombuffer(stored_samples(recovery.path), session_dtype(read_session(db)))
        assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        blocks = [
            (n, np.frombuffer(b, stored.dtype)) for n, b in db.execute("SELECT id, samples FROM block ORDER BY id")
        ]
    ids = [0, *(number for number, _ in blocks)]
    ends = [int(whole["index"][0]) - 1, *(int(block["index"][-1]) for _, block in blocks)]
    behind = [number for (number, block), end in zip(blocks, ends[:-1], strict=True) if block["index"][0] > end + 1]
    absent = [(n + 1, m - 1) for n, m in itertools.pairwise(ids) if n + 1 < m and m in behind]
    assert [(first, last) for table, first, last in recovery.missing.rows if table == "block"] == absent
    position = stored["index"].astype(int) - int(whole["index"][0])
    assert (np.diff(position) > 0).all()
    again = whole[position].copy()
    after_hole = np.concatenate([[True], np.diff(position) > 1])
    assert (stored[~after_hole] == again[~after_hole]).all()
    again["flags"] = stored["flags"]  # derived again, the first sample behind a hole is marked
    assert (stored == again).all()
    missing = set(whole["index"].tolist()) - set(stored["index"].tolist())
    named, perhaps = set(), set()
    for hole in recovery.missing.samples:
        first = int(whole["index"][0]) if hole.after_index is None else hole.after_index + 1
        last = int(whole["index"][-1]) if hole.before_index is None else hole.before_index - 1
        (perhaps if hole.before_index is None else named).update(range(first, last + 1))
        assert hole.samples is None or hole.samples == last + 1 - first
    assert named <= missing <= named | perhaps
    pairs = zip(pages_of(killed.database, killed.log), pages_of(database, log), strict=True)
    intact = {n for n, (was, now) in enumerate(pairs) if was == now}
    lost = [
        {n for n, at in table.items() if not all(map(intact.intersection, at))}
        for table in (killed.blocks, killed.chunks)
    ]
    assert {killed.block_of[index] for index in missing} <= lost[0]
    assert {int(whole["host_ns"][index - int(whole["index"][0])]) for index in missing} <= lost[1]
    if recovery.status == "salvaged":
        assert path.read_bytes() == database
        assert path.with_name("run.boat-wal").read_bytes() == log
        assert recovery.damaged
    verdict, summary = verify_recording(recovery.path), summarise(recovery.path)
    assert summary.missing == recovery.missing == verdict.missing
    if missing:
        assert recovery.missing
        assert summary.lost_samples == len(missing & named) or not missing & named
    return recovery


def zeroed(content: bytes, at: int, n: int) -> bytes:
    return content[:at] + bytes(len(content[at : at + n])) + content[at + n :]


def flipped(content: bytes, at: int, rng: random.Random) -> bytes:
    return content[:at] + bytes([content[at] ^ rng.randrange(1, 256)]) + content[at + 1 :]


def damaged(killed: Killed, rng: random.Random) -> tuple[bytes, bytes]:
    """Return both files with one to three damages."""
    files = [killed.database, killed.log]
    for _ in range(rng.choice([1, 1, 2, 3])):
        which = int(rng.random() < 0.7)
        content = files[which]
        match rng.randrange(4):
            case 0:
                content = zeroed(content, rng.randrange(which ^ 1, len(content) // PAGE) * PAGE, PAGE)
            case 1:
                content = zeroed(content, rng.randrange(len(content)), rng.choice([1, 32, 512]))
            case 2:
                for _ in range(rng.randrange(1, 6)):
                    content = flipped(content, rng.randrange(100, len(content)), rng)
            case _:
                files[1] = zeroed(files[1], 0, 32)
        files[which] = content if content is not killed.log else files[which]
    return files[0], files[1]


@pytest.mark.fault(59, how="one page of the log of a killed recording zeroed", times=2)
def test_one_zeroed_page_of_the_log_loses_no_committed_sample(killed: Killed, tmp_path: Path) -> None:
    """SQLite ignores all behind it: recovery reads on, in a copy, and the damaged files stay."""
    log = zeroed(killed.log, len(killed.log) // 9 // PAGE * PAGE, PAGE)
    recovery = check(killed, tmp_path, killed.database, log)
    assert recovery is not None
    assert not recovery.missing.samples
    assert (recovery.status, recovery.path.name) == ("salvaged", "run.salvaged.boat")
    assert recovery.samples == len(killed.samples)
    if not recovery.missing:
        assert verify_recording(recovery.path).identical


@pytest.mark.parametrize("times", few_and_many(59, "pages zeroed, bytes flipped, headers zeroed, up to three", 15, 500))
def test_random_damage_loses_only_what_lay_in_damaged_pages(killed: Killed, tmp_path: Path, times: int) -> None:
    """Nothing wrong is stored, no intact row is lost, and what is called missing is what is missing."""
    rng = random.Random(times)
    refused = lost = 0
    for _ in range(times):
        recovery = check(killed, tmp_path, *damaged(killed, rng))
        refused += recovery is None
        lost += recovery is not None and bool(recovery.missing)
    assert refused < times / 4
    assert lost


@pytest.mark.fault(59, how="the last frames of the log zeroed", times=1)
def test_what_is_missing_is_said_by_every_reader(killed: Killed, tmp_path: Path) -> None:
    """`recover`, `info` and `verify`, before and after: no "0 lost" and no plain "identical"."""
    sound = read_log(left(tmp_path, killed.database, killed.log))
    assert sound is not None
    log = zeroed(killed.log, 32 + (len(sound.frames) - 2) * FRAME, 2 * FRAME)
    path = left(tmp_path, killed.database, log)
    before = invoke(verify, str(path))
    assert (before.exit_code, before.stdout[:10]) == (1, "different:")
    assert "may be missing" in invoke(info, str(path)).stdout
    found = json.loads(invoke(recover_command, str(path), "--json").stdout)
    assert found["missing"]["samples"][-1]["before_index"] is None
    target = Path(found["path"])
    last = found["missing"]["samples"][-1]["after_index"]
    said = f"samples after index {last} ({found['missing']['samples'][-1]['after_s']:.3f} s) may be missing"
    information, after = invoke(info, str(target)).stdout, invoke(verify, str(target)).stdout
    assert said in information
    assert "at least 0 samples in 1 gap" in information
    assert said in after
    assert after.splitlines()[0] != "identical"
    assert recover(target).missing == summarise(target).missing


@pytest.mark.fault(59, how="salt or checksum of a frame of the log flipped", times=6)
@pytest.mark.parametrize("at", [8, 16], ids=["salt", "checksum"])
def test_header_of_a_frame_that_ends_the_log_for_sqlite_is_damage(killed: Killed, tmp_path: Path, at: int) -> None:
    """Its page is intact, as the next frame proves: all is read, and the log is kept."""
    recovery = check(killed, tmp_path, killed.database, flipped(killed.log, 32 + 5 * FRAME + at, random.Random(1)))
    assert recovery is not None
    assert (recovery.status, recovery.samples) == ("salvaged", len(killed.samples))
    assert recovery.damaged == ("frame 6 of the log cannot be verified",)


@pytest.fixture(scope="module")
def others_log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The log of another recording of the same board."""
    folder, source = tmp_path_factory.mktemp("other"), Source()
    recorder = begin(folder / "run.boat", source)
    for _ in range(5):
        recorder(source.next(330_000))
        assert recorder.flush()
    log = (folder / "run.boat-wal").read_bytes()
    recorder.close(RunEnd.STOPPED)
    return log


def said_by_every_reader(path: Path) -> bool:
    """Whether each reader says that samples may be missing, or names the remedy."""
    results = [invoke(info, str(path)), invoke(verify, str(path))]
    try:
        said = list(missing_of(read_boat_file(path).meta).lines())
    except (RecordingError, FileError) as error:
        said = [str(error)]
        assert error.command == f"boat-daq recover {path}" or "may be missing" in str(error)
    assert said
    assert "locking" not in f"{said} {[result.exception for result in results]}"  # SQLite's word for a log that is none
    shown = results[0].stdout
    assert "may be missing" in shown or results[0].exit_code
    assert not shown or "at least 0 samples in 1 gap" in shown
    return "may be missing" in results[1].stdout or results[1].exit_code == 1


KINDS = ["foreign", "foreign and damaged", "absent", "header", "short", "random"]


@pytest.mark.fault(
    59, how="the log of a killed recording cut, absent, random, or another's; with and without -shm", times=36
)
@pytest.mark.parametrize("shared", [True, False], ids=["with -shm", "without"])
@pytest.mark.parametrize("kind", KINDS)
def test_log_that_is_not_whole_is_never_said_to_be(
    killed: Killed, others_log: bytes, tmp_path: Path, kind: str, shared: bool
) -> None:
    """The -shm says which log was written, and how much of it; without one the end stays unknown."""
    sound = read_log(left(tmp_path, killed.database, killed.log))
    assert sound is not None
    cut = killed.log[: 32 + len(sound.frames) // 2 * FRAME + 777]
    noise = random.Random(1).randbytes(len(killed.log))
    logs = [others_log, zeroed(others_log, 32 + 4 * FRAME, FRAME), b"", killed.log[:32], cut, noise]
    log = dict(zip(KINDS, logs, strict=True))[kind]
    path = left(tmp_path, killed.database, log, killed.shared if shared else b"")
    if not log:
        path.with_name("run.boat-wal").unlink()
    assert said_by_every_reader(path)  # and reading leaves the -shm as it is
    recovery = recover(path)
    proven = shared or kind.startswith("foreign")
    without = {"header": "absent", "short": "unproven", "random": "absent"}
    state = dict.fromkeys(without, "short") if shared else without
    assert recovery.log == state.get(kind, kind.partition(" ")[0])
    with closing(open_recording(recovery.path)) as db:
        blobs = [blob for (blob,) in db.execute("SELECT samples FROM block ORDER BY id")]
    stored = np.frombuffer(b"".join(blobs), killed.samples.dtype)
    assert stored.tobytes() == killed.samples[: len(stored)].tobytes()
    assert len(stored) < len(killed.samples)
    (hole,) = recovery.missing.samples
    assert (hole.after_index, hole.before_index) == (int(stored["index"][-1]) if len(stored) else None, None)
    assert summarise(recovery.path).missing == recovery.missing
    if proven:
        assert recovery.status == "salvaged"
        assert f"{path.name}-wal" in recovery.damaged[0]
        assert not log or path.with_name("run.boat-wal").read_bytes() == log
    if recovery.kept:
        assert recovery.kept[0].read_bytes() == killed.database
    else:
        assert recovery.log == "unproven"
    if shared and kind != "absent":
        path.with_name("run.boat-wal").write_bytes(killed.log)  # found, and put beside the file: all is there
        assert recover(path).samples == len(killed.samples)


@pytest.mark.fault(59, how="random bytes, or the log of another, beside a closed recording", times=3)
def test_log_beside_a_closed_recording_is_not_read(others_log: bytes, tmp_path: Path) -> None:
    """It has none, as every reader says; recovery changes neither."""
    content = EXAMPLE.read_bytes()
    for log in (random.Random(1).randbytes(3 * FRAME), bytes(40), others_log):
        path = left(tmp_path, content, log)
        for command in (info, info, verify):  # SQLite leaves a -shm beside a log that it reads
            shown = invoke(command, str(path)).stdout
            assert ("17018 in 170.17 s" if command is info else "run.boat-wal does not belong to run.boat") in shown
        assert read_boat_file(path).time_s.size == 17018
        recovery = recover(path)
        assert (recovery.status, recovery.samples, len(recovery.damaged)) == ("closed", 17018, 1)
        assert "none is needed" in recovery.damaged[0]
        assert (path.read_bytes(), path.with_name("run.boat-wal").read_bytes()) == (content, log)


@pytest.fixture(scope="module")
def clock_back(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A closed recording of a board whose clock goes back in the middle of the third of five chunks."""
    source, path = Source("clock_back@0.9:0.5"), tmp_path_factory.mktemp("clock") / "run.boat"
    recorder = begin(path, source)
    for _ in range(5):
        recorder(source.next(330_000))
        assert recorder.flush()
    recorder.close(RunEnd.STOPPED)
    return path


@pytest.mark.fault(59, how="the first and every second block of two recordings with a wrong checksum", times=2)
@pytest.mark.parametrize("name", ["example", "clock_back"])
def test_derived_samples_are_neither_doubled_nor_of_another_segment(
    tmp_path: Path, request: pytest.FixtureRequest, name: str
) -> None:
    """The last chunk of the example holds samples, the answer to VENT, and samples again; segment 1 holds none.

    In the other recording, segment 2 begins within a chunk, of which both blocks are lost.
    """
    recording = EXAMPLE if name == "example" else request.getfixturevalue(name)
    whole = stored_samples(recording)
    path = left(tmp_path, recording.read_bytes(), b"")
    with closing(sqlite3.connect(path)) as db, db:
        segments = db.execute("SELECT segment, sum(n) FROM block GROUP BY segment").fetchall()
        lost = "last_chunk = 3" if name == "clock_back" else "id % 2 = 0 OR id = 1"
        db.execute(f"UPDATE block SET crc32 = crc32 + 1 WHERE {lost}")
    assert (len(segments), len(whole) > 0) == (2 if name == "clock_back" else 1, True)
    recovery = recover(path)
    assert (recovery.status, bool(recovery.missing)) == ("salvaged", False)
    assert stored_samples(recovery.path) == whole
    with closing(open_recording(recovery.path)) as db:
        assert db.execute("SELECT segment, sum(n) FROM block GROUP BY segment").fetchall() == segments
    assert verify_recording(recovery.path).identical


@pytest.mark.fault(59, how="the first chunk, the last, a middle one and all blocks of a recording damaged", times=5)
@pytest.mark.parametrize(
    ("chunks", "blocks", "holes"),
    [
        ("3", "none", []),  # where a segment begins: its samples are kept
        ("1", "1", [(1, None, 34, None)]),
        ("3", "3", [(2, 66, 100, None)]),
        ("5", "5", [(2, 132, None, None)]),
        ("none", "1, 2, 3, 4, 5", []),
    ],
)
def test_holes_are_named_by_the_samples_beside_them(
    clock_back: Path, tmp_path: Path, chunks: str, blocks: str, holes: list[tuple[int | None, ...]]
) -> None:
    """Segment, index before and behind, and how many; each with the board's time of its sample."""
    path = left(tmp_path, clock_back.read_bytes(), b"")
    with closing(sqlite3.connect(path)) as db, db:
        whole = np.frombuffer(stored_samples(path), session_dtype(read_session(db)))
        db.execute(f"UPDATE chunk SET crc32 = crc32 + 1 WHERE id IN ({chunks})".replace("none", ""))
        db.execute(f"UPDATE block SET crc32 = crc32 + 1 WHERE last_chunk IN ({blocks})".replace("none", ""))
    found = recover(path).missing.samples
    assert [(hole.segment, hole.after_index, hole.before_index, hole.samples) for hole in found] == holes
    time_s = dict(zip(whole["index"].tolist(), (whole["time_us"] / 1e6).tolist(), strict=True))
    assert [(hole.after_s, hole.before_s) for hole in found] == [
        (time_s.get(after), time_s.get(before)) for _, after, before, _ in holes
    ]


def test_log_that_begins_again_or_was_not_written_yet_is_no_damage(tmp_path: Path) -> None:
    """Killed before the first sample, at a restart of the log, and without power, which leaves an older -shm."""
    folder, source = tmp_path / "run", Source()
    folder.mkdir()
    recorder = begin(folder / "run.boat", source)

    def now(name: str) -> bytes:
        return (folder / name).read_bytes()

    states = [[now("run.boat"), now("run.boat-wal"), now("run.boat-shm")]]
    counts = [0]
    for _ in range(3):
        recorder(source.next(330_000))
        assert recorder.flush()
    older = now("run.boat-shm")
    recorder._file._connection.execute("PRAGMA wal_checkpoint(RESTART)")
    states.append([now("run.boat"), now("run.boat-wal"), now("run.boat-shm")])
    counts.append(sum(map(len, source.samples)))
    recorder(source.next(330_000))
    assert recorder.flush()
    states.append([now("run.boat"), now("run.boat-wal"), older])
    counts.append(sum(map(len, source.samples)))
    recorder.close(RunEnd.STOPPED)
    (tmp_path / "left").mkdir()
    found = [recover(left(tmp_path / "left", *state)) for state in states]
    assert [(one.status, one.damaged, one.samples) for one in found] == [("recovered", (), count) for count in counts]
    assert [(one.log, bool(one.missing)) for one in found] == [("whole", False), ("whole", False), ("unproven", True)]


def test_frame_that_a_killed_program_had_begun_is_no_damage(killed: Killed, tmp_path: Path) -> None:
    """It writes header and page by themselves: over an older frame, the older page stays."""
    sound = read_log(left(tmp_path, killed.database, killed.log))
    assert sound is not None
    end = 32 + len(sound.frames) * FRAME
    header = killed.log[end - FRAME :][:4] + bytes(4) + killed.log[16:24] + bytes(range(8))
    log = killed.log[:end] + header + bytes(range(256)) * 16 + killed.log[end + FRAME :]
    path = left(tmp_path, killed.database, log)
    recovery = recover(path)
    assert (recovery.status, recovery.damaged, recovery.samples) == ("recovered", (), len(killed.samples))
    assert verify_recording(path).identical


@pytest.mark.fault(59, how="a damaged log before something is added to the recording", times=1)
def test_nothing_opens_a_damaged_log_for_writing(killed: Killed, tmp_path: Path) -> None:
    """SQLite would keep what is before the damage and remove the rest."""
    log = flipped(killed.log, 32 + 2 * FRAME + 100, random.Random(1))
    path = left(tmp_path, killed.database, log)
    with pytest.raises(StorageError, match="damaged log"):
        RecordingFile.reopen(path)
    assert path.with_name("run.boat-wal").read_bytes() == log


def test_log_stays_until_the_file_alone_is_sound(killed: Killed, tmp_path: Path) -> None:
    """A page that is written wrongly by the checkpoint, on a bad disk: the log, which is sound, is not removed."""
    path = left(tmp_path, killed.database, killed.log)
    file = RecordingFile.reopen(path)
    assert file._check() == ""
    content = path.read_bytes()
    path.write_bytes(content[: 2 * PAGE] + bytes(PAGE) + content[3 * PAGE :])
    with pytest.raises(StorageError, match="is damaged"):
        file.close()
    assert path.with_name("run.boat-wal").read_bytes()[: len(killed.log)] == killed.log


def test_sound_log_is_read_like_sqlite_does(killed: Killed, tmp_path: Path) -> None:
    """Every frame is verified, and the pages are those that SQLite makes of it."""
    path = left(tmp_path, killed.database, killed.log)
    log = read_log(path)
    assert log is not None
    assert log.damage == []
    assert log.committed() == len(log.frames)
    database = np.frombuffer(killed.database, np.uint8).reshape(-1, PAGE)
    pages = {number + 1: page.tobytes() for number, page in enumerate(database)}
    pages |= {page: log.image(frame) for page, frame in log.newest(database).items()}
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    merged = path.read_bytes()
    assert len(merged) == PAGE * len(pages)
    assert all(merged[(n - 1) * PAGE :][:PAGE] == page for n, page in pages.items())
