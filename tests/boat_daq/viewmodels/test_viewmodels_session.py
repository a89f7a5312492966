"""Live page, sequence, readings, photograph, overlay, connection: what each knows and decides."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.engine.plan import StepMark, built_in_plans
from boat_daq.engine.snapshot import LinkState, Phase, Progress, ReadingRequest, SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.undo import UndoHistory
from boat_daq.viewmodels.live.connection import link_text
from boat_daq.viewmodels.live.live_model import HEADINGS, HEADINGS_SHORT, LiveElongation, LiveModel, with_holes
from boat_daq.viewmodels.live.overlay import OverlayModel
from boat_daq.viewmodels.live.photograph import Photograph
from boat_daq.viewmodels.live.readings import ReadingsModel, column_of_lengths, parse_mm
from boat_daq.viewmodels.live.sequence import BUTTONS, SequenceModel, drawing, staircase
from protocol.recording import sample_dtype
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring, idle

PLAN = built_in_plans()["calibration"]


@pytest.fixture(scope="module")
def ring():
    return filled_ring(600.0)


# ---- live -----------------------------------------------------------------------------------------------------------


def test_a_frame_never_has_more_points_than_the_screen(ring):
    """Whatever the span, a frame holds a few points a pixel, and the extremes of all samples are in it."""
    model = LiveModel(lambda: ring, window_s=math.inf)
    frame = model.frame(800)
    assert frame.columns["time_s"].size <= 2400
    everything = ring.view()
    for name in ("s1_mv", "s2_mv", "pressure_kpa"):
        assert frame.columns[name].min() == everything[name].min()
        assert frame.columns[name].max() == everything[name].max()


@pytest.mark.parametrize("column_s", [0.01, 2.0])
def test_no_line_and_no_band_where_nothing_was_measured(column_s):
    """An unplugged board: the line breaks and the band closes over its hole; a lost sample breaks nothing."""
    time_s = np.repeat(np.arange(0.0, 400 * column_s, column_s), 2)
    time_s[200:] += 30 * max(column_s, 1.0)
    time_s[500:] += column_s
    columns = with_holes({"time_s": time_s, "s1_mv": np.ones(800)})
    assert np.flatnonzero(np.isnan(columns["s1_mv"])).tolist() == [200]
    assert time_s[199] < columns["time_s"][200] < time_s[200]
    mm = columns["s1_mv"]
    at, low, high = LiveElongation(mm, np.full(801, 0.5), np.zeros(801, bool)).band(columns["time_s"])
    inside = (at >= time_s[199]) & (at <= time_s[200])
    assert (high - low)[inside].tolist() == [1.0, 1.0, 0.0, 0.0, 1.0, 1.0]
    assert np.isfinite(low).all()


def test_following_and_looking_back(ring):
    """Following ends at the newest sample; a look at the past stays where it is; zoom keeps its anchor."""
    model = LiveModel(lambda: ring, window_s=30.0)
    assert model.span_s() == pytest.approx((569.99, 599.99))
    model.look_at(100.0, 120.0)
    model.zoom(0.5)
    assert model.span_s() == (105.0, 115.0)
    model.follow()
    model.zoom(2.0)
    assert model.span_s() == pytest.approx((539.99, 599.99))


def append(ring, time_s, *, s1_mv):
    """Add one sample to a filled ring."""
    sample = np.zeros(1, sample_dtype(2, "signal"))
    sample["time_us"], sample["host_ns"] = round(time_s * 1e6), round(time_s * 1e9)
    sample["signal_mv"] = s1_mv, 1624.0
    ring.append(sample)


def test_the_picture_moves_by_whole_columns_and_goes_on_in_between():
    """In between, what is drawn on begins where the picture ended and holds every newer sample, inside its ranges."""
    ring = filled_ring(60.0)
    model, now_s = LiveModel(lambda: ring, window_s=60.0), ring.view(last=1)["time_s"][0]
    drawn, moved, added = model.frame(800), 0, 0
    model.ranges(drawn, 0.0)
    column_s = 60.0 / 800
    for _ in range(100):
        now_s += 0.01
        append(ring, now_s, s1_mv=1640.0)
        more = model.newest(drawn, 800)
        if more is None:
            before, drawn = drawn, model.frame(800)
            model.ranges(drawn, 0.0)
            moved += 1
            assert (drawn.high_s - before.high_s) / column_s == pytest.approx(1.0)
        else:
            added += 1
            assert (more.low_s, more.high_s) == (drawn.low_s, drawn.high_s)
            assert more.columns["time_s"][0] == drawn.columns["time_s"][-1]
            assert more.columns["time_s"][-1] == pytest.approx(now_s)
            assert np.diff(more.columns["time_s"]) == pytest.approx(0.01)
        assert now_s <= drawn.high_s + 1e-9 <= now_s + column_s + 1e-6
    assert moved == pytest.approx(1.0 / column_s, abs=1.0)
    assert moved + added == 100


@pytest.mark.parametrize("what", ["leaves its range", "a hole", "another width", "held", "a calibration"])
def test_a_picture_that_must_change_is_drawn_anew(what):
    """A value outside the vertical range, a hole, another width, a look at the past, a calibration just loaded."""
    ring = filled_ring(60.0)
    model, now_s = LiveModel(lambda: ring, window_s=3600.0), ring.view(last=1)["time_s"][0]
    drawn = model.frame(800)
    model.ranges(drawn, 0.0)
    append(ring, now_s + 0.01, s1_mv=1640.0)
    assert model.newest(drawn, 800) is not None
    if what == "leaves its range":
        append(ring, now_s + 0.02, s1_mv=9000.0)
    elif what == "a hole":
        append(ring, now_s + 1.2, s1_mv=1640.0)
    elif what == "held":
        model.look_at(0.0, 30.0)
    elif what == "a calibration":
        model.inverse = lambda mv: LiveElongation(mv[:, 0], mv[:, 1], np.zeros(len(mv), bool))
    assert model.newest(drawn, 640 if what == "another width" else 800) is None


def test_nothing_to_draw_before_the_first_sample():
    """Without a ring there is no frame, no headline and no statistics, and no error either."""
    model = LiveModel(lambda: None)
    assert model.frame(800) is None
    assert not model.has_data()
    assert model.headline(idle()).pressure == "\u2013"
    assert model.statistics() == []


def test_statistics_between_the_cursors_agree_with_numpy(ring):
    """Mean, sd, extremes and slope are those of the samples between A and B, in whichever order they stand."""
    model = LiveModel(lambda: ring)
    model.put_cursor("a", 50.0)
    model.put_cursor("b", 40.0)
    first = model.statistics()[0]
    columns = ring.view()
    inside = (columns["time_s"] >= 40.0) & (columns["time_s"] <= 50.0)
    y, t = columns["s1_mv"][inside], columns["time_s"][inside]
    assert (first.mean, first.sd) == pytest.approx((y.mean(), y.std(ddof=1)))
    assert (first.low, first.high) == (y.min(), y.max())
    assert first.slope_per_s == pytest.approx(np.polyfit(t, y, 1)[0], rel=1e-6)
    at_a, at_b = y[t >= t[-1] - 0.2].mean(), y[t <= t[0] + 0.2].mean()
    assert first.difference == pytest.approx(at_b - at_a, rel=0.02)
    model.put_cursor("a", 30.0)
    model.put_cursor("b", 40.0)
    t, y = columns["time_s"], columns["s1_mv"]
    from_a, to_b = y[(t >= 30.0) & (t <= 30.2)].mean(), y[(t >= 39.8) & (t <= 40.0)].mean()
    assert model.statistics()[0].difference == pytest.approx(to_b - from_a, rel=0.02)
    assert all(len(span.cells) == len(HEADINGS) == len(HEADINGS_SHORT) + 1 for span in model.statistics())


def test_elongation_outside_the_range_is_said_not_shown(ring):
    """A signal outside the calibrated range gives a dash and the reason."""
    outside = LiveElongation(np.array([np.nan]), np.array([np.nan]), np.array([False]))
    model = LiveModel(lambda: ring, inverse=lambda signal: outside)
    head = model.headline(connected())
    assert (head.elongation, head.band) == ("\u2013", "outside the calibrated range")


@given(st.floats(1.0, 3600.0), st.integers(200, 3000))
def test_no_frame_is_paid_for_that_cannot_be_seen(window_s, width):
    """The frame interval is at least 60 a second and never slower than a byte may take to its pixel."""
    interval = LiveModel(lambda: None, window_s=window_s).frame_interval_ms(width, connected=True)
    assert 16 <= interval <= 45


# ---- sequence -------------------------------------------------------------------------------------------------------


def test_the_staircase_has_the_plans_own_duration():
    """The picture ends when the plan's estimate ends, and each step begins where the one before ended."""
    picture = staircase(PLAN)
    assert picture.time_s[-1] == pytest.approx(PLAN.duration_s)
    assert picture.step_starts_s.size == len(PLAN.steps)
    assert np.all(np.diff(picture.time_s) >= 0)
    assert set(picture.pressure_kpa[1::2]) == {step.target_kpa for step in PLAN.steps}


def test_the_done_part_ends_with_now():
    """The filled part is closed on the zero line, at the share of the time that has passed."""
    picture = staircase(PLAN)
    half = picture.time_s[-1] / 2
    shown = drawing(picture, half, (-40.0, 50.0))
    assert shown.done[0] == (0.0, shown.zero)
    assert shown.done[-1] == (pytest.approx(0.5), shown.zero)
    assert drawing(picture, 0.0, None).done == ()


def test_every_state_has_its_buttons():
    """No state of a session is without a line in the table, and every button does something."""
    assert set(BUTTONS) == set(SessionState)
    session = RecordedSession(connected())
    model = SequenceModel(session, UndoHistory())
    for button in {b for row in BUTTONS.values() for b in row}:
        model.press(button)
    assert sorted(session.asked) == sorted(["arm", "start", "disarm", "pause", "resume", "stop", "clear_fault"])


def test_a_board_that_cannot_be_commanded_offers_nothing():
    """A replay or a text profile shows data; no button of the run is offered."""
    session = RecordedSession(dataclasses.replace(connected(), can_command=False))
    assert SequenceModel(session, UndoHistory()).allowed(session.snapshot()) == ()


@pytest.mark.parametrize(
    ("key", "text", "part"),
    [
        ("cycles", "2.5", "whole number"),
        ("cycles", "zero", "not a number"),
        ("step_kpa", "7", "divide"),
        ("high_kpa", "80", "limit"),
    ],
)
def test_a_bad_entry_is_refused_and_changes_nothing(key, text, part):
    """The refusal names the reason; the plan stays as it was."""
    model = SequenceModel(RecordedSession(idle()), UndoHistory())
    assert part in model.edit(key, text)
    assert model.plan == PLAN


def test_an_entry_is_kept_and_undone():
    """A good entry changes the plan through the history."""
    history = UndoHistory()
    model = SequenceModel(RecordedSession(idle()), history)
    assert model.edit("low_kpa", "\u221230") == ""
    assert model.plan.low_kpa == -30.0
    history.undo()
    assert model.plan == PLAN


# ---- readings -------------------------------------------------------------------------------------------------------


def plateaus(cycles=2):
    """Marks of a whole staircase."""
    return tuple(
        StepMark(i, step.cycle, step.branch, step.target_kpa, 10.0, 1000 * i, status="reached")
        for i, step in enumerate(dataclasses.replace(PLAN, cycles=cycles).steps, 1)
    )


def elongation(mark):
    """A smooth elongation with a loop between the branches."""
    u = mark.target_kpa / 50
    return round(2 * (0.14 + 3.6 * u + 0.1 * u**2 - (0.2 * (1 - u**2) if mark.branch == "loading" else 0.0))) / 2


def read_session(*more):
    """A session whose plateaus were all read; `more` marks follow them."""
    session = RecordedSession(connected())
    session.marks = (*plateaus(), *more)
    for mark in plateaus():
        session.add_reading(mark.number, elongation(mark), "typed")
    return session


def test_a_remark_says_which_plateau_and_how_much():
    """An outlier's remark has its millimetres; its hover plateau, cycle, value, and what the fit says there."""
    session = read_session()
    mark = session.marks[13]
    session.add_reading(14, elongation(mark) + 2.0, "typed")
    row = ReadingsModel(session, UndoHistory()).rows(session.snapshot())[13]
    assert row.cells[-1].startswith("+") and row.cells[-1].endswith(" mm?")
    assert (mark.target_kpa, mark.branch, mark.cycle) == (0.0, "loading", 1)
    assert " mm at 0 kPa, loading, cycle 1, where the running fit says " in row.hover


@pytest.mark.parametrize(
    ("status", "detail", "word"),
    [("reached", {}, ""), ("reached", {"steady": False}, "not steady"), ("timeout", {}, "not reached"),
     ("aborted", {}, "cut short")],
)  # fmt: skip
def test_what_became_of_a_plateau_stands_in_its_line(status, detail, word):
    """Only a plateau that still drifted is called not steady; one that was never reached is called that."""
    session = RecordedSession(connected())
    session.marks = (dataclasses.replace(plateaus(1)[2], status=status, detail=detail),)
    (row,) = ReadingsModel(session, UndoHistory()).rows(session.snapshot())
    assert row.cells[-1] == word
    assert ("+30 kPa, unloading, cycle 1" in row.hover) is bool(word)


def test_a_plateau_that_was_cut_short_is_not_missing():
    """All but the plateau at which the run was paused were read: none is missing; one of them left out is."""
    session = RecordedSession(connected())
    cut = plateaus(1)[5]
    session.marks = (*plateaus(1)[:5], dataclasses.replace(cut, status="aborted"))
    model = ReadingsModel(session, UndoHistory())
    for mark in session.marks[:5]:
        session.add_reading(mark.number, 1.0, "typed")
    assert model.summary(model.rows(session.snapshot())) == "all 5 plateaus read"
    session.add_reading(1, None, "typed")
    assert model.summary(model.rows(session.snapshot())) == "4 of 5 plateaus read"


def test_the_way_out_asks_for_no_reading():
    """The vent at the end is a step, but no plateau: it has no line, is not counted, and takes no value of a paste."""
    session = read_session(StepMark(99, 0, "end", 0.0, 0.0, 10**6, status="reached"))
    model, n = ReadingsModel(session, UndoHistory()), len(plateaus())
    rows = model.rows(session.snapshot())
    assert len(rows) == n
    assert model.summary(rows) == f"all {n} plateaus read"
    assert model.paste("\n".join(["1.5"] * n)) == n
    assert [r.step_id for r in session.kept[n:]] == [mark.number for mark in plateaus()]
    with pytest.raises(OperatorError, match=f"only {n} plateaus"):
        model.paste("\n".join(["1"] * (n + 1)), 1)


def test_a_paste_enters_all_or_nothing():
    """A bad line is named and nothing is kept; a good column goes line by line from the chosen plateau on."""
    session = RecordedSession(connected())
    session.marks = plateaus(1)
    history = UndoHistory()
    model = ReadingsModel(session, history)
    with pytest.raises(OperatorError, match="line 3"):
        model.paste("mm\n1.0\nx\n2.0", 1)
    assert session.kept == []
    assert model.paste("kPa\tmm\n50\t3,5\n40\t3,0\n", 2) == 2
    assert [(r.step_id, r.elongation_mm) for r in session.kept] == [(2, 3.5), (3, 3.0)]
    history.undo()
    assert [r.elongation_mm for r in session.kept[2:]] == [None, None]
    with pytest.raises(OperatorError, match="plateaus follow"):
        model.paste("\n".join(["1"] * 40), 1)


def test_the_question_names_the_plateau():
    """The window asks with pressure, branch and cycle, and the row of the table is marked."""
    session = RecordedSession(dataclasses.replace(
        connected(), waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.1, 99.0)))  # fmt: skip
    session.marks = plateaus(1)
    model = ReadingsModel(session, UndoHistory())
    assert model.question(session.snapshot()) == "Elongation at +30 kPa, unloading, cycle 1"
    assert [row.step_id for row in model.rows(session.snapshot()) if row.current] == [3]


@pytest.mark.parametrize(("text", "value"), [("2.31", 2.31), (" 2,31 mm", 2.31), ("\u22120.5", -0.5), ("+3", 3.0)])
def test_lengths_as_people_type_them(text, value):
    """Comma or point, a typographic minus, a unit: all mean the same length."""
    assert parse_mm(text) == value


def test_a_length_longer_than_the_actuator_is_refused():
    """90 mm cannot be an elongation of a 75 mm actuator: the unit was forgotten."""
    with pytest.raises(OperatorError, match="longer than the actuator"):
        parse_mm("90")


def test_columns_of_a_spreadsheet():
    """Tabs, semicolons and commas part columns; the last one is taken; a heading and comments are left out."""
    assert column_of_lengths("# note\nkPa,mm\n50,3.5\n40,3.0\n") == [3.5, 3.0]
    assert column_of_lengths("50;3,5\r\n40;3,0\r\n") == [3.5, 3.0]
    assert column_of_lengths("3,5\n3,0\n") == [3.5, 3.0]


# ---- photograph -----------------------------------------------------------------------------------------------------


@given(st.floats(0, 2 * math.pi), st.floats(2.0, 40.0), st.floats(-5.0, 5.0), st.floats(-200.0, 200.0))
def test_a_turned_and_scaled_picture_gives_the_same_elongation(angle, pixels_per_mm, mm, shift):
    """Turning, scaling and shifting the camera changes nothing; a sideways miss of the tip does not count."""
    along = np.array([math.cos(angle), math.sin(angle)]) * pixels_per_mm
    across = np.array([-along[1], along[0]])
    place = np.array([shift, -shift])
    photo = Photograph(distance_mm=10.0)
    for spot in (0 * along, 10 * along, 60 * along, (60 + mm) * along + 0.7 * across):
        photo = photo.click(*(place + spot))
    assert photo.elongation_mm == pytest.approx(mm, abs=1e-9)
    assert photo.resolution_mm > math.sqrt(24) * photo.click_px / pixels_per_mm * 0.999


def test_clicks_go_back_and_the_scale_stays():
    """A fifth click corrects the tip; the next picture keeps scale and rest; two clicks on one spot give no scale."""
    photo = Photograph().click(0, 0).click(100, 0).click(50, 0).click(60, 0).click(70, 0)
    assert photo.elongation_mm == pytest.approx(2.0)
    assert photo.next_picture().clicks == photo.clicks[:3]
    assert photo.back().elongation_mm is None
    assert Photograph().click(5, 5).click(5, 5).mm_per_pixel is None
    with pytest.raises(ValueError, match="0"):
        photo.with_distance(0.0)


# ---- overlay and link -----------------------------------------------------------------------------------------------


def test_cycles_lie_over_each_other_from_their_beginnings(ring):
    """Each cycle's trace begins at 0 and holds the samples of its own steps."""
    marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in range(1, 4)
    )
    model = OverlayModel(lambda: ring, lambda: marks, lambda time_us: time_us / 1e6)
    cycles = model.cycles()
    assert [c.number for c in cycles] == [1, 2, 3]
    for cycle in cycles:
        assert cycle.time_s[0] == pytest.approx(0.0, abs=0.3)  # a thinned point may lie just before
        assert cycle.time_s[-1] == pytest.approx(36.0, abs=0.3)


@pytest.mark.parametrize("link", list(LinkState))
def test_every_link_state_has_colour_shape_and_word(link):
    """No state of the link is told by its colour alone."""
    text = link_text(dataclasses.replace(idle(), link=link))
    assert text.state
    assert text.shape
    assert text.word


def test_progress_in_a_line():
    """Cycle, step, phase and time left are said in the lab's words."""
    from boat_daq.viewmodels.live.sequence import progress_text

    progress = Progress(
        "calibration", 9, 37, 1, 2, 0, (), "unloading", Phase.WAITING_FOR_READING, -30.0, 3.0, 60.0, 227.0
    )
    text = progress_text(dataclasses.replace(connected(), progress=progress))
    assert text == "cycle 1 of 2   step 9 of 37   3:47 left   waiting for the reading at \u221230 kPa"
    paused = dataclasses.replace(progress, phase=Phase.VENTING)
    text = progress_text(dataclasses.replace(connected(), progress=paused, state=SessionState.PAUSED))
    assert text == "cycle 1 of 2   step 9 of 37   3:47 left   goes on with a whole cycle"


# ---- profiles -------------------------------------------------------------------------------------------------------


def test_a_pasted_rx8_line_becomes_a_profile():
    """The line of the shipped profile, pasted bare, describes the same columns; other variables are skipped."""
    from boat_daq.viewmodels.live.profiles import profile_text
    from protocol.text.profile import load_profile

    line = "RX8 [h=43] @1T @0T @1P @0P @1S1 @0S1 @1S2 @0S2 @0Aux [t=00]"
    profile = load_profile(profile_text(line))
    assert sorted(column.name for column in profile.columns) == ["pressure", "s1_signal", "s2_signal", "time"]
    assert profile.n_sensors == 2
    assert profile_text(" some/profile.toml ") == "some/profile.toml"
    with pytest.raises(OperatorError, match="no sensor"):
        profile_text("RX8 [h=43] @0A [t=00]")
    with pytest.raises(OperatorError, match="no pressure"):
        profile_text("RX8 [h=43] @1S1 @0S1 [t=00]")


@pytest.mark.parametrize(
    ("port", "text"),
    [
        ("COM3", "COM3"),
        ("replay:/a/b/SA1.boat@20", "replay of SA1.boat"),
        ("/dev/serial/by-id/" + "x" * 40, "\u2026" + "x" * 28),
    ],
)
def test_a_port_has_room_in_the_head(port, text):
    """A replay is named by its file, a long path by its end."""
    from boat_daq.viewmodels.live.connection import short_port

    assert short_port(port) == text
