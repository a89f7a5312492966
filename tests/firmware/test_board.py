"""Parts of the firmware that the virtual board does not have: regulator, late main loop, full transmit buffer."""

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
from tests.firmware.firmware_build import FirmwareProcess


class FirmwareRig:
    """A booted firmware at ambient pressure, and the samples it has sent."""

    def __init__(self, process: FirmwareProcess) -> None:
        self._process = process
        self._reader = FrameReader()
        self._seq = itertools.count()
        self.samples: list[Sample] = []
        self.request("Z")
        self.boot()

    def boot(self) -> list[BoardMessage]:
        """Boot with the switches as they are and return the messages."""
        return self._decode(self._process.boot())

    def request(self, text: str) -> list[BoardMessage]:
        """Send a request to the process and return the messages of that time."""
        return self._decode(self._process.transmitted(text))

    def _decode(self, data: bytes) -> list[BoardMessage]:
        messages = [decode_message(frame, 2) for frame in self._reader.receive(data)]
        self.samples += [message for message in messages if isinstance(message, Sample)]
        return [message for message in messages if message is not None]

    def send(self, command: Command) -> list[BoardMessage]:
        """Send a command and return the messages that follow at once."""
        return self.request("R " + encode_command(command, next(self._seq) % 256).hex())

    def command(self, command: Command) -> int:
        """Send a command and return the status of its answer."""
        (answer,) = [message for message in self.send(command) if isinstance(message, Ack)]
        return answer.status

    @property
    def gauge(self) -> tuple[int, int, int, int]:
        """Return pressure in Pa, drive in permille, valve open, state."""
        pressure_pa, permille, vent, state = map(int, self._process.request("Q").split())
        return pressure_pa, permille, vent, state


@pytest.fixture
def rig(process: FirmwareProcess) -> FirmwareRig:
    """A firmware that has just booted at ambient pressure."""
    return FirmwareRig(process)


@pytest.mark.parametrize("ramp_kpa_per_s", [2, 10, 40])
def test_regulator_follows_the_ramp_and_holds(rig: FirmwareRig, ramp_kpa_per_s: int) -> None:
    """Through the whole range: on target at the end of the ramp, less than 2 kPa overshoot, then HOLDING."""
    rig.command(Start(100))
    before_kpa = 0
    for target_kpa in (50, -40, 0):
        assert rig.command(SetPressure(1000 * target_kpa, 1000 * ramp_kpa_per_s)) == AckStatus.DONE
        ticks = 100 * abs(target_kpa - before_kpa) // ramp_kpa_per_s + 100
        samples = [m for m in rig.request(f"G {ticks}") if isinstance(m, Sample)]
        ahead = 1 if target_kpa > before_kpa else -1
        assert max(ahead * (sample.pressure_pa - 1000 * target_kpa) for sample in samples) < 2000
        pressure_pa, _, vent, state = rig.gauge
        assert (vent, state) == (0, BoardState.HOLDING)
        assert pressure_pa == pytest.approx(1000 * target_kpa, abs=100)
        before_kpa = target_kpa


def test_regulator_compensates_a_leak(rig: FirmwareRig) -> None:
    """A bladder that loses 5 % a second is held within the tolerance of its target."""
    rig.request("L 0.05 90")
    rig.command(SetPressure(40_000, 20_000))
    rig.request("G 600")
    pressure_pa, permille, _, state = rig.gauge
    assert state == BoardState.HOLDING
    assert pressure_pa == pytest.approx(40_000, abs=500)
    assert permille > 0


def test_target_beyond_the_pump_is_reported(rig: FirmwareRig) -> None:
    """After 2 s of ramp and 8 s of timeout EVENT 8 with the pressure reached; vented, FAULT."""
    rig.request("L 0 30")
    rig.command(SetPressure(40_000, 20_000))
    (event,) = rig.request("G 1100")
    assert isinstance(event, BoardEvent)
    assert (event.code, event.value) == (EventCode.TARGET_NOT_REACHED, 30_000)
    assert event.time_us == pytest.approx(10_000_000, abs=10_000)
    assert rig.gauge[2:] == (1, BoardState.FAULT)


def test_board_vents_without_heartbeat(rig: FirmwareRig) -> None:
    """Under pressure, 500 ms without a heartbeat open the valve; the event is stored."""
    rig.command(Heartbeat(500))
    rig.command(SetPressure(40_000, 0))
    rig.request("G 49")
    assert rig.gauge[2:] == (0, BoardState.RAMPING)
    (event,) = rig.request("G 1")
    assert (event.code, event.value) == (EventCode.HEARTBEAT_LOST, 500)
    assert rig.gauge[1:] == (0, 1, BoardState.FAULT)
    rig.request("G 200")
    assert rig.gauge[0] < 1000


def test_valve_opens_with_the_command_not_with_the_next_tick(rig: FirmwareRig) -> None:
    """VENT sets the valve before it is answered."""
    rig.command(SetPressure(40_000, 0))
    rig.request("G 20")
    assert rig.gauge[2] == 0
    rig.command(Vent())
    assert rig.gauge[1:] == (0, 1, BoardState.VENTED)


def test_estop_pressed_at_power_on_is_a_fault(rig: FirmwareRig) -> None:
    """It is not reported by an event, but the board stays in FAULT; its release is reported."""
    rig.request("E 1")
    hello, booted = rig.boot()
    assert isinstance(hello, Hello)
    assert booted.code == EventCode.BOOTED
    assert rig.gauge[3] == BoardState.FAULT
    (event,) = rig.request("E 0")
    assert event.code == EventCode.ESTOP_RELEASED


def test_samples_without_buffer_space_are_counted_exactly(rig: FirmwareRig) -> None:
    """The host does not read: the index advances, EVENT 9 has the number, the next sample is flagged."""
    rig.command(Start(1000))
    rig.request("T 0 0 0")
    rig.request("M 0")
    for _ in range(7):
        assert rig.request("T 0") == []
    rig.request("M 100000")
    event, first, *rest = rig.request("T 0")
    assert isinstance(event, BoardEvent)
    assert isinstance(first, Sample)
    assert (event.code, event.value, first.index) == (EventCode.SAMPLES_DROPPED, 70, 101)
    assert first.flags & SampleFlag.DROPPED_BEFORE
    assert not any(sample.flags & SampleFlag.DROPPED_BEFORE for sample in rest)


def test_late_main_loop_counts_missed_samples(rig: FirmwareRig) -> None:
    """A main loop late by 95 ms at 100 Hz skips eight instants and samples the ninth; never two at one instant."""
    rig.command(Start(100))
    rig.request("T 0")
    event, sample = rig.request("J 95000")
    assert (event.code, event.value) == (EventCode.SAMPLES_DROPPED, 8)
    assert (sample.index, sample.time_us) == (10, 105_000)
    assert [m.index for m in rig.request("T 0")] == [11]


def test_events_wait_for_buffer_space_and_keep_their_times(rig: FirmwareRig) -> None:
    """Without a reader the first eight events are kept in order: they show the cause."""
    rig.request("M 0")
    for pressed in (1, 0) * 6:
        rig.request(f"E {pressed}")
        rig.request("T 0")
    rig.request("M 100000")
    events = rig.request("T 0")
    assert [event.code for event in events] == [EventCode.ESTOP_PRESSED, EventCode.ESTOP_RELEASED] * 4
    assert [event.time_us for event in events] == [10_000 * n for n in range(8)]


def test_modem_manager_is_not_answered(rig: FirmwareRig) -> None:
    """AT commands, as Linux sends them to a new serial port, are no frames; a single 00 of the host ends them."""
    assert rig.request("R " + b"AT\r\nATE1 E0\r\nAT+CGMI\r\n".hex()) == []
    rig.request("R 00")
    (hello,) = rig.send(Identify())
    assert isinstance(hello, Hello)


def test_watchdog_over_wraps_of_the_clock(rig: FirmwareRig) -> None:
    """The 32-bit clock wraps after 71.6 min without an effect on watchdog and sampling."""
    rig.command(Heartbeat(5000))
    rig.command(Start(1))
    for _ in range(1200):  # 80 min
        rig.command(Heartbeat(5000))
        rig.request("J 4000000")
    assert rig.gauge[3] == BoardState.IDLE
    assert rig.samples[-1].index == 4800
    assert rig.samples[-1].time_us == 4_800_000_000 % 2**32
    assert rig.command(Stop()) == AckStatus.DONE
    (event,) = rig.request("J 5000000")
    assert (event.code, event.value) == (EventCode.HEARTBEAT_LOST, 5000)
