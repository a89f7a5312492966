"""Numbers as words, ranges, tables, matching, what is remembered and undone, notices."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common import formatting, tables
from boat_daq.viewmodels.common.matching import ranked
from boat_daq.viewmodels.common.notices import Notices, Severity
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.undo import Change, UndoHistory
from boat_daq.viewmodels.live import axis

finite = st.floats(-1e9, 1e9)


@pytest.mark.parametrize(
    ("value", "decimals", "sign", "text"),
    [
        (1702.42, 1, False, "1\u2009702.4"), (-0.04, 1, True, "0.0"), (-30.0, 1, True, "\u221230.0"),
        (2.0, 2, True, "+2.00"), (math.nan, 1, False, "\u2013"), (None, 1, False, "\u2013"),
        (math.inf, 1, False, "\u2013"),
    ],
)  # fmt: skip
def test_number(value, decimals, sign, text):
    """Fixed decimals, a real minus, no minus before zero, an en dash for what is not known."""
    assert formatting.number(value, decimals, sign=sign) == text


@given(finite, st.integers(0, 4))
def test_what_is_shown_can_be_typed(value, decimals):
    """A shown number, typed back, is the number to its decimals."""
    assert formatting.plain_number(formatting.number(value, decimals)) == pytest.approx(value, abs=0.51 * 10**-decimals)


@pytest.mark.parametrize("text", ["", "abc", "1..2", "nan", "inf", "1 2"])
def test_no_number_is_refused(text):
    """What is not one finite number raises."""
    with pytest.raises(ValueError):
        formatting.plain_number(text)


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (192.4, "3:12"), (3792, "1:03:12"), (math.nan, "\u2013")])
def test_duration(seconds, text):
    """Minutes and seconds, hours where there are any."""
    assert formatting.duration(seconds) == text


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4))
def test_a_framed_range_holds_its_data_on_the_ladder(low, span):
    """The range holds the data, is not much larger, and its tick step is 1, 2 or 5 times a power of ten."""
    high = low + span
    bottom, top = axis.framed(low, high)
    assert bottom <= low
    assert top >= high
    assert top - bottom <= 3.5 * max(high - low, 1e-9) + 1e-9 * abs(low)
    step = axis.tick_step(top - bottom)
    assert round(step / 10 ** math.floor(math.log10(step) + 1e-9)) in (1, 2, 5, 10)


def test_a_steady_range_grows_at_once_and_shrinks_late():
    """Data that leave the range widen it now; data that need less narrow it only after the patience."""
    steady = axis.SteadyRange(smallest=1.0, patience_s=1.5)
    first = steady.update(0.0, 10.0, 0.0)
    assert steady.update(2.0, 9.0, 0.1) == first
    wide = steady.update(0.0, 100.0, 0.2)
    assert wide[1] >= 100.0
    assert steady.update(0.0, 10.0, 1.0) == wide
    assert steady.update(0.0, 10.0, 2.0) == wide
    assert steady.update(0.0, 10.0, 2.6)[1] < 20.0


def test_a_steady_range_survives_nothing_to_show():
    """Without one finite value the range stays what it was, or begins somewhere sane."""
    steady = axis.SteadyRange(smallest=2.0)
    assert steady.update(math.nan, math.nan, 0.0) == (0.0, 2.0)
    kept = steady.update(-1.0, 1.0, 1.0)
    assert steady.update(math.nan, math.nan, 2.0) == kept
    assert axis.extremes(np.array([np.nan]), np.zeros(0)) == pytest.approx((math.nan, math.nan), nan_ok=True)


@pytest.mark.parametrize(
    ("time_s", "step", "text"), [(65, 5, "1:05"), (3780, 60, "1:03:00"), (2.4, 0.2, "2.4"), (-5, 5, "\u22120:05")]
)
def test_clock(time_s, step, text):
    """Tick labels are clock times; below a second, decimals."""
    assert axis.clock(time_s, step) == text


words = st.text(st.characters(exclude_categories=("Cc", "Cs", "Zl", "Zp")), max_size=8)


@pytest.mark.fault(49, how="any words, and those that a spreadsheet would run", times=100)
@given(st.lists(finite, max_size=5), st.lists(words | st.sampled_from(["=1+1", "+x", "-x", "@x", "\tx"]), max_size=5))
def test_a_saved_table_reads_back(numbers, texts):
    """Numbers come back to the last digit; a text that a spreadsheet would run stands behind an apostrophe."""
    text = tables.csv_text({"a": np.array(numbers), "b": texts})
    rows = list(csv.reader(io.StringIO(text, newline="")))
    assert rows[0] == ["a", "b"]
    assert [float(row[0]) for row in rows[1:] if row[0]] == numbers
    read = [row[1] for row in rows[1:]][: len(texts)]
    assert not any(cell.startswith(tables.FORMULA_STARTS) for cell in read)
    assert [
        cell[1:] if word.startswith(tables.FORMULA_STARTS) else cell for cell, word in zip(read, texts, strict=True)
    ] == texts


def test_commands_are_found_by_beginnings_first():
    """Words' beginnings come before letters inside, these before letters in order; no match is left out."""
    names = ["Save the plot as PNG", "Show the last 10 s", "Paste readings"]
    assert ranked("sa pl", names, str) == ["Save the plot as PNG"]
    assert ranked("wlt", names, str) == ["Show the last 10 s"]
    assert ranked("", names, str) == names
    assert ranked("xyz", names, str) == []


def test_preferences_last_and_a_broken_file_is_no_end(tmp_path):
    """What was set is there at the next start; a file that is no JSON begins anew; another kind is the default."""
    Preferences(tmp_path).set("window_s", 30.0)
    assert Preferences(tmp_path).get("window_s", 60.0) == 30.0
    assert Preferences(tmp_path).get("window_s", "text") == "text"
    (tmp_path / "window.json").write_text("{", encoding="utf-8")
    assert Preferences(tmp_path).get("window_s", 60.0) == 60.0


def test_history_undoes_in_order():
    """Undo takes the last change back first; redo does it again; a new change forgets what was undone."""
    values = [0]
    history = UndoHistory()
    for n in (1, 2):
        history.push(Change(f"{n}", lambda n=n: values.append(n), values.pop))
    history.undo()
    assert values == [0, 1]
    history.redo()
    assert values == [0, 1, 2]
    history.undo()
    history.push(Change("3", lambda: values.append(3), values.pop))
    assert values == [0, 1, 3]
    assert history.undone == []


def test_the_weightiest_notice_stands():
    """A fault stays over later warnings, an information leaves by itself, a dismissed one gives way."""
    now = [0.0]
    notices = Notices(lambda: now[0])
    notices.say(Severity.FAULT, "the port is gone")
    now[0] = 1.0
    notices.say(Severity.WARNING, "2 samples lost")
    notices.inform("Saved")
    assert notices.current().cause == "the port is gone"
    assert notices.waiting() == 2
    notices.dismiss(notices.current())
    assert notices.current().cause == "2 samples lost"
    notices.dismiss(notices.current())
    assert notices.current().cause == "Saved"
    now[0] = 60.0
    assert notices.current() is None


def test_an_attempt_never_raises():
    """An error of ours says cause and remedy; a stranger is shown with its details."""

    def refuse():
        raise OperatorError("no port was chosen", "Choose one.")

    notices = Notices()
    assert not notices.attempt(refuse)
    assert (notices.current().cause, notices.current().remedy, notices.current().details) == (
        "no port was chosen",
        "Choose one.",
        "",
    )
    assert not notices.attempt(lambda: 1 / 0)
    assert "ZeroDivisionError" in notices.current().details
    assert notices.attempt(lambda: None, done="Saved")
