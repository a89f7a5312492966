"""Commands and answers on a clock that is passed in. Times are in ms here."""

from __future__ import annotations

import pytest

from protocol import (
    ClearFault,
    Connection,
    Heartbeat,
    Identify,
    RequestError,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
)
from protocol.link.events import BoardRestarted, CommandDone, CommandLost, HelloReceived, LinkEvent, WrongProtocol
from protocol.link.framing import FrameReader
from protocol.link.messages import Ack, AckStatus, Command, Hello, MessageType, decode_command
from protocol.link.pending_commands import PendingCommands
from tests.protocol.link.streams import BOOTED, HELLO, START_DONE, sample, stream

MS = 1_000_000


class LinkRig:
    """A connection, and what its board received."""

    def __init__(self, *, in_turn: bool = False) -> None:
        self.link = Connection(in_turn=in_turn)
        self.board = FrameReader()

    def send(self, command: Command, at_ms: int) -> int:
        """Send and return the seq."""
        (frame,) = self.board.receive(self.link.send(command, at_ms * MS))
        assert decode_command(frame) == command
        return frame.seq

    def poll(self, at_ms: int) -> tuple[list[LinkEvent], list[tuple[Command | AckStatus, int]]]:
        """Poll and return the events, and what went out again with its seq."""
        events, data = self.link.poll(at_ms * MS)
        return events, [(decode_command(frame), frame.seq) for frame in self.board.receive(data)]

    def answer(self, type_: MessageType, seq: int, at_ms: int, status: int = 0) -> list[LinkEvent]:
        return self.link.receive(stream(Ack(type_, seq, status)), at_ms * MS)


@pytest.fixture
def rig() -> LinkRig:
    return LinkRig()


@pytest.fixture
def in_turn() -> LinkRig:
    return LinkRig(in_turn=True)


@pytest.mark.fault(17, how="no answer to a command", times=1)
def test_unanswered_command_is_sent_three_times_with_one_seq(rig: LinkRig) -> None:
    """At 0, 250 and 500 ms; lost at 750 ms, and nothing after that."""
    seq = rig.send(Vent(), 0)
    assert rig.poll(249) == ([], [])
    assert rig.poll(250) == ([], [(Vent(), seq)])
    assert rig.link.next_deadline_ns == 500 * MS
    assert rig.poll(500) == ([], [(Vent(), seq)])
    assert rig.poll(749) == ([], [])
    assert rig.poll(750) == ([CommandLost(Vent(), seq)], [])
    assert rig.poll(10_000) == ([], [])
    assert rig.link.next_deadline_ns is None
    assert rig.link.statistics.resent == 2


def test_host_that_slept_repeats_before_giving_up(rig: LinkRig) -> None:
    """After a stall of five seconds a command is repeated once and waited for, not given up three times over."""
    seq = rig.send(Vent(), 0)
    assert rig.poll(5000) == ([], [(Vent(), seq)])
    assert rig.poll(5100) == ([], [])
    assert rig.answer(MessageType.VENT, seq, 5200) == [CommandDone(Vent(), seq, AckStatus.DONE)]


@pytest.mark.parametrize("in_turn", [False, True])
def test_stall_of_the_program_is_not_a_silent_board(*, in_turn: bool) -> None:
    """Late to the last deadline by more than 100 ms: the answer, which may wait in the port, gets a window more."""
    rig = LinkRig(in_turn=in_turn)
    seq = rig.send(Heartbeat(5000), 0)
    rig.poll(250)
    rig.poll(500)
    assert rig.poll(1500) == ([], [])
    assert rig.poll(1749) == ([], [])
    answered = CommandDone(Heartbeat(5000), seq, AckStatus.DONE)
    assert rig.answer(MessageType.HEARTBEAT, seq, 1749) == [answered]
    assert rig.poll(10_000) == ([], [])


@pytest.mark.parametrize(("late_ms", "lost"), [(100, True), (101, False)])
def test_boundary_of_a_late_caller(rig: LinkRig, late_ms: int, *, lost: bool) -> None:
    """A read waits 50 ms; a turn of twice that is a stall."""
    rig.send(Heartbeat(5000), 0)
    rig.poll(250)
    rig.poll(500)
    assert bool(rig.poll(750 + late_ms)[0]) is lost
    assert bool(rig.poll(1000 + late_ms)[0]) is not lost


def test_program_that_keeps_stalling_still_gives_up(rig: LinkRig) -> None:
    """Three windows more, and no fourth."""
    seq = rig.send(Heartbeat(5000), 0)
    events = [rig.poll(at_ms)[0] for at_ms in range(1000, 9000, 1000)]
    assert events == [[], [], [], [], [], [CommandLost(Heartbeat(5000), seq)], [], []]


def test_nothing_is_given_up_before_the_backlog_is_read(rig: LinkRig) -> None:
    """The read began at 749 ms and was stalled behind it: bytes of 750 ms may wait in the port."""
    seq = rig.send(Heartbeat(5000), 0)
    rig.poll(250)
    rig.poll(500)
    assert rig.link.poll(800 * MS, 749 * MS) == ([], b"")
    assert rig.link.poll(801 * MS, 750 * MS) == ([CommandLost(Heartbeat(5000), seq)], b"")


@pytest.mark.parametrize("status", [*AckStatus, 99])
def test_every_answer_completes_its_command_with_its_status(rig: LinkRig, status: int) -> None:
    """The status of a refusal is passed on, also an unknown one."""
    seq = rig.send(SetPressure(50_000, 0), 0)
    (event,) = rig.answer(MessageType.SET_PRESSURE, seq, 10, status)
    assert event == CommandDone(SetPressure(50_000, 0), seq, status)
    assert rig.poll(10_000) == ([], [])


def test_answer_without_a_command_is_only_counted(rig: LinkRig) -> None:
    """An answer with a wrong seq or type, repeated or late, does not complete a command."""
    seq = rig.send(Vent(), 0)
    assert rig.answer(MessageType.VENT, seq + 1, 1) == []
    assert rig.answer(MessageType.STOP, seq, 2) == []
    assert len(rig.answer(MessageType.VENT, seq, 3)) == 1
    assert rig.answer(MessageType.VENT, seq, 4) == []
    assert rig.link.statistics.late_answers == 3


def test_vent_is_sent_at_once(rig: LinkRig) -> None:
    """With 50 commands pending and none answered, VENT is sent at once."""
    for timeout_ms in range(100, 150):
        rig.send(Heartbeat(timeout_ms), 0)
    rig.send(Vent(), 0)
    _, again = rig.poll(250)
    assert [command for command, _ in again] == [Heartbeat(149), Vent()]


def test_vent_does_not_wait_in_turn(in_turn: LinkRig) -> None:
    """With one command pending and fifty queued, VENT is sent at once, and only VENT is repeated."""
    overtaken, then = SetLimits(-1, 1), [Heartbeat(500), Stop()]
    limits = in_turn.send(overtaken, 0)
    assert all(in_turn.link.send(command, 0) == b"" for command in then)
    vent = in_turn.send(Vent(), 10)
    assert in_turn.poll(260) == ([], [(Vent(), vent)])
    in_turn.answer(MessageType.VENT, vent, 270)
    assert in_turn.poll(280) == ([], [(overtaken, limits)])  # what it overtook, with its own number
    in_turn.answer(MessageType.SET_LIMITS, limits, 290)
    assert in_turn.poll(290) == ([], [(then[0], vent + 1)])


@pytest.mark.parametrize("command", [Start(100), SetPressure(5, 0), SetLimits(-1, 1), Heartbeat(500), ClearFault()])
def test_nothing_is_sent_between_a_command_and_its_repeats(in_turn: LinkRig, command: Command) -> None:
    """A board may remember one type and seq only: a heartbeat before the repeat would have it act twice."""
    seq = in_turn.send(command, 0)
    other = Heartbeat(500) if isinstance(command, Start) else Start(9)
    assert in_turn.link.send(other, 240 * MS) == b""
    assert in_turn.poll(250) == ([], [(command, seq)])
    assert in_turn.poll(500) == ([], [(command, seq)])
    in_turn.answer(MessageType(0x81 + [Identify, Start, Stop, SetPressure, Vent, Heartbeat, ClearFault, SetLimits]
                            .index(type(command))), seq, 510)  # fmt: skip
    assert in_turn.link.next_deadline_ns == 0  # its turn has come
    assert in_turn.poll(510) == ([], [(other, seq + 1)])


@pytest.mark.parametrize("command", [Start(100), ClearFault()])
def test_start_and_clear_fault_are_not_repeated_after_a_vent(in_turn: LinkRig, command: Command) -> None:
    """A repeated START would restart the stream; without an answer it is reported as lost."""
    seq = in_turn.send(command, 0)
    in_turn.answer(MessageType.VENT, in_turn.send(Vent(), 10), 20)
    assert in_turn.poll(749) == ([], [])
    assert in_turn.poll(750) == ([CommandLost(command, seq)], [])


def test_queued_pressure_never_follows_a_vent(in_turn: LinkRig) -> None:
    """Queued before the VENT and not yet sent: dropped."""
    first = in_turn.send(Heartbeat(500), 0)
    assert in_turn.link.send(SetPressure(50_000, 0), 0) == b""
    vent = in_turn.send(Vent(), 5)
    in_turn.answer(MessageType.HEARTBEAT, first, 10)
    in_turn.answer(MessageType.VENT, vent, 10)
    assert in_turn.poll(10) == ([], [])
    assert in_turn.poll(10_000) == ([], [])


def test_a_fast_boards_watchdog_is_fed_with_the_repeat_itself(in_turn: LinkRig) -> None:
    """Where 250 ms are too long for a board's clock, a heartbeat brings the waiting command's repeat forward."""
    seq = in_turn.send(SetPressure(50_000, 0), 0)
    (frame,) = in_turn.board.receive(in_turn.link.feed(Heartbeat(5000), 50 * MS))
    assert (decode_command(frame), frame.seq) == (SetPressure(50_000, 0), seq)
    assert in_turn.poll(249) == ([], [])
    assert in_turn.poll(250) == ([], [(SetPressure(50_000, 0), seq)])


def test_no_pressure_is_repeated_after_vent(rig: LinkRig) -> None:
    """A SET_PRESSURE whose answer was lost is not repeated behind a VENT: it would pressurise a vented rig."""
    first = rig.send(SetPressure(50_000, 0), 0)
    vent = rig.send(Vent(), 100)
    assert rig.poll(260) == ([], [])
    assert rig.answer(MessageType.VENT, vent, 300) == [CommandDone(Vent(), vent, AckStatus.DONE)]
    assert rig.poll(10_000) == ([], [])
    assert rig.answer(MessageType.SET_PRESSURE, first, 10_001) == []


@pytest.mark.parametrize(
    ("older", "newer"),
    [(SetPressure(1, 0), SetPressure(2, 0)), (Heartbeat(500), Heartbeat(0)), (SetLimits(-1, 1), SetLimits(-2, 2)),
     (Start(10), Stop()), (Stop(), Start(10))],
)  # fmt: skip
def test_repetition_never_undoes_a_later_command(rig: LinkRig, older: Command, newer: Command) -> None:
    """Only the newer of two that contradict each other goes out again."""
    rig.send(older, 0)
    seq = rig.send(newer, 10)
    assert rig.poll(260) == ([], [(newer, seq)])


def test_a_superseded_command_still_gets_its_answer(rig: LinkRig) -> None:
    """A refusal that comes late is a refusal."""
    seq = rig.send(SetPressure(99_000, 0), 0)
    rig.send(SetPressure(1_000, 0), 1)
    (event,) = rig.answer(MessageType.SET_PRESSURE, seq, 5, AckStatus.OUT_OF_LIMITS)
    assert event == CommandDone(SetPressure(99_000, 0), seq, AckStatus.OUT_OF_LIMITS)


def test_dead_link_is_detected_though_every_command_is_superseded(rig: LinkRig) -> None:
    """A ramp with a new target every 100 ms is lost after 750 ms without an answer."""
    lost: list[LinkEvent] = []
    for step in range(8):
        rig.send(SetPressure(step, 0), 100 * step)
        lost += rig.poll(100 * step + 50)[0]
    assert lost == [CommandLost(SetPressure(0, 0), 0)]


def test_seq_counts_modulo_256_and_a_repeat_keeps_its_own(rig: LinkRig) -> None:
    """300 commands: numbers go round, and IDENTIFY begins with a lone 00."""
    assert [rig.send(Vent(), 0) for _ in range(300)] == [n % 256 for n in range(300)]
    assert rig.link.send(Identify(), 0).startswith(b"\0")


def test_a_hello_answers_identify(rig: LinkRig) -> None:
    """HELLO is first, then its IDENTIFY, without a status."""
    seq = rig.send(Identify(), 0)
    rig.poll(250)
    assert rig.link.receive(stream(HELLO), 300 * MS) == [HelloReceived(HELLO), CommandDone(Identify(), seq, None)]
    assert rig.link.hello == HELLO


def test_answer_to_a_repeated_identify_is_not_a_restart(rig: LinkRig) -> None:
    """Two IDENTIFYs are answered by two HELLOs with a sample between them: not a restart."""
    rig.send(Identify(), 0)
    rig.poll(250)
    events = rig.link.receive(stream(HELLO, sample(0), HELLO), 300 * MS)
    assert [type(event) for event in events].count(HelloReceived) == 2
    assert not any(isinstance(event, BoardRestarted) for event in events)


def test_reset_on_opening_the_port_is_not_a_restart(rig: LinkRig) -> None:
    """The HELLO of the boot and the requested one: the board had no state to lose."""
    rig.send(Identify(), 0)
    events = rig.link.receive(stream(HELLO, BOOTED, HELLO), 10 * MS)
    assert not any(isinstance(event, BoardRestarted) for event in events)


@pytest.mark.fault(10, how="HELLO, event or both in a session, with commands unanswered", times=4)
@pytest.mark.parametrize("boot", [(HELLO,), (BOOTED,), (HELLO, BOOTED), (BOOTED, HELLO)])
def test_restart_is_reported_once_and_gives_up_forgotten_commands(rig: LinkRig, boot: tuple) -> None:
    """After an unrequested HELLO or a "booted" pressure is never repeated, VENT is."""
    rig.send(Identify(), 0)
    rig.link.receive(stream(HELLO, START_DONE, sample(0)), 10 * MS)
    pressure, vent = rig.send(SetPressure(1, 0), 20), rig.send(Vent(), 20)
    rig.answer(MessageType.VENT, rig.send(Vent(), 21), 22)
    events = rig.link.receive(stream(*boot), 30 * MS)
    assert [isinstance(event, BoardRestarted) for event in events].count(True) == 1
    assert CommandLost(SetPressure(1, 0), pressure) in events
    assert rig.poll(270) == ([], [(Vent(), vent)])


def test_late_identify_answer_is_not_awaited_forever(rig: LinkRig) -> None:
    """After a lost IDENTIFY, an answer to a later command means that no HELLO is pending: the next one is a reboot."""
    rig.send(Identify(), 0)
    rig.poll(250)
    rig.link.receive(stream(HELLO), 260 * MS)
    rig.answer(MessageType.HEARTBEAT, rig.send(Heartbeat(500), 300), 310)
    (event, *_) = rig.link.receive(stream(HELLO), 400 * MS)
    assert event == BoardRestarted(HELLO)


def test_another_protocol_version_is_named_and_gets_no_start(rig: LinkRig) -> None:
    """Both versions are in the event and in the refusal; VENT, STOP and IDENTIFY are still sent."""
    values = {field: getattr(HELLO, field) for field in Hello.__dataclass_fields__}
    seq = rig.send(Identify(), 0)
    newer = stream(Hello(**{**values, "protocol": 2}))
    assert rig.link.receive(newer, 0) == [WrongProtocol(2, 1), CommandDone(Identify(), seq, None)]
    for command in (Start(100), SetPressure(0, 0), Heartbeat(500)):
        with pytest.raises(Exception, match="version 2, this program version 1") as caught:
            rig.link.send(command, 0)
        assert type(caught.value).__name__ == "RemoteError"
    rig.send(Vent(), 0)
    rig.send(Stop(), 0)
    assert rig.link.receive(stream(sample(0)), 0) == []
    assert rig.link.statistics.unknown == 1


def test_queued_command_is_never_sent_to_another_version(in_turn: LinkRig) -> None:
    """START was queued before the HELLO of another version."""
    in_turn.send(Identify(), 0)
    assert in_turn.link.send(Start(100), 0) == b""
    values = {field: getattr(HELLO, field) for field in Hello.__dataclass_fields__}
    in_turn.link.receive(stream(Hello(**{**values, "protocol": 2})), 0)
    assert in_turn.poll(10_000) == ([], [])


def test_value_that_does_not_fit_is_refused_without_a_seq(rig: LinkRig) -> None:
    """What cannot be sent leaves no trace in the numbering."""
    with pytest.raises(RequestError):
        rig.link.send(Start(70_000), 0)
    assert rig.send(Vent(), 0) == 0


def test_commands_out_of_turn_are_sent_at_once() -> None:
    """Unless it is asked for, none waits for the one before; the binary protocol commands pressure."""
    for link in (Connection(), PendingCommands()):
        assert link.send(Heartbeat(500), 0)
        assert link.send(Start(100), 0)
    assert Connection.can_command


def test_early_repeat_is_counted_once() -> None:
    """A heartbeat that would wait repeats the command before it; without one that waits, it is a command of its own."""
    start = Connection(in_turn=True)
    frame = start.send(Start(100), 0)
    assert start.feed(Heartbeat(500), MS) == frame
    assert start.statistics.resent == 1
    asking = Connection(in_turn=True)
    asking.send(Identify(), 0)
    assert asking.feed(Heartbeat(500), MS) == b""  # it waits for its turn
    assert asking.statistics.resent == 0


def test_hello_that_nobody_asked_for_leaves_no_debt() -> None:
    """One IDENTIFY, one HELLO due; with none sent, none is."""
    pending = PendingCommands()
    assert pending.hellos_due == 0
    assert pending.identified(0) == []
    assert pending.hellos_due == 0
    pending.send(Identify(), 0)
    assert pending.hellos_due == 1
    assert len(pending.identified(MS)) == 1
    assert pending.hellos_due == 0


def test_caller_is_late_from_one_nanosecond_beyond_100_ms() -> None:
    """At 100 ms after the last deadline the command is lost, a nanosecond later it has another window."""
    for late_ns, lost in ((100_000_001, False), (100_000_000, True)):
        rig = LinkRig()
        rig.send(Heartbeat(5000), 0)
        rig.poll(250)
        rig.poll(500)
        assert bool(rig.link.poll(750 * MS + late_ns)[0]) is lost


def test_backlog_of_a_late_caller_is_waited_for_up_to_100_ms(rig: LinkRig) -> None:
    """The last bytes were read before the deadline: 100 ms after it the answer may still wait in the port."""
    seq = rig.send(Heartbeat(5000), 0)
    rig.poll(250)
    rig.poll(500)
    assert rig.link.poll(850 * MS, 749 * MS) == ([], b"")
    assert rig.poll(851) == ([], [])  # now the program is late itself
    assert rig.poll(1101) == ([CommandLost(Heartbeat(5000), seq)], [])


def test_command_that_is_not_due_holds_up_no_other(rig: LinkRig) -> None:
    """The first was repeated and waits until 500 ms; the second is due at 350 ms."""
    rig.send(Vent(), 0)
    other = rig.send(SetLimits(-1, 1), 100)
    rig.poll(250)
    assert rig.poll(360) == ([], [(SetLimits(-1, 1), other)])


def test_lost_command_holds_up_no_other(rig: LinkRig) -> None:
    """One is late, one is waited for, one is lost: each on its own."""
    first, second = rig.send(Vent(), 0), rig.send(SetLimits(-1, 1), 0)
    for at_ms in (250, 500):
        rig.poll(at_ms)
    assert rig.poll(750) == ([CommandLost(Vent(), first), CommandLost(SetLimits(-1, 1), second)], [])


def test_impossible_value_is_refused_while_it_would_wait(in_turn: LinkRig) -> None:
    """At once, not when its turn comes; and a command that waits already waits once."""
    in_turn.send(Heartbeat(500), 0)
    with pytest.raises(RequestError):
        in_turn.link.send(Start(70_000), 0)
    assert [in_turn.link.send(Stop(), 0) for _ in range(2)] == [b"", b""]
    in_turn.answer(MessageType.HEARTBEAT, 0, 1)
    assert in_turn.poll(2) == ([], [(Stop(), 1)])
    in_turn.answer(MessageType.STOP, 1, 3)
    assert in_turn.poll(4) == ([], [])


def test_superseded_command_is_lost_only_where_nothing_was_answered_since() -> None:
    """An answer at the very instant it was sent counts."""
    for answered_ms, lost in ((None, True), (0, False)):
        rig = LinkRig()
        old = rig.send(SetPressure(1, 0), 0)
        new = rig.send(SetPressure(2, 0), 0)
        if answered_ms is not None:
            rig.answer(MessageType.SET_PRESSURE, new, answered_ms)
        events = [event for at_ms in (250, 500, 750) for event in rig.poll(at_ms)[0]]
        assert (CommandLost(SetPressure(1, 0), old) in events) is lost


def test_stall_gives_every_command_another_window(rig: LinkRig) -> None:
    """Two that were sent three times, and a program that was late by 750 ms."""
    rig.send(Vent(), 0)
    rig.send(SetLimits(-1, 1), 0)
    for at_ms in (250, 500, 1500):
        assert rig.poll(at_ms)[0] == []
    assert rig.link.next_deadline_ns == 1750 * MS


def test_heartbeat_that_feeds_is_sent_where_none_waits(rig: LinkRig, in_turn: LinkRig) -> None:
    """In turn with nothing pending; out of turn whatever is."""
    rig.send(Vent(), 0)
    for one, seq in ((in_turn, 0), (rig, 1)):
        (frame,) = one.board.receive(one.link.feed(Heartbeat(500), MS))
        assert (decode_command(frame), frame.seq) == (Heartbeat(500), seq)
