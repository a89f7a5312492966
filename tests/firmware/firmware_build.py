"""Compiles the firmware for this computer, warnings as errors and both sanitizers on, and runs it as a process."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
FIRMWARE = HERE.parents[1] / "protocol" / "firmware"
PORTABLE = [FIRMWARE / f"boat{part}.c" for part in ("", "_control", "_frame")]
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
SANITIZERS = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def compile_host(folder: Path, name: str, *sources: str) -> Path:
    """Return the program `name` made of the firmware and of `sources` from the folder c/.

    What is compiled in the folder already is not compiled again.
    """
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not on this computer: the firmware cannot be compiled for it")
    objects = []
    for source in [*PORTABLE, *(HERE / "c" / source for source in sources)]:
        objects.append(folder / f"{source.stem}.o")
        if objects[-1].exists():
            continue
        strict = WARNINGS if source in PORTABLE else [flag for flag in WARNINGS if flag != "-Wconversion"]
        command = [compiler, *strict, *SANITIZERS, f"-I{FIRMWARE}", "-c", str(source), "-o", str(objects[-1])]
        subprocess.run(command, check=True)
    program = folder / name
    subprocess.run([compiler, *SANITIZERS, *map(str, objects), "-o", str(program), "-lm"], check=True)
    return program


class FirmwareProcess:
    """The firmware as a process that reads requests from a pipe (c/pipe_board.c)."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen([str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def request(self, text: str) -> str:
        """Send one request and return the line that answers it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line.endswith("\n"), f"the firmware ended at {text[:200]!r}"
        return line.strip()

    def transmitted(self, text: str) -> bytes:
        """Send one request and return the bytes transmitted meanwhile."""
        return bytes.fromhex(self.request(text))

    def boot(self, *, reason: int = 0, clock_us: int = 0) -> bytes:
        """Boot with this reason and clock and return the bytes transmitted."""
        return self.transmitted(f"B {reason} {clock_us}")

    def receive(self, data: bytes) -> bytes:
        """Receive bytes of the host and return those transmitted."""
        return self.transmitted(f"R {data.hex()}")

    def close(self) -> None:
        """End the process and check that no sanitizer reported anything."""
        assert self._process.communicate(timeout=10) == ("", None)
        assert self._process.returncode == 0
