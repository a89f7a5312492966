"""Readings of a closed recording, in their panel."""

from __future__ import annotations

from pathlib import Path

import pytest

from boat_daq.gui.results.closed_readings import ClosedReadings
from protocol.base.units import ShownUnits
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import run_command, run_shortcut


def test_readings_of_a_recording_are_edited(make, tmp_path, qtbot):
    """Choose the recording, open its readings, type another value, undo it; the file keeps both."""
    import shutil

    from boat_daq.engine.recording.closed_run import ClosedRun

    sample = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"
    (tmp_path / "recordings").mkdir()
    path = Path(shutil.copy(sample, tmp_path / "recordings" / "older.boat"))
    window = make(RecordedSession(connected(), filled_ring(10.0)))
    window.model.unit_choice.choose(ShownUnits.of("mbar"))
    window.go("Recordings")
    page = window.pages["Recordings"]
    qtbot.waitUntil(lambda: (window.refresh(), page.list.rowCount())[1] == 1, timeout=20_000)
    qtbot.waitUntil(lambda: (window.refresh(), page.offers("readings"))[1], timeout=20_000)  # the newest is selected
    run_command(window, "Correct its readings …")
    before = ClosedRun(path).readings()
    (panel,) = window.findChildren(ClosedReadings)
    model = panel.table.model
    assert model.readings.headings[2] == "mbar"
    model.setData(model.index(2, 3), "1.25")
    assert ClosedRun(path).readings() == before  # far from the others: it is asked for again
    model.setData(model.index(2, 3), "1.25")
    assert ClosedRun(path).readings()[-1].elongation_mm == 1.25
    run_shortcut(window, "Ctrl+Z")
    assert ClosedRun(path).readings()[-1].elongation_mm == pytest.approx(float(before[2].elongation_mm))
    assert len(ClosedRun(path).readings()) == len(before) + 2
    panel.close()
    window.refresh()
    assert not panel.isVisible()
