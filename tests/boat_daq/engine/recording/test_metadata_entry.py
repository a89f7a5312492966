"""Metadata of a closed recording, and remembered for its unit."""

from __future__ import annotations

import shutil
from pathlib import Path

from analysis import load_recording
from boat_daq.engine.recording.metadata_entry import read_metadata, remember, remembered, state_metadata
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.settings import UnitLibrary
from protocol.recording import Metadata

SAMPLE = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"
STATED = Metadata("Eve", "<b>A & Co</b>", "Rod", "7", "wet", 21.0, 40.0, {"batch": "\u05e9"})


def test_newest_metadata_count_and_the_recording_still_verifies(tmp_path):
    """They are added, never changed; every reader has the same; samples are untouched."""
    path = Path(shutil.copy(SAMPLE, tmp_path))
    before = read_metadata(path)
    assert (before.operator, before.customer) == ("demo", "")
    state_metadata(path, STATED.changed({"customer": "B"}))
    state_metadata(path, STATED)
    assert read_metadata(path) == load_recording(path).metadata == summarise(path).metadata == STATED
    assert (summarise(path).operator, summarise(path).note) == ("Eve", "wet")
    assert verify_recording(path).identical


def test_a_unit_remembers_its_item_and_not_that_of_its_simulated_namesake(tmp_path):
    units = UnitLibrary(tmp_path)
    remember(units, "SA1", STATED)
    assert remembered(units, "SA1") == STATED.of_unit()
    assert remembered(units.of(simulated=True), "SA1") == remembered(units, "") == Metadata()
