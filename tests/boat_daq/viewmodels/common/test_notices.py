"""Notices by weight and time, and attempts."""

from __future__ import annotations

import math
from dataclasses import replace

from boat_daq.engine.snapshot import LastSample, LinkState, Message, MessageKind, SessionSnapshot, SessionState
from boat_daq.viewmodels.common.notices import Notices, SessionMessages, Severity
from protocol.base.errors import RequestError
from protocol.base.units import Quantity, ShownUnits, UnitText
from protocol.recording import BoardState, SampleFlag


def test_current_notice_is_the_most_severe():
    """A fault stays over later warnings, an information leaves by itself, a dismissed one gives way."""
    now = [0.0]
    notices = Notices(lambda: now[0])
    notices.add(Severity.FAULT, "the port is gone")
    now[0] = 1.0
    notices.add(Severity.WARNING, "2 samples lost")
    now[0] = 5.0
    assert notices.current().cause == "the port is gone"
    now[0] = 10.0
    notices.inform("Saved")
    assert notices.current().cause == "Saved"  # it was hidden behind the older ones, and never seen
    now[0] = 16.5
    notices.inform("Saved")
    now[0] = 17.0
    notices.add(Severity.FAULT, "the port is gone")
    assert notices.current().cause == "the port is gone"
    assert notices.waiting() == 2
    notices.dismiss(notices.current())
    assert notices.current().cause == "Saved"
    notices.dismiss(notices.current())
    assert notices.current().cause == "2 samples lost"
    notices.dismiss(notices.current())
    now[0] = 60.0
    assert notices.current() is None


def test_message_has_the_units_and_the_minus_of_the_window():
    """Truth: 40 kPa = 400 mbar. The program's own texts and files have a hyphen; a name with one keeps it."""
    notices = Notices()
    cause = UnitText("no reading at ", Quantity(-40.0, "kPa", "+g"), ", cycle 1 of a-1.boat")
    assert cause == "no reading at -40 kPa, cycle 1 of a-1.boat"
    assert notices.add(Severity.WARNING, cause).cause == "no reading at \u221240 kPa, cycle 1 of a-1.boat"
    notices.units = ShownUnits.of("mbar")
    found = notices.add(Severity.WARNING, cause, UnitText("vent below ", Quantity(-1.0, "kPa")))
    assert found.sentences == "No reading at \u2212400 mbar, cycle 1 of a-1.boat. Vent below \u221210 mbar."


def test_attempt_never_raises():
    """An error of the program has cause and remedy; any other is shown with its details."""

    def refuse():
        raise RequestError("no port was chosen", "Choose one.")

    now = [0.0]
    notices = Notices(lambda: now[0])
    assert not notices.attempt(refuse)
    now[0] = 100.0
    assert notices.current() is None  # nobody waits for the answer any more
    assert not notices.attempt(refuse)
    assert (notices.current().cause, notices.current().remedy, notices.current().details) == (
        "no port was chosen",
        "Choose one.",
        "",
    )
    assert not notices.attempt(lambda: 1 / 0)
    assert "ZeroDivisionError" in notices.current().details
    assert notices.attempt(lambda: None, done="Saved")
    assert notices.waiting() == 2  # the refusal is new: it may not have been read yet
    now[0] = 110.0
    assert notices.attempt(lambda: None)
    assert notices.current().details  # the operator did something else: only the fault of the program waits
    assert notices.waiting() == 0


def test_a_file_name_keeps_its_first_letter() -> None:
    """It was shown as another file: D.toml."""
    from boat_daq.viewmodels.common.notices import sentence

    assert sentence("d.toml is not a plan") == "d.toml is not a plan."
    assert sentence("the port is gone") == "The port is gone."


def shown(*states):
    """Return the current notice after each (state, messages, alarms[, target]), in turn; None where there is none."""
    now, found = [0.0], []
    notices = Notices(lambda: now[0])
    follower = SessionMessages(notices, SessionSnapshot(SessionState.IDLE, LinkState.UP))
    for state, messages, alarms, *target in states:
        last = LastSample(0.0, 0.0, target[0] if target else math.nan, (), BoardState.IDLE, SampleFlag(0))
        follower.follow(SessionSnapshot(state, LinkState.UP, messages=messages, alarms=alarms, last=last))
        now[0] += 10.0
        found.append(notices.current() and (notices.current().severity, notices.current().cause))
    return found


def test_a_fault_of_a_run_leaves_with_the_fault_or_the_next_run():
    """In the next run the strip went on saying "50 kPa was not reached" of the one before."""
    late = Message(1, MessageKind.STEP_TIMEOUT, "error", "50 kPa was not reached in time")
    vented = Message(2, MessageKind.BOARD_VENTED, "error", "the board vented by itself")
    notice, fault = (Severity.FAULT, late.cause), (Severity.FAULT, vented.cause)
    aborted, running = (SessionState.ABORTED, (late,), ()), (SessionState.RUNNING, (late,), ())
    failed, cleared = (SessionState.FAULT, (late, vented), ()), (SessionState.IDLE, (late, vented), ())
    assert shown(aborted, aborted, running, failed, cleared) == [notice, notice, None, fault, None]


def test_what_ended_a_pressure_by_hand_leaves_when_one_is_held_again():
    """ "The elongation does not follow; vented" stood beside "Holding +1.00 mm"."""
    stopped = (Message(1, MessageKind.NOT_FOLLOWING, "error", "the elongation does not follow; vented"),)
    idle, held = (SessionState.IDLE, stopped, ()), (SessionState.IDLE, stopped, (), 12.0)
    notice = (Severity.FAULT, stopped[0].cause)
    assert shown(held, held, idle, held) == [notice, notice, notice, None]  # at first its last pressure is held


def test_an_alarm_leaves_once_it_is_over():
    """ "The signal of sensor 1 is constant" stayed after it had changed."""
    constant = (Message(1, MessageKind.FLAT_LINE, "warning", "the signal of sensor 1 is constant"),)
    on = (SessionState.IDLE, constant, (constant[0].cause,))
    assert shown(on, on, (SessionState.IDLE, constant, ())) == [(Severity.WARNING, constant[0].cause)] * 2 + [None]


def test_a_note_does_not_hide_a_fault_of_the_same_cause():
    """A refused watchdog was a fault, then a note for six seconds, then nothing."""
    refused = "the board refused HEARTBEAT"
    fault = Message(1, MessageKind.REFUSED, "error", refused)
    again = Message(2, MessageKind.REFUSED, "info", refused)
    assert (
        shown((SessionState.FAULT, (fault,), ()), (SessionState.FAULT, (fault, again), ()))
        == [(Severity.FAULT, refused)] * 2
    )


def test_a_link_lost_in_a_run_is_named_until_the_fault_is_cleared():
    """With the board back, only "reconnected" was left on the other pages: the run stood in fault."""
    notices = Notices()
    lost = SessionSnapshot(SessionState.FAULT, LinkState.LOST)
    follower = SessionMessages(notices, SessionSnapshot(SessionState.RUNNING, LinkState.UP))
    gone = (Message(1, MessageKind.LINK_LOST, "error", "SA1 was disconnected"),)
    follower.follow(replace(lost, messages=gone))
    assert notices.current().cause == gone[0].cause
    follower.follow(replace(lost, link=LinkState.UP, messages=gone))
    assert (notices.current().severity, notices.current().remedy) == (Severity.WARNING, "Clear the fault on Measure.")
    follower.follow(SessionSnapshot(SessionState.IDLE, LinkState.UP, messages=gone))
    assert notices.current() is None


def test_a_vent_without_a_board_leaves_once_one_is_connected():
    """ "No board is connected" stayed beside a connected board."""
    notices = Notices()
    closed, up = (SessionSnapshot(SessionState.IDLE, link) for link in (LinkState.CLOSED, LinkState.UP))
    follower = SessionMessages(notices, closed)
    vent = (Message(1, MessageKind.VENT, "error", "VENT was not sent: no board is connected"),)
    follower.follow(replace(closed, messages=vent))
    assert notices.current().cause == vent[0].cause
    follower.follow(replace(up, messages=vent))
    assert notices.current() is None
