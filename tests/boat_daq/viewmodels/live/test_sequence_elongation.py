"""Elongation as a setpoint in the window: the typed value, the plan in millimetres, and the line that is shown."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.snapshot import ElongationControl
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.sequence import SequenceModel, drawing, elongation_text, staircase, step_begins
from protocol.base.errors import RequestError
from tests.boat_daq.gui.recorded_session import connected

CONTROLLED = ElongationControl(1.5, 1.4, 1.38, 0.06, saturated=True, lost=(2,))


def sequence(folder: Path, shown: Any) -> tuple[SequenceModel, Mock, object]:
    """Return a model with a recording session, that session, and the regulator that it makes."""
    session, regulator = Mock(), object()
    session.snapshot.return_value = shown
    return SequenceModel(session, UndoHistory(), Preferences(folder), lambda: regulator), session, regulator


def test_a_typed_elongation_closes_the_loop_and_then_moves_its_setpoint(tmp_path):
    model, session, regulator = sequence(tmp_path, connected())
    model.hold = True
    model.set_elongation("1.5")
    session.control_elongation.assert_called_with(1.5, regulator, hold=True)
    session.snapshot.return_value = dataclasses.replace(connected(), elongation=CONTROLLED)
    model.set_elongation("-0.5")
    session.control_elongation.assert_called_with(-0.5, None, hold=True)
    with pytest.raises(RequestError, match="not a number"):
        model.set_elongation("long")


def test_a_plan_in_millimetres_is_armed_with_the_regulator(tmp_path):
    model, session, regulator = sequence(tmp_path, connected())
    model.choose("steps-mm")
    model.arm()
    assert session.arm.call_args.kwargs["regulator"] is regulator
    model.choose("calibration")
    model.arm()
    assert session.arm.call_args.kwargs["regulator"] is None


def test_what_is_controlled_is_shown_in_a_line():
    assert elongation_text(connected()) == ""
    text = elongation_text(dataclasses.replace(connected(), elongation=CONTROLLED))
    assert text == "Setpoint +1.40 mm, measured +1.38 mm, pressure at its limit or ramp, sensor 2 lost"


def test_a_profile_is_drawn_along_its_segments():
    plan = built_in_plans()["sine-sweep-mm"]
    time_s, mm = staircase(plan)
    assert time_s[-1] == pytest.approx(plan.duration_s)
    assert (mm.min(), mm.max()) == (pytest.approx(-2.0, abs=0.05), pytest.approx(3.0, abs=0.05))
    assert len(step_begins(plan)) == len(plan.steps) + 1
    heights = np.array([y for _, y in drawing(plan, 0.0, None).line])
    assert heights.min() > 0.0
    assert heights.max() < 1.0
