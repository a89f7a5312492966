"""Metadata of a recording in progress: stated by the session, by another program, and refused where nobody answers."""

from __future__ import annotations

import os

import pytest

from boat_daq.engine.recording import metadata
from boat_daq.engine.recording.file import WriterLock
from boat_daq.engine.recording.metadata import read_metadata, state_metadata
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session import journal
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.errors import StorageError
from protocol.recording import Metadata
from tests.boat_daq.commands.calls import call
from tests.boat_daq.engine.served_board import serve_in_thread

STATED = Metadata("Eve", "A & Co", "Rod", "7", "wet", 21.0, 40.0, {"batch": "\u05e9"})
PATIENCE_S = 20.0


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_metadata_are_stated_while_recording(monkeypatch, tmp_path):
    """By the session at once, by `boat-daq metadata` through the session; the newest count, and the file verifies."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    monkeypatch.setattr(journal, "EVERY_S", 0.05)
    path, session = tmp_path / "run.boat", Session(Settings(), UnitLibrary())
    with serve_in_thread(BoardSettings()) as board:
        session.connect(board.url, unit="SA1")
        session.wait_connected()
        session.start_recording(path, {"operator": "Ada"})
        assert session.metadata(path) == Metadata("Ada")
        session.state_metadata(path, STATED)
        assert session.metadata(path) == STATED
        shown = call("metadata", path, "--set", "customer=B", "--set", "note=dry", "--json")
        assert (shown["customer"], shown["note"], shown["item"]) == ("B", "dry", "Rod")
        assert session.metadata(path) == read_metadata(path) == STATED.changed({"customer": "B", "note": "dry"})
        for number, wrong in enumerate(("[]}", "[{}]", '[{}, {"customer": 3}]'), 1):
            path.with_name("run.boat-metadata").write_text(wrong)
            session.wait(lambda s, n=number: sum("run.boat-metadata" in m.cause for m in s.messages) == n, PATIENCE_S)
        assert not path.with_name("run.boat-metadata").exists()
        session.stop_recording()
        session.state_metadata(path, STATED)
        assert session.metadata(path) == read_metadata(path) == STATED
        session.close()
    assert UnitLibrary(simulated=True).load("SA1").metadata["customer"] == "B"
    assert verify_recording(path).identical


def test_only_what_another_program_has_changed_is_stated():
    """It may have read what was stated before; a field that it removed is removed."""
    before = Metadata("Eve", fields={"batch": "1", "oven": "2"})
    wanted = before.changed({"customer": "A & Co", "oven": "", "shift": "3"})
    current = before.changed({"operator": "Ada", "batch": "7"})
    merged = metadata.with_changes_of(current, before, wanted)
    assert merged == Metadata("Ada", "A & Co", fields={"batch": "7", "shift": "3"})


def test_a_program_that_does_not_answer_is_named(monkeypatch, tmp_path):
    """Nothing is left beside the recording."""
    from tests.boat_daq.engine.recording.test_metadata import SAMPLE

    monkeypatch.setattr(metadata, "REQUEST_S", 0.1)
    path = tmp_path / "run.boat"
    path.write_bytes(SAMPLE.read_bytes())
    lock = WriterLock(path)
    with pytest.raises(StorageError, match="does not take metadata"):
        state_metadata(path, STATED)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.boat", "run.boat-lock"]
    lock.close()
