"""The firmware, compiled once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware.firmware_build import FirmwareProcess, compile_host


@pytest.fixture(scope="session")
def firmware_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder in which the firmware is compiled, for all programs that it is part of."""
    return tmp_path_factory.mktemp("firmware")


@pytest.fixture(scope="session")
def firmware_program(firmware_folder: Path) -> Path:
    """Return the program of the firmware at a pipe."""
    return compile_host(firmware_folder, "pipe_board", "host.c", "pipe_board.c")


@pytest.fixture
def process(firmware_program: Path) -> Iterator[FirmwareProcess]:
    """Yield a firmware process that has not booted yet."""
    process = FirmwareProcess(firmware_program)
    yield process
    process.close()
