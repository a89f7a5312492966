"""Faults on the emulated chip: the valve opens in time by the chip's own clock, and nothing wrong is recorded."""

from __future__ import annotations

import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from analysis import load_recording
from boat_daq.engine.settings import Settings, save_settings
from protocol.link.messages import (
    AckStatus,
    BoardEvent,
    EventCode,
    Heartbeat,
    Hello,
    Identify,
    SetPressure,
    Start,
    encode_command,
)
from protocol.recording import BoardState
from tests.firmware.emulated_chip import ChipHost, EmulatedChip, compile_board, emulated, needs_chip

pytestmark = [needs_chip, pytest.mark.nightly, pytest.mark.timeout(900)]

ROOT = Path(__file__).resolve().parents[2]
WATCHDOG_MS = 125  # after which the valve opens; the processor is reset after as much again
TICK_MS = 10
RAM_START, RAM_BYTES = 0x20000000, 32 * 1024
UART_DATA = 0x40004000
POWER, WATCHDOG, RESET_PIN = 0, 1, 3  # boot reasons
SHORT_PLAN = """
name = "short"
kind = "staircase"
cycles = 2
high_kpa = 30.0
low_kpa = -20.0
step_kpa = 10.0
ramp_kpa_per_s = 40.0
settling_s = 0.2
window_s = 0.3
min_dwell_s = 0.5
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program of the board."""
    return compile_board(tmp_path_factory.mktemp("faults"))


@pytest.fixture
def chip(program: Path) -> Iterator[EmulatedChip]:
    """Yield an emulated chip that has just booted."""
    with emulated(program) as chip:
        yield chip


@pytest.fixture
def host(chip: EmulatedChip) -> Iterator[ChipHost]:
    """Yield a host of the chip's that has received samples at 100 Hz and holds 30 kPa."""
    with closing(ChipHost(chip)) as host:
        host.command(Identify())
        host.command(Heartbeat(5000))
        host.command(Start(100))
        host.command(SetPressure(30_000, 0))
        host.until(lambda _: bool(host.kept_samples) and host.kept_samples[-1].state == BoardState.HOLDING)
        yield host


def booted(host: ChipHost, reason: int) -> None:
    """Wait for a boot of that reason, and check that a command is answered after it."""
    event = host.until_event(EventCode.BOOTED)
    assert event.value == reason
    host.socket.sendall(b"\0")
    hello = host.command(Identify())
    assert isinstance(hello, Hello)
    assert hello.boot_reason == reason


def pressure_falls(chip: EmulatedChip) -> None:
    """Check that the valve is open and the pressure below 1 kPa after two seconds of the chip's time."""
    with chip.halted() as debugger:
        start_ms = debugger.actuator().ms
    while True:
        with chip.halted() as debugger:
            actuator = debugger.actuator()
        if actuator.ms - start_ms > 2000:
            break
        time.sleep(0.2)
    assert actuator.vent == 1
    assert abs(actuator.pressure_mpa) < 1_000_000


# ---- the processor -------------------------------------------------------------------------------------------------


@pytest.mark.fault(
    10, how="the main loop of an emulated chip halted under pressure, until its watchdog resets it", times=1
)
def test_halted_main_loop_opens_the_valve_and_is_reset(chip: EmulatedChip, host: ChipHost) -> None:
    """A converter that never ends: 125 ms later the valve is open, the watchdog resets, HELLO reports it."""
    with chip.halted() as debugger:
        debugger.set_actuator(conversion_ms=2**31 - 1)
        halted_ms = debugger.actuator().ms
    host.until_event(EventCode.BOOTED)
    with chip.halted() as debugger:
        opened_ms = debugger.actuator().opened_ms
        debugger.set_actuator(conversion_ms=0)
    assert opened_ms - halted_ms <= WATCHDOG_MS + TICK_MS
    host.socket.sendall(b"\0")
    hello = host.command(Identify())
    assert isinstance(hello, Hello)
    assert hello.boot_reason == WATCHDOG
    pressure_falls(chip)


@pytest.mark.fault(10, how="a fault of an emulated chip's processor under pressure", times=1)
def test_processor_fault_is_reset_by_the_watchdog(chip: EmulatedChip, host: ChipHost) -> None:
    """A processor that has faulted runs no handler but the watchdog's: valve open, reset, HELLO reports it."""
    with chip.halted() as debugger:
        assert debugger.actuator().vent == 0
        debugger.fault()
    booted(host, WATCHDOG)
    pressure_falls(chip)


@pytest.mark.fault(10, how="an emulated chip reset after any number of bytes of a frame", times=20)
def test_reset_amid_frames_loses_only_those_frames(chip: EmulatedChip) -> None:
    """The reset pin after any number of a frame's bytes, twenty times: one damaged frame at most, event 1 found."""
    source = random.Random(4)
    with closing(ChipHost(chip)) as host:
        for _ in range(20):
            host.command(Start(100))
            host.samples(3)
            damaged = host.reader.malformed + host.reader.crc_errors
            with chip.halted() as debugger:
                debugger.run_to_write(UART_DATA, times=source.randint(1, 30))
                debugger.reset()
            booted(host, RESET_PIN)
            assert host.reader.malformed + host.reader.crc_errors <= damaged + 1
        assert host.reader.malformed + host.reader.crc_errors > 0


@pytest.mark.fault(10, how="an emulated chip reset between the halves of a command", times=1)
def test_command_cut_by_a_reset_is_not_executed(chip: EmulatedChip, host: ChipHost) -> None:
    """Half of a SET_PRESSURE, a reset, its other half: no answer, the valve stays open."""
    frame = encode_command(SetPressure(40_000, 0), 77)
    host.socket.sendall(frame[:7])
    host.samples(2)
    with chip.halted() as debugger:
        debugger.reset()
    host.until_event(EventCode.BOOTED)
    host.socket.sendall(frame[7:])
    booted_state = host.command(Start(100))
    assert getattr(booted_state, "status", None) == AckStatus.DONE
    assert host.samples(20)[-1].state == BoardState.IDLE
    pressure_falls(chip)


@pytest.mark.fault(10, how="RAM of an emulated chip filled with random bytes under pressure, and a reset", times=1)
def test_brown_out_is_a_power_cycle(chip: EmulatedChip, host: ChipHost) -> None:
    """RAM of random bytes and a reset: a boot from power, a valve that is open, commands and samples as ever."""
    with chip.halted() as debugger:
        debugger.write_at(RAM_START, random.Random(5).randbytes(RAM_BYTES))
        debugger.reset()
    booted(host, POWER)
    host.command(Start(100))
    samples = host.samples(10)
    assert [sample.state for sample in samples] == [BoardState.IDLE] * len(samples)
    pressure_falls(chip)


# ---- the line ------------------------------------------------------------------------------------------------------


@pytest.mark.fault(2, how="bytes lost by overruns of an emulated chip's UART", times=1)
def test_overrun_loses_bytes_and_executes_nothing_wrong(chip: EmulatedChip, host: ChipHost) -> None:
    """Commands without a pause while a conversion takes 100 ms: the buffer overruns, later commands are answered."""
    with chip.halted() as debugger:
        debugger.set_actuator(conversion_ms=100)
    before = host.kept_samples[-1]
    overruns = 0
    for _ in range(40):
        host.socket.sendall(b"".join(encode_command(Heartbeat(5000), seq) for seq in range(120)))
        host.until(lambda m: isinstance(m, BoardEvent) and m.code == EventCode.SAMPLES_DROPPED)
        with chip.halted() as debugger:
            overruns = debugger.actuator().overruns
        if overruns:
            break
    assert overruns
    with chip.halted() as debugger:
        debugger.set_actuator(conversion_ms=0)
    host.socket.sendall(b"\0")
    assert isinstance(host.command(Identify()), Hello)
    after = host.samples(20)
    assert after[-1].state == BoardState.HOLDING
    dropped = sum(m.value for m in host.messages if isinstance(m, BoardEvent) and m.code == EventCode.SAMPLES_DROPPED)
    received = sum(sample.index > before.index for sample in host.kept_samples)
    assert host.kept_samples[-1].index - before.index == received + dropped


@contextmanager
def noisy_cable(chip: EmulatedChip, *, bytes_per_error: int) -> Iterator[str]:
    """Relay between a program and the chip; one bit is flipped in so many bytes, in both directions."""
    host, port = chip.url.removeprefix("socket://").split(":")
    source = random.Random(6)

    def carry(sender: socket.socket, receiver: socket.socket) -> None:
        try:
            while data := bytearray(sender.recv(4096)):
                for at in range(len(data)):
                    if source.randrange(bytes_per_error) == 0:
                        data[at] ^= 1 << source.randrange(8)
                receiver.sendall(data)
        except OSError:
            return  # the program has left

    def serve() -> None:
        inside, _ = server.accept()
        with inside, socket.create_connection((host, int(port))) as outside:
            back = threading.Thread(target=carry, args=(outside, inside), daemon=True)
            back.start()
            carry(inside, outside)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"


# ---- the whole program ---------------------------------------------------------------------------------------------


def started_record(url: str, run: Path, *options: str) -> subprocess.Popen[str]:
    """Start `boat-daq record`."""
    command = [sys.executable, "-m", "boat_daq", "record", "--port", url, "--out", str(run), *options, "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def ended_record(process: subprocess.Popen[str], returncode: int) -> dict[str, Any]:
    """Wait until it ends so and return its object."""
    text, errors = process.communicate(timeout=800)
    assert process.returncode == returncode, errors
    content: dict[str, Any] = json.loads(text)
    return content


def verified(run: Path) -> None:
    """Check that the samples derived again from the recorded bytes are identical."""
    command = [sys.executable, "-m", "boat_daq", "verify", str(run), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=120)
    assert json.loads(done.stdout)["identical"] is True


@pytest.fixture
def plan(tmp_path: Path) -> str:
    """Return the file of a short plan."""
    path = tmp_path / "short.toml"
    path.write_text(SHORT_PLAN, encoding="utf-8")
    return str(path)


def under_pressure(chip: EmulatedChip) -> None:
    """Wait until the program has brought the actuator to more than 15 kPa."""
    end_s = time.monotonic() + 240
    while time.monotonic() < end_s:
        with chip.halted() as debugger:
            if debugger.actuator().pressure_mpa > 15_000_000:
                return
        time.sleep(0.1)
    raise AssertionError("the program commands no pressure")


@pytest.mark.fault(1, how="bits flipped between `record` and an emulated chip, in both directions", times=1)
def test_noise_on_the_line_costs_only_the_damaged_frames(chip: EmulatedChip, tmp_path: Path, plan: str) -> None:
    """A wrong bit in 3,000 bytes: the plan ends, every gap is counted, no sample is wrong, verify is identical."""
    run = tmp_path / "run.boat"
    with noisy_cable(chip, bytes_per_error=3000) as url:
        summary = ended_record(started_record(url, run, "--plan", plan), 0)
    assert summary["stop_reason"] == "finished"
    assert summary["crc_errors"] + summary["damaged_frames"] > 0
    assert 0 < summary["lost_samples"] < 0.05 * summary["samples"]
    recording = load_recording(run)
    assert 1400 < (recording.lit - recording.dark)[:, 0].min() <= (recording.lit - recording.dark)[:, 0].max() < 1800
    verified(run)


@pytest.mark.fault(7, how="the clock of an emulated chip wraps while `record` runs at 1 kHz", times=1)
def test_clock_wraps_while_recording(program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The 32-bit clock wraps three seconds after boot: 1,000 samples/s, none lost, time continuous."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    save_settings(Settings(rate_hz=1000))
    run = tmp_path / "run.boat"
    with emulated(program) as chip:
        with chip.halted() as debugger:
            debugger.reset()
            debugger.run_to("boat_init")
            debugger.write("clock_ms", struct.pack("<I", (2**32 - 6_000_000) // 1000))
        summary = ended_record(started_record(chip.url, run, "--duration", "10"), 0)
        with chip.halted() as debugger:
            assert debugger.actuator().ms > 6_000
    assert (summary["lost_samples"], summary["samples"] > 9_000) == (0, True)
    assert load_recording(run).time_s[-1] == pytest.approx(summary["samples"] / 1000, abs=0.01)
    verified(run)


@pytest.mark.fault(18, how="`record` killed with -9 while an emulated chip is under pressure", times=1)
def test_killed_host_leaves_a_vented_actuator(chip: EmulatedChip, tmp_path: Path, plan: str) -> None:
    """kill -9 under pressure: the valve opens within a second of the chip's clock; the next host is told."""
    process = started_record(chip.url, tmp_path / "run.boat", "--plan", plan)
    under_pressure(chip)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    pressure_falls(chip)
    with chip.halted() as debugger:
        actuator = debugger.actuator()
    assert 0 < actuator.opened_ms - actuator.heard_ms <= 1000 + TICK_MS
    with closing(ChipHost(chip)) as host:
        host.command(Identify())
        host.command(Start(100))
        assert host.samples(1)[0].state == BoardState.FAULT


@pytest.mark.fault(10, how="a fault of an emulated chip's processor while `record` runs a plan", times=1)
def test_reset_amid_a_recorded_plan_ends_it_in_a_sound_recording(chip: EmulatedChip, tmp_path: Path, plan: str) -> None:
    """A watchdog reset under pressure: the run ends with its cause, the recording verifies, the valve is open."""
    run = tmp_path / "run.boat"
    process = started_record(chip.url, run, "--plan", plan)
    under_pressure(chip)
    with chip.halted() as debugger:
        debugger.fault()
    summary = ended_record(process, 1)
    assert "restart" in summary["failure"] or "restart" in summary["stop_reason"]
    assert summary["samples"] > 0
    verified(run)
    pressure_falls(chip)
