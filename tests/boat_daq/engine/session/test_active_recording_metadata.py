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
        path.with_name("run.boat-metadata").write_text("[]}")
        session.wait(lambda s: any("run.boat-metadata" in m.cause for m in s.messages), PATIENCE_S)
        assert not path.with_name("run.boat-metadata").exists()
        session.stop_recording()
        session.state_metadata(path, STATED)
        assert session.metadata(path) == read_metadata(path) == STATED
        session.close()
    assert UnitLibrary(simulated=True).load("SA1").metadata["customer"] == "B"
    assert verify_recording(path).identical


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
