"""The firmware, compiled once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware.firmware_build import FirmwareProcess, compile_host


@pytest.fixture(scope="session")
def firmware_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program of the firmware at a pipe."""
    return compile_host(tmp_path_factory.mktemp("firmware"), "pipe_board", "host.c", "pipe_board.c")


@pytest.fixture
def process(firmware_program: Path) -> Iterator[FirmwareProcess]:
    """Yield a firmware process that has not booted yet."""
    process = FirmwareProcess(firmware_program)
    yield process
    process.close()
