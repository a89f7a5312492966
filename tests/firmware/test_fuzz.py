"""The decoder and the whole board under a fuzzer, sanitizers on."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.firmware.firmware_build import compile_host

TARGETS = {"fuzz_decoder": 20_000, "fuzz_board": 8_000}  # inputs a second that even a busy computer manages


@pytest.fixture(scope="module", params=TARGETS)
def target(request: pytest.FixtureRequest, firmware_folder: Path) -> tuple[str, Path]:
    """A fuzz target and its program."""
    return request.param, compile_host(firmware_folder, request.param, "host.c", f"{request.param}.c", "fuzz_main.c")


def fuzz(program: Path, seconds: float, seed: int) -> int:
    """Return how many inputs were tried; the program aborts at the first that violates an invariant."""
    run = subprocess.run([str(program), str(seconds), str(seed)], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return int(run.stdout)


def test_fuzzing_for_a_fifth_of_a_second_finds_nothing(target: tuple[str, Path]) -> None:
    """The invariants of c/fuzz_decoder.c and c/fuzz_board.c hold in a fifth of a second of processor time."""
    name, program = target
    assert fuzz(program, 0.2, seed=1) > TARGETS[name] / 20


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(2, 6))
def test_fuzzing_for_minutes_finds_nothing(target: tuple[str, Path], seed: int) -> None:
    """The same for half a minute from each of four seeds; prints the number of inputs."""
    name, program = target
    tried = fuzz(program, 30.0, seed)
    print(f"{name} seed {seed}: {tried} inputs")
    assert tried > TARGETS[name]
