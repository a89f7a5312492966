"""The table of readings: entries, pastes, warnings, the prompt."""

from __future__ import annotations

import dataclasses

import pytest

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import ReadingRequest, RunEnding, SessionState
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.readings import ReadingsModel, column_of_lengths, parse_mm
from protocol.base.errors import RequestError
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import RecordedSession, connected
from tests.boat_daq.viewmodels.helpers import PLAN


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


def test_warning_names_plateau_and_distance():
    """An outlier's warning has its millimetres; its tooltip plateau, cycle, value, and the fit's value."""
    session = read_session()
    mark = session.marks[13]
    session.add_reading(14, elongation(mark) + 2.0, "typed")
    row = ReadingsModel(session, UndoHistory()).rows(session.snapshot())[13]
    assert row.cells[-1].startswith("+") and row.cells[-1].endswith("?")
    assert (mark.target_kpa, mark.branch, mark.cycle) == (0.0, "loading", 1)
    assert " mm at 0 kPa, loading, cycle 1, the other readings give " in row.tip


@pytest.mark.parametrize(
    ("status", "detail", "word"),
    [("reached", {}, ""), ("reached", {"steady": False}, "not steady"), ("timeout", {}, "not reached"),
     ("aborted", {}, "interrupted")],
)  # fmt: skip
def test_row_shows_how_its_plateau_ended(status, detail, word):
    """Only a plateau that still drifted is called not steady; one that was never reached is called that."""
    session = RecordedSession(connected())
    session.marks = (dataclasses.replace(plateaus(1)[2], status=status, detail=detail),)
    (row,) = ReadingsModel(session, UndoHistory()).rows(session.snapshot())
    assert row.cells[-1] == word
    assert ("+30 kPa, unloading, cycle 1" in row.tip) is bool(word)


def test_interrupted_plateau_is_not_missing():
    """All but the plateau at which the run was paused were read: none is missing; one of them left out is."""
    session = RecordedSession(connected())
    cut = plateaus(1)[5]
    session.marks = (*plateaus(1)[:5], dataclasses.replace(cut, status="aborted"))
    model = ReadingsModel(session, UndoHistory())
    for mark in session.marks[:5]:
        session.add_reading(mark.number, 1.0, "typed")
    assert model.summary(session.snapshot()) == "5 of 5 plateaus read"
    session.add_reading(1, None, "typed")
    assert model.summary(session.snapshot()) == "4 of 5 plateaus read"


def test_plateaus_that_are_still_to_come_are_counted():
    """In a run of 19 plateaus "3 of 3 read" looked done, interrupted too; a cycle that is repeated adds its own."""
    session = RecordedSession(dataclasses.replace(connected(), plan=dataclasses.replace(PLAN, cycles=1)))
    first = plateaus(1)
    cut = dataclasses.replace(first[3], status="aborted")
    again = tuple(dataclasses.replace(mark, number=mark.number + 4) for mark in first)
    again = tuple(dataclasses.replace(mark, cycle=2) if mark.cycle else mark for mark in again)
    model = ReadingsModel(session, UndoHistory())
    ended = {"state": SessionState.IDLE, "run_ended": RunEnding(RunEnd.FINISHED)}
    for marks, changes, expected in (
        (first[:4], {}, 19),
        ((*first[:3], cut), {"state": SessionState.PAUSED}, 19),
        ((*first[:3], cut), {"run_ended": RunEnding(RunEnd.FAULT, "the link was lost")}, 19),
        ((*first[:3], cut, *again[:2]), {"state": SessionState.RUNNING}, 22),
        ((*first[:3], cut, *again), ended, 22),
        (first[:4], ended, 4),  # early, as the uncertainty was reached
    ):
        session.marks = marks
        session.change(**changes)
        assert model.summary(session.snapshot()) == f"0 of {expected} plateaus read"


def test_last_step_needs_no_reading():
    """The vent at the end is a step, but no plateau: it has no line, is not counted, and takes no value of a paste."""
    session = read_session(StepMark(99, 0, "end", 0.0, 0.0, 10**6, status="reached"))
    model, n = ReadingsModel(session, UndoHistory()), len(plateaus())
    rows = model.rows(session.snapshot())
    assert len(rows) == n
    assert model.summary(session.snapshot()) == f"{n} of {n} plateaus read"
    assert model.paste("\n".join(["1.5"] * n)) == n
    assert [r.step_id for r in session.kept[n:]] == [mark.number for mark in plateaus()]
    with pytest.raises(RequestError, match=f"for {n} plateaus"):
        model.paste("\n".join(["1"] * (n + 1)), 1)


def test_paste_enters_all_or_nothing():
    """A bad line is named and nothing is kept; a good column goes line by line from the chosen plateau on."""
    session = RecordedSession(connected())
    session.marks = plateaus(1)
    history = UndoHistory()
    model = ReadingsModel(session, history)
    with pytest.raises(RequestError, match="line 3"):
        model.paste("mm\n1.0\nx\n2.0", 1)
    assert session.kept == []
    assert model.paste("kPa\tmm\n50\t3,5\n40\t3,0\n", 2) == 2
    assert [(r.step_id, r.elongation_mm) for r in session.kept] == [(2, 3.5), (3, 3.0)]
    history.undo()
    assert [r.elongation_mm for r in session.kept[2:]] == [None, None]
    with pytest.raises(RequestError, match="for 19 plateaus"):
        model.paste("\n".join(["1"] * 40), 1)


def test_prompt_names_the_plateau():
    """The prompt has pressure, branch and cycle, and the row of the table is marked."""
    session = RecordedSession(dataclasses.replace(
        connected(), waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.1)))  # fmt: skip
    session.marks = plateaus(1)
    model = ReadingsModel(session, UndoHistory())
    assert model.question(session.snapshot()) == "At +30 kPa, unloading, cycle 1"
    assert [row.step.number for row in model.rows(session.snapshot()) if row.current] == [3]


@pytest.mark.parametrize(("text", "value"), [("2.31", 2.31), (" 2,31 mm", 2.31), ("\u22120.5", -0.5), ("+3", 3.0)])
def test_lengths_are_parsed_as_typed(text, value):
    """Comma or point, a typographic minus, a unit: all mean the same length."""
    assert parse_mm(text) == value


def test_length_beyond_the_actuator_is_refused():
    """90 mm cannot be an elongation of a 75 mm actuator: the unit was forgotten."""
    with pytest.raises(RequestError, match="longer than the actuator"):
        parse_mm("90")


def test_columns_of_a_spreadsheet():
    """Tabs, semicolons and commas part columns; the last one is taken; a heading and comments are left out."""
    assert column_of_lengths("# note\nkPa,mm\n50,3.5\n40,3.0\n") == [3.5, 3.0]
    assert column_of_lengths("50;3,5\r\n40;3,0\r\n") == [3.5, 3.0]
    assert column_of_lengths("3,5\n3,0\n") == [3.5, 3.0]


def nominal(kpa):
    """The nominal actuator, 0.07 mm/kPa, half of its band 0.55 mm."""
    return 0.07 * kpa, 0.55


def of_first_plateaus(*mm):
    """A model whose first plateaus have these readings, and the next plateau."""
    session = RecordedSession(connected())
    session.marks = plateaus(1)[: len(mm) + 1]
    for mark, value in zip(session.marks, mm, strict=False):
        session.add_reading(mark.number, value, "typed")
    return ReadingsModel(session, UndoHistory(), nominal), session.marks[-1]


def test_implausible_reading_is_named_before_it_is_entered():
    """25 mm at +30 kPa, and 2.50 mm at every plateau, used to pass in silence."""
    model, due = of_first_plateaus(3.5, 2.9)
    assert due.target_kpa == 30.0
    assert model.warning(due.number, "25") == "Model +2.1 \u00b10.6 mm"
    assert [model.warning(due.number, text) for text in ("2.0", "3.1", "", "-", "2..5")] == [""] * 5
    model, due = of_first_plateaus(2.5)
    assert model.warning(due.number, "2.5") == "The same as at +50 kPa"
    assert model.warning(due.number, "2.6") == ""
    model, due = of_first_plateaus(9.5, 8.9)
    assert model.warning(due.number, "8.1") == ""  # a unit with a longer stroke is asked about once


def test_reading_off_the_curve_so_far_is_named_without_a_nominal():
    """A unit that is not the nominal one is compared with its own readings."""
    session = read_session()
    session.marks = (*session.marks, dataclasses.replace(session.marks[-3], number=900))
    model = ReadingsModel(session, UndoHistory())
    right = elongation(session.marks[-1])
    assert model.warning(900, f"{right}") == ""
    assert f"Other readings give {right:+.0f}"[:-1] in model.warning(900, f"{right + 2}").replace("\u2212", "-")


def test_row_far_from_the_nominal_is_marked():
    """Pasted values pass no field: they are marked in the table."""
    model, _ = of_first_plateaus(3.5, 9.0)
    rows = model.rows(model.session.snapshot())
    assert [row.cells[-1] for row in rows] == ["", "model +2.8?", ""]
    assert "+9.00 mm at +40 kPa, unloading, cycle 1, model" in rows[1].tip


def test_text_that_was_not_entered_stays_with_its_plateau():
    """It is in the table until a reading of that plateau is entered; a plateau that has one keeps nothing."""
    model, due = of_first_plateaus(3.5)
    assert model.leave(1, "3.4") == model.leave(due.number, " ") == ""
    assert model.leave(due.number, "2.9 ") == "+40 kPa, unloading, cycle 1"
    assert model.rows(model.session.snapshot())[1].cells[-1] == "2.9: not entered"
    model.enter(due.number, "2.8")
    assert model.rows(model.session.snapshot())[1].cells[-2:] == ("2.80", "")
