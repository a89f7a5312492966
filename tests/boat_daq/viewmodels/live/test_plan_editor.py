"""The editor of a plan of segments: every edit gives a plan, and is undone by the window's history."""

from __future__ import annotations

import numpy as np
import pytest

from boat_daq.engine.plan import Loop
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.plan_editor import PlanEditor
from boat_daq.viewmodels.live.sequence import SequenceModel, drawing
from protocol.base.errors import RequestError


@pytest.fixture
def editor(tmp_path) -> PlanEditor:
    undo = UndoHistory()
    made = PlanEditor(SequenceModel(None, undo, Preferences(tmp_path)))
    made.undo = undo
    made.new()
    return made


def targets(editor: PlanEditor) -> list[float]:
    return [segment.target for segment in editor.plan.segments]


def test_segments_are_added_moved_and_removed(editor):
    """Each begins where the one before leads; the last one is not removed."""
    editor.set_value(0, "target", "20")
    editor.add("ramp")
    editor.set_value(1, "target", "-30")
    editor.add("sine", 0)
    assert targets(editor) == [20.0, 20.0, -30.0]
    editor.move(2, -1)
    assert targets(editor) == [20.0, -30.0, 20.0]
    editor.remove(0)
    editor.remove(0)
    with pytest.raises(RequestError, match="at least one"):
        editor.remove(0)
    editor.undo.undo()
    assert targets(editor) == [-30.0, 20.0]


def test_loops_keep_their_segments(editor):
    """A segment added before or inside a loop, or removed from it, moves its ends; without any it goes."""
    for _ in range(3):
        editor.add("step")
    editor.add_loop("2", "3", "4")
    editor.add("step", 0)
    assert editor.plan.loops == (Loop(3, 4, 4),)
    editor.add("step", 2)
    assert editor.plan.loops == (Loop(3, 5, 4),)
    for _ in range(3):
        editor.remove(2)
    assert editor.plan.loops == ()
    with pytest.raises(RequestError, match="whole numbers"):
        editor.add_loop("1", "2", "2.5")
    editor.add_loop("1", "2", "2")
    editor.remove_loop(0)
    assert editor.plan.loops == ()


def test_entry_that_makes_no_plan_is_refused_and_the_plan_stays(editor):
    """Beyond the limits, not a number, a quarter period: the reason, and nothing changes."""
    editor.add("sine")
    before = editor.plan
    for key, text, reason in (("target", "90", "limits"), ("target", "x", "number"), ("periods", "1.3", "periods")):
        with pytest.raises(RequestError, match=reason):
            editor.set_value(1, key, text)
    with pytest.raises(RequestError):
        editor.set_plan("max_kpa", "-3")
    assert editor.plan == before
    editor.set_plan("max_kpa", "95")
    editor.set_value(1, "target", "80")
    assert targets(editor)[1] == 80.0


def test_preview_is_the_course_of_the_plan_with_limits_and_readings(editor):
    """A ramp is a slope, a sine a sine, a hold a level; readings are where they will be asked for."""
    editor.add("ramp")
    editor.set_value(1, "target", "20")
    editor.set_reading(1, True)
    editor.add("sine")
    curve = editor.curve((-35.0, 45.0))
    opening_s = editor.plan.min_dwell_s
    at = np.interp([opening_s + 5.0 + 1.0, opening_s + 5.0 + 2.0 + 5.0 + 2.5], curve.time_s, curve.value)
    np.testing.assert_allclose(at, [10.0, 30.0], atol=0.1)  # a chord of the sine
    assert curve.time_s[-1] == pytest.approx(editor.plan.duration_s)
    assert (curve.readings_s.tolist(), curve.readings.tolist()) == ([opening_s + 12.0], [20.0])
    assert curve.limits == (-40.0, 50.0, -35.0, 45.0)
    assert editor.summary == "3 segments run, 1 readings, about 1:05"
    drawn = drawing(editor.plan, 0.0, None)
    assert max(y for _, y in drawn.line) > 0.8 > drawn.zero


def test_staircase_is_taken_as_segments(editor, tmp_path):
    """A ramp to each plateau with its reading; the cycles become a loop."""
    editor._sequence.choose("calibration")
    assert not editor.editable
    editor.from_chosen()
    plan = editor.plan
    assert (plan.kind, len(plan.segments), plan.loops) == ("profile", 19, (Loop(2, 19, 5),))
    assert [segment.target for segment in plan.segments[:3]] == [50.0, 40.0, 30.0]
    assert all(segment.reading for segment in plan.segments)
    assert len(plan.unrolled) == 1 + 5 * 18


def test_values_may_be_millimetres(editor):
    """Their limits are not those of the pressure."""
    editor.set_quantity("mm")
    editor.add("ramp")
    assert editor.plan.segments[1].rate_per_s == 0.5
    assert editor.curve((-35.0, 45.0)).limits == ()
    editor.set_plan("name", "slow")
    editor.set_plan("cycles", "3")
    assert (editor.plan.name, editor.plan.cycles, editor.headings()[0]) == ("slow", 3, "Target (mm)")
