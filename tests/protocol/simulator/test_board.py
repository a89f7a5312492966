"""The virtual board against the contract of protocol/SPEC.md, through bytes alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.base.errors import RequestError
from protocol.link.framing import encode_frame
from protocol.link.messages import (
    Ack,
    AckStatus,
    BoardEvent,
    ClearFault,
    EventCode,
    Heartbeat,
    Hello,
    Identify,
    MessageType,
    Sample,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
    encode_command,
)
from protocol.recording import BoardState, SampleFlag
from protocol.simulator.board import RATE_MAX_HZ, VirtualBoard
from protocol.simulator.board_control import HARD_LIMITS_PA
from protocol.simulator.faults import FAULTS, make_fault
from tests.protocol.simulator.board_host import BoardHost

DONE = AckStatus.DONE


def test_boot_sends_hello_and_its_reason():
    """At power-on a HELLO with a simulated identity is sent, then EVENT 1."""
    hello, event = BoardHost().received
    assert isinstance(hello, Hello)
    assert (hello.protocol, hello.n_sensors, hello.adc_bits, hello.vref_mv) == (1, 2, 12, 3300)
    assert (hello.pressure_min_pa, hello.pressure_max_pa) == HARD_LIMITS_PA
    assert hello.board_id == "SIMULATED-SA1"
    assert event == BoardEvent(0, EventCode.BOOTED, 0)


@pytest.mark.parametrize("unit", ["SA1", "SA2", "SA3", "SA1-falling", "SA2-falling", "SA3-falling"])
def test_every_identity_fits_and_is_simulated(unit):
    """16 ASCII characters hold each unit's identity, and no two are the same."""
    host = BoardHost(unit=unit)
    (hello,) = host.send(Identify())
    assert "SIMULATED" in hello.board_id
    assert hello.board_id.removesuffix("-F").endswith(unit.removesuffix("-falling"))


@pytest.mark.parametrize("rate_hz", [1, 3, 62, 100, 999, 10_000, RATE_MAX_HZ])
def test_samples_flow_from_start_to_stop(rate_hz):
    """index counts from 0 at every START, instant n is n / rate later, and STOP ends it."""
    host = BoardHost()
    host.wait(0.123457)
    for _ in range(2):
        host.received.clear()
        assert host.status_of(Start(rate_hz)) == DONE
        host.wait(1.0)
        host.wait(0.5)
        assert host.status_of(Stop()) == DONE
        host.wait(1.0)
        samples = host.samples
        index = [sample.index for sample in samples]
        since = np.array([sample.time_us - samples[0].time_us for sample in samples])
        assert index == list(range(int(1.5 * rate_hz) + 1))
        np.testing.assert_array_equal(since, np.array(index) * 1_000_000 // rate_hz)


@pytest.mark.parametrize(
    ("command", "status"),
    [
        (Start(0), AckStatus.OUT_OF_LIMITS),
        (Start(RATE_MAX_HZ + 1), AckStatus.OUT_OF_LIMITS),
        (SetPressure(55_001, 0), AckStatus.OUT_OF_LIMITS),
        (SetPressure(-45_001, 0), AckStatus.OUT_OF_LIMITS),
        (SetPressure(2**31 - 1, 2**32 - 1), AckStatus.OUT_OF_LIMITS),
        (Heartbeat(99), AckStatus.OUT_OF_LIMITS),
        (Heartbeat(5001), AckStatus.OUT_OF_LIMITS),
        (SetLimits(-46_000, 50_000), AckStatus.OUT_OF_LIMITS),
        (SetLimits(-40_000, 56_000), AckStatus.OUT_OF_LIMITS),
        (SetLimits(10_000, -10_000), AckStatus.OUT_OF_LIMITS),
        (ClearFault(), AckStatus.NOT_IN_THIS_STATE),
        (Stop(), DONE),
        (Vent(), DONE),
        (Heartbeat(100), DONE),
        (Heartbeat(0), DONE),
        (SetLimits(*HARD_LIMITS_PA), DONE),
        (SetPressure(55_000, 0), DONE),
    ],
    ids=str,
)
def test_answer_of_a_fresh_board(command, status):
    """Each command gets the status of the contract's table."""
    assert BoardHost().status_of(command) == status


def test_unknown_short_and_long_commands():
    """Unknown type: 1. Too short: 2. Longer than known: a newer minor version, executed. A board's type: no answer."""
    host = BoardHost()
    answers = []
    for seq, (type_, payload) in enumerate(
        [(0xF0, b""), (MessageType.START, b"\x64"), (MessageType.START, b"d\0\xff")]
    ):
        host.board.receive(encode_frame(type_, seq, payload))
        answers += host.wait(0.0)
    assert [answer.status for answer in answers if isinstance(answer, Ack)] == [1, 2, 0]
    host.board.receive(encode_frame(MessageType.SAMPLE, 9, b"x" * 22))
    assert not [m for m in host.wait(0.0) if isinstance(m, Ack)]


def test_damaged_commands_are_not_executed():
    """Any one flipped bit of a command is a command that never came."""
    frame = bytearray(encode_command(SetPressure(10_000, 0), 7))
    for place, bit in itertools.product(range(len(frame) - 1), range(8)):
        board = VirtualBoard()
        board.advance(0)
        damaged = frame.copy()
        damaged[place] ^= 1 << bit
        board.receive(bytes(damaged))
        assert board.advance(0) == b""


def test_repeated_command_is_answered_and_not_executed_again():
    """The same type and seq twice running: the same answer, no second START; another seq starts anew."""
    host = BoardHost()
    host.send(Start(100), seq=5)
    host.wait(1.0)
    first, *_ = host.send(Start(100), seq=5)
    assert first == Ack(MessageType.START, 5, DONE)
    assert host.wait(0.05)[0].index > 100
    host.send(Start(100), seq=6)
    assert host.wait(0.05)[0].index <= 1


def test_states_during_a_ramp():
    """IDLE until commanded, RAMPING, HOLDING within tolerance, RAMPING again, VENTED."""
    host = BoardHost()
    host.status_of(Start(100))
    host.wait(0.5)
    host.go_to(30.0)
    host.go_to(-20.0)
    host.status_of(Vent())
    host.wait(1.0)
    states = [state for state, _ in itertools.groupby(sample.state for sample in host.samples)]
    expected = ["IDLE", "RAMPING", "HOLDING", "RAMPING", "HOLDING", "VENTED"]
    assert [BoardState(state).name for state in states] == expected
    holding = [s.pressure_pa for s in host.samples if s.state == BoardState.HOLDING]
    assert all(min(abs(p - 30_000), abs(p + 20_000)) < 800 for p in holding)
    assert abs(host.samples[-1].pressure_pa) < 1_500


def test_lost_heartbeat_vents_and_latches():
    """Armed and unfed the board vents, is in FAULT, sends EVENT 4 with the ms; only CLEAR_FAULT ends it."""
    host = BoardHost()
    host.status_of(Start(100))
    assert host.status_of(Heartbeat(500)) == DONE
    host.go_to(40.0, seconds=0.4)
    for _ in range(10):
        host.status_of(Heartbeat(500))
        host.wait(0.4)
    assert host.codes == []
    assert host.board.pressure_kpa > 35.0
    assert all(s.flags & SampleFlag.WATCHDOG_ARMED for s in host.samples[2:])
    host.wait(2.5)
    (event,) = host.events
    assert (event.code, event.value) == (EventCode.HEARTBEAT_LOST, pytest.approx(500, abs=10))
    assert abs(host.board.pressure_kpa) < 0.1
    assert host.samples[-1].state == BoardState.FAULT
    assert host.status_of(SetPressure(0, 0)) == AckStatus.FAULT_LATCHED
    assert host.status_of(Heartbeat(0)) == AckStatus.NOT_IN_THIS_STATE
    assert host.status_of(Vent()) == DONE
    host.wait(0.1)
    assert host.samples[-1].state == BoardState.FAULT
    assert host.status_of(ClearFault()) == DONE
    host.wait(0.1)
    assert host.samples[-1].state == BoardState.VENTED


def test_any_good_frame_feeds_the_watchdog():
    """IDENTIFY, and even an unknown command, keeps it quiet; damaged bytes do not."""
    host = BoardHost()
    host.status_of(Heartbeat(300))
    for seq in range(10):
        host.board.receive(encode_frame(0xC7, seq))
        host.wait(0.25)
    assert host.codes == []
    for _ in range(3):
        host.board.receive(b"\x05\x85\x01noise\x00")
        host.wait(0.25)
    assert host.codes == [EventCode.HEARTBEAT_LOST]


def test_watchdog_is_disarmed_only_at_rest():
    """HEARTBEAT 0 is refused under pressure, executed once vented."""
    host = BoardHost()
    host.status_of(Heartbeat(1000))
    host.go_to(10.0, seconds=0.5)
    assert host.status_of(Heartbeat(0)) == AckStatus.NOT_IN_THIS_STATE
    host.status_of(Vent())
    assert host.status_of(Heartbeat(0)) == DONE
    host.wait(10.0)
    assert host.codes == []


def test_tightened_limits_bind():
    """Targets outside limits set by the host are refused; a pressure already beyond them by over 2 kPa is vented."""
    host = BoardHost()
    assert host.status_of(SetLimits(-30_000, 30_000)) == DONE
    assert host.status_of(SetPressure(30_001, 0)) == AckStatus.OUT_OF_LIMITS
    host.go_to(30.0)
    assert host.codes == []
    host.status_of(SetLimits(-30_000, 20_000))
    host.wait(1.0)
    (event,) = host.events
    assert event.code == EventCode.OVER_PRESSURE
    assert event.value == pytest.approx(30_000, abs=500)
    assert host.status_of(ClearFault()) == DONE


def test_target_outside_new_limits_is_replaced():
    """A target beyond a new limit is replaced by that limit, without venting."""
    host = BoardHost()
    host.go_to(50.0, seconds=0.5, ramp_kpa_per_s=10.0)
    host.status_of(SetLimits(-30_000, 20_000))
    host.wait(5.0)
    assert host.board.pressure_kpa == pytest.approx(20.0, abs=0.3)
    assert host.codes == []


@pytest.mark.parametrize("target", [HARD_LIMITS_PA[0], HARD_LIMITS_PA[1]])
def test_full_travel_between_the_limits_never_trips(target):
    """A target at a limit, as fast as the pumps go, overshoots by less than the 2 kPa that would vent."""
    host = BoardHost()
    for _ in range(3):
        host.go_to(target / 1000, ramp_kpa_per_s=0.0)
        host.go_to(0.0, ramp_kpa_per_s=0.0)
    assert host.codes == []


def test_full_transmit_buffer_drops_samples():
    """Samples beyond the free bytes are dropped and counted; the next one that fits is flagged; messages always fit."""
    host = BoardHost()
    host.status_of(Start(1000))
    host.take(host.board.advance(100_000))
    host.take(host.board.advance(1_000_000, free_bytes=1000))
    host.take(host.board.advance(1_000_000, free_bytes=0))
    assert host.status_of(Heartbeat(1000)) == DONE
    host.take(host.board.advance(100_000))
    index = np.array([sample.index for sample in host.samples])
    (gap,) = np.flatnonzero(np.diff(index) > 1)
    lost = int(index[gap + 1] - index[gap] - 1)
    assert lost > 1900
    assert host.events == [BoardEvent(host.samples[gap + 1].time_us, EventCode.SAMPLES_DROPPED, lost)]
    flagged = [s.index for s in host.samples if s.flags & SampleFlag.DROPPED_BEFORE]
    assert flagged == [index[gap + 1]]
    assert host.reader.crc_errors == host.reader.malformed == 0


def test_every_sample_has_its_true_values():
    """A truth record for every sample made, and the sample's values within noise of it."""
    board = VirtualBoard(log_truth=True)
    host = BoardHost()
    host.board = board
    host.wait(0.0)
    host.status_of(Start(200))
    host.go_to(50.0, seconds=8.0)
    truth = board.take_truth()
    assert truth["index"].tolist() == [s.index for s in host.samples]
    assert truth["time_us"].tolist() == [s.time_us for s in host.samples]
    pressure = np.array([s.pressure_pa for s in host.samples]) / 1000
    assert np.abs(pressure - truth["pressure_kpa"]).max() < 0.3
    signal = (np.array([s.lit for s in host.samples]) - np.array([s.dark for s in host.samples])) * 3300 / 4096
    assert (signal - truth["signal_mv"]).std(axis=0) == pytest.approx([1.49, 1.04], rel=0.06)
    assert truth["elongation_mm"][-1] == pytest.approx(3.8, abs=0.05)
    assert board.elongation_mm == pytest.approx(truth["elongation_mm"][-1], abs=0.01)
    assert board.take_truth().size == 0


def test_time_does_not_run_backwards():
    """A negative step is the caller's mistake."""
    with pytest.raises(ValueError, match="backwards"):
        VirtualBoard().advance(-1)


def test_unknown_unit_is_refused():
    """By name, with the names there are."""
    with pytest.raises(RequestError, match="SA7"):
        VirtualBoard("SA7")


COMMANDS = st.sampled_from(
    [Identify(), Start(100), Start(1000), Stop(), SetPressure(50_000, 0), SetPressure(-40_000, 30_000), Vent(),
     Heartbeat(300), Heartbeat(0), ClearFault(), SetLimits(-41_000, 51_000)]
)  # fmt: skip
SCRIPTS = st.lists(st.tuples(st.integers(0, 700_000), COMMANDS), max_size=8)
FAULT_SETS = st.lists(
    st.tuples(st.sampled_from(sorted(FAULTS)), st.floats(0.0, 2.0)).map(lambda row: make_fault(*row)), max_size=3
)


def play(board: VirtualBoard, script: list, steps: itertools.cycle) -> bytes:
    """All bytes of a board through a script, in steps of the given lengths."""
    out = bytearray()
    for seq, (pause, command) in enumerate([*script, (1_000_000, Identify())]):
        while pause > 0:
            step = min(pause, next(steps))
            out += board.advance(step)
            pause -= step
        board.receive(encode_command(command, seq))
    return bytes(out + board.advance(0))


@given(SCRIPTS, FAULT_SETS, st.integers(0, 5), st.lists(st.integers(3_000, 400_000), min_size=1, max_size=4))
def test_same_seed_and_bytes_give_the_same_bytes(script, faults, seed, steps):
    """However board time is cut up, and whatever goes wrong: the stream is the same, byte for byte."""
    whole = play(VirtualBoard(seed=seed, faults=faults), script, itertools.cycle([2**40]))
    parts = play(VirtualBoard(seed=seed, faults=faults), script, itertools.cycle(steps))
    assert parts == whole


def test_other_seed_other_noise():
    """The seed is the noise: another one gives other counts, the same truth."""
    streams, elongations = [], []
    for seed in (1, 2):
        host = BoardHost(seed=seed)
        host.status_of(Start(100))
        host.wait(1.0)
        streams.append([s.lit for s in host.samples])
        elongations.append(host.board.elongation_mm)
    assert streams[0] != streams[1]
    assert elongations == [0.0, 0.0]


@given(st.binary(max_size=600))
def test_received_garbage_changes_nothing(data):
    """Random bytes from the host raise nothing and pressurise nothing."""
    host = BoardHost()
    host.board.receive(data)
    host.wait(1.0)
    assert host.board.pressure_kpa == 0.0


@given(SCRIPTS)
def test_pressure_never_leaves_the_limits_on_command(script):
    """Whatever order of commands: the pressure stays within the hard limits and their 2 kPa."""
    host = BoardHost()
    for pause, command in script:
        host.wait(pause / 1e6)
        host.send(command)
        for _ in range(5):
            host.wait(0.2)
            assert HARD_LIMITS_PA[0] - 2000 <= 1000 * host.board.pressure_kpa <= HARD_LIMITS_PA[1] + 2000
    assert all(isinstance(m, Sample | Ack | Hello | BoardEvent) for m in host.received)


def test_samples_after_an_answer_have_its_state():
    """No sample behind an ACK or an event contradicts it, though the control ticks only every 10 ms."""
    host = BoardHost("estop@0.553:0.5")
    host.status_of(Start(10_000))
    host.wait(0.0521)
    for command, state in [(SetPressure(20_000), BoardState.RAMPING), (Vent(), BoardState.VENTED)]:
        assert host.status_of(command) == DONE
        first, *_ = host.wait(0.0002)
        assert first.state == state
    host.status_of(Heartbeat(5000))
    assert host.wait(0.0002)[0].flags & SampleFlag.WATCHDOG_ARMED
    seen = host.wait(0.52)
    after = seen[next(at for at, m in enumerate(seen) if isinstance(m, BoardEvent)) :]
    assert all(m.flags & SampleFlag.ESTOP and m.state == BoardState.FAULT for m in after if isinstance(m, Sample))


def test_samples_dropped_at_the_end_of_a_run_are_reported_there():
    """Without a following sample EVENT 9 precedes the ACK of STOP, and the next run begins unflagged."""
    host = BoardHost()
    host.status_of(Start(1000))
    host.wait(0.1)
    host.take(host.board.advance(100_000, free_bytes=0))
    event, ack = host.send(Stop())
    assert (event.code, event.value) == (EventCode.SAMPLES_DROPPED, 100)
    assert ack.status == DONE
    host.status_of(Start(1000))
    first, *_ = host.wait(0.01)
    assert (first.index, first.flags) == (0, 0)


def test_rebooted_board_reports_saturation_again():
    """The events before the reset are lost with all other state."""
    host = BoardHost("saturate@0.5:1", "reset@0.9")
    host.status_of(Start(100))
    host.wait(1.0)
    host.status_of(Start(100))
    host.wait(0.1)
    assert host.codes == [EventCode.SENSOR_SATURATED, EventCode.SENSOR_SATURATED]
