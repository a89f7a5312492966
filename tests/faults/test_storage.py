"""Faults of disks and folders, on a real small disk and a real pseudo-terminal."""

from __future__ import annotations

import dataclasses
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest

from boat_daq.engine.recording import file as recording_file
from boat_daq.engine.recording.closed_run import append_reading
from boat_daq.engine.recording.file import RecordingFile, check_space
from boat_daq.engine.recording.recovery import recover
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.snapshot import SessionState
from protocol.base.errors import RecordingError, StorageError
from protocol.recording import RunEnd, open_recording
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import Source, begin, reading
from tests.faults.drill import OVER, ROOT, SHORT, drill, needs_pty
from tests.faults.nightly_counts import few_and_many
from tests.faults.old_recordings import write_recording
from tests.outside_writes import MOUNTER, Mounter

LONG = dataclasses.replace(SHORT, cycles=40)
needs_tmpfs = pytest.mark.skipif(
    sys.platform != "linux" or getattr(os, "geteuid", lambda: 1)() != 0, reason="a small tmpfs needs root on Linux"
)


@pytest.fixture
def mounter(pytestconfig: pytest.Config) -> Mounter:
    """What can mount and unmount."""
    return pytestconfig.stash[MOUNTER]


@contextmanager
def small_disk(mounter: Mounter, folder: Path, megabytes: int) -> Iterator[Path]:
    """Mount a file system of that size; skip the test where mounting is refused."""
    place = folder / "disk"
    place.mkdir()
    code, text = mounter.run("mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(place))
    if code:
        pytest.skip(f"no tmpfs can be mounted here: {text}")
    try:
        yield place
    finally:
        assert mounter.run("umount", "--lazy", str(place))[0] == 0


def fill(place: Path, leave_bytes: int) -> None:
    """Fill the disk but for so many bytes."""
    size = shutil.disk_usage(place).free - leave_bytes
    with suppress(OSError), (place / "filler").open("wb", buffering=0) as file:  # the recorder takes space as well
        for _ in range(0, size, 4096):
            file.write(bytes(4096))


# ---- a full disk -----------------------------------------------------------------------------------------------------


@needs_pty
@needs_tmpfs
@pytest.mark.fault(28, how="a tmpfs of 64 MB filled up in a run under pressure, over a pty", times=1)
def test_full_disk_stops_the_run(mounter: Mounter, tmp_path: Path) -> None:
    """The run is aborted and vented with a message; what was written opens and is identical to its bytes."""
    with small_disk(mounter, tmp_path, 64) as place:
        with drill(tmp_path, home=place) as found:
            found.start(LONG)
            found.reached(lambda s: s.recorded_s > 10 and s.last is not None and abs(s.last.pressure_kpa) > 5)
            fill(place, 0)
            seen = found.reached(lambda s: s.state in OVER, 30)
            assert seen.state is not SessionState.IDLE
            found.reached(lambda _: found.vented(), 10)
            causes = [message.cause for message in found.session.snapshot().messages]
            assert any("full" in cause for cause in causes), causes
        shutil.copytree(place, tmp_path / "copy", ignore=shutil.ignore_patterns("filler", "*lock"))
    (left,) = (tmp_path / "copy").glob("*.boat")
    recovery = recover(left)
    assert recovery.damaged == ()
    assert recovery.samples > 500
    assert verify_recording(left).identical


@needs_tmpfs
@pytest.mark.parametrize("instants", few_and_many(28, "a tmpfs filled at random instants while it is written", 3, 60))
def test_disk_full_at_any_instant_loses_no_acknowledged_sample(
    mounter: Mounter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, instants: int
) -> None:
    """At any instant: one error, acknowledged samples are stored, the others as soon as space is free again."""
    monkeypatch.setattr(recording_file, "SPACE_FLOOR_BYTES", 0)
    rng = random.Random(instants)
    with small_disk(mounter, tmp_path, 8) as place:
        for number in range(instants):
            source, errors = Source(), []
            path = place / f"{number}.boat"
            recorder = begin(path, source, on_error=errors.append)
            free_bytes = rng.randrange(20_000, 120_000)
            fill(place, free_bytes)
            deadline = time.monotonic() + 20
            while not errors and time.monotonic() < deadline:
                recorder(source.next(400_000))
                time.sleep(0.01)
            assert errors
            assert all("full" in error.cause for error in errors)
            acknowledged = recorder.acknowledged.samples
            with suppress(RecordingError), closing(open_recording(path)) as db:  # a reader of a log needs space as well
                assert db.execute("SELECT coalesce(sum(n), 0) FROM block").fetchone()[0] >= acknowledged
            (place / "filler").unlink()
            assert recorder.flush(10.0)
            recorder.close(RunEnd.FINISHED)
            assert verify_recording(path).samples == sum(map(len, source.samples))
            path.unlink()


# ---- folders and names -----------------------------------------------------------------------------------------------


@needs_pty
@pytest.mark.fault(29, how="the folder removed in a run under pressure, over a pty", times=1)
def test_removed_folder_ends_the_run(tmp_path: Path) -> None:
    """Within seconds the run is aborted and vented, with a message."""
    place = tmp_path / "gone"
    place.mkdir()
    with drill(tmp_path, home=place) as found:
        found.start(LONG)
        found.reached(lambda s: s.last is not None and abs(s.last.pressure_kpa) > 5)
        shutil.rmtree(place)
        seen = found.reached(lambda s: s.state in OVER, 30)
        assert seen.state is not SessionState.IDLE
        found.reached(lambda _: found.vented(), 10)
        causes = [message.cause for message in found.session.snapshot().messages]
        assert any("moved or removed" in cause or "cannot be written" in cause for cause in causes), causes


@needs_tmpfs
@pytest.mark.fault(29, how="a tmpfs that is read-only: a recording begun, read and recovered there", times=3)
def test_read_only_disk_is_read_and_not_written(mounter: Mounter, tmp_path: Path) -> None:
    """No recording is begun there; those on it can be read, and are not recovered in place."""
    with small_disk(mounter, tmp_path, 8) as place:
        path = write_recording(place / "run.boat")
        samples = summarise(path).samples
        assert mounter.run("mount", "-o", "remount,ro", str(place))[0] == 0
        with pytest.raises(StorageError, match="cannot write in"):
            RecordingFile.create(place / "second.boat", meta_of(Source().link))
        with pytest.raises(StorageError, match="cannot be written"):
            check_space(place, rate_hz=100, duration_s=1, n_sensors=2)
        assert summarise(path).samples == samples
        assert verify_recording(path).identical
        assert recover(path).status == "closed"
        with pytest.raises(StorageError, match="cannot write in"):
            append_reading(path, reading(1, 2.0))


@pytest.mark.fault(36, how="`record` into 0-byte, directory and existing names, by `RecordingFile.create`", times=2)
def test_existing_names_are_not_overwritten(tmp_path: Path) -> None:
    """A 0-byte file and a folder of that name are never overwritten."""
    meta = meta_of(Source().link)
    (tmp_path / "empty.boat").touch()
    (tmp_path / "folder.boat").mkdir()
    for name in ("empty.boat", "folder.boat"):
        with pytest.raises(Exception, match="exists already") as refusal:
            RecordingFile.create(tmp_path / name, meta)
        assert refusal.value.remedy  # type: ignore[attr-defined]
    assert (tmp_path / "empty.boat").read_bytes() == b""
    with pytest.raises(RecordingError, match="0 bytes"):
        open_recording(tmp_path / "empty.boat")
    assert not list(tmp_path.glob("*lock"))


# ---- two programs ----------------------------------------------------------------------------------------------------


@pytest.mark.fault(33, how="`recover` and `info` by a second process on a recording under way", times=2)
def test_second_program_only_reads(tmp_path: Path) -> None:
    """It may read and is refused writing; the first program continues."""
    source = Source()
    path = tmp_path / "run.boat"
    recorder = begin(path, source)
    recorder(source.next(500_000))
    assert recorder.flush()
    code = (
        "import sys; from pathlib import Path; from boat_daq.engine.recording.summary import summarise;"
        "from boat_daq.engine.recording.recovery import recover; "
        "p = Path(sys.argv[1]); print(summarise(p).status); recover(p)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "recording\n"
    assert "being written by another program" in done.stderr
    recorder(source.next(500_000))
    recorder.close(RunEnd.FINISHED)
    assert verify_recording(path).identical
    assert summarise(path).samples > 90
