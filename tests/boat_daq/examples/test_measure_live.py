"""The script of the documentation, on a virtual board."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

import pytest

from analysis import load_recording
from boat_daq.engine.settings import Settings
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import LinkState
from boat_daq.examples.measure_live import main
from boat_daq.measure import Session
from protocol.base.errors import DeviceError
from tests.boat_daq.engine.served_board import serve_in_thread

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")


def test_the_script_measures_and_reads_its_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All that was yielded is in the frame; and it runs inside an event loop, as in a notebook."""
    with serve_in_thread(BoardSettings(speed=20.0)) as board:

        async def cell() -> object:
            return main(board.url, str(tmp_path / "run.boat"))

        asyncio.run(cell())
    frame = load_recording(tmp_path / "run.boat").to_frame()
    printed = capsys.readouterr().out
    assert "run finished" in printed
    assert sum(int(line.split()[0]) for line in printed.splitlines() if "samples," in line) == 200
    assert {0.0, 20.0} <= set(frame["target_kpa"].dropna())
    assert frame["index"].is_monotonic_increasing


def test_a_session_that_cannot_open_is_closed_and_raises(tmp_path: Path) -> None:
    with pytest.raises(DeviceError):
        Session.open(str(tmp_path / "no port"), timeout_s=2, settings=Settings())


def test_an_interrupted_script_vents_and_closes() -> None:
    """What leaves the block, an exception of the script too, closes the session."""
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        with pytest.raises(ZeroDivisionError), Session.open(board.url, settings=Settings()) as session:
            session.set_pressure(10.0)
            raise ZeroDivisionError
        assert session.snapshot().link is LinkState.CLOSED
