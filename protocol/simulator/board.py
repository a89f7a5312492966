"""The virtual board: all of protocol/SPEC.md over a simulated specimen, without clock or port.

`receive` takes the host's bytes at the present board time, `advance` passes board time and returns the bytes sent. The
same seed and the same bytes at the same board times give the same bytes, however `advance` is divided: the control
ticks at fixed times, noise is a function of the number of a tick or a sample, and blocks are computed element by
element. Everything is sent in the order of board time; samples between two messages are framed by the block.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from protocol.link import messages
from protocol.link.framing import Frame, FrameReader
from protocol.link.messages import AckStatus, BoardEvent, BoardMessage, EventCode
from protocol.recording import SampleFlag
from protocol.simulator import sampler
from protocol.simulator.board_control import HARD_LIMITS_PA, BoardControl
from protocol.simulator.faults import FAULTS, Fault, FaultSchedule
from protocol.simulator.plant import PUMP_NOISE, PUMP_REACH_KPA, TICK_US, Body, Pneumatics, Sensors
from protocol.simulator.specimens import find_specimen
from protocol.simulator.transmitter import Transmitter

RATE_MAX_HZ = 20_000
_TICKS_AT_ONCE = 400
_SATURATION_QUIET_US = 1_000_000  # saturation again within this time is the same event
_KPA_PER_CYCLE = 180.0  # travel of a full cycle, for softening


class VirtualBoard:
    """A board with one of `specimens.SPECIMEN_NAMES`. RequestError: no such specimen.

    `log_truth`: keep the noise-free values of each sample for `take_truth`. `log_elongation`: keep the true elongation
    of each tick for `take_elongation`.
    """

    def __init__(
        self,
        specimen: str = "SA1",
        *,
        seed: int = 0,
        faults: Iterable[Fault] = (),
        log_truth: bool = False,
        log_elongation: bool = False,
    ) -> None:
        self.specimen = find_specimen(specimen)
        self.n_sensors = len(self.specimen.sensors)
        self.now_us = 0  # board time since power-on
        faults = tuple(faults)
        self._true_us = 0
        self._drift = next((fault for fault in faults if fault.name == "drift_ppm"), None)
        self._seed = seed
        self._schedule = FaultSchedule(faults)
        self._since_us: dict[str, int] = {}  # when each fault began
        self._transmitter = Transmitter(self.n_sensors, self._schedule, seed)
        self._boot_at_us: int | None = None  # a booting board neither receives nor sends
        self._refusal: AckStatus | None = None
        self._truth: list[NDArray[np.void]] | None = [] if log_truth else None
        self._elongation: list[NDArray[np.float64]] | None = [] if log_elongation else None
        self._pneumatics = Pneumatics()
        self._body = Body(self.specimen.actuator)
        self._sensors = Sensors(self.specimen.sensors, self.specimen.range_mm)
        self._sampler = sampler.Sampler(self.specimen, seed)
        self._pump_noise = sampler.SampleNoise(seed, 0, 0)
        self._travel_kpa = 0.0
        self._later: list[tuple[int, BoardMessage]] = []
        clock_wrap = next((fault.start_us for fault in faults if fault.name == "clock_wrap"), 0)
        begun, ended = self._schedule.move_to(0)
        self._boot(messages.BootReason.POWER, clock_start_us=-clock_wrap)
        self._apply_faults(begun, ended)
        found = self._rows(np.array([self._pneumatics.pressure_kpa] * 2), np.ones(2))
        self._plant = sampler.PlantBlock(-1, found, np.zeros(1, np.int64), np.zeros(1, np.int64))
        self._run(0)

    # ---- public interface ----------------------------------------------------------------------------------------

    @property
    def pressure_kpa(self) -> float:
        return self._pneumatics.pressure_kpa

    @property
    def elongation_mm(self) -> float:
        """The true elongation, at the end of the present tick."""
        return float(self._plant.rows[-1, 1])

    @property
    def watchdog_us(self) -> int | None:
        """Board time (as `now_us`) at which an unfed watchdog vents; None where it is not armed."""
        return self._control.watchdog_us

    @property
    def unplugged(self) -> bool:
        """Whether the port is unplugged: the server of the board closes it, and opens it again."""
        return "unplug" in self._schedule.active

    def opened(self) -> None:
        """Notify the board that its port was opened; some reset on that."""
        if "reset_on_open" in self._schedule.active:
            self._reset_control()
            self._transmitter.off = True
            self._boot_at_us = self.now_us + round(1e6 * self._schedule.active["reset_on_open"])

    def receive(self, data: bytes) -> None:
        """Take bytes from the host, at the present board time."""
        if self.unplugged or self._boot_at_us is not None:
            return
        for frame in self._reader.receive(data):
            if frame.type >= messages.MessageType.IDENTIFY:
                self._handle(frame)

    def advance(self, dt_us: int, *, free_bytes: int | None = None) -> bytes:
        """Pass `dt_us` and return the bytes sent; samples beyond `free_bytes` are dropped. ValueError: `dt_us` < 0."""
        if dt_us < 0:
            raise ValueError("board time does not run backwards")
        self._true_us += dt_us
        self._transmitter.free_bytes = free_bytes
        end = self._board_time(self._true_us)
        while self.now_us < end:
            changes = [time for time in (self._schedule.next_change_us, self._boot_at_us) if time is not None]
            self._run(min([end, self.now_us + _TICKS_AT_ONCE * TICK_US, *changes]))
            if changes and self.now_us >= min(changes):
                if self.now_us == self._boot_at_us:
                    self._boot(messages.BootReason.RESET_PIN)
                self._apply_faults(*self._schedule.move_to(self.now_us))
                self._update_state()
        return self._transmitter.take()

    def take_truth(self) -> NDArray[np.void]:
        """Return the true values of the samples made since the last call (`sampler.truth_dtype`)."""
        parts, self._truth = self._truth, [] if self._truth is not None else None
        return np.concatenate([np.empty(0, sampler.truth_dtype(self.n_sensors)), *(parts or [])])

    def take_elongation(self) -> tuple[int, NDArray[np.float64]]:
        """Return the number of the first tick since the last call, and the true elongation of each, mm."""
        parts, self._elongation = self._elongation, [] if self._elongation is not None else None
        elongation = np.concatenate([np.empty(0), *(parts or [])])
        return self._last_tick - elongation.size + 1, elongation

    # ---- time ----------------------------------------------------------------------------------------------------

    def _board_time(self, true_us: int) -> int:
        """Return the board's time at a true time: the same without a drift."""
        if self._drift is None or true_us <= self._drift.start_us:
            return true_us
        start = self._drift.start_us
        return start + (true_us - start) * (1_000_000 + round(self._drift.value)) // 1_000_000

    def _clock(self, now_us: int) -> int:
        """Return the reading of the 32-bit clock."""
        return (now_us - self._booted_us + self._clock_start_us) & 0xFFFFFFFF

    def _reset_control(self) -> None:
        """Forget all commands; a board that reboots vents."""
        self._sampler.stop()
        self._later.clear()
        if self.now_us:
            self._pneumatics.vent()
        self._control = BoardControl(self._pneumatics, RATE_MAX_HZ)

    def _boot(self, reason: int, *, clock_start_us: int = 0) -> None:
        self._reset_control()
        self._boot_at_us, self._boot_reason = None, reason
        self._booted_us, self._clock_start_us = self.now_us, clock_start_us
        self._reader = FrameReader()
        self._answered: tuple[int, int, AckStatus] | None = None
        self._last_saturated_us = [self.now_us - _SATURATION_QUIET_US] * self.n_sensors
        self._transmitter.reset()
        if "estop" in self._schedule.active:
            self._control.set_estop(True, announce=False)
        if "pressure_invalid" in self._schedule.active:
            self._control.set_pressure_invalid(True)
        self._transmitter.send(self._hello())
        self._transmitter.send(BoardEvent(self._clock(self.now_us), EventCode.BOOTED, reason))

    def _hello(self) -> messages.Hello:
        return messages.Hello(
            protocol=int(self._schedule.active.get("wrong_protocol", messages.PROTOCOL_VERSION)),
            fw_major=1,
            fw_minor=0,
            n_sensors=self.n_sensors,
            rate_max_hz=RATE_MAX_HZ,
            adc_bits=sampler.ADC_BITS,
            boot_reason=self._boot_reason,
            vref_mv=sampler.VREF_MV,
            pressure_min_pa=HARD_LIMITS_PA[0],
            pressure_max_pa=HARD_LIMITS_PA[1],
            board_id=self.specimen.board_id,
        )

    # ---- faults --------------------------------------------------------------------------------------------------

    def _apply_faults(self, begun: Iterable[Fault], ended: Iterable[Fault]) -> None:
        """Apply each fault that has begun or ended to the part that it concerns."""
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
            self._transmitter.send(BoardEvent(self._clock(self.now_us), code, value))

    def _begin(self, fault: Fault) -> None:
        match fault.name:
            case "estop":
                self._control.set_estop(True, announce=fault.start_us > 0)  # pressed before power-on: a level only
            case "pressure_invalid":
                self._control.set_pressure_invalid(True)
            case "reset":
                self._boot(int(fault.value))
            case "clock_back":
                self._clock_start_us -= round(1e6 * fault.value)
            case "beyond_limit":
                self._pneumatics.pressure_kpa = fault.value
            case "slow_rate":
                self._sampler.change_rate(self.now_us, round(fault.value))
            case "garbage":
                generator = np.random.default_rng((self._seed, fault.start_us))
                self._transmitter.send_raw(generator.bytes(int(fault.value)))
            case "boot_text":
                self._transmitter.send_raw(b"\0\0BOAT boot loader 1.0, press any key\r\n" * int(fault.value))
            case "ack_refused":
                self._refusal = AckStatus(int(fault.value))
            case name if FAULTS[name].lasting == "count":
                self._transmitter.countdown[name] += int(fault.value)

    # ---- commands ------------------------------------------------------------------------------------------------

    def _handle(self, frame: Frame) -> None:
        """Answer one good frame of the host; the same type and seq twice running acts once."""
        self._control.feed(self.now_us)
        if self._answered is not None and self._answered[:2] == (frame.type, frame.seq):
            status = self._answered[2]
        else:
            status = self._act(frame)
        self._answered = (frame.type, frame.seq, status)
        answer: BoardMessage = messages.Ack(frame.type, frame.seq, status)
        if frame.type == messages.MessageType.IDENTIFY:
            answer = self._hello()
        if self._transmitter.countdown.take("ack_lost"):
            return
        if "ack_late" in self._schedule.active:
            self._later.append((self.now_us + round(1000 * self._schedule.active["ack_late"]), answer))
        else:
            self._transmitter.send(answer)

    def _act(self, frame: Frame) -> AckStatus:
        command = messages.decode_command(frame)
        if isinstance(command, AckStatus):
            return command
        if isinstance(command, messages.Identify):
            return AckStatus.DONE
        if self._refusal is not None and isinstance(command, messages.SetPressure):
            refusal, self._refusal = self._refusal, None
            return refusal
        status = self._control.execute(command, self.now_us)
        self._update_state()
        if status is AckStatus.DONE and isinstance(command, messages.Start | messages.Stop):
            self._transmitter.report_dropped(self._clock(self.now_us))
        if status is AckStatus.DONE and isinstance(command, messages.Start):
            self._sampler.start(self.now_us, round(self._schedule.active.get("slow_rate", command.rate_hz)))
        elif isinstance(command, messages.Stop):
            self._sampler.stop()
        return status

    def _update_state(self) -> None:
        """Give the samples after this instant the present state and flags, not those of the last tick."""
        self._plant.states[-1], self._plant.flags[-1] = self._control.state, self._control.flags

    # ---- passing time --------------------------------------------------------------------------------------------

    def _run(self, stop_us: int) -> None:
        """Run every tick and make every sample up to and with `stop_us`; no fault changes in between."""
        outgoing = self._run_ticks(max(0, stop_us // TICK_US - self._last_tick))
        outgoing += [item for item in self._later if item[0] <= stop_us]
        self._later = [item for item in self._later if item[0] > stop_us]
        self.now_us = stop_us
        samples = self._sampler.make(self._plant, stop_us, self._schedule.active, self._since_us)
        if self._truth is not None and samples.time_us.size:
            self._truth.append(samples.truth)
        outgoing += self._saturations(samples)
        self._emit(samples, sorted(outgoing, key=lambda item: item[0]))

    @property
    def _last_tick(self) -> int:
        return self._plant.first_tick + self._plant.states.size - 1

    def _run_ticks(self, count: int) -> list[tuple[int, BoardMessage]]:
        """Run the next ticks of control and plant; `_plant` then begins with the last tick before them."""
        outgoing: list[tuple[int, BoardMessage]] = []
        if not count:
            return outgoing
        control, pneumatics, first = self._control, self._pneumatics, self._last_tick + 1
        noise = (PUMP_NOISE * self._pump_noise.rows(first, count)[0][:, 0]).tolist()
        gauge, bladder, states = [], [], []
        for tick in range(count):
            control.tick((first + tick) * TICK_US)
            if control.events:
                time_us = (first + tick) * TICK_US
                outgoing += [(time_us, BoardEvent(self._clock(time_us), *event)) for event in control.take_events()]
            states.append(control.state)
            pneumatics.step(noise[tick])
            gauge.append(pneumatics.pressure_kpa)
            bladder.append(pneumatics.bladder_kpa)
        rows = self._rows(np.array(bladder), self._softening(gauge))
        rows[:, 0] = gauge
        if self._elongation is not None:
            self._elongation.append(rows[:, 1])
        before = self._plant
        self._plant = sampler.PlantBlock(
            before.first_tick + before.states.size - 1,
            np.concatenate([before.rows[-2:], rows]),
            np.concatenate([before.states[-1:], np.array(states, np.int64)]),
            np.concatenate([before.flags[-1:], np.full(count, control.flags, np.int64)]),
        )
        return outgoing

    def _rows(self, bladder_kpa: NDArray[np.float64], softening: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the plant's next rows, (kPa, mm, mV of each sensor), from the bladder's pressure."""
        elongation = self._body.advance(bladder_kpa) * softening
        return np.column_stack([bladder_kpa, elongation, self._sensors.advance(elongation)])

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

    def _saturations(self, samples: sampler.SampleBlock) -> list[tuple[int, BoardMessage]]:
        """Return an EVENT for each sensor that begins to saturate."""
        outgoing: list[tuple[int, BoardMessage]] = []
        flagged = np.flatnonzero(samples.bodies["flags"] & SampleFlag.SATURATED)
        for row in flagged.tolist():
            time_us = int(samples.time_us[row])
            for sensor in np.flatnonzero((samples.bodies["counts"][row] == sampler.FULL_SCALE).any(axis=1)).tolist():
                if time_us - self._last_saturated_us[sensor] >= _SATURATION_QUIET_US:
                    outgoing.append((time_us, BoardEvent(self._clock(time_us), EventCode.SENSOR_SATURATED, sensor)))
                self._last_saturated_us[sensor] = time_us
        return outgoing

    # ---- sending -------------------------------------------------------------------------------------------------

    def _emit(self, samples: sampler.SampleBlock, outgoing: list[tuple[int, BoardMessage]]) -> None:
        """Send samples and messages in the order of their times, a message before the sample of the same instant."""
        samples.bodies["time_us"] = (samples.time_us - self._booted_us + self._clock_start_us) & 0xFFFFFFFF
        start = 0
        for time_us, message in outgoing:
            cut = int(np.searchsorted(samples.time_us, time_us))
            self._transmitter.send_samples(samples.bodies[start:cut])
            self._transmitter.send(message)
            start = cut
        self._transmitter.send_samples(samples.bodies[start:])
