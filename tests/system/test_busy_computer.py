"""A heavy page never costs a run: no vent while every page is opened on a busy computer."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.system.busy_computer import RUN_S, play

RUNS = 25  # of each rate


@pytest.mark.nightly
@pytest.mark.timeout(RUN_S * RUNS)
@pytest.mark.skipif(sys.platform != "linux", reason="a pseudo-terminal and the choice of cores")
@pytest.mark.fault(
    60, how="every page opened in a run, eight busy processes on its two cores, 100 Hz and 1 kHz", times=50
)
@pytest.mark.parametrize("rate_hz", [100, 1000])
def test_every_page_opened_on_a_busy_computer_vents_no_run(tmp_path: Path, rate_hz: int) -> None:
    """The run goes on at its pressure, and no error is told."""
    for number in range(RUNS):
        folder = tmp_path / str(number)
        folder.mkdir()
        found = play(rate_hz, folder)
        assert found["pages"] == 8, found
        assert found["running"], found
        assert found["errors"] == [], found
        assert found["pressure_kpa"] > 40.0, found
