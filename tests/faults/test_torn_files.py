"""Torn copies and flipped bits: salvaged or refused with a cause, never read in part without an error."""

from __future__ import annotations

import random
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from analysis.data.boat_file import read_boat_file
from boat_daq.engine.recording.recovery import Recovery, recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RecordingError, StorageError
from protocol.recording import RunEnd, open_recording
from tests.boat_daq.engine.recording_source import Source, begin
from tests.faults.nightly_counts import few_and_many
from tests.faults.old_recordings import write_recording

PAGE = 4096


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a closed recording of some dozen pages."""
    return write_recording(tmp_path_factory.mktemp("whole") / "run.boat", blocks=8)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes]:
    """Return the contents of a recording in progress: the file and its log."""
    folder = tmp_path_factory.mktemp("pair")
    source = Source()
    recorder = begin(folder / "run.boat", source)
    for _ in range(8):
        recorder(source.next(200_000))
        assert recorder.flush()
    content = (folder / "run.boat").read_bytes(), (folder / "run.boat-wal").read_bytes()
    recorder.close(RunEnd.STOPPED)
    return content


def torn(folder: Path, main: bytes, log: bytes | None) -> Recovery | None:
    """Recover a torn copy: return None where it is refused with a cause, else the recovery after checking the file."""
    for left in folder.iterdir():
        left.unlink()
    path = folder / "run.boat"
    path.write_bytes(main)
    if log is not None:
        path.with_name("run.boat-wal").write_bytes(log)
    try:
        recovery = recover(path)
    except (RecordingError, StorageError) as refusal:
        assert refusal.cause
        return None
    with closing(open_recording(recovery.path)) as db:
        assert db.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert db.execute("SELECT coalesce(sum(n), 0) FROM block").fetchone()[0] == recovery.samples
    if recovery.status == "salvaged":
        assert recovery.damaged
        assert path.read_bytes() == main
    return recovery


@pytest.mark.fault(31, how="a copy cut off at every page boundary of the closed file", times=16)
def test_copy_torn_at_any_page_is_recovered_or_refused(whole: Path, tmp_path: Path) -> None:
    """Each is recovered as far as it can be read, or refused with a cause; the whole file gives most."""
    content = whole.read_bytes()
    got = [torn(tmp_path, content[:end], None) for end in range(0, len(content) + 1, PAGE)]
    samples = [0 if recovery is None else recovery.samples for recovery in got]
    assert got[-1] is not None
    assert got[-1].damaged == ()
    assert max(samples) == samples[-1] == summarise(whole).samples
    assert len(got) > 10


@pytest.mark.fault(31, how="a copy of a recording under way, its log cut at every page of it", times=25)
def test_torn_log_gives_the_last_complete_commit(pair: tuple[bytes, bytes], tmp_path: Path) -> None:
    """The log's frames are 24 bytes longer than a page: each cut gives the last complete commit before it."""
    main, log = pair
    samples = []
    for end in [*range(32, len(log) + 1, PAGE + 24), len(log)]:
        recovery = torn(tmp_path, main, log[:end])
        assert recovery is not None
        assert recovery.damaged == ()
        samples.append(recovery.samples)
    assert samples == sorted(samples)
    assert samples[0] == 0
    assert samples[-1] > 100
    assert len(samples) > 20


@pytest.mark.fault(31, how="a copy without its log, and a log without its file", times=2)
def test_file_and_log_without_each_other(pair: tuple[bytes, bytes], tmp_path: Path) -> None:
    """The file without its log has no samples yet; the log without its file is refused."""
    main, log = pair
    recovery = torn(tmp_path, main, None)
    assert recovery is None or recovery.samples == 0
    (tmp_path / "run.boat").unlink()
    (tmp_path / "run.boat-wal").write_bytes(log)
    with pytest.raises(RecordingError, match="no file"):
        recover(tmp_path / "run.boat")


@pytest.mark.parametrize("cuts", few_and_many(31, "the last two pages cut at so many of their 8,192 bytes", 12, 8192))
def test_last_pages_cut_at_any_byte_are_salvaged_or_refused(whole: Path, tmp_path: Path, cuts: int) -> None:
    """Salvaged with the damage named, or refused with a cause."""
    content = whole.read_bytes()
    for end in np.linspace(len(content) - 2 * PAGE, len(content), cuts, endpoint=False, dtype=int):
        recovery = torn(tmp_path, content[:end], None)
        assert recovery is None or recovery.damaged


@pytest.mark.parametrize("flips", few_and_many(32, "one bit flipped anywhere in a closed file", 40, 2000))
def test_flipped_bit_is_found_or_changes_no_sample(whole: Path, tmp_path: Path, flips: int) -> None:
    """Found by `recover` or `verify`, or in unused space: then every sample is what it was."""
    content, rng = whole.read_bytes(), random.Random(flips)
    truth = read_boat_file(whole)
    found = 0
    for _ in range(flips):
        rotten = bytearray(content)
        rotten[rng.randrange(len(rotten))] ^= 1 << rng.randrange(8)
        recovery = torn(tmp_path, bytes(rotten), None)
        if recovery is None or recovery.damaged:
            found += 1
            continue
        if not verify_recording(recovery.path).identical:
            found += 1
            continue
        again = read_boat_file(recovery.path)
        assert (again.signal_mv == truth.signal_mv).all()
        assert (again.time_s == truth.time_s).all()
    assert 0 < found < flips
