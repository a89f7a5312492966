"""Two boards at 1 kHz at once: what ends one leaves the other's samples, link and recording alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.session.session import Session
from boat_daq.engine.session.shared_vent import SharedVent
from boat_daq.engine.settings import HOME_VARIABLE, Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

RATE_HZ = 1000


def without_a_gap(path: Path) -> int:
    """Return the number of samples of a recording; none was lost, and their times are a period apart."""
    from analysis import load_recording

    summary, run = summarise(path), load_recording(path)
    assert (summary.gaps, summary.lost_samples, summary.damaged_frames) == (0, 0, 0)
    np.testing.assert_allclose(np.diff(run.time_s), 1 / RATE_HZ, atol=2e-4)
    return int(run.time_s.size)


def test_a_board_that_is_lost_leaves_the_other_session_alone(tmp_path: Path) -> None:
    """Both record; one board is unplugged: that session says so, the other one goes on without a gap, and vents."""
    units, paths = UnitLibrary(tmp_path / "units"), [tmp_path / "one.boat", tmp_path / "two.boat"]
    boards = [serve_in_thread(BoardSettings(unit=unit, seed=seed)) for seed, unit in enumerate(("SA1", "SA2"))]
    sessions = [Session(Settings(rate_hz=RATE_HZ), units) for _ in boards]
    try:
        for session, board, path in zip(sessions, boards, paths, strict=True):
            session.connect(board.url)
            session.wait_connected()
            session.start_recording(path)
        one, two = sessions
        reached(two, lambda s: s.recorded_s > 0.2, 20)
        boards[1].close()
        assert two.wait(lambda s: s.link is LinkState.LOST, 20).link is LinkState.LOST
        before = one.snapshot().recorded_s
        assert one.wait(lambda s: s.recorded_s > before + 0.3, 20).link is LinkState.UP
        one.vent()
        assert one.stop_recording() == paths[0]
    finally:
        for each in (*sessions, *boards):
            each.close()
    assert without_a_gap(paths[0]) > 500
    assert summarise(paths[1]).samples >= 200


@pytest.mark.nightly
def test_a_program_that_is_killed_leaves_the_other_one_alone(tmp_path: Path) -> None:
    """Two programs at 1 kHz; VENT ALL reaches both; one is killed: the other records all its samples, VENT ALL too."""
    home = tmp_path / "home"
    environment = {**os.environ, HOME_VARIABLE: str(home)}
    home.mkdir()
    (home / "settings.toml").write_text(f"rate_hz = {RATE_HZ}\n", encoding="utf-8")
    paths, vented = [tmp_path / "one.boat", tmp_path / "two.boat"], []
    shared = SharedVent(lambda: vented.append(True), lambda: "this", home)
    with serve(BoardSettings(unit="SA1")) as first, serve(BoardSettings(unit="SA2")) as second:
        record = [sys.executable, "-m", "boat_daq", "record", "--duration", "12"]
        programs = [
            subprocess.Popen([*record, "--port", board.url, "--unit", unit, "--out", str(path)], env=environment)
            for board, unit, path in zip((first, second), ("SA1", "SA2"), paths, strict=True)
        ]
        deadline = time.monotonic() + 60
        while len(shared.others()) < 2 and time.monotonic() < deadline:
            time.sleep(0.1)
        assert sorted(answer.name for answer in shared.vent_others() if answer.vented) == ["SA1", "SA2"]
        while not paths[1].exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(3)
        programs[1].send_signal(signal.SIGKILL)
        programs[1].wait()
        assert [answer.name for answer in shared.vent_others()] == ["SA1"]
        assert programs[0].wait(60) == 0
    shared.close()
    assert vented == []
    assert without_a_gap(paths[0]) >= 11.9 * RATE_HZ
