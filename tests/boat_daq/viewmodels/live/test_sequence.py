"""The plan in its form, its staircase, its buttons, its progress."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from boat_daq.engine.snapshot import (
    ElongationControl,
    HealthSnapshot,
    LinkState,
    Phase,
    Progress,
    RunEnding,
    SessionState,
)
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.sequence import STATE_TEXTS, SequenceModel, done_s, drawing, staircase
from protocol.link.events import LinkStatistics
from protocol.recording import BoardState, RunEnd, SampleFlag
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, idle
from tests.boat_daq.viewmodels.helpers import PLAN


def sequence(folder: Path, session: Any = None, undo: UndoHistory | None = None) -> SequenceModel:
    """Return the model of a session, with preferences in `folder`."""
    return SequenceModel(session or Mock(), undo or UndoHistory(), Preferences(folder))


def test_plan_is_restored_at_the_next_start(tmp_path: Path) -> None:
    """Two cycles, and no waiting for readings, as they were set; the built-in plan is untouched."""
    first = sequence(tmp_path)
    assert (first.plan.cycles, first.wait_for_reading) == (5, True)
    assert first.edit("cycles", "2") == ""
    first.require_readings(False)
    again = sequence(tmp_path)
    assert (again.plan, again.wait_for_reading) == (first.plan, False)
    assert again.plan.cycles == 2
    again.choose("calibration")
    assert sequence(tmp_path).plan.cycles == 5


@pytest.mark.parametrize("kept", ["", "cycles = 0", "no TOML at all ["])
def test_stored_plan_that_is_invalid_is_ignored(tmp_path: Path, kept: str) -> None:
    """A plan from another time that today's rules refuse does not keep the window from its start."""
    Preferences(tmp_path).set("plan", kept)
    assert sequence(tmp_path).plan == sequence(tmp_path / "none").plan


def test_drawing_and_text_are_of_the_plan_that_runs_next(tmp_path: Path) -> None:
    """After a run of many cycles another plan was chosen: its text was beside the drawing of the old one."""
    model = sequence(tmp_path)
    many, one = model.plans["repeatability"], dataclasses.replace(model.plan, cycles=1)
    ended = dataclasses.replace(connected(), plan=many)
    held = {state: dataclasses.replace(connected(), plan=one, state=state) for state in SessionState}
    limits = (-40.0, 50.0)
    assert model.drawing(ended) == drawing(model.plan, 0.0, limits)
    assert model.lines(ended)[0] == "calibration: 91 plateaus, 6 min + your readings, about 21 min"
    for state in (SessionState.ARMED, SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING):
        assert model.drawing(held[state]) == drawing(one, 0.0, limits)
        assert model.lines(held[state])[0].startswith("calibration: 19 plateaus, ")
    assert model.drawing(held[SessionState.ABORTED]) == drawing(model.plan, 0.0, limits)


def test_staircase_has_the_duration_of_the_plan():
    """The picture ends when the plan's estimate ends, and each step begins where the one before ended."""
    time_s, pressure_kpa = staircase(PLAN)
    assert time_s[-1] == pytest.approx(PLAN.duration_s)
    assert time_s[::2].size == len(PLAN.steps) + 1
    assert np.all(np.diff(time_s) >= 0)
    assert set(pressure_kpa[1::2]) == {step.target_kpa for step in PLAN.steps}


def test_done_part_ends_at_the_current_time():
    """The filled part is closed on the zero line, at the share of the time that has passed."""
    half = staircase(PLAN)[0][-1] / 2
    shown = drawing(PLAN, half, (-40.0, 50.0))
    assert shown.done[0] == (0.0, shown.zero)
    assert shown.done[-1] == (pytest.approx(0.5), shown.zero)
    assert drawing(PLAN, 0.0, None).done == ()
    plan = dataclasses.replace(PLAN, cycles=2)
    edges = staircase(plan)[0][::2]  # of 37 steps; cycle 1 was interrupted at step 9, cycles 2 and 3 count
    for state, step, steps, complete, at in (
        (SessionState.RUNNING, 9, 37, 0, edges[8] + 0.5),
        (SessionState.PAUSED, 9, 46, 0, 0.0),
        (SessionState.RUNNING, 10, 46, 0, 0.5),
        (SessionState.RUNNING, 29, 47, 1, edges[18] + 0.5),
        (SessionState.PAUSED, 30, 49, 1, edges[19]),
        (SessionState.FINISHING, 10, 10, 0, edges[9] + 0.5),
    ):
        progress = Progress(step, steps, 1, 3, complete, (1,), "unloading", Phase.RAMPING, 0.0, 0.5, 60.0, 60.0)
        assert done_s(plan, dataclasses.replace(connected(), state=state, progress=progress)) == pytest.approx(at)


def test_every_state_has_its_buttons(tmp_path):
    """No state of a session is without a line in the table, and every button does something."""
    assert set(STATE_TEXTS) == set(SessionState)
    session = RecordedSession(connected())
    model = sequence(tmp_path, session)
    for button in {b for _, _, buttons in STATE_TEXTS.values() for b in buttons}:
        model.press(button)
    assert sorted(session.calls) == sorted(["arm", "start", "disarm", "pause", "resume", "stop", "clear_fault"])


def test_board_that_cannot_be_commanded_has_no_buttons(tmp_path):
    """A text profile without commands shows data; no button of the run is offered."""
    session = RecordedSession(dataclasses.replace(connected(), can_command=False, why_read_only="no vent"))
    assert sequence(tmp_path, session).allowed(session.snapshot()) == ()
    assert shown(can_command=False, why_read_only="no vent")[1] == "read only: no vent"  # it proposed the plan


@pytest.mark.parametrize(
    ("key", "text", "part"),
    [
        ("cycles", "2.5", "whole number"),
        ("cycles", "zero", "not a number"),
        ("step_kpa", "7", "divide"),
        ("high_kpa", "80", "limit"),
    ],
)
def test_invalid_entry_is_refused_and_changes_nothing(tmp_path, key, text, part):
    """The refusal names the reason; the plan stays as it was."""
    model = sequence(tmp_path, RecordedSession(idle()))
    assert part in model.edit(key, text)
    assert model.plan == PLAN


def test_entry_is_kept_and_undone(tmp_path):
    """A good entry changes the plan through the history."""
    history = UndoHistory()
    model = sequence(tmp_path, RecordedSession(idle()), history)
    assert model.edit("low_kpa", "\u221230") == ""
    assert model.plan.low_kpa == -30.0
    history.undo()
    assert model.plan == PLAN


def test_progress_in_a_line():
    """Cycle, step, phase and time left have the laboratory's terms."""
    from boat_daq.viewmodels.live.sequence import progress_text

    progress = Progress(9, 37, 1, 2, 0, (), "unloading", Phase.WAITING_FOR_READING, -30.0, 3.0, 60.0, 227.0)
    text = progress_text(dataclasses.replace(connected(), progress=progress))
    assert text == "cycle 1 of 2   step 9 of 37   3:47 left   waiting for the reading at \u221230 kPa"
    ending = dataclasses.replace(progress, step=38, steps=38, cycle=2, branch="end", phase=Phase.VENTING)
    text = progress_text(dataclasses.replace(connected(), progress=ending, plan=PLAN))
    assert text.startswith("cycle 2 of 2   plateau 37 of 37")  # it was "step 38 of 38" of 37 plateaus
    paused = dataclasses.replace(progress, phase=Phase.VENTING)
    text = progress_text(dataclasses.replace(connected(), progress=paused, state=SessionState.PAUSED))
    assert text == "cycle 1 interrupted   3:47 left   will be repeated as cycle 2"  # the button: Resume at cycle 2
    again = dataclasses.replace(progress, step=12, steps=40, cycle=2, cycles=3, incomplete_cycles=(1,))
    text = progress_text(dataclasses.replace(connected(), progress=again))
    assert text.startswith("cycle 2 of 3, 1 repeated   step 12 of 40")
    held = ElongationControl(1.5, 1.5, 1.493, 0.07)
    text = progress_text(dataclasses.replace(connected(), elongation=held))
    assert text == "setpoint +1.50 mm, measured +1.49 mm"


def shown(**changes):
    """Return state and progress of a connected board with these changes, as the line of the run shows them."""
    from boat_daq.viewmodels.live.sequence import progress_text, state_text

    last = dataclasses.replace(connected().last, **changes.pop("last", {}))
    snapshot = dataclasses.replace(connected(), last=last, **changes)
    return state_text(snapshot), progress_text(snapshot)


def test_pressure_of_a_lost_board_is_unknown():
    """Unplugged at +30 kPa it was "Fault, vented": nothing tells so; the watchdog, where armed, is what vents."""
    armed = {"last": {"flags": SampleFlag.WATCHDOG_ARMED}, "state": SessionState.FAULT}
    vents = "the board vents by its watchdog within 3 s"
    assert shown(link=LinkState.LOST, **armed) == ("\u25a0 Link lost, pressure unknown", vents)
    health = HealthSnapshot(LinkStatistics(), None, None, 3.5, 0.0, None, None, None, ())
    assert shown(link=LinkState.LOST, health=health, **armed)[1] == "the board should have vented by its watchdog"
    assert shown(link=LinkState.OPENING, **armed) == ("\u25a0 Link lost, pressure unknown", vents)  # sought again
    closed = {"link": LinkState.CLOSED, "state": SessionState.ABORTED}
    assert shown(**closed, last={"pressure_kpa": 0.4})[0].endswith("early")
    was = "its last pressure was +30.0 kPa"
    assert shown(**closed) == ("\u25a0 Disconnected, pressure unknown", was)
    assert shown(link=LinkState.SILENT, **armed) == ("\u25a0 No data, pressure unknown", vents)
    assert shown(link=LinkState.LOST, speed=20.0, **armed)[1].endswith("within 5 s")
    assert "no watchdog" in shown(link=LinkState.LOST, state=SessionState.FAULT)[1]
    at = {"state": SessionState.FAULT, "last": {"target_kpa": math.nan}}
    assert shown(**at)[0] == "\u25a0 Fault, venting"
    restarted = {"state": BoardState.VENTED, "target_kpa": math.nan}  # at +17 kPa it was "Fault, vented"
    assert shown(**at | {"last": restarted})[0] == "\u25a0 Fault, venting"
    assert shown(**at | {"last": {"pressure_kpa": 0.4}})[0] == "\u25a0 Fault, vented"
    assert shown(**at | {"state": SessionState.PAUSED})[0] == "\u2016 Paused, venting"
    lost = "the link was lost"  # while an elongation was held: no run has ended
    assert shown(state=SessionState.FAULT, latched=lost)[1] == lost


def test_what_is_held_without_a_run_is_named():
    """Under closed loop at +28 kPa the state was "Idle"."""
    held = ElongationControl(2.0, 2.0, 1.99, 0.07)
    assert shown(elongation=held, last={"pressure_kpa": 28.04})[0] == "\u25cf Holding +2.00 mm at +28 kPa"
    for mm in (0.4, math.nan):  # the unit leaks, or nothing tells
        lost = dataclasses.replace(held, elongation_mm=mm)
        assert shown(elongation=lost, last={"pressure_kpa": 2.5})[0] == "\u25b2 Not at +2.00 mm"
    on_the_way = dataclasses.replace(held, setpoint_mm=1.2)
    assert shown(elongation=on_the_way)[0] == "\u25cf Moving to +2.00 mm at +30 kPa"
    assert shown()[0] == "\u25cf Holding +30 kPa"
    armed = shown(state=SessionState.ARMED, last={"target_kpa": 0.0, "pressure_kpa": 0.0})
    assert armed == ("\u25d4 Armed", "0 kPa is held: press VENT before Start")  # while Start is refused
    assert shown(last={"pressure_kpa": 12.0})[0] == "\u25cf Moving to +30 kPa"
    assert shown(last={"target_kpa": math.nan, "pressure_kpa": 0.2})[0] == "\u25cb Idle"


def test_a_pressure_that_is_not_there_or_not_known_is_named():
    """It was "Moving" for ever, "Idle" at +26 kPa after a refused vent, and "vented" with an invalid sensor."""
    aborted = {"state": SessionState.ABORTED, "run_ended": RunEnding(RunEnd.ABORTED, "50 kPa was not reached in time")}
    assert shown(last={"pressure_kpa": 0.1}, pressure_off=True)[0] == "\u25b2 Not at +30 kPa"
    vented, unknown = {"target_kpa": math.nan, "pressure_kpa": 26.0}, {"target_kpa": math.nan, "pressure_kpa": math.nan}
    assert shown(last=vented)[0] == "\u25cb Idle, at +26.0 kPa"
    assert shown(last=vented, state=SessionState.ARMED)[0] == "\u25d4 Armed, at +26.0 kPa"
    listening = {"can_command": False, "state": SessionState.FAULT}  # this program vents nothing there
    assert shown(last=vented, **listening)[0] == "\u25a0 Fault, at +26.0 kPa"
    assert shown(last=vented, **aborted)[0] == "\u25a0 Stopped early, venting"
    assert shown(last=vented, pressure_off=True, **aborted)[0] == "\u25a0 Stopped early, at +26.0 kPa"
    assert shown(last=unknown, state=SessionState.FAULT)[0] == "\u25a0 Fault, pressure unknown"
    assert shown(**aborted) == ("\u25cf Holding +30 kPa", "")  # by hand: the run before is over
