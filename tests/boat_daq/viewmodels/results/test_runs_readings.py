"""Readings of a closed recording."""

from __future__ import annotations

import pytest

from analysis import load_recording
from boat_daq.engine.recording.closed_run import ClosedRun
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.readings import ReadingsModel
from boat_daq.viewmodels.results.calibration_texts import readings_text
from boat_daq.viewmodels.results.run_entry import read_run
from boat_daq.viewmodels.results.run_result import analyse_run
from protocol.base.errors import RequestError
from tests.boat_daq.gui.recorded_session import idle


def test_reading_is_corrected_by_a_newer_row(closed):
    """A correction, its undo and its redo are rows behind the first; the last one counts, for the analysis too."""
    history, run = UndoHistory(), ClosedRun(closed)
    table = ReadingsModel(run, history)
    rows = table.rows(idle())
    step, before, entered = rows[4].step.number, rows[4].elongation_mm, len(run.readings())
    table.enter(step, "1.11")
    assert table.rows(idle())[4].elongation_mm == 1.11
    history.undo()
    assert table.rows(idle())[4].elongation_mm == before
    history.redo()
    kept = ClosedRun(closed).readings()
    assert [r.elongation_mm for r in kept[entered:]] == [1.11, before, 1.11]
    assert len(kept) == entered + 3
    read = load_recording(closed).readings
    assert float(read[read["step"] == step]["elongation_mm"].iloc[-1]) == 1.11


def test_reading_for_no_plateau_is_refused(closed):
    """What is not a plateau of the recording is refused, and nothing is added."""
    run = ClosedRun(closed)
    with pytest.raises(RequestError, match="no step"):
        run.add_reading(9999, 1.0, "typed")
    assert ClosedRun(closed).readings() == run.readings()


def test_readings_are_counted_alike_everywhere(closed):
    """One run had 97 readings in the list, 94 in its table and 22 of 91 on the Calibrate page."""
    table = ReadingsModel(ClosedRun(closed), UndoHistory())
    steps = [row.step.number for row in table.rows(idle())]
    table.enter(steps[4], "1.11")
    table.enter(steps[5], "")
    result = analyse_run(str(closed))
    assert table.summary(idle()) == "36 of 37 plateaus read"
    assert readings_text(result).startswith("36 of 37 plateaus read")
    assert read_run(closed).cells[5] == "36"
