"""What the firmware does that the virtual board has no need of: its own regulator, a late main loop, a full buffer."""

from __future__ import annotations

import itertools

import pytest

from protocol.link.framing import FrameReader
from protocol.link.messages import (
    Ack,
    AckStatus,
    BoardEvent,
    BoardMessage,
    Command,
    EventCode,
    Heartbeat,
    Hello,
    Identify,
    Sample,
    SetPressure,
    Start,
    Stop,
    Vent,
    decode_message,
    encode_command,
)
from protocol.recording import BoardState, SampleFlag
from tests.firmware.firmware_build import Bench


class Lab:
    """A booted firmware at ambient pressure, and the samples it has sent."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._reader = FrameReader()
        self._seq = itertools.count()
        self.samples: list[Sample] = []
        self.order("Z")
        self.boot()

    def boot(self) -> list[BoardMessage]:
        """Boot, whatever the switches are; return what is said."""
        return self._hear(self._bench.boot())

    def order(self, order: str) -> list[BoardMessage]:
        """Give an order to the bench; return what is said meanwhile."""
        return self._hear(self._bench.order(order))

    def _hear(self, data: bytes) -> list[BoardMessage]:
        messages = [decode_message(frame, 2) for frame in self._reader.receive(data)]
        self.samples += [message for message in messages if isinstance(message, Sample)]
        return [message for message in messages if message is not None]

    def send(self, command: Command) -> list[BoardMessage]:
        """Send a command; return what is said at once."""
        return self.order("R " + encode_command(command, next(self._seq) % 256).hex())

    def ask(self, command: Command) -> int:
        """Send a command; return its status."""
        (answer,) = [message for message in self.send(command) if isinstance(message, Ack)]
        return answer.status

    @property
    def gauge(self) -> tuple[int, int, int, int]:
        """Pressure Pa, drive permille, valve open, state."""
        pressure_pa, permille, vent, state = map(int, self._bench.tell("Q").split())
        return pressure_pa, permille, vent, state


@pytest.fixture
def lab(bench: Bench) -> Lab:
    """A firmware that has just booted at ambient pressure."""
    return Lab(bench)


@pytest.mark.parametrize("ramp_kpa_per_s", [2, 10, 40])
def test_regulator_follows_the_ramp_and_holds(lab: Lab, ramp_kpa_per_s: int) -> None:
    """Up and down through the whole range: on target when the ramp is over, less than 2 kPa beyond it, then HOLDING."""
    lab.ask(Start(100))
    before_kpa = 0
    for target_kpa in (50, -40, 0):
        assert lab.ask(SetPressure(1000 * target_kpa, 1000 * ramp_kpa_per_s)) == AckStatus.DONE
        ticks = 100 * abs(target_kpa - before_kpa) // ramp_kpa_per_s + 100
        samples = [m for m in lab.order(f"G {ticks}") if isinstance(m, Sample)]
        ahead = 1 if target_kpa > before_kpa else -1
        assert max(ahead * (sample.pressure_pa - 1000 * target_kpa) for sample in samples) < 2000
        pressure_pa, _, vent, state = lab.gauge
        assert (vent, state) == (0, BoardState.HOLDING)
        assert pressure_pa == pytest.approx(1000 * target_kpa, abs=100)
        before_kpa = target_kpa


def test_regulator_makes_a_leak_good(lab: Lab) -> None:
    """A bladder that loses 5 % a second is held within the tolerance of its target."""
    lab.order("L 0.05 90")
    lab.ask(SetPressure(40_000, 20_000))
    lab.order("G 600")
    pressure_pa, permille, _, state = lab.gauge
    assert state == BoardState.HOLDING
    assert pressure_pa == pytest.approx(40_000, abs=500)
    assert permille > 0


def test_a_target_out_of_the_pumps_reach_is_given_up(lab: Lab) -> None:
    """2 s of ramp and 8 s of patience, then EVENT 8 with the pressure reached; vented, FAULT."""
    lab.order("L 0 30")
    lab.ask(SetPressure(40_000, 20_000))
    (event,) = lab.order("G 1100")
    assert isinstance(event, BoardEvent)
    assert (event.code, event.value) == (EventCode.TARGET_NOT_REACHED, 30_000)
    assert event.time_us == pytest.approx(10_000_000, abs=10_000)
    assert lab.gauge[2:] == (1, BoardState.FAULT)


def test_a_dead_host_finds_the_board_vented(lab: Lab) -> None:
    """Under pressure and unfed for 500 ms the valve opens; the event waits in the log."""
    lab.ask(Heartbeat(500))
    lab.ask(SetPressure(40_000, 0))
    lab.order("G 49")
    assert lab.gauge[2:] == (0, BoardState.RAMPING)
    (event,) = lab.order("G 1")
    assert (event.code, event.value) == (EventCode.HEARTBEAT_LOST, 500)
    assert lab.gauge[1:] == (0, 1, BoardState.FAULT)
    lab.order("G 200")
    assert lab.gauge[0] < 1000


def test_valve_opens_with_the_command_not_with_the_next_tick(lab: Lab) -> None:
    """VENT sets the valve before it is answered."""
    lab.ask(SetPressure(40_000, 0))
    lab.order("G 20")
    assert lab.gauge[2] == 0
    lab.ask(Vent())
    assert lab.gauge[1:] == (0, 1, BoardState.VENTED)


def test_estop_pressed_at_power_on_is_a_level(lab: Lab) -> None:
    """No event tells of it, but the board is in FAULT and stays there; its release is told."""
    lab.order("E 1")
    hello, booted = lab.boot()
    assert isinstance(hello, Hello)
    assert booted.code == EventCode.BOOTED
    assert lab.gauge[3] == BoardState.FAULT
    (event,) = lab.order("E 0")
    assert event.code == EventCode.ESTOP_RELEASED


def test_samples_without_room_are_counted_exactly(lab: Lab) -> None:
    """A host that does not read: the index goes on, EVENT 9 says how many, the next sample is flagged."""
    lab.ask(Start(1000))
    lab.order("T 0 0 0")
    lab.order("M 0")
    for _ in range(7):
        assert lab.order("T 0") == []
    lab.order("M 100000")
    event, first, *rest = lab.order("T 0")
    assert isinstance(event, BoardEvent)
    assert isinstance(first, Sample)
    assert (event.code, event.value, first.index) == (EventCode.SAMPLES_DROPPED, 70, 101)
    assert first.flags & SampleFlag.DROPPED_BEFORE
    assert not any(sample.flags & SampleFlag.DROPPED_BEFORE for sample in rest)


def test_a_late_main_loop_drops_what_it_missed(lab: Lab) -> None:
    """Away for 95 ms at 100 Hz: eight instants are over, the ninth is sampled; never two samples of one moment."""
    lab.ask(Start(100))
    lab.order("T 0")
    event, sample = lab.order("J 95000")
    assert (event.code, event.value) == (EventCode.SAMPLES_DROPPED, 8)
    assert (sample.index, sample.time_us) == (10, 105_000)
    assert [m.index for m in lab.order("T 0")] == [11]


def test_events_wait_for_room_and_keep_their_times(lab: Lab) -> None:
    """With nobody to read, the first eight are kept in order: they are the cause."""
    lab.order("M 0")
    for pressed in (1, 0) * 6:
        lab.order(f"E {pressed}")
        lab.order("T 0")
    lab.order("M 100000")
    events = lab.order("T 0")
    assert [event.code for event in events] == [EventCode.ESTOP_PRESSED, EventCode.ESTOP_RELEASED] * 4
    assert [event.time_us for event in events] == [10_000 * n for n in range(8)]


def test_modem_manager_is_not_answered(lab: Lab) -> None:
    """AT commands, as Linux sends them to a new serial port, are no frames; the host's lone 00 ends them."""
    assert lab.order("R " + b"AT\r\nATE1 E0\r\nAT+CGMI\r\n".hex()) == []
    lab.order("R 00")
    (hello,) = lab.send(Identify())
    assert isinstance(hello, Hello)


def test_watchdog_over_wraps_of_the_clock(lab: Lab) -> None:
    """The 32-bit clock wraps after 71.6 min; neither the watchdog nor the sampling notices."""
    lab.ask(Heartbeat(5000))
    lab.ask(Start(1))
    for _ in range(1200):  # 80 min
        lab.ask(Heartbeat(5000))
        lab.order("J 4000000")
    assert lab.gauge[3] == BoardState.IDLE
    assert lab.samples[-1].index == 4800
    assert lab.samples[-1].time_us == 4_800_000_000 % 2**32
    assert lab.ask(Stop()) == AckStatus.DONE
    (event,) = lab.order("J 5000000")
    assert (event.code, event.value) == (EventCode.HEARTBEAT_LOST, 5000)
