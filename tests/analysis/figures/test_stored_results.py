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
from protocol.base.errors import BoatDaqError, FileError
from tests.analysis.boat_builder import Staircase, write_boat


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
    at = "'$.sensors[1].figures.fso_mv.value'"
    with closing(sqlite3.connect(run)) as db, db:
        db.execute(f"UPDATE result SET content = json_set(content, {at}, (1.0 + 1e-11) * (content ->> {at}))")
    assert verdict() == ""  # another processor's rounding
    with closing(sqlite3.connect(run)) as db, db:
        db.execute(f"UPDATE result SET content = json_set(content, {at}, (1.0 + 1e-8) * (content ->> {at}))")
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


@pytest.mark.parametrize(
    ("key", "value"),
    [("seed", "x"), ("seed", -1), ("plateau", {"no": 1}), ("more", 1), ("degree", [3])],
)
def test_parameters_of_no_analysis_are_refused(
    tmp_path: Path, analysed: tuple[Recording, Analysis], key: str, value: object
) -> None:
    """A forged result is refused with its cause; without options too."""
    run = write_boat(tmp_path / "run.boat", analysed[0])
    options = {**asdict(analysed[1].options), key: value}
    with pytest.raises(BoatDaqError) as refusal:
        reproduce(run, {"options": options})
    assert refusal.value.cause
    with pytest.raises(FileError, match="cannot be used: KeyError"):
        reproduce(run, {})
