"""Every named fault has the effect of its description, and no other."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from protocol.link.messages import (
    Ack,
    AckStatus,
    BootReason,
    ClearFault,
    EventCode,
    Hello,
    Identify,
    SetLimits,
    SetPressure,
    Start,
    Vent,
    encode_command,
)
from protocol.recording import BoardState, SampleFlag
from protocol.simulator.channel_model import OTHER_DEVICE
from protocol.simulator.faults import FAULTS
from tests.protocol.simulator.board_host import BoardHost

DONE = AckStatus.DONE


def streaming(*faults: str, seconds: float = 0.0, rate_hz: int = 100) -> BoardHost:
    """A board that has been sending samples for a while."""
    host = BoardHost(*faults)
    host.status_of(Start(rate_hz))
    host.wait(seconds)
    return host


@functools.cache
def clean() -> BoardHost:
    """A board without faults that has sent samples for 100 s; read only."""
    return streaming(seconds=100.0, rate_hz=200)


def signals(host: BoardHost) -> np.ndarray:
    """Signals of all samples in counts, shape (n, 2)."""
    samples = host.samples
    return np.array([s.lit for s in samples], float) - np.array([s.dark for s in samples], float)


# ---- the wire --------------------------------------------------------------------------------------------------------


@pytest.mark.fault(1, how="virtual board's `bit_flips` at 1e-4, 1e-3 and 1e-2 a byte", times=3)
@pytest.mark.parametrize("chance", [1e-4, 1e-3, 1e-2])
def test_bit_flips_cost_their_frames_and_no_more(chance):
    """Damaged frames are lost, in the number expected; no sample is wrong."""
    hit = streaming(f"bit_flips@0.01:{chance}", seconds=100.0, rate_hz=200)
    good = set(clean().samples)
    assert all(sample in good for sample in hit.samples)
    survive = (1 - chance) ** 31  # a frame and the 00 before it
    assert len(hit.samples) / len(clean().samples) == pytest.approx(survive, abs=0.02)


def test_drop_byte_costs_its_frame():
    """A lost byte loses a frame, two at most; the rest is untouched."""
    clean, hit = streaming(seconds=100.0), streaming("drop_byte@0.01:0.001", seconds=100.0)
    good = set(clean.samples)
    assert all(sample in good for sample in hit.samples)
    assert 0.9 * len(good) < len(hit.samples) < len(good)


@pytest.mark.fault(3, how="virtual board's `garbage` and `boot_text`", times=2)
@pytest.mark.parametrize("fault", ["garbage@1:5000", "boot_text@1:20"])
def test_garbage_makes_no_false_frame(fault):
    """What is between the frames is skipped and counted; one sample at most goes with it."""
    clean, hit = streaming(seconds=2.0), streaming(fault, seconds=2.0)
    assert len(clean.samples) - len(hit.samples) <= 1
    assert hit.reader.crc_errors + hit.reader.malformed + hit.reader.oversize > 0


@pytest.mark.parametrize("fault", ["wrong_baud", "other_device", "silent", "unplug@0:0"])
def test_wrong_baud_rate_gives_no_frame(fault):
    """No frame arrives, and no command is executed."""
    host = BoardHost(fault)
    assert host.received == []
    host.send(Identify())
    host.send(Start(100))
    host.wait(5.0)
    assert host.received == []


def test_other_device_sends_text():
    """The answer to every command are the lines of a thermometer."""
    host = BoardHost("other_device")
    host.board.receive(encode_command(Start(100), 0))
    text = host.board.advance(1_000_000)
    assert OTHER_DEVICE * 10 in text
    assert set(text) <= set(OTHER_DEVICE)


def test_silent_board_still_executes():
    """Silent for two seconds: the samples of that time are lost, a VENT sent in that time is executed."""
    host = streaming("silent@5:2")
    host.go_to(40.0, seconds=5.5)
    host.send(Vent())
    host.wait(1.0)
    assert abs(host.board.pressure_kpa) < 1.0
    host.wait(2.0)
    index = [s.index for s in host.samples]
    assert max(np.diff(index)) == pytest.approx(200, abs=2)
    assert host.samples[-1].state == BoardState.VENTED


def test_unplugged_board_receives_nothing():
    """For three seconds the port is gone both ways; the board runs on."""
    host = streaming("unplug@1:3", seconds=1.5)
    assert host.board.unplugged
    host.send(Vent())
    host.wait(3.0)
    assert not host.board.unplugged
    assert host.samples[-1].state == BoardState.IDLE
    assert max(np.diff([s.index for s in host.samples])) == pytest.approx(300, abs=2)


# ---- frames ----------------------------------------------------------------------------------------------------------


def test_impossible_values_arrive_in_good_frames():
    """5 MPa, 65535 counts, dark above lit, and then plain samples again."""
    host = streaming("absurd_value@1:3", seconds=2.0)
    first, second, third = [s for s in host.samples if s.time_us > 1_000_000][:3]
    assert first.pressure_pa == 5_000_000
    assert second.lit == second.dark == (65_535, 65_535)
    assert all(dark > lit for lit, dark in zip(third.lit, third.dark, strict=True))
    assert host.reader.crc_errors == 0
    assert (signals(host)[-50:] > 1000).all()


@pytest.mark.parametrize("lost", [1, 7, 255, 256, 70_000])
def test_index_gap_is_exact(lost):
    """So many indices are missing, at one place, and no flag or event admits it."""
    host = streaming(f"index_gap@0.5:{lost}", rate_hz=10_000, seconds=0.6 + lost / 10_000)
    steps = np.diff([s.index for s in host.samples])
    assert steps[steps > 1].tolist() == [lost + 1]
    assert host.events == []


def test_dropped_samples_are_reported():
    """So many indices are missing; the sample behind them is flagged, and EVENT 9 has the number."""
    host = streaming("dropped@1:37", seconds=3.0)
    samples = host.samples
    steps = np.diff([s.index for s in samples])
    assert steps[steps > 1].tolist() == [38]
    flagged = [row for row, s in enumerate(samples) if s.flags & SampleFlag.DROPPED_BEFORE]
    assert flagged == [int(np.argmax(steps)) + 1]
    assert [(e.code, e.value) for e in host.events] == [(EventCode.SAMPLES_DROPPED, 37)]


def test_duplicates_and_reordering():
    """So many frames come twice; so many pairs come swapped; nothing is missing."""
    twice, swapped = streaming("duplicate@1:4", seconds=2.0), streaming("reorder@1:4", seconds=2.0)
    index = [s.index for s in twice.samples]
    assert len(index) - len(set(index)) == 4
    steps = np.diff([s.index for s in swapped.samples])
    assert (steps < 0).sum() == 4
    assert sorted(s.index for s in swapped.samples) == list(range(len(swapped.samples)))


@pytest.mark.fault(17, how="virtual board's `ack_lost`, `ack_late`, `ack_refused`", times=3)
def test_lost_late_and_refused_answers():
    """Lost: executed without an answer. Late: answered 400 ms later. Refused: SET_PRESSURE has status 4 once."""
    lost = BoardHost("ack_lost@0.1:2")
    lost.wait(0.2)
    assert [m for m in lost.send(SetPressure(20_000, 0)) if isinstance(m, Ack)] == []
    lost.wait(3.0)
    assert lost.board.pressure_kpa == pytest.approx(20.0, abs=0.5)
    late = BoardHost("ack_late@0:400")
    assert late.send(Vent()) == []
    assert late.wait(0.39) == []
    assert late.wait(0.02) == [Ack(0x85, late.seq, DONE)]
    refused = BoardHost("ack_refused@0")
    assert refused.status_of(Start(100)) == DONE
    assert refused.status_of(SetPressure(20_000, 0)) == AckStatus.NOT_IN_THIS_STATE
    refused.wait(1.0)
    assert refused.board.pressure_kpa == 0.0
    assert refused.status_of(SetPressure(20_000, 0)) == DONE


def test_wrong_protocol():
    """HELLO names the version."""
    host = BoardHost("wrong_protocol:7")
    assert [m.protocol for m in host.received if isinstance(m, Hello)] == [7]


# ---- the board -------------------------------------------------------------------------------------------------------


def test_clock_wraps():
    """The 32-bit clock passes 2^32 at that second, one period after the sample before."""
    host = streaming("clock_wrap@2", seconds=4.0)
    time_us = np.array([s.time_us for s in host.samples])
    (wrap,) = np.flatnonzero(np.diff(time_us) < 0)
    assert (np.diff(time_us) % 2**32 == 10_000).all()
    assert time_us[wrap + 1] < 10_000
    assert abs(int(wrap) - 199) <= 1


def test_clock_goes_back():
    """At 3 s the clock is set 2.5 s back, and goes on; the index does too."""
    host = streaming("clock_back@3:2.5", seconds=4.0)
    steps = np.diff([s.time_us for s in host.samples])
    (at,) = np.flatnonzero(steps < 0)
    assert steps[at] == 10_000 - 2_500_000
    assert (np.delete(steps, at) == 10_000).all()
    assert (np.diff([s.index for s in host.samples]) == 1).all()


@pytest.mark.parametrize("ppm", [200, 10_000, -10_000])
def test_clock_drift(ppm):
    """After 100 true seconds from its begin the board's clock is off by that much."""
    host = BoardHost(f"drift_ppm@0:{ppm}")
    host.wait(100.0)
    assert host.board.now_us == pytest.approx(100e6 * (1 + ppm / 1e6), abs=1)


def test_jitter_and_slow_rate():
    """Jitter delays each sample by up to its value and loses none; a slow board samples at its own rate."""
    jittery = streaming("jitter@0:4", seconds=10.0)
    late = np.array([s.time_us for s in jittery.samples]) - 10_000 * np.arange(len(jittery.samples))
    assert late.min() >= 0
    assert 3_500 < late.max() - late.min() <= 4_000
    slow = streaming("slow_rate@5:62", seconds=15.0)
    time_us = np.array([s.time_us for s in slow.samples])
    assert np.sum(time_us < 5e6) == 500
    assert np.diff(time_us[time_us > 5.1e6]).mean() == pytest.approx(1e6 / 62, abs=1)


def test_reset():
    """HELLO with its reason, clock at 0, no samples, pressure let out, IDLE."""
    host = streaming(f"reset@4:{BootReason.BROWN_OUT}")
    host.go_to(40.0, seconds=3.9)
    host.received.clear()
    host.wait(3.0)
    hello = next(m for m in host.received if isinstance(m, Hello))
    assert hello.boot_reason == BootReason.BROWN_OUT
    after = host.received[host.received.index(hello) :]
    assert not [m for m in after if m in host.samples]
    assert abs(host.board.pressure_kpa) < 0.1
    host.status_of(Start(100))
    host.wait(0.1)
    assert host.samples[-1].state == BoardState.IDLE
    assert host.samples[-1].time_us < 4_000_000


def test_reset_on_open():
    """Opening the port reboots the board: no reception for half a second, then HELLO."""
    host = BoardHost("reset_on_open")
    host.wait(1.0)
    host.received.clear()
    host.board.opened()
    host.send(Identify())
    assert host.wait(0.4) == []
    assert [type(m).__name__ for m in host.wait(0.2)] == ["Hello", "BoardEvent"]


def test_estop():
    """Pressed: EVENT 5, vented, FAULT, flag; CLEAR_FAULT only after the release, which EVENT 6 reports."""
    host = streaming("estop@4:3")
    host.go_to(40.0, seconds=5.0)
    assert abs(host.board.pressure_kpa) < 2.0
    assert host.samples[-1].flags & SampleFlag.ESTOP
    assert host.samples[-1].state == BoardState.FAULT
    assert host.status_of(ClearFault()) == AckStatus.NOT_IN_THIS_STATE
    host.wait(3.0)
    assert host.codes == [EventCode.ESTOP_PRESSED, EventCode.ESTOP_RELEASED]
    assert not host.samples[-1].flags & SampleFlag.ESTOP
    assert host.status_of(ClearFault()) == DONE


def test_estop_pressed_at_power_on_is_a_level():
    """At power-on there is no EVENT; flag and FAULT are set from the first sample."""
    host = streaming("estop@0:0", seconds=1.0)
    assert host.codes == []
    assert all(s.flags & SampleFlag.ESTOP and s.state == BoardState.FAULT for s in host.samples)
    assert host.status_of(SetPressure(10_000, 0)) == AckStatus.FAULT_LATCHED


def test_pressure_invalid():
    """Flagged, vented, FAULT, until the sensor is back and the fault cleared."""
    host = streaming("pressure_invalid@4:3")
    host.go_to(40.0, seconds=5.0)
    assert host.samples[-1].flags & SampleFlag.PRESSURE_INVALID
    assert host.status_of(ClearFault()) == AckStatus.NOT_IN_THIS_STATE
    host.wait(3.0)
    assert host.status_of(ClearFault()) == DONE
    assert abs(host.board.pressure_kpa) < 0.1


# ---- pneumatics and body ---------------------------------------------------------------------------------------------


@pytest.mark.fault(19, how="1.5 and 4 kPa beyond a target at the limit", times=2)
def test_overshoot_beyond_the_limits_trips():
    """1.5 kPa beyond a target is recorded and lived with; 4 kPa beyond a target at the limit vents with EVENT 2."""
    mild, wild = streaming("overshoot@0:1.5"), streaming("overshoot@0:4")
    for host in (mild, wild):
        host.status_of(SetLimits(-40_000, 50_000))
        host.go_to(50.0)
    assert mild.codes == []
    assert 51.0 < max(s.pressure_pa for s in mild.samples) / 1000 < 52.0
    assert mild.samples[-1].state == BoardState.HOLDING
    (event,) = wild.events
    assert event.code == EventCode.OVER_PRESSURE
    assert 52_000 < event.value < 53_000


def test_found_beyond_a_limit():
    """60 kPa at power-on is beyond the hard limits: vented. 53 kPa is not, and waits for the host's tighter limits."""
    hard, soft = streaming("beyond_limit@0:60", seconds=1.0), streaming("beyond_limit@0:53", seconds=1.0)
    assert hard.codes == [EventCode.OVER_PRESSURE]
    assert soft.codes == []
    assert soft.samples[0].pressure_pa == pytest.approx(53_000, abs=300)
    assert soft.status_of(SetLimits(-40_000, 50_000)) == DONE
    soft.wait(1.0)
    assert soft.codes == [EventCode.OVER_PRESSURE]
    under = streaming("beyond_limit@0:-60", seconds=1.0)
    assert under.codes == [EventCode.UNDER_PRESSURE]


@pytest.mark.parametrize(("fault", "reached_kpa"), [("dead_pump@0", 0.0), ("stall@0:30", 30.0)])
def test_target_not_reached(fault, reached_kpa):
    """Eight seconds beyond the ramp's own time the board ends the ramp: vented, EVENT 8 with the pressure reached."""
    host = streaming(fault)
    host.go_to(50.0, seconds=10.0, ramp_kpa_per_s=20.0)
    assert host.codes == []
    host.wait(1.0)
    (event,) = host.events
    assert event.code == EventCode.TARGET_NOT_REACHED
    assert event.value == pytest.approx(1000 * reached_kpa, abs=200)
    host.wait(2.0)
    assert abs(host.board.pressure_kpa) < 0.1


def test_pump_dying_under_a_hold():
    """The leak takes the pressure out of tolerance, which the board reports after its timeout."""
    host = streaming("dead_pump@10")
    host.go_to(50.0, seconds=40.0)
    assert host.codes == [EventCode.TARGET_NOT_REACHED]


def test_leak_loses_elongation_under_a_held_pressure():
    """At 10 % a minute the gauge is constant and the body shortens by about a tenth."""
    host = streaming("leak@10:10")
    host.go_to(50.0, seconds=10.0)
    before = host.board.elongation_mm
    host.wait(60.0)
    assert host.board.pressure_kpa == pytest.approx(50.0, abs=0.2)
    assert 0.03 < 1 - host.board.elongation_mm / before < 0.12


def test_softening():
    """5 % over 50 cycles is 0.5 % over 5, in the elongation at the same pressure."""
    soft, plain = streaming("softening@0:5"), streaming()
    elongation = []
    for host in (soft, plain):
        for _ in range(5):
            host.go_to(50.0, seconds=6.0, ramp_kpa_per_s=40.0)
            host.go_to(-40.0, seconds=6.0, ramp_kpa_per_s=40.0)
        elongation.append(host.board.elongation_mm)
    assert elongation[0] / elongation[1] - 1 == pytest.approx(0.05 * 4.75 / 50, rel=0.05)


# ---- sensors ---------------------------------------------------------------------------------------------------------


def test_frozen_channel():
    """One sensor is constant while the pressure moves, the other is not."""
    host = streaming("frozen_channel@0.5:2", seconds=1.0)
    host.go_to(50.0)
    moved = np.ptp(signals(host)[100:], axis=0)
    assert moved[1] == 0.0
    assert moved[0] > 100.0


@pytest.mark.fault(22, how="virtual board's `saturate`", times=1)
def test_saturation_is_flagged_and_reported_once():
    """Counts at full scale, flag bit 0, one EVENT 7 with the sensor's number from 0."""
    host = streaming("saturate@1:2", seconds=3.0)
    assert [(e.code, e.value) for e in host.events] == [(EventCode.SENSOR_SATURATED, 1)]
    for sample in host.samples:
        assert bool(sample.flags & SampleFlag.SATURATED) == (sample.lit[1] == 4095) == (sample.time_us > 1_000_000)


@pytest.mark.parametrize("fault", ["ambient_step@1:300", "ambient_ramp@1:100", "flicker@1:100"])
def test_ambient_light_shows_in_the_dark_counts(fault):
    """The light from outside is in both readings; the signal keeps its level."""
    host = streaming(fault, seconds=6.0)
    dark = np.array([s.dark for s in host.samples], float)
    assert dark[-100:].mean() - dark[:90].mean() > 70.0
    level = signals(host)
    assert np.abs(level[-100:].mean(axis=0) - level[:90].mean(axis=0)).max() < 5.0


def test_sensor_disagreement():
    """The last sensor is off by that much from then on."""
    host = streaming("sensor_disagreement@1:20", seconds=2.0)
    level = signals(host) * 3300 / 4096
    shift = level[110:].mean(axis=0) - level[:90].mean(axis=0)
    assert shift == pytest.approx([0.0, 20.0], abs=0.7)


def test_every_fault_is_tested_here():
    """No row of the table without its test above."""
    import pathlib

    text = pathlib.Path(__file__).read_text(encoding="utf-8")
    untested = [name for name in FAULTS if f'"{name}' not in text]
    assert untested == []
