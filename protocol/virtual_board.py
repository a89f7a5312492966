"""The board that is not there: the whole contract of protocol/SPEC.md over a simulated unit, without clock or port.

`receive` takes the host's bytes at the present board time, `advance` moves the board on and returns all it sent
meanwhile. Rules of this file:

- The same seed and the same bytes in at the same board times give the same bytes out, however `advance` is cut up: the
  control ticks at fixed times, noise belongs to the number of a tick or a sample, and what is computed by the block is
  computed element by element.
- Everything leaves through one door, `_send`, in the order of board time; the wire's faults stand there.
- Between two messages samples are made and framed by the block.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from protocol.board_control import HARD_LIMITS_PA, BoardControl
from protocol.faults import Countdown, Fault, FaultSchedule
from protocol.framing import Frame, FrameReader
from protocol.light import ADC_BITS, FULL_SCALE, VREF_MV, SampleNoise
from protocol.messages import (
    PROTOCOL_VERSION,
    Ack,
    AckStatus,
    BoardEvent,
    BoardMessage,
    BootReason,
    EventCode,
    Hello,
    Identify,
    MessageType,
    Start,
    Stop,
    decode_command,
    encode_message,
)
from protocol.plant import PUMP_REACH_KPA, TICK_US, Body, Pneumatics, Sensors
from protocol.recording import SampleFlag
from protocol.sample_frames import encode_samples, frame_length
from protocol.sampler import PlantBlock, SampleBlock, Sampler, truth_dtype
from protocol.units import find_unit
from protocol.wire import Wire

RATE_MAX_HZ = 20_000
_TICKS_AT_ONCE = 400
_PUMP_NOISE = 0.15  # kPa/s a tick: some 0.03 kPa of ripple in the pressure
_SATURATION_QUIET_US = 1_000_000  # a sensor that saturates again sooner has not stopped
_KPA_PER_CYCLE = 180.0  # travel of a full cycle, for softening
_EVENT_ROOM = 20  # bytes of an EVENT on the wire, and some


class VirtualBoard:
    """A board with one unit on it.

    Parameters
    ----------
    unit : a name of `protocol.units.UNIT_NAMES`.
    seed : of all noise and of damage on the wire.
    faults : what goes wrong, and when (`protocol.faults`).
    log_truth : keep the noise-free values beside each sample for `take_truth`.

    Raises
    ------
    LocalError : no such unit.
    """

    def __init__(
        self, unit: str = "SA1", *, seed: int = 0, faults: Iterable[Fault] = (), log_truth: bool = False
    ) -> None:
        self.unit = find_unit(unit)
        self.now_us = 0  # board time since power-on
        faults = tuple(faults)
        self._true_us = 0
        self._drift = next((fault for fault in faults if fault.name == "drift_ppm"), None)
        self._seed = seed
        self._schedule = FaultSchedule(faults)
        self._since_us: dict[str, int] = {}  # when each fault began
        self._countdown = Countdown()
        self._wire = Wire(seed)
        self._out = bytearray()
        self._room: int | None = None
        self._boot_at_us: int | None = None  # a board that boots neither hears nor speaks
        self._refusal: AckStatus | None = None
        self._truth: list[NDArray[np.void]] | None = [] if log_truth else None
        self._pneumatics = Pneumatics()
        self._body = Body(self.unit.actuator)
        self._sensors = Sensors(self.unit.sensors, self.unit.range_mm)
        self._sampler = Sampler(self.unit, seed)
        self._pump_noise = SampleNoise(seed, 0, 0)
        self._travel_kpa = 0.0
        self._absurd = 0
        self._held = np.empty((0, frame_length(self.n_sensors)), np.uint8)  # of a pair in the wrong order, the first
        self._later: list[tuple[int, BoardMessage]] = []
        self._last_saturated_us = [-_SATURATION_QUIET_US] * self.n_sensors
        clock_wrap = next((fault.start_us for fault in faults if fault.name == "clock_wrap"), 0)
        begun, ended = self._schedule.move_to(0)
        self._boot(BootReason.POWER, clock_start_us=-clock_wrap)
        self._apply_faults(begun, ended)
        at_rest = np.zeros(1)
        rest = np.column_stack([at_rest, self._body.advance(at_rest), self._sensors.advance(at_rest)])
        self._plant = PlantBlock(-1, np.concatenate([rest, rest]), np.zeros(1, np.int64), np.zeros(1, np.int64))
        self._run(0)

    # ---- what the board's owner calls ----------------------------------------------------------------------------

    @property
    def n_sensors(self) -> int:
        """How many sensors the unit has."""
        return len(self.unit.sensors)

    @property
    def unplugged(self) -> bool:
        """True while the port is gone: whoever serves the board closes it, and opens it again."""
        return "unplug" in self._schedule.active

    def opened(self) -> None:
        """Tell the board that its port was opened; some reset on that."""
        if "reset_on_open" in self._schedule.active:
            self._sampler.stop()
            self._boot_at_us = self.now_us + round(1e6 * self._schedule.active["reset_on_open"])

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, at the present board time."""
        if self.unplugged or self._boot_at_us is not None:
            return
        for frame in self._reader.receive(data):
            if frame.type >= MessageType.IDENTIFY:
                self._handle(frame)

    def advance(self, dt_us: int, *, room: int | None = None) -> bytes:
        """Move on by `dt_us` and return the bytes sent since the last call.

        Parameters
        ----------
        dt_us : true time to pass, microseconds, 0 or more.
        room : bytes that the transmit buffer can take; samples beyond it are dropped and counted, messages are not.
        """
        if dt_us < 0:
            raise ValueError("board time does not run backwards")
        self._true_us += dt_us
        self._room = room
        end = self._board_time(self._true_us)
        while self.now_us < end:
            stop = min(end, self.now_us + _TICKS_AT_ONCE * TICK_US)
            changes = [self._schedule.next_change_us, self._boot_at_us]
            self._run(min([stop, *(change for change in changes if change is not None)]))
            if self._boot_at_us is not None and self.now_us >= self._boot_at_us:
                self._boot(BootReason.RESET_PIN)
            self._apply_faults(*self._schedule.move_to(self.now_us))
        out = bytes(self._out)
        self._out.clear()
        return out

    def take_truth(self) -> NDArray[np.void]:
        """Return the truth of the samples made since the last call (`sampler.truth_dtype`)."""
        parts, self._truth = self._truth, [] if self._truth is not None else None
        return np.concatenate([np.empty(0, truth_dtype(self.n_sensors)), *(parts or [])])

    # ---- time ----------------------------------------------------------------------------------------------------

    def _board_time(self, true_us: int) -> int:
        """Return the board's time at a true time: the same but for a drift."""
        if self._drift is None or true_us <= self._drift.start_us:
            return true_us
        start = self._drift.start_us
        return start + (true_us - start) * (1_000_000 + round(self._drift.value)) // 1_000_000

    def _clock(self, now_us: int) -> int:
        """Return what the 32-bit clock shows."""
        return (now_us - self._booted_us + self._clock_start_us) & 0xFFFFFFFF

    def _boot(self, reason: int, clock_start_us: int = 0) -> None:
        self._boot_at_us = None
        self._booted_us, self._clock_start_us = self.now_us, clock_start_us
        self._reader = FrameReader()
        self._seq = 0
        self._dropped = 0
        self._later.clear()
        self._answered: tuple[int, int, AckStatus] | None = None
        self._sampler.stop()
        self._control = BoardControl(self._pneumatics, RATE_MAX_HZ)
        active = self._schedule.active
        if self.now_us:
            self._pneumatics.vent()  # the valve opens without current
            self._control.restore_levels("estop" in active, "pressure_invalid" in active)
        self._boot_reason = reason
        self._send_message(self._hello())
        self._send_message(BoardEvent(self._clock(self.now_us), EventCode.BOOTED, reason))

    def _hello(self) -> Hello:
        return Hello(
            protocol=int(self._schedule.active.get("wrong_protocol", PROTOCOL_VERSION)),
            fw_major=1,
            fw_minor=0,
            n_sensors=self.n_sensors,
            rate_max_hz=RATE_MAX_HZ,
            adc_bits=ADC_BITS,
            boot_reason=self._boot_reason,
            vref_mv=VREF_MV,
            pressure_min_pa=HARD_LIMITS_PA[0],
            pressure_max_pa=HARD_LIMITS_PA[1],
            board_id=self.unit.board_id,
        )

    # ---- faults --------------------------------------------------------------------------------------------------

    def _apply_faults(self, begun: Iterable[Fault], ended: Iterable[Fault]) -> None:
        """Hand each fault that has begun or ended to the part that it concerns."""
        for fault in begun:
            self._since_us[fault.name] = fault.start_us
            self._begin(fault)
        for fault in ended:
            if fault.name == "estop":
                self._control.set_estop(False)
            elif fault.name == "pressure_invalid":
                self._control.set_pressure_invalid(False)
        active = self._schedule.active
        self._pneumatics.pump_works = "dead_pump" not in active
        self._pneumatics.reach_kpa = (-active["stall"], active["stall"]) if "stall" in active else PUMP_REACH_KPA
        self._pneumatics.overshoot_kpa = active.get("overshoot", 0.0)
        self._pneumatics.leak_per_s = active.get("leak", 0.0) / 100 / 60
        for code, value in self._control.take_events():
            self._send_message(BoardEvent(self._clock(self.now_us), code, value))

    def _begin(self, fault: Fault) -> None:
        match fault.name:
            case "estop":
                self._control.set_estop(True, announce=fault.start_us > 0)
            case "pressure_invalid":
                self._control.set_pressure_invalid(True)
            case "reset":
                self._boot(int(fault.value))
            case "beyond_limit":
                self._pneumatics.pressure_kpa = fault.value
            case "slow_rate":
                self._sampler.change_rate(self.now_us, round(fault.value))
            case "garbage":
                generator = np.random.default_rng((self._seed, fault.start_us))
                self._send(generator.bytes(int(fault.value)))
            case "boot_text":
                self._send(b"\0\0BOAT boot loader 1.0, press any key\r\n" * int(fault.value))
            case "ack_refused":
                self._refusal = AckStatus(int(fault.value))
            case name:
                self._countdown.add(name, fault.value)

    # ---- commands ------------------------------------------------------------------------------------------------

    def _handle(self, frame: Frame) -> None:
        """Answer one good frame of the host; the same type and seq twice running acts once."""
        self._control.feed(self.now_us)
        if self._answered is not None and self._answered[:2] == (frame.type, frame.seq):
            status = self._answered[2]
        else:
            status = self._act(frame)
        self._answered = (frame.type, frame.seq, status)
        answer: BoardMessage = Ack(frame.type, frame.seq, status)
        if frame.type == MessageType.IDENTIFY:
            answer = self._hello()
        if self._countdown.take("ack_lost"):
            return
        if "ack_late" in self._schedule.active:
            self._later.append((self.now_us + round(1000 * self._schedule.active["ack_late"]), answer))
        else:
            self._send_message(answer)

    def _act(self, frame: Frame) -> AckStatus:
        command = decode_command(frame)
        if isinstance(command, AckStatus):
            return command
        if isinstance(command, Identify):
            return AckStatus.DONE
        if self._refusal is not None:
            refusal, self._refusal = self._refusal, None
            return refusal
        status = self._control.obey(command, self.now_us)
        if status is AckStatus.DONE and isinstance(command, Start):
            slow = self._schedule.active.get("slow_rate", command.rate_hz)
            self._sampler.start(self.now_us, round(slow))
        elif isinstance(command, Stop):
            self._sampler.stop()
        return status

    # ---- the run of time -----------------------------------------------------------------------------------------

    def _run(self, stop_us: int) -> None:
        """Run every tick and make every sample up to and with `stop_us`; no fault changes on the way."""
        messages = self._run_ticks(max(0, stop_us // TICK_US - self._last_tick))
        messages += [item for item in self._later if item[0] <= stop_us]
        self._later = [item for item in self._later if item[0] > stop_us]
        self.now_us = stop_us
        samples = self._sampler.make(self._plant, stop_us, self._schedule.active, self._since_us)
        if self._truth is not None and samples.time_us.size:
            self._truth.append(samples.truth)
        messages += self._saturations(samples)
        self._emit(samples, sorted(messages, key=lambda item: item[0]))

    @property
    def _last_tick(self) -> int:
        return self._plant.first_tick + self._plant.states.size - 1

    def _run_ticks(self, count: int) -> list[tuple[int, BoardMessage]]:
        """Run the next ticks of control and plant; `_plant` then begins with the last tick before them."""
        messages: list[tuple[int, BoardMessage]] = []
        if not count:
            return messages
        control, pneumatics, first = self._control, self._pneumatics, self._last_tick + 1
        noise = (_PUMP_NOISE * self._pump_noise.rows(first, count)[0][:, 0]).tolist()
        gauge, bladder, states = [], [], []
        for tick in range(count):
            control.tick((first + tick) * TICK_US)
            if control.events:
                time_us = (first + tick) * TICK_US
                messages += [(time_us, BoardEvent(self._clock(time_us), *event)) for event in control.take_events()]
            states.append(control.state)
            pneumatics.step(noise[tick])
            gauge.append(pneumatics.pressure_kpa)
            bladder.append(pneumatics.bladder_kpa)
        elongation = self._body.advance(np.array(bladder)) * self._softening(gauge)
        rows = np.column_stack([np.array(gauge), elongation, self._sensors.advance(elongation)])
        before = self._plant
        self._plant = PlantBlock(
            before.first_tick + before.states.size - 1,
            np.concatenate([before.rows[-2:], rows]),
            np.concatenate([before.states[-1:], np.array(states, np.int64)]),
            np.concatenate([before.flags[-1:], np.full(count, control.flags, np.int64)]),
        )
        return messages

    def _softening(self, gauge_kpa: list[float]) -> NDArray[np.float64]:
        """Return by how much the body has softened at each tick, 1 = not at all."""
        softening = self._schedule.active.get("softening")
        if softening is None:
            return np.ones(len(gauge_kpa))
        gains = []
        for before, after in pairwise([float(self._plant.rows[-1, 0]), *gauge_kpa]):
            self._travel_kpa += abs(after - before)
            gains.append(1.0 + softening / 100 * self._travel_kpa / _KPA_PER_CYCLE / 50)
        return np.array(gains)

    def _saturations(self, samples: SampleBlock) -> list[tuple[int, BoardMessage]]:
        """Return an EVENT for each sensor that begins to saturate."""
        messages: list[tuple[int, BoardMessage]] = []
        flagged = np.flatnonzero(samples.bodies["flags"] & SampleFlag.SATURATED)
        for row in flagged.tolist():
            time_us = int(samples.time_us[row])
            for sensor in np.flatnonzero((samples.bodies["counts"][row] == FULL_SCALE).any(axis=1)).tolist():
                if time_us - self._last_saturated_us[sensor] >= _SATURATION_QUIET_US:
                    messages.append((time_us, BoardEvent(self._clock(time_us), EventCode.SENSOR_SATURATED, sensor)))
                self._last_saturated_us[sensor] = time_us
        return messages

    # ---- sending -------------------------------------------------------------------------------------------------

    def _emit(self, samples: SampleBlock, messages: list[tuple[int, BoardMessage]]) -> None:
        """Send samples and messages in the order of their times, a message before the sample of the same instant."""
        samples.bodies["time_us"] = (samples.time_us - self._booted_us + self._clock_start_us) & 0xFFFFFFFF
        self._make_absurd(samples.bodies)
        start = 0
        for time_us, message in messages:
            cut = int(np.searchsorted(samples.time_us, time_us))
            self._send_samples(samples.bodies[start:cut])
            self._send_message(message)
            start = cut
        self._send_samples(samples.bodies[start:])

    def _make_absurd(self, bodies: NDArray[np.void]) -> None:
        for row in range(self._countdown.take("absurd_value", bodies.size)):
            kind = self._absurd % 3
            self._absurd += 1
            if kind == 0:
                bodies["pressure_pa"][row] = 5_000_000
            elif kind == 1:
                bodies["counts"][row] = 0xFFFF
            else:
                bodies["counts"][row] = bodies["counts"][row][:, ::-1]

    def _send_samples(self, bodies: NDArray[np.void]) -> None:
        """Frame and send, or drop what finds no room; the first sample behind a drop says so."""
        lost = self._countdown.take("dropped", bodies.size)
        self._dropped += lost
        bodies = bodies[lost:]
        fitting = bodies.size
        if self._room is not None:
            fitting = (self._room - len(self._out) - _EVENT_ROOM) // frame_length(self.n_sensors)
        sent = bodies[: max(0, fitting)]
        if sent.size:
            if self._dropped:
                time_us = int(sent["time_us"][0])
                self._send_message(BoardEvent(time_us, EventCode.SAMPLES_DROPPED, self._dropped))
                sent["flags"][0] |= SampleFlag.DROPPED_BEFORE
                self._dropped = 0
            frames = encode_samples(sent, self._seq)
            self._seq += sent.size
            self._send(self._arrange(frames).tobytes())
        self._dropped += bodies.size - sent.size

    def _arrange(self, frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Lose, repeat or swap whole frames, where a fault says so."""
        if not self._countdown.left and not len(self._held):
            return frames
        frames = frames[self._countdown.take("index_gap", len(frames)) :]
        twice = self._countdown.take("duplicate", len(frames))
        frames = np.concatenate([np.repeat(frames[:twice], 2, axis=0), frames[twice:]])
        frames = np.concatenate([self._held, frames])
        self._held = frames[:0]
        swapped = 2 * self._countdown.take("reorder", len(frames) // 2)
        order = np.arange(swapped) ^ 1
        rest = frames[swapped:]
        if "reorder" in self._countdown.left:
            self._held, rest = rest, rest[:0]
        return np.concatenate([frames[order], rest])

    def _send_message(self, message: BoardMessage) -> None:
        frame = encode_message(message, self._seq)
        self._seq += 1
        self._send(frame)

    def _send(self, data: bytes) -> None:
        if self._boot_at_us is None:
            self._out += self._wire.carry(data, self._schedule.active)
