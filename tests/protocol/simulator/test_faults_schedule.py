"""Names, values and times of the board's faults: how they are written, refused, and put in order."""

from __future__ import annotations

import pytest

from protocol.base.errors import ChoiceError, RequestError
from protocol.simulator.faults import FAULTS, Countdown, FaultSchedule, fault_list, make_fault, parse_fault


def test_unknown_name_leads_to_the_list() -> None:
    """The error names the command that lists them, and each has a sentence there."""
    with pytest.raises(ChoiceError) as refused:
        parse_fault("meteor@3")
    assert refused.value.command == "boat-daq board --fault list"
    assert all(kind.sentence in fault_list() for kind in FAULTS.values())


@pytest.mark.parametrize(
    "text",
    ["reset@x", "reset@-1", "reset@1:two", "reset@nan", "reset@1e30", "reset@1:9", "bit_flips@1:2", "estop@1:-3",
     "saturate@0:3"],
)  # fmt: skip
def test_impossible_times_and_values_are_refused(text):
    """No number, before power-on, or outside what the fault can have."""
    with pytest.raises(RequestError):
        parse_fault(text)


def test_parts_of_the_notation():
    """NAME@SECONDS[:VALUE]; without a value the table's, without a time from power-on."""
    assert parse_fault("estop@30") == make_fault("estop", 30.0, 5.0)
    assert parse_fault("estop@30").end_us == 35_000_000
    assert parse_fault("leak:3") == make_fault("leak", 0.0, 3.0)
    assert parse_fault("leak").end_us is None


def test_schedule():
    """Begin and end are reported once each, in order; a lasting fault is active in between; the latest wins."""
    schedule = FaultSchedule([make_fault("estop", 2, 3), make_fault("leak", 1, 5), make_fault("leak", 4, 9)])
    assert schedule.next_change_us == 1_000_000
    begun, ended = schedule.move_to(2_000_000)
    assert ([f.name for f in begun], ended) == (["leak", "estop"], [])
    assert schedule.active == {"leak": 5, "estop": 3}
    begun, ended = schedule.move_to(5_000_000)
    assert ([f.name for f in begun], [f.name for f in ended]) == (["leak"], ["estop"])
    assert schedule.active == {"leak": 9}
    assert schedule.next_change_us is None


def test_countdown():
    """Takes what is left and no more."""
    countdown = Countdown()
    countdown["duplicate"] += 3
    assert [countdown.take("duplicate", 2), countdown.take("duplicate", 2), countdown.take("duplicate")] == [2, 1, 0]
    assert not countdown
