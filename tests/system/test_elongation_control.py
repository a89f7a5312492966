"""The control of the elongation on a board of another maker, written from the wire contract alone."""

from __future__ import annotations

import sys
import time
from contextlib import closing

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.calibration.inverse import Fusion, Inverse
from analysis.twin.controller import ElongationController, Tuning
from analysis.twin.dynamics import Lag
from analysis.twin.hysteresis import HysteresisModel
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.snapshot import MessageKind
from tests.system import third_party_boards as boards

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")]

MM_PER_KPA, STEP_MV = 0.07, 3300 / 4096


class LateByTwice300(boards.Board):
    """A link over which every frame takes 300 ms: the answer to a command comes 600 ms after it."""

    delay_s = 0.6


def regulator() -> ElongationController:
    """Return the controller of a unit without hysteresis, whose signals are those of these boards."""
    x = np.linspace(-3.0, 3.0, 30)
    lines = [(1901 + 39 * n + 10 * x / MM_PER_KPA) * STEP_MV for n in range(2)]
    fusion = Fusion.of([Inverse.of(fit_calibration(x, y, 1), noise_sd=1.0) for y in lines])
    model = HysteresisModel(np.zeros(1), np.array([MM_PER_KPA]), 0.0, 0.0, 0.0, (-40.0, 40.0))
    return ElongationController(model, fusion, Tuning.of(Lag(0.02, 30.0, 1.0), 30.0))


def started(board: boards.Board, tmp_path) -> Session:
    session = Session(Settings(), UnitLibrary(tmp_path))
    session.connect(board.url)
    session.wait_connected()
    session.wait(lambda s: all(check.ok for check in session.preflight() if check.name == "zero"), 5.0)
    session.control_elongation(1.4, regulator())
    return session


def test_a_board_from_the_contract_alone_holds_an_elongation(tmp_path):
    with closing(boards.Board()) as board, closing(started(board, tmp_path)) as session:
        time.sleep(4.0)
        assert board.pressure / 1000 * MM_PER_KPA == pytest.approx(1.4, abs=0.05)
        assert session.snapshot().elongation.elongation_mm == pytest.approx(1.4, abs=0.05)
        assert max(board.pressures) < 23.0
        session.vent()
        assert session.wait(lambda s: s.elongation is None, 2.0).elongation is None


def test_answers_beyond_the_margin_end_the_control_vented(tmp_path):
    with closing(LateByTwice300()) as board, closing(started(board, tmp_path)) as session:
        seen = session.wait(lambda s: any(m.kind is MessageKind.LINK_DELAY for m in s.messages), 10.0)
        message = next(m for m in seen.messages if m.kind is MessageKind.LINK_DELAY)
        assert "the control bears" in message.cause
        assert "vented" in message.cause
        time.sleep(1.5)
        assert abs(board.pressure) < 1000
