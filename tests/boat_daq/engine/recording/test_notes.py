"""Notes on a closed recording."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from analysis import load_recording
from boat_daq.engine.recording.notes import add_note
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from protocol.base.errors import RequestError

SAMPLE = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.fixture
def closed(tmp_path):
    """A closed recording."""
    return Path(shutil.copy(SAMPLE, tmp_path / "old.boat"))


def test_newest_note_counts_and_the_recording_still_verifies(closed):
    """Notes are added, never changed; an empty one withdraws; samples, gaps and readings are untouched."""
    before = summarise(closed)
    add_note(closed, "tube replaced")
    add_note(closed, "tube replaced, zero checked")
    assert summarise(closed).note == load_recording(closed).meta["note"] == "tube replaced, zero checked"
    assert verify_recording(closed).identical
    add_note(closed, "")
    after = summarise(closed)
    assert after.note == ""
    assert (after.gaps, after.samples, after.readings) == (before.gaps, before.samples, before.readings)
    with pytest.raises(RequestError, match="longer"):
        add_note(closed, "x" * 3000)
