"""A camera beside a session: readings into the recording and to the plateaus, faults as messages."""

from __future__ import annotations

import dataclasses
import math
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from analysis.data.boat_file import store_video
from analysis.data.camera_record import CameraRecord
from analysis.data.load import load_recording
from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session import camera_channel
from boat_daq.engine.session.camera_channel import CameraChannel
from boat_daq.engine.snapshot import CameraReading, Reading
from protocol.base.errors import RequestError
from protocol.recording import RunEnd
from tests.boat_daq.engine.recording_source import Source


class Still:
    """A source that gives no frame by itself."""

    name, live, frame_count = "0", True, 0

    def frames(self):
        return iter(())

    def close(self) -> None:
        """Nothing to close."""


class FakeSession:
    """What a channel uses of a session: board time is host time less a second."""

    def __init__(self) -> None:
        self.entered: list[Reading] = []
        self.warned: list[str] = []
        self.kept: list[CameraReading] = []
        self.marks: tuple[StepMark, ...] = ()
        self.waiting: int | None = None
        self.resumed = 0
        self.live = self

    def add_sink(self, sink):
        self.sink = sink
        return lambda: None

    def keep_camera(self, reading, about, rest_mm) -> None:
        self.kept.append(reading)

    def warn_of_camera(self, cause: str, remedy: str = "") -> None:
        self.warned.append(cause)

    def steps(self):
        return self.marks

    def resumed_after(self) -> int:
        return self.resumed

    def readings(self):
        return tuple(self.entered)

    def snapshot(self):
        class Seen:
            waiting_for_reading = None

        return Seen

    def add_reading(self, step_id, elongation_mm, source, *, resolution_mm=None, reader="", note="") -> None:
        self.entered.append(Reading(step_id, elongation_mm, resolution_mm, source, "", reader, note))

    def samples(self, until_s: float) -> None:
        """Pass a block of samples up to a time of the host."""
        block = np.zeros(1, [("host_ns", "<i8"), ("time_us", "<i8")])
        block["host_ns"], block["time_us"] = until_s * 1e9, (until_s - 1.0) * 1e6
        self.sink(block)


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def channel(session: FakeSession):
    channel = CameraChannel(session, Still(), lambda picture, time_s: None, dict)
    yield channel
    channel.close()


def frames(channel: CameraChannel, first_s: float, last_s: float, x_mm: float | None, fault: str = "") -> None:
    """Pass frames at 30 Hz as the camera's thread does."""
    for time_s in np.arange(first_s, last_s, 1 / 30):
        reading = CameraReading(int(time_s * 1e9), x_mm, None if x_mm is None else 0.004, fault)
        channel._take(reading, np.zeros((2, 2), np.uint8))


def hold(session: FakeSession, *, ended: bool = True) -> None:
    """Let the run hold a plateau from 4 to 6 s of the host."""
    last_us = 5_000_000 if ended else None
    session.marks = (StepMark(1, 0, "start", 50.0, 10.0, 1_000_000, 2_500_000, 3_000_000, last_us, "reached"),)


def test_a_plateau_gets_the_mean_of_its_frames_from_rest(session: FakeSession, channel: CameraChannel) -> None:
    """Rest at 0.2 mm before the run, 4.0 mm in its settled part."""
    session.samples(1.0)
    frames(channel, 1.0, 2.0, 0.2)
    session.samples(2.5)
    hold(session)
    frames(channel, 2.5, 4.0, 3.0)
    frames(channel, 4.0, 6.0, 4.0)
    session.samples(6.1)
    frames(channel, 6.1, 6.2, 4.0)
    (reading,) = session.entered
    assert reading.elongation_mm == pytest.approx(3.8, abs=1e-4)
    assert (reading.source, reading.step_id) == ("camera", 1)
    assert reading.resolution_mm == pytest.approx(0.004 * math.sqrt(12), rel=0.01)


def test_a_plateau_without_marks_gets_no_reading_and_a_warning(session: FakeSession, channel: CameraChannel) -> None:
    """With the reason."""
    session.samples(1.0)
    frames(channel, 1.0, 2.0, 0.0)
    session.samples(2.5)
    hold(session)
    frames(channel, 2.5, 6.0, None, "covered")
    session.samples(6.1)
    frames(channel, 6.1, 6.2, 4.0)
    assert session.entered == []
    assert any("a mark is covered in part" in text for text in session.warned)
    assert any(text.startswith("no reading of the camera at +50 kPa") for text in session.warned)


def test_the_operators_reading_stays(session: FakeSession, channel: CameraChannel) -> None:
    """The camera does not replace it."""
    session.samples(1.0)
    frames(channel, 1.0, 2.0, 0.0)
    session.samples(2.5)
    hold(session)
    session.entered.append(Reading(1, 3.5, 0.5, "typed", ""))
    frames(channel, 4.0, 6.0, 4.0)
    session.samples(6.1)
    frames(channel, 6.1, 6.2, 4.0)
    assert [reading.source for reading in session.entered] == ["typed"]


def test_rest_that_was_not_seen_is_warned_of(session: FakeSession, channel: CameraChannel) -> None:
    """Readings then count from the camera's own beginning."""
    session.samples(2.5)
    hold(session, ended=False)
    frames(channel, 2.6, 2.7, 1.0)
    assert any("saw no elongation before the run" in text for text in session.warned)


def test_a_resumed_run_counts_from_the_rest_before_it(session: FakeSession, channel: CameraChannel) -> None:
    """The steps before are of another clock and another camera: they get no reading, and a warning says so."""
    before = StepMark(1, 1, "unloading", 30.0, 10.0, 900_000_000, 901_000_000, 902_000_000, 903_000_000, "reached")
    session.marks, session.resumed = (before,), 1
    session.samples(1.0)
    frames(channel, 1.0, 2.0, 0.2)
    session.samples(2.5)
    again = StepMark(2, 1, "start", 50.0, 10.0, 1_000_000, 2_500_000, 3_000_000, 5_000_000, "reached")
    session.marks = (before, again)
    frames(channel, 4.0, 6.0, 4.0)
    session.samples(6.1)
    frames(channel, 6.1, 6.2, 4.0)
    assert [(reading.step_id, reading.elongation_mm) for reading in session.entered] == [(2, pytest.approx(3.8))]
    assert [text for text in session.warned if "resumed" in text] != []


def test_a_camera_opened_during_a_run_gives_no_readings(session: FakeSession) -> None:
    """Its rest position is not that of the run; a warning says so once."""
    hold(session)
    channel = CameraChannel(session, Still(), lambda picture, time_s: None, dict)
    next_one = StepMark(2, 1, "unloading", 40.0, 10.0, 5_000_000, 5_500_000, 6_000_000, 8_000_000, "reached")
    session.marks += (next_one,)
    session.samples(5.0)
    frames(channel, 5.0, 9.0, 4.0)
    session.samples(9.1)
    frames(channel, 9.1, 9.2, 4.0)
    channel.close()
    assert session.entered == []
    assert [text for text in session.warned if "opened during the run" in text] == session.warned != []
    assert channel.rest_mm == 0.0


def test_a_video_file_is_no_camera(session: FakeSession) -> None:
    """It is for the analysis."""
    source = Still()
    source.live = False
    with pytest.raises(RequestError, match="is a file"):
        CameraChannel(session, source, lambda picture, time_s: None, dict)


def test_every_fault_has_its_sentence() -> None:
    """Cause and remedy for what lasts; what lasts half a second or belongs to the beginning has none."""
    from analysis.tracking.marks import PictureFault

    codes = {str(fault) for fault in PictureFault}
    assert set(camera_channel.FAULT_TEXTS) | {"learning", "repeated"} == codes


def test_readings_are_kept_in_the_recording(path: Path, source: Source, recorder: Recorder) -> None:
    """In a table of their own, read back in the recording's time, salvaged and verified with it."""
    for n in range(40):
        block = source.next()
        recorder(block)
        if n % 8 == 4:
            lost = n == 12
            recorder.camera(CameraReading(block.host_ns, None if lost else 0.1 * n, 0.004, "lost" if lost else "", 1))
    recorder.close(RunEnd.STOPPED)
    camera = load_recording(path).camera
    assert camera is not None
    assert camera.faults == {"lost": 1}
    assert camera.dropped == 5
    assert camera.elongation_mm[0] == pytest.approx(0.4)
    assert np.all(np.diff(camera.time_s) >= 0)
    assert verify_recording(path).identical


def test_readings_of_a_video_count_before_those_of_a_camera(path: Path, source: Source, recorder: Recorder) -> None:
    """Another video replaces them; what the camera gave stays; verified and salvaged with the recording."""
    for _ in range(40):
        block = source.next()
        recorder(block)
        recorder.camera(CameraReading(block.host_ns, 0.5, 0.004))
    recorder.close(RunEnd.STOPPED)
    x = np.array([np.nan, 0.25, 0.5])
    fault = np.array(["lost", "", ""])
    record = CameraRecord(np.array([-0.1, 0.5, 1.000001]), x, np.where(np.isnan(x), np.nan, 0.01), fault, 3)
    assert store_video(path, record, {"source": "first.mkv", "u_scale": 0.001}) == ""
    moved = dataclasses.replace(record, elongation_mm=record.elongation_mm - 0.25)
    assert store_video(path, moved, {"source": "second.mkv", "u_scale": 0.002}) == "first.mkv"
    recording = load_recording(path)
    assert recording.camera is not None
    assert recording.camera.time_s.tolist() == [-0.1, 0.5, 1.000001]
    assert recording.camera.elongation_mm[1:].tolist() == [0.0, 0.25]
    assert (recording.camera.dropped, recording.camera.faults) == (3, {"lost": 1})
    assert (recording.meta["camera"]["source"], recording.meta["camera"]["u_scale"]) == ("second.mkv", 0.002)
    assert verify_recording(path).identical
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("SELECT count(*) FROM camera").fetchone()[0] == 40


def test_a_recording_that_is_open_takes_no_video(path: Path, source: Source, recorder: Recorder) -> None:
    """It has one writer."""
    recorder(source.next())
    record = CameraRecord(np.zeros(1), np.zeros(1), np.zeros(1), np.array([""]))
    with pytest.raises(RequestError, match="is being recorded"):
        store_video(path, record, {"source": "x.mkv"})
