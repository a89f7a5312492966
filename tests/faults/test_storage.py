"""Faults of disks, files and clocks, on real files, a real small disk, and a real pseudo-terminal."""

from __future__ import annotations

import dataclasses
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from analysis.boat_file import read_boat_file
from boat_daq.engine import recording_file
from boat_daq.engine.disk_space import check_space
from boat_daq.engine.offline import append_reading
from boat_daq.engine.recorder import Recorder
from boat_daq.engine.recording_file import RecordingFile, Statement
from boat_daq.engine.recovery import Recovery, recover
from boat_daq.engine.settings import Settings, UnitLibrary, load_settings
from boat_daq.engine.snapshot import SessionState
from boat_daq.engine.summary import summarise
from boat_daq.engine.verify import verify_recording
from boat_daq.errors import StorageError
from protocol.errors import RecordingError
from protocol.recording import open_recording, read_session, sample_dtype
from tests.boat_daq.board_link import meta_of
from tests.boat_daq.test_recorder import Source
from tests.faults.drill import OVER, ROOT, SHORT, drill, needs_pty
from tests.faults.old_recordings import write_recording

PAGE = 4096
LONG = dataclasses.replace(SHORT, cycles=40)
needs_tmpfs = pytest.mark.skipif(
    sys.platform != "linux" or getattr(os, "geteuid", lambda: 1)() != 0, reason="a small tmpfs needs root on Linux"
)


@contextmanager
def small_disk(folder: Path, megabytes: int) -> Iterator[Path]:
    """A file system of that size; the test is skipped where mounting is refused."""
    place = folder / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={megabytes}m", "tmpfs", str(place)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no tmpfs can be mounted here: {done.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


def fill(place: Path, leave_bytes: int) -> None:
    """Take up the disk's room but for so much."""
    size = shutil.disk_usage(place).free - leave_bytes
    with suppress(OSError), (place / "filler").open("wb", buffering=0) as file:  # the recorder takes room as well
        for _ in range(0, size, 4096):
            file.write(bytes(4096))


# ---- a full disk ---------------------------------------------------------------------------------------------------


@needs_pty
@needs_tmpfs
@pytest.mark.fault(28, how="a tmpfs of 64 MB filled up in a run under pressure, over a pty", times=1)
def test_a_disk_that_fills_up_stops_the_run(tmp_path: Path) -> None:
    """The run is aborted and vented, the reason said; what was written opens and is identical to its bytes."""
    with small_disk(tmp_path, 64) as place:
        with drill(tmp_path, home=place) as found:
            found.start(LONG)
            found.wait(lambda s: s.recorded_s > 10 and s.last is not None and abs(s.last.pressure_kpa) > 5)
            fill(place, 0)
            seen = found.wait(lambda s: s.state in OVER, 30)
            assert seen.state is not SessionState.IDLE
            found.wait(lambda _: found.vented(), 10)
            told = [message.cause for message in found.session.snapshot().messages]
            assert any("full" in cause for cause in told), told
        shutil.copytree(place, tmp_path / "copy", ignore=shutil.ignore_patterns("filler", "*lock"))
    (left,) = (tmp_path / "copy").glob("*.boat")
    recovery = recover(left)
    assert recovery.damaged == ()
    assert recovery.samples > 500
    assert verify_recording(left).identical


@needs_tmpfs
@pytest.mark.parametrize(
    "instants",
    [
        pytest.param(
            3, marks=pytest.mark.fault(28, how="a tmpfs filled at random instants while it is written", times=3)
        ),
        pytest.param(
            60,
            marks=[
                pytest.mark.nightly,
                pytest.mark.timeout(1800),
                pytest.mark.fault(28, how="a tmpfs filled at random instants while it is written", times=60),
            ],
        ),
    ],
)
def test_a_disk_full_at_any_instant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, instants: int) -> None:
    """Whenever the last byte is gone: told once, what was acknowledged is there, and the rest once there is room."""
    monkeypatch.setattr(recording_file, "SPACE_FLOOR_BYTES", 0)
    rng = random.Random(instants)
    with small_disk(tmp_path, 8) as place:
        for number in range(instants):
            source, errors = Source(), []
            path = place / f"{number}.boat"
            recorder = Recorder(path, meta_of(source.link), on_error=errors.append)
            recorder.attached(source.link.decoder_state())
            source.samples.clear()
            room = rng.randrange(20_000, 120_000)
            fill(place, room)
            deadline = time.monotonic() + 20
            while not errors and time.monotonic() < deadline:
                recorder(source.next(400_000))
                time.sleep(0.01)
            assert errors
            assert all("full" in error.cause for error in errors)
            acknowledged = recorder.acknowledged.samples
            with suppress(RecordingError), closing(open_recording(path)) as db:  # a reader of a log needs room as well
                assert db.execute("SELECT coalesce(sum(n), 0) FROM block").fetchone()[0] >= acknowledged
            (place / "filler").unlink()
            assert recorder.flush(10.0)
            recorder.close("finished")
            assert verify_recording(path).samples == sum(map(len, source.samples))
            path.unlink()


# ---- folders -------------------------------------------------------------------------------------------------------


@needs_pty
@pytest.mark.fault(29, how="the folder removed in a run under pressure, over a pty", times=1)
def test_a_folder_that_vanishes_ends_the_run(tmp_path: Path) -> None:
    """Noticed within seconds: aborted, vented, said."""
    place = tmp_path / "gone"
    place.mkdir()
    with drill(tmp_path, home=place) as found:
        found.start(LONG)
        found.wait(lambda s: s.last is not None and abs(s.last.pressure_kpa) > 5)
        shutil.rmtree(place)
        seen = found.wait(lambda s: s.state in OVER, 30)
        assert seen.state is not SessionState.IDLE
        found.wait(lambda _: found.vented(), 10)
        told = [message.cause for message in found.session.snapshot().messages]
        assert any("moved or removed" in cause or "cannot be written" in cause for cause in told), told


@needs_tmpfs
@pytest.mark.fault(29, how="a tmpfs that is read-only: a recording begun, read and recovered there", times=3)
def test_a_read_only_disk(tmp_path: Path) -> None:
    """Nothing is begun there; what is on it can be read, and is not recovered in place."""
    with small_disk(tmp_path, 8) as place:
        path = write_recording(place / "run.boat")
        samples = summarise(path).samples
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True, capture_output=True)
        with pytest.raises(StorageError, match="cannot write in"):
            RecordingFile.create(place / "second.boat", meta_of(Source().link))
        with pytest.raises(StorageError, match="cannot be written"):
            check_space(place, rate_hz=100, duration_s=1, n_sensors=2)
        assert summarise(path).samples == samples
        assert verify_recording(path).identical
        assert recover(path).status == "closed"
        with pytest.raises(StorageError, match="cannot write in"):
            append_reading(path, 1, 2.0, source="typed")


# ---- torn copies and bit rot ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A closed recording of some dozen pages."""
    return write_recording(tmp_path_factory.mktemp("whole") / "run.boat", blocks=8)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, bytes]:
    """The two files of a recording under way: the file itself, and its log."""
    folder = tmp_path_factory.mktemp("pair")
    source = Source()
    recorder = Recorder(folder / "run.boat", meta_of(source.link))
    recorder.attached(source.link.decoder_state())
    for _ in range(8):
        recorder(source.next(200_000))
        assert recorder.flush()
    content = (folder / "run.boat").read_bytes(), (folder / "run.boat-wal").read_bytes()
    recorder.close("stopped")
    return content


def torn(folder: Path, main: bytes, log: bytes | None) -> Recovery | None:
    """Recover a torn copy: None where it is refused in words; what comes back is sound and holds what it says."""
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
def test_a_copy_torn_at_every_page_boundary(whole: Path, tmp_path: Path) -> None:
    """Each opens on what can be read, or says what is wrong; more of the file never gives less."""
    content = whole.read_bytes()
    got = [torn(tmp_path, content[:end], None) for end in range(0, len(content) + 1, PAGE)]
    samples = [0 if recovery is None else recovery.samples for recovery in got]
    assert got[-1] is not None
    assert got[-1].damaged == ()
    assert max(samples) == samples[-1] == summarise(whole).samples
    assert len(got) > 10


@pytest.mark.fault(31, how="a copy of a recording under way, its log cut at every page of it", times=25)
def test_a_log_torn_at_every_page_boundary(pair: tuple[bytes, bytes], tmp_path: Path) -> None:
    """The log's frames are 24 bytes longer than a page: each cut opens on the last whole commit before it."""
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
def test_half_a_copy(pair: tuple[bytes, bytes], tmp_path: Path) -> None:
    """The bare file names itself and holds nothing yet; the bare log is nobody's."""
    main, log = pair
    recovery = torn(tmp_path, main, None)
    assert recovery is None or recovery.samples == 0
    (tmp_path / "run.boat").unlink()
    (tmp_path / "run.boat-wal").write_bytes(log)
    with pytest.raises(RecordingError, match="no file"):
        recover(tmp_path / "run.boat")


@pytest.mark.parametrize(
    "step",
    [
        pytest.param(701, marks=pytest.mark.fault(31, how="the last two pages cut at every 701st byte", times=12)),
        pytest.param(
            3,
            marks=[
                pytest.mark.nightly,
                pytest.mark.timeout(1800),
                pytest.mark.fault(31, how="the last two pages cut at every third byte", times=2731),
            ],
        ),
    ],
)
def test_the_last_pages_cut_at_any_byte(whole: Path, tmp_path: Path, step: int) -> None:
    """Salvaged or refused in words, never half believed."""
    content = whole.read_bytes()
    for end in range(len(content) - 2 * PAGE, len(content), step):
        recovery = torn(tmp_path, content[:end], None)
        assert recovery is None or recovery.damaged


@pytest.mark.parametrize(
    "flips",
    [
        pytest.param(40, marks=pytest.mark.fault(32, how="one bit flipped anywhere in a closed file", times=40)),
        pytest.param(
            2000,
            marks=[
                pytest.mark.nightly,
                pytest.mark.timeout(1800),
                pytest.mark.fault(32, how="one bit flipped anywhere in a closed file", times=2000),
            ],
        ),
    ],
)
def test_a_flipped_bit_is_found_or_harms_nothing(whole: Path, tmp_path: Path, flips: int) -> None:
    """Found by recover or verify, or in a place that holds nothing: then every sample is what it was."""
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


# ---- two programs --------------------------------------------------------------------------------------------------


@pytest.mark.fault(33, how="`recover` and `info` by a second process on a recording under way", times=2)
def test_a_second_program_only_reads(tmp_path: Path) -> None:
    """It may look, and is refused to write; the first goes on undisturbed."""
    source = Source()
    path = tmp_path / "run.boat"
    recorder = Recorder(path, meta_of(source.link))
    recorder.attached(source.link.decoder_state())
    recorder(source.next(500_000))
    assert recorder.flush()
    code = (
        "import sys; from pathlib import Path; from boat_daq.engine.summary import summarise;"
        "from boat_daq.engine.recovery import recover; p = Path(sys.argv[1]); print(summarise(p).status); recover(p)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, cwd=ROOT)
    assert done.stdout == "recording\n"
    assert "being written by another program" in done.stderr
    recorder(source.next(500_000))
    recorder.close("finished")
    assert verify_recording(path).identical
    assert summarise(path).samples > 90


# ---- clocks --------------------------------------------------------------------------------------------------------


class JumpingClock(datetime):
    """A wall clock that somebody sets while the program runs."""

    jump = timedelta(0)

    @classmethod
    def now(cls, tz: object = None) -> datetime:  # type: ignore[override]
        return datetime.now(tz) + cls.jump  # type: ignore[arg-type]


@pytest.mark.fault(34, how="the wall clock set 3 h back, an hour on, and to 1970, while it is recorded", times=3)
@pytest.mark.parametrize("jump_h", [-3.0, 1.0, -495_000.0])
def test_a_clock_that_jumps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jump_h: float) -> None:
    """Durations, sample times and their order are those of the monotonic clock and the board; UTC has its offset."""
    monkeypatch.setattr(recording_file, "datetime", JumpingClock)
    monkeypatch.setattr(JumpingClock, "jump", timedelta(0))
    source = Source()
    path = tmp_path / "run.boat"
    recorder = Recorder(path, meta_of(source.link))
    recorder.attached(source.link.decoder_state())
    recorder(source.next(500_000))
    assert recorder.flush()
    monkeypatch.setattr(JumpingClock, "jump", timedelta(hours=jump_h))
    recorder.reading(1, 1.0, source="typed")
    recorder(source.next(500_000))
    recorder.close("finished")
    with closing(open_recording(path)) as db:
        meta = read_session(db)
        hosts = [host for (host,) in db.execute("SELECT host_ns FROM chunk ORDER BY id")]
    assert hosts == sorted(hosts)
    assert 0 <= meta["ended_host_ns"] - meta["started_host_ns"] < 60e9
    for key in ("started_utc", "ended_utc"):
        assert datetime.fromisoformat(meta[key]).utcoffset() is not None
    assert datetime.fromisoformat(meta["ended_utc"]).year == (1970 if jump_h < -1000 else datetime.now().year)
    assert summarise(path).duration_s == pytest.approx(1.0, abs=0.05)
    assert (np.diff(read_boat_file(path).time_s) > 0).all()
    assert verify_recording(path).identical


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="the zone cannot be set here")
@pytest.mark.fault(34, how="a time zone with daylight saving, before and after its change", times=2)
@pytest.mark.parametrize(("zone", "offset_h"), [("AAA-1BBB,J1,J365", 2), ("AAA-1", 1)])
def test_the_offset_stands_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zone: str, offset_h: int
) -> None:
    """The same instant, named with the offset that was in force."""
    monkeypatch.setenv("TZ", zone)
    time.tzset()
    try:
        before = datetime.now().astimezone()
        path = write_recording(tmp_path / "run.boat", blocks=1)
    finally:
        monkeypatch.undo()
        time.tzset()
    with closing(open_recording(path)) as db:
        started = datetime.fromisoformat(read_session(db)["started_utc"])
    assert started.utcoffset() == timedelta(hours=offset_h)
    assert timedelta(0) <= started - before + timedelta(seconds=1) < timedelta(minutes=2)


# ---- a day ---------------------------------------------------------------------------------------------------------

LOOK = """
import resource, sys
from pathlib import Path
from analysis.overview import load_overview
from boat_daq.engine.summary import summarise
limit = 1 << 30
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
path = Path(sys.argv[1])
print(summarise(path).samples, load_overview(path).samples)
"""


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS is Linux's")
@pytest.mark.fault(35, how="a day of 8.64 million samples, summed up in 1 GB of address space", times=1)
def test_a_day_is_summed_up_in_bounded_memory(tmp_path: Path) -> None:
    """Every sample of the day is counted, from the overview, without its samples in memory."""
    from boat_daq.engine.recording_rows import Overview

    path = tmp_path / "day.boat"
    dtype = sample_dtype(2)
    meta = {"simulated": True, "n_sensors": 2, "sample_kind": "counts", "vref_mv": 3300, "adc_bits": 12, "rate_hz": 100}
    file = RecordingFile.create(path, meta)
    file.commit([("INSERT INTO segment VALUES (1, 0, 1, 'opened', 0, NULL)", ())])
    overview = Overview(3300 / 4096)
    statements: list[Statement] = []
    for block in range(86_400):
        samples = np.zeros(100, dtype)
        samples["index"] = np.arange(100) + 100 * block
        samples["time_us"] = samples["index"].astype(np.int64) * 10_000
        row = (block + 1, 1, 0, 100, int(samples["time_us"][0]), int(samples["time_us"][-1]), samples.tobytes(), None)
        statements += [("INSERT INTO block VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row), *overview.add(block + 1, 1, samples)]
        if len(statements) > 5_000:
            file.commit(statements)
            statements = []
    file.commit([*statements, *overview.finish()])
    file.close(check=False)
    done = subprocess.run([sys.executable, "-c", LOOK, str(path)], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["8640000", "8640000"]


# ---- settings and units --------------------------------------------------------------------------------------------

SAVES = """
import dataclasses, sys
from pathlib import Path
from boat_daq.engine.settings import Settings, UnitLibrary, save_settings
folder = Path(sys.argv[1])
library = UnitLibrary(folder / "units")
print("go", flush=True)
for number in range(1, 10**9):
    save_settings(Settings(operator=f"{number} " + "x" * 5000), folder)
    library.add_calibration("SA1", {"number": number, "filler": "y" * 3000})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
@pytest.mark.parametrize(
    "times",
    [
        pytest.param(
            3, marks=pytest.mark.fault(30, how="settings and units killed with -9 while they are saved", times=3)
        ),
        pytest.param(
            100,
            marks=[
                pytest.mark.nightly,
                pytest.mark.timeout(1800),
                pytest.mark.fault(30, how="settings and units killed with -9 while they are saved", times=100),
            ],
        ),
    ],
)
def test_settings_and_units_survive_a_kill(tmp_path: Path, times: int) -> None:
    """Always a whole file and a whole backup; no calibration that was stored is ever missing."""
    rng = random.Random(times)
    most = 0
    for number in range(times):
        folder = tmp_path / str(number)
        with subprocess.Popen([sys.executable, "-c", SAVES, str(folder)], stdout=subprocess.PIPE, cwd=ROOT) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"go\n"
            time.sleep(rng.uniform(0.02, 0.3))
            process.send_signal(signal.SIGKILL)
        for backup in folder.rglob("*.bak"):
            if not backup.with_suffix("").exists():
                pytest.fail("a backup without its file")
        saved = load_settings(folder)
        history = UnitLibrary(folder / "units").load("SA1").history
        assert [entry.content["number"] for entry in history] == list(range(1, len(history) + 1))
        assert saved == Settings() or int(saved.operator.split()[0]) in (len(history), len(history) + 1)
        if (folder / "settings.toml.bak").exists():
            shutil.copy(folder / "settings.toml.bak", folder / "settings.toml")
            assert load_settings(folder).operator.endswith("x")
        most = max(most, len(history))
    assert most > 0


@pytest.mark.fault(36, how="`record` into 0-byte, directory and existing names, by the recording's own door", times=2)
def test_names_that_are_taken(tmp_path: Path) -> None:
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
