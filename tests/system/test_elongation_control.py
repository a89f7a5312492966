"""The control of the elongation over real ports: a board of another maker, a slow network, faults of the board."""

from __future__ import annotations

import socket
import sys
import threading
import time
from contextlib import closing, suppress

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.calibration.inverse import Fusion, Inverse
from analysis.elongation_control.controller import ElongationController, Tuning
from analysis.elongation_control.dynamics import Lag
from analysis.elongation_control.hysteresis import HysteresisModel
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import MessageKind
from boat_daq.workflows.unit_control import as_regulator
from tests.analysis import twin_unit
from tests.conftest import reached
from tests.system import third_party_boards as boards

pytestmark = [pytest.mark.nightly, pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")]

MM_PER_KPA, STEP_MV = 0.07, 3300 / 4096
LIMITS_KPA = (-45.3, 55.3)  # of the virtual board, as measured


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
    reached(session, lambda s: all(check.ok for check in session.preflight() if check.name == "zero"), 5.0)
    session.control_elongation(1.4, as_regulator(regulator()))
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
        seen = reached(session, lambda s: any(m.kind is MessageKind.LINK_DELAY for m in s.messages), 10.0)
        message = next(m for m in seen.messages if m.kind is MessageKind.LINK_DELAY)
        assert "the control tolerates" in message.cause
        assert "vented" in message.cause
        time.sleep(1.5)
        assert abs(board.pressure) < 1000


class DelayedPort:
    """A TCP port of this computer before another one: every byte arrives `delay_s` later, either way."""

    def __init__(self, url: str, delay_s: float) -> None:
        host, _, port = url.removeprefix("socket://").rpartition(":")
        self._there, self._delay_s = (host, int(port)), delay_s
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self._ends: list[socket.socket] = [self._listener]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):  # closed
            while True:
                near, _ = self._listener.accept()
                far = socket.create_connection(self._there)
                self._ends += [near, far]
                for source, sink in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=(source, sink), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(65536):
                threading.Timer(self._delay_s, self._send, (sink, data)).start()  # in order: far apart in time
            sink.shutdown(socket.SHUT_RDWR)

    def _send(self, sink: socket.socket, data: bytes) -> None:
        with suppress(OSError):
            sink.sendall(data)

    def close(self) -> None:
        for end in self._ends:
            end.close()


def controlled(url: str, mm: float, tmp_path) -> Session:
    """Return a session that controls the elongation of a virtual SA1."""
    session = Session(Settings(), UnitLibrary(tmp_path))
    session.connect(url)
    session.wait_connected()
    reached(session, lambda s: all(check.ok for check in session.preflight() if check.name == "zero"), 5.0)
    session.control_elongation(mm, as_regulator(twin_unit.regulator()))
    return session


def highest_kpa(session: Session, seconds: float) -> tuple[float, float]:
    """Return the lowest and highest pressure of some seconds."""
    seen, end_s = [0.0], time.monotonic() + seconds
    while time.monotonic() < end_s:
        last = session.snapshot().last
        seen.append(last.pressure_kpa if last is not None else 0.0)
        time.sleep(0.02)
    return min(seen), max(seen)


def test_a_network_late_by_300_ms_each_way_ends_the_control_within_limits(tmp_path):
    with (
        serve(BoardSettings(port="127.0.0.1:0")) as board,
        closing(DelayedPort(board.url, 0.3)) as port,
        closing(controlled(port.url, 2.5, tmp_path)) as session,
    ):
        low, high = highest_kpa(session, 6.0)
        stops = [m for m in session.snapshot().messages if m.kind is MessageKind.LINK_DELAY]
        assert [m.level for m in stops] == ["error"]
        assert "the control tolerates" in stops[0].cause
        assert session.snapshot().elongation is None
        assert LIMITS_KPA[0] < low < high < LIMITS_KPA[1]
        last = reached(session, lambda s: abs(s.last.pressure_kpa) < 2.0, 5.0).last
        assert abs(last.pressure_kpa) < 2.0


@pytest.mark.parametrize(
    ("faults", "mm", "ends"),
    [
        (("leak@8:3000",), 3.0, {MessageKind.NOT_FOLLOWING}),
        (("stall@8:15",), 3.0, {MessageKind.NOT_FOLLOWING}),
        (("saturate@8:1",), 1.0, {MessageKind.SENSOR_LOST}),
        (("frozen_channel@8:2",), 1.0, {MessageKind.SENSOR_LOST}),
        (("saturate@8:1", "frozen_channel@8:2"), 1.0, {MessageKind.ELONGATION_UNKNOWN, MessageKind.NOT_FOLLOWING}),
        (("ambient_step@8:1500",), 1.0, set()),
        ((), 3.68, set()),  # beside the end of the range, where the curves are flattest
    ],
)
def test_a_fault_over_a_real_port_ends_in_a_known_state(faults, mm, ends, tmp_path):
    with serve(BoardSettings(faults=faults)) as board, closing(controlled(board.url, mm, tmp_path)) as session:
        low, high = highest_kpa(session, 16.0)
        state = session.snapshot()
        kinds = {message.kind for message in state.messages}
        assert LIMITS_KPA[0] < low < high < LIMITS_KPA[1]
        assert kinds & ends or not ends
        if state.elongation is None:
            assert abs(state.last.pressure_kpa) < 2.0
            assert any(message.level == "error" and message.cause for message in state.messages)
        else:
            assert state.elongation.elongation_mm == pytest.approx(mm, abs=0.1)
