"""What the view models keep from one start to the next, and what the fidelity reaches."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest

from analysis.fidelity import fidelity
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.undo import UndoHistory
from boat_daq.viewmodels.live.sequence import SequenceModel
from boat_daq.viewmodels.results.repeatability import RepeatabilityModel


def sequence(folder: Path) -> SequenceModel:
    model = SequenceModel(Mock(), UndoHistory())
    model.remember_in(Preferences(folder))
    return model


def test_the_plan_of_the_last_time_is_there_again(tmp_path: Path) -> None:
    """Two cycles, and no waiting for readings, as they were set; the built-in plan is untouched."""
    first = sequence(tmp_path)
    assert (first.plan.cycles, first.wait_for_reading) == (5, True)
    assert first.edit("cycles", "2") == ""
    first.ask_readings(False)
    again = sequence(tmp_path)
    assert (again.plan, again.wait_for_reading) == (first.plan, False)
    assert again.plan.cycles == 2
    again.choose("calibration")
    assert sequence(tmp_path).plan.cycles == 5


@pytest.mark.parametrize("kept", ["", "cycles = 0", "no TOML at all ["])
def test_a_remembered_plan_that_is_refused_is_left(tmp_path: Path, kept: str) -> None:
    """A plan from another time that today's rules refuse does not keep the window from its start."""
    Preferences(tmp_path).set("plan", kept)
    assert sequence(tmp_path).plan == sequence(tmp_path / "none").plan


def test_the_repeatability_is_as_fine_as_the_fidelity_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The level goes with the work, as on the calibration page."""
    begun = Mock()
    monkeypatch.setattr("boat_daq.viewmodels.results.repeatability.Job", begun)
    model = RepeatabilityModel(Mock())
    for level in ("draft", "reference"):
        model.set_fidelity(fidelity(level))
        model.analyse(tmp_path / "run.boat")
        assert begun.call_args.kwargs["level"] == level
