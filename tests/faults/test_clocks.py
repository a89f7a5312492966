"""Wall clocks that jump, time zones that change, and a recording of a day in bounded memory."""

from __future__ import annotations

import subprocess
import sys
import time
from contextlib import closing
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from analysis.data.boat_file import read_boat_file
from boat_daq.engine.recording import file as recording_file
from boat_daq.engine.recording.file import RecordingFile, Statement
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.recording import RunEnd, open_recording, read_session, sample_dtype
from tests.boat_daq.engine.recording_source import Source, begin, reading
from tests.faults.drill import ROOT
from tests.faults.old_recordings import write_recording


class JumpingClock(datetime):
    """A wall clock that is set while the program runs."""

    jump = timedelta(0)

    @classmethod
    def now(cls, tz: object = None) -> datetime:  # type: ignore[override]
        return datetime.now(tz) + cls.jump  # type: ignore[arg-type]


@pytest.mark.fault(34, how="the wall clock set 3 h back, an hour on, and to 1970, while it is recorded", times=3)
@pytest.mark.parametrize("jump_h", [-3.0, 1.0, -495_000.0])
def test_clock_jump_changes_no_duration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jump_h: float) -> None:
    """Durations, sample times and their order are those of the monotonic clock and the board; UTC has its offset."""
    monkeypatch.setattr(recording_file, "datetime", JumpingClock)
    monkeypatch.setattr(JumpingClock, "jump", timedelta(0))
    source = Source()
    path = tmp_path / "run.boat"
    recorder = begin(path, source)
    recorder(source.next(500_000))
    assert recorder.flush()
    monkeypatch.setattr(JumpingClock, "jump", timedelta(hours=jump_h))
    recorder.reading(reading(1, 1.0))
    recorder(source.next(500_000))
    recorder.close(RunEnd.FINISHED)
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
def test_start_is_stored_with_its_offset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, zone: str, offset_h: int
) -> None:
    """The session's start has the offset that was in force."""
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


# ---- a day -----------------------------------------------------------------------------------------------------------


LOOK = """
import resource, sys
from pathlib import Path
from boat_daq.engine.recording.summary import summarise
limit = 1 << 30
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
path = Path(sys.argv[1])
print(summarise(path).samples)
"""


@pytest.mark.nightly
@pytest.mark.timeout(1800)
@pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS is Linux's")
@pytest.mark.fault(35, how="a day of 8.64 million samples, summed up in 1 GB of address space", times=1)
def test_summary_of_a_day_takes_bounded_memory(tmp_path: Path) -> None:
    """Every sample of the day is counted, from the overview, without its samples in memory."""
    from boat_daq.engine.recording.rows import OverviewRows

    path = tmp_path / "day.boat"
    dtype = sample_dtype(2)
    meta = {"simulated": True, "n_sensors": 2, "sample_kind": "counts", "vref_mv": 3300, "adc_bits": 12, "rate_hz": 100}
    file = RecordingFile.create(path, meta)
    file.commit([("INSERT INTO segment VALUES (1, 0, 1, 'opened', 0, NULL)", ())])
    overview = OverviewRows(3300 / 4096)
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
    assert done.stdout.split() == ["8640000"]
