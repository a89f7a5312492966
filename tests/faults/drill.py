"""A fault drill: the virtual board on a real pseudo-terminal, the program's own session, and the file it leaves."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.data.boat_file import read_boat_file
from analysis.data.recording import Recording
from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, Unit, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from protocol.link.framing import FrameReader
from protocol.link.messages import Command, decode_command
from protocol.recording import open_recording
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached

needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")
OVER = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)
SHORT = Plan("drill", "staircase", 1, step_kpa=45.0, ramp_kpa_per_s=20.0)
VOLT_MV = 3300 / 4096  # of one count
ROOT = Path(__file__).resolve().parents[2]


class Drill:
    """One board, one session, one recording; `close` before reading the file."""

    def __init__(self, home: Path, session: Session, *, truth: Path) -> None:
        self.path = home / "run.boat"
        self.session = session
        self._truth = truth

    def start(self, plan: Plan = SHORT) -> None:
        """Arm a plan and start it."""
        self.session.arm(plan)
        self.session.start()

    def reached(self, condition: Callable[[SessionSnapshot], bool], seconds: float = 60.0) -> SessionSnapshot:
        """Return the first snapshot that meets the condition; fail if none does in time."""
        return reached(self.session, condition, seconds)

    def until_sample(self, index: int) -> None:
        """Wait until the board's sample of that number, or a later one, has come."""
        self.reached(lambda s: s.recorded_s * 100 > index or s.link is LinkState.LOST, 120)

    def close(self) -> Recording:
        """Close the recording, check that it is identical to its bytes, and return it."""
        self.session.stop_recording()
        verdict = verify_recording(self.path)
        assert verdict.identical, verdict.difference
        return self.again()

    def again(self) -> Recording:
        """Read the closed recording."""
        return read_boat_file(self.path)

    def ends(self) -> tuple[int, int]:
        """Return the index of the first and of the last sample in the file."""
        index = self.again().index
        return int(index[0]), int(index[-1])

    def rows(self, sql: str) -> list[tuple[Any, ...]]:
        """Return rows of the recording."""
        with closing(open_recording(self.path)) as db:
            return db.execute(sql).fetchall()

    def commands(self) -> list[tuple[int, Command]]:
        """Return sequence number and command of every frame sent, repetitions included."""
        sent = b"".join(raw for (raw,) in self.rows("SELECT raw FROM chunk WHERE direction = 1 ORDER BY id"))
        decoded = [(frame.seq, decode_command(frame)) for frame in FrameReader().receive(sent)]
        return [(seq, command) for seq, command in decoded if not isinstance(command, int)]

    def truth(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the board's own run, index, time, pressure, elongation and signals, one row per sample."""
        lines = self._truth.read_text(encoding="utf-8").splitlines()[2:-1]
        return np.array([line.split(",") for line in lines], dtype=float)

    def vented(self) -> bool:
        """Return whether the board's own pressure is ambient."""
        return abs(self.truth()[-1, 3]) < 1.0


@contextmanager
def drill(
    folder: Path,
    *faults: str,
    speed: float = 50.0,
    unit: Unit | None = None,
    home: Path | None = None,
    own_process: bool = False,
) -> Iterator[Drill]:
    """Serve a board with faults, connect, and begin a recording.

    Parameters
    ----------
    folder : holds the truth and the units, and the recording where `home` is None.
    speed : board seconds per second.
    own_process : whether the board runs while this process is blocked.
    """
    assert os.name == "posix"
    truth = folder / "truth.csv"
    units = UnitLibrary(folder / "units")
    if unit is not None:
        units.save(unit)
    session = Session(Settings(), units)
    try:
        start = serve if own_process else serve_in_thread
        with start(BoardSettings(speed=speed, faults=faults, truth=str(truth))) as board:
            session.connect(board.url, unit=unit.name if unit else "")
            session.wait_connected(15.0)
            found = Drill(home or folder, session, truth=truth)
            session.start_recording(found.path, {"operator": "drill"})
            yield found
            session.close()
    finally:
        session.close()
