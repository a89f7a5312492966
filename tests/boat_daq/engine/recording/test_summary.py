"""A recording in short, against recordings whose segments, steps and losses are known."""

from __future__ import annotations

import dataclasses
import os
import shutil
import sqlite3
from contextlib import closing

import pytest
from typer.testing import CliRunner

from boat_daq.cli import app
from boat_daq.engine.recording.recorder import Recorder
from boat_daq.engine.recording.summary import summarise
from protocol.base.errors import RecordingError
from protocol.recording import RunEnd
from tests.boat_daq.engine.board_link import meta_of
from tests.boat_daq.engine.recording_source import Source, add_step


def begun(path, **meta) -> tuple[Recorder, Source]:
    source = Source()
    recorder = Recorder(path, meta_of(source.link, **meta))
    recorder.attached(source.link.decoder_state())
    return recorder, source


def test_segments_are_summed_one_by_one(tmp_path):
    """Samples, duration and rate of each; an empty segment is left out; a pause between does not count."""
    recorder, source = begun(tmp_path / "run.boat", operator="Ada", unit="SA2", note="n")
    for _ in range(5):
        recorder(source.next(1_000_000))
    recorder.new_segment("paused", paused=True)
    recorder.new_segment("resumed")
    source.board.advance(10_000_000)
    for _ in range(3):
        recorder(source.next(1_000_000))
    recorder.close(RunEnd.FINISHED)
    summary = summarise(tmp_path / "run.boat")
    assert (summary.operator, summary.unit, summary.note, summary.stop_reason) == ("Ada", "SA2", "n", "finished")
    assert [(s.number, s.reason, s.samples) for s in summary.segments] == [(1, "opened", 500), (3, "resumed", 300)]
    assert [s.duration_s for s in summary.segments] == pytest.approx([4.99, 2.99])
    assert [s.rate_hz for s in summary.segments] == pytest.approx([100.0, 100.0])
    assert summary.samples == 800
    assert summary.duration_s == pytest.approx(7.98)
    assert summary.rate_hz == pytest.approx(100.0)


def test_an_unclosed_recording_is_counted_beyond_its_overview(tmp_path):
    """Live or killed, the samples that no overview row holds yet are there too; the lock distinguishes the two."""
    recorder, source = begun(tmp_path / "run.boat")
    for _ in range(25):
        recorder(source.next(1_000_000))
        recorder.flush()
    live = summarise(tmp_path / "run.boat")
    for suffix in ("", "-wal"):
        shutil.copy(tmp_path / f"run.boat{suffix}", tmp_path / f"left.boat{suffix}")
    recorder.close(RunEnd.STOPPED)
    left = summarise(tmp_path / "left.boat")
    assert (live.status, left.status) == ("recording", "interrupted")
    assert live.samples == left.samples == 2_500
    assert live.ended_utc is None


def test_cycles_are_complete_when_all_their_steps_were_reached(tmp_path):
    """A cycle with fewer steps than the others, or one not reached, is partial; steps outside cycles do not count."""
    recorder, source = begun(tmp_path / "run.boat")
    recorder(source.next())
    steps = [(0, "start", "reached")]
    for cycle, last in ((1, "reached"), (2, "timeout"), (3, "reached")):
        steps += [(cycle, "unloading", "reached"), (cycle, "unloading", "reached"), (cycle, "loading", last)]
    steps += [(4, "unloading", "reached"), (4, "unloading", "aborted")]
    for cycle, branch, status in steps:
        recorder.step(dataclasses.replace(add_step(recorder, cycle, branch), status=status), new=False)
    recorder.close(RunEnd.FINISHED)
    summary = summarise(tmp_path / "run.boat")
    assert (summary.cycles.complete, summary.cycles.partial) == (2, 2)
    assert summary.steps == 12


def test_cycles_of_a_profile_need_no_second_branch(tmp_path):
    """Sines about one value end where they begin; one that was aborted is partial."""
    recorder, source = begun(tmp_path / "run.boat")
    recorder(source.next())
    for cycle, status in ((1, "reached"), (2, "reached"), (3, "aborted")):
        mark = add_step(recorder, cycle, "loading", detail={"segment": {"kind": "sine"}, "start": 0.5})
        recorder.step(dataclasses.replace(mark, status=status), new=False)
    recorder.close(RunEnd.STOPPED)
    cycles = summarise(tmp_path / "run.boat").cycles
    assert (cycles.complete, cycles.partial) == (2, 1)


def test_damaged_frames_are_those_of_every_link(tmp_path):
    """The counters begin at zero with each link: what the links before counted is added, of whatever kind it is."""
    recorder, source = begun(tmp_path / "run.boat")
    recorder(source.next(1_000_000))
    recorder.close(RunEnd.FINISHED)
    rows = [(500, 1, 0, 0), (900, 3, 1, 0), (900, 3, 1, 0), (400, 0, 0, 2), (800, 2, 5, 2)]  # bytes, kinds of damage
    with closing(sqlite3.connect(tmp_path / "run.boat")) as db, db:
        db.execute("DELETE FROM health")
        db.executemany(
            "INSERT INTO health (host_ns, bytes, frames, samples, lost, crc_errors, malformed, oversize, duplicates,"
            " unknown) VALUES (0, ?, 0, 0, 0, ?, ?, ?, 0, 0)",
            rows,
        )
    summary = summarise(tmp_path / "run.boat")
    assert (summary.crc_errors, summary.damaged_frames) == (3 + 2, 3 + 1 + 2 + 5 + 2)


def test_a_recording_without_a_sample_has_no_rate(tmp_path):
    """Zero samples, no rate, no pressure: unknown, not an error."""
    recorder, _ = begun(tmp_path / "run.boat")
    recorder.close(RunEnd.STOPPED)
    summary = summarise(tmp_path / "run.boat")
    assert (summary.samples, summary.rate_hz, summary.pressure_max_kpa, summary.segments) == (0, None, None, ())


def test_what_is_no_recording_is_refused(tmp_path):
    """An absent file and another file are refused."""
    with pytest.raises(RecordingError, match="no file"):
        summarise(tmp_path / "none.boat")
    (tmp_path / "text.boat").write_text("hello")
    with pytest.raises(RecordingError, match="not a boat-daq recording"):
        summarise(tmp_path / "text.boat")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes")
def test_a_pipe_is_refused_without_waiting(tmp_path):
    """What is no plain file is not opened: a pipe without a writer would hold the reader for ever."""
    os.mkfifo(tmp_path / "run.boat")
    with pytest.raises(RecordingError, match="not a regular file"):
        summarise(tmp_path / "run.boat")


def test_a_damaged_table_is_an_error_of_the_file(tmp_path):
    """Pages of zeros behind a whole schema: damaged, and what to do; not a fault of the program."""
    path = tmp_path / "run.boat"
    recorder, source = begun(path)
    for _ in range(30):
        recorder(source.next(1_000_000))
        recorder.flush()
    recorder.close(RunEnd.FINISHED)
    with closing(sqlite3.connect(path)) as db:
        ((page,),) = db.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'block'")
        ((size,),) = db.execute("PRAGMA page_size")
    with path.open("r+b") as file:
        file.seek((page - 1) * size)
        file.write(bytes(size))
    with pytest.raises(RecordingError, match="malformed") as refused:
        summarise(path)
    assert "recover" in str(refused.value.remedy).lower()


def test_control_characters_of_names_become_question_marks(tmp_path):
    """Escape sequences and line ends in an operator's name are shown as question marks; letters of any script stay."""
    recorder, source = begun(tmp_path / "run.boat", operator="Zoë\x1b[31m\r\nstatus", unit="SA2", note="")
    recorder(source.next(1_000_000))
    recorder.close(RunEnd.FINISHED)
    shown = CliRunner().invoke(app, ["info", str(tmp_path / "run.boat")]).stdout
    assert "operator    Zoë?[31m??status\n" in shown
    assert "\x1b" not in shown


def test_corrected_reading_counts_its_plateau_once(tmp_path):
    """One run had 97 readings on Runs and 94 on Calibrate: a correction was counted, and so was a withdrawal."""
    recorder, source = begun(tmp_path / "run.boat")
    recorder(source.next(1_000_000))
    recorder.close(RunEnd.FINISHED)
    rows = ((1, 1.0), (2, 2.0), (1, 1.5), (2, None), (3, 0.0))
    with closing(sqlite3.connect(tmp_path / "run.boat")) as db, db:
        db.execute("PRAGMA foreign_keys = OFF")
        db.executemany(
            "INSERT INTO reading (step, elongation_mm, resolution_mm, source, utc) VALUES (?, ?, 0.5, 'typed', '2026')",
            rows,
        )
    assert summarise(tmp_path / "run.boat").readings == 2
