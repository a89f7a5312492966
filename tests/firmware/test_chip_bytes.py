"""The same requests to the firmware on this computer's processor and on an emulated Cortex-M3: the same bytes."""

from __future__ import annotations

import json
import random
import subprocess
from pathlib import Path

import pytest

from protocol.link.framing import encode_frame
from protocol.link.messages import (
    ClearFault,
    Command,
    Heartbeat,
    Identify,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
    encode_command,
)
from tests.firmware.emulated_chip import compile_pipe, needs_chip, pipe_command

pytestmark = [needs_chip, pytest.mark.nightly]
VECTORS = Path(__file__).resolve().parents[1] / "vectors"


@pytest.fixture(scope="module")
def pipe_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program of the firmware at a pipe, for the chip."""
    return compile_pipe(tmp_path_factory.mktemp("chip"))


def lines_of(command: list[str], requests: list[str]) -> list[str]:
    """Run a program on requests and return its lines."""
    done = subprocess.run(command, input="\n".join(requests) + "\n", capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def assert_same_bytes(host: Path, chip: Path, requests: list[str]) -> None:
    """Fail on the first request that is answered differently."""
    expected, found = lines_of([str(host)], requests), lines_of(pipe_command(chip), requests)
    for number, (one, other) in enumerate(zip(expected, found, strict=True)):
        assert one == other, f"request {number}: {requests[number][:200]}"
    assert len(expected) == len(requests)


def vector_requests() -> list[str]:
    """Return requests that put every vector through the receiver and, to a booted board, through the commands."""
    requests = []
    for name in ("messages", "cobs", "damaged", "session"):
        cases = json.loads((VECTORS / f"{name}.json").read_text(encoding="utf-8"))
        for case in cases if isinstance(cases, list) else [cases]:
            wire = case["wire"] if "wire" in case else case["encoded"] + "00"
            requests += [f"F {wire}", "Z", "B 0 0", f"R {wire}", "T 0 0 0"]
    return requests


def random_command(source: random.Random) -> Command:
    """Return any command, its values inside and outside of what is allowed."""
    pressure_pa = source.choice([source.randint(-60_000, 60_000), source.randint(-(2**31), 2**31 - 1)])
    ramp = source.choice([0, 1, 3_000, 20_000, 40_000, source.getrandbits(32)])
    return source.choice(
        [
            SetPressure(pressure_pa, ramp),
            SetPressure(pressure_pa // 10, ramp),
            SetLimits(-source.randint(0, 50_000), source.randint(0, 60_000)),
            SetLimits(pressure_pa, source.randint(-60_000, 60_000)),
            Heartbeat(source.choice([0, 99, 100, 500, 5000, 5001, source.getrandbits(16)])),
            Start(source.choice([0, 1, 3, 62, 100, 250, 1000, 20_001, source.getrandbits(10)])),
            Stop(),
            Vent(),
            ClearFault(),
            Identify(),
        ]
    )


def random_frame(source: random.Random) -> bytes:
    """Return a command; one time in four another frame, a damaged one, or any bytes."""
    data = encode_command(random_command(source), source.randint(0, 3))
    match source.randrange(12):
        case 0:
            return encode_frame(
                source.randint(0x7F, 0x90), source.randint(0, 3), source.randbytes(source.randint(0, 12))
            )
        case 1:
            at = source.randrange(len(data))
            return data[:at] + bytes([data[at] ^ 1 << source.randrange(8)]) + data[at + 1 :]
        case 2:
            return source.randbytes(source.randint(0, 300))
    return data


def random_request(source: random.Random) -> str:
    """Return a request of any kind but those that reset."""
    kind = source.choice("RRRRTTTTPVESDMJ")
    match kind:
        case "R":
            return "R " + random_frame(source).hex()
        case "T":
            start_pa, step_pa = source.randint(-42_000, 50_000), source.randint(-600, 600)
            return "T " + " ".join(str(start_pa + i * step_pa) for i in range(source.randint(1, 12)))
        case "P":
            return f"P {source.randint(-48_000, 58_000)}"
        case "V" | "E":  # one time in eight a fault
            return f"{kind} {int((kind == 'V') == (source.random() > 0.125))}"
        case "S":
            return f"S {source.choice([0, 0, 1, 2, 3])}"
        case "D":
            return f"D {source.randint(0, 5)}"
        case "M":
            return f"M {source.choice([0, 20, 64, 100, 1_000_000])}"
    return f"J {source.randint(0, 100_000)}"


def random_script(source: random.Random) -> list[str]:
    """Return the requests of one board's life: a boot at any clock, then 5 to 25 requests and its state."""
    boot = ["Z", f"N {source.randint(1, 4)}", f"B {source.randint(0, 4)} {source.getrandbits(32)}"]
    started = "R " + encode_command(Start(source.choice([100, 1000])), 200).hex()
    held_pa = source.randint(-40_000, 50_000)
    command = encode_command(SetPressure(held_pa, 0), 201).hex()
    held = [f"P {held_pa}", f"R {command}", "T" + f" {held_pa}" * 10]  # half of them begin in HOLDING
    requests = [random_request(source) for _ in range(source.randint(5, 25))]
    return [*boot, started, *held * source.randrange(2), *requests, "Q"]


def test_chip_answers_vectors_as_this_computer(firmware_program: Path, pipe_program: Path) -> None:
    """Every vector of tests/vectors/."""
    assert_same_bytes(firmware_program, pipe_program, vector_requests())


@pytest.mark.parametrize("seed", range(2, 12))
def test_chip_answers_ten_thousand_scripts_as_this_computer(
    firmware_program: Path, pipe_program: Path, seed: int
) -> None:
    """A thousand random scripts from each of ten seeds."""
    source = random.Random(seed)
    scripts = [request for _ in range(1000) for request in random_script(source)]
    assert_same_bytes(firmware_program, pipe_program, scripts)
