"""Metadata of a recording in progress: stated by its session, refused from another program."""

from __future__ import annotations

import os

import pytest

from boat_daq.engine.recording.metadata_entry import read_metadata, state_metadata
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from protocol.base.errors import StorageError
from protocol.recording import Metadata
from tests.boat_daq.engine.served_board import serve_in_thread

STATED = Metadata("Eve", "A & Co", "Rod", "7", "wet", 21.0, 40.0, {"batch": "\u05e9"})


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_metadata_are_stated_while_recording(monkeypatch, tmp_path):
    """The session states them at once; another program is refused; the file verifies."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    path, session = tmp_path / "run.boat", Session(Settings(), UnitLibrary())
    with serve_in_thread(BoardSettings()) as board:
        session.connect(board.url, unit="SA1")
        session.wait_connected()
        session.start_recording(path, {"operator": "Ada"})
        assert session.recording.metadata(path) == Metadata("Ada")
        session.recording.state(path, STATED)
        assert session.recording.metadata(path) == STATED
        with pytest.raises(StorageError, match="is being written by another program"):
            state_metadata(path, STATED.changed({"customer": "B"}))
        session.stop_recording()
        assert read_metadata(path) == STATED
        closed = STATED.changed({"customer": "B", "note": "dry"})
        session.recording.state(path, closed)
        assert session.recording.metadata(path) == read_metadata(path) == closed
        session.close()
    assert verify_recording(path).identical
