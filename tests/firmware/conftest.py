"""The firmware, compiled once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware.firmware_build import Bench, compile_host


@pytest.fixture(scope="session")
def bench_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The firmware with a pipe for a board."""
    return compile_host(tmp_path_factory.mktemp("bench"), "bench", "host.c", "bench.c")


@pytest.fixture
def bench(bench_program: Path) -> Iterator[Bench]:
    """A firmware that has not booted yet."""
    bench = Bench(bench_program)
    yield bench
    bench.close()
