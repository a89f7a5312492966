"""Results kept in a recording: when one can be computed again from the recording alone."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import pytest

from analysis import Analysis, Options, Recording, analyse
from analysis.figures.stored_results import code_state, reproduce, store_analysis
from boat_daq.commands.recordings import reanalyse
from boat_daq.engine.recording.verify import verify_recording
from tests.analysis.boat_builder import Staircase, write_boat


@pytest.mark.parametrize(
    ("read_utc", "corrected"),
    [
        ("2026-07-01T12:59:59.999+02:00", False),  # 10:59:59.999 UTC, a millisecond before the result
        ("2026-07-01T13:00:00.001+02:00", True),
        ("2026-07-01T05:59:59.999-05:00", False),
        ("2026-07-01T06:00:00.001-05:00", True),
        ("2026-07-01T10:59:59.999+00:00", False),
        ("2026-07-01T11:00:00.001+00:00", True),
    ],
)
def test_a_reading_is_newer_than_a_result_by_its_instant(tmp_path: Path, read_utc: str, corrected: bool) -> None:
    """Readings carry the offset of where they were read, results are in UTC: as text they do not compare."""
    run = write_boat(tmp_path / "run.boat", Staircase(cycles=1).recording())
    analysis = analyse(run, options=Options(mcmc=False))
    assert store_analysis(run, analysis) == ""
    with sqlite3.connect(run) as db:
        db.execute("UPDATE result SET utc = '2026-07-01T11:00:00.000000+00:00'")
        insert = "INSERT INTO reading (utc, step, elongation_mm, source) VALUES (?, 99, 1.0, 'test')"
        db.execute(insert, (read_utc,))
    db.close()
    again = reproduce(run, 1, {"options": asdict(analysis.options)})
    assert (again is None) == corrected


@pytest.fixture(scope="module")
def analysed() -> tuple[Recording, Analysis]:
    """A short run and its analysis."""
    recording = Staircase(cycles=1).recording()
    return recording, analyse(recording, options=Options(mcmc=False))


def test_an_older_recording_is_not_added_to(tmp_path: Path, analysed: tuple[Recording, Analysis]) -> None:
    """Not a byte of it changes, and the message names `upgrade`; one of today's layout keeps the result."""
    run = write_boat(tmp_path / "run.boat", analysed[0])
    with closing(sqlite3.connect(run)) as db:
        db.execute("PRAGMA user_version = 1")
    before = run.read_bytes()
    message = store_analysis(run, analysed[1])
    assert "layout of an older program" in message
    assert "Upgrade the recording" in message
    assert run.read_bytes() == before
    with closing(sqlite3.connect(run)) as db:
        db.execute("PRAGMA user_version = 2")
    assert store_analysis(run, analysed[1]) == ""


def test_a_result_names_the_program_state_that_computed_it(
    tmp_path: Path, analysed: tuple[Recording, Analysis], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A changed number of this very program is distinguished from one that another state of it computed."""
    run = write_boat(tmp_path / "run.boat", analysed[0])
    monkeypatch.setattr("boat_daq.engine.recording.verify._verify_stream", lambda *_: None)  # made without raw bytes
    assert store_analysis(run, analyse(run, options=Options(mcmc=False))) == ""

    def verdict() -> str:
        return verify_recording(run, reanalyse=reanalyse, code=code_state()).difference

    assert verdict() == ""
    with closing(sqlite3.connect(run)) as db, db:
        db.execute("UPDATE result SET content = json_set(content, '$.sensors[1].figures.fso_mv.value', 1.0)")
    assert verdict() == (
        "result 1 (analysis): this program, which computed it, gives other numbers than are stored; "
        "the first is sensors[1].figures.fso_mv.value"
    )
    with closing(sqlite3.connect(run)) as db, db:
        db.execute("UPDATE result SET parameters = json_set(parameters, '$.code', 'abc')")
    assert "another state of the program (version" in verdict()
    assert f"code abc; this is code {code_state()}" in verdict()
    with closing(sqlite3.connect(run)) as db, db:
        db.execute("UPDATE result SET parameters = json_remove(parameters, '$.code')")
    assert "its code is not recorded" in verdict()
