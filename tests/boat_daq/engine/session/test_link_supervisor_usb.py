"""A lost board is found by the serial number of its USB device; the instrument that took its port receives nothing."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from boat_daq.engine.link import ports
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.snapshot import LinkState, MessageKind
from protocol.link.framing import FrameReader
from protocol.link.messages import MessageType
from protocol.simulator.board import VirtualBoard
from tests.conftest import reached

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

PATIENCE_S = 20.0
PROFILE = """name = "One sensor"
kind = "lines"
device = { n_sensors = 1, rate_hz = 100, vref_mv = 3300, adc_bits = 12, polarity = -1 }
lines.fields = [{ name = "time", unit = "ms" }, { name = "pressure", unit = "kPa" }, "s1_lit", "s1_dark"]
"""


class Plug:
    """A device on a pseudo-terminal, under the names that the system gives its port.

    Parameters
    ----------
    make : a function of what came that returns what the device sends, called every 10 ms.
    """

    def __init__(self, make: Callable[[bytes], bytes]) -> None:
        self.received, self._make = b"", make
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def at(self, name: Path) -> None:
        """Take the name of a port."""
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(self._slave))

    def _work(self) -> None:
        while not self._stop.wait(0.01):
            came = os.read(self._master, 4096) if select.select([self._master], [], [], 0)[0] else b""
            self.received += came
            if data := self._make(came):
                os.write(self._master, data)

    def pull(self) -> None:
        """Unplug."""
        if not self._stop.is_set():
            self._stop.set()
            self._thread.join()
            os.close(self._master)
            os.close(self._slave)


def boat(unit: str = "SA1") -> Callable[[bytes], bytes]:
    """A BOAT board at its own speed; the same identity each time."""
    board = VirtualBoard(unit)

    def turn(came: bytes) -> bytes:
        board.receive(came)
        return board.advance(10_000)

    return turn


def lines() -> Callable[[bytes], bytes]:
    """A board that prints text."""
    begun = time.monotonic()
    return lambda _came: b"%d,0.0,500,20\n" % ((time.monotonic() - begun) * 1000)


@contextmanager
def session_in(folder: Path) -> Iterator[Session]:
    session = Session(Settings(), UnitLibrary(folder / "units"))
    try:
        yield session
    finally:
        session.close()


@pytest.mark.fault(11, how="a board that comes back under another port's name, its own taken", times=2)
@pytest.mark.parametrize(("make", "profile"), [(boat, None), (lines, PROFILE)])
def test_board_is_found_by_its_usb_serial_number(monkeypatch, tmp_path, make, profile):
    """Under its new name, for a text profile too; its serial number is then stored with the unit."""
    monkeypatch.setattr("boat_daq.engine.session.link_supervisor.SEEK_S", 0.1)
    first, second = tmp_path / "ttyACM0", tmp_path / "ttyACM1"
    present: list[SimpleNamespace] = []
    monkeypatch.setattr(ports.system_ports, "comports", lambda: present)
    board, again, other = Plug(make()), Plug(make()), Plug(make())
    board.at(first)
    present[:] = [port(first, "PSOC-7")]
    try:
        with session_in(tmp_path) as session:
            session.connect(str(first), profile)
            session.wait_connected()
            board.pull()
            present[:] = []
            assert session.wait(lambda s: s.link is LinkState.LOST, PATIENCE_S).link is LinkState.LOST
            other.at(first)  # another of the same identity takes the name, the board comes back with the next one
            again.at(second)
            present[:] = [port(first, "T-1"), port(second, "PSOC-7")]
            seen = reached(session, lambda s: s.link is LinkState.UP, PATIENCE_S)
            assert (seen.link, seen.port) == (LinkState.UP, str(second))
        assert other.received == b""
    finally:
        for plug in (board, again, other):
            plug.pull()


def test_usb_serial_number_is_stored_with_the_unit(monkeypatch, tmp_path):
    """Of a real board only: a virtual one shares nothing with the unit but the name."""
    name, shown = tmp_path / "ttyACM0", Plug(lines())
    shown.at(name)
    monkeypatch.setattr(ports.system_ports, "comports", lambda: [port(name, "PSOC-7")])
    try:
        for profile, stored in ((PROFILE.replace("n_s", "simulated = true, n_s"), {}), (PROFILE, {"PSOC-7": "SA7"})):
            with session_in(tmp_path) as session:
                session.connect(str(name), profile, unit="SA7")
                session.wait_connected()
            assert UnitLibrary(tmp_path / "units").boards() == stored  # the supervisor has ended
    finally:
        shown.pull()


def port(name: Path, serial: str) -> SimpleNamespace:
    """A port as pyserial describes it."""
    return SimpleNamespace(device=str(name), description="", serial_number=serial, location="1-2:1.0")


@pytest.mark.fault(11, how="another board on the port of the lost one", times=1)
def test_another_board_on_the_same_port_is_refused_and_said_once(monkeypatch, tmp_path):
    """It is asked who it is, and gets nothing else; the board itself is taken back."""
    monkeypatch.setattr("boat_daq.engine.session.link_supervisor.SEEK_S", 0.1)
    name = tmp_path / "port"
    board, other, again = Plug(boat()), Plug(boat("SA2")), Plug(boat())
    board.at(name)
    try:
        with session_in(tmp_path) as session:
            session.connect(str(name), record_to=tmp_path / "run.boat")
            session.wait_connected()
            reached(session, lambda s: s.recorded_s > 0.1, PATIENCE_S)
            board.pull()
            reached(session, lambda s: s.link is LinkState.LOST, PATIENCE_S)
            other.at(name)
            said = reached(session, lambda s: "another board" in s.messages[-1].cause, PATIENCE_S)
            tried = len(other.received)
            while len(other.received) < 2 * tried:
                time.sleep(0.01)
            again.at(name)
            reached(session, lambda s: s.messages[-1].kind is MessageKind.BOARD_FOUND, PATIENCE_S)
            seen = reached(session, lambda s: s.recorded_s > said.recorded_s + 0.1, PATIENCE_S)
    finally:
        for plug in (board, other, again):
            plug.pull()
    kinds = [message.kind for message in seen.messages]
    assert (kinds.count(MessageKind.LINK_FAILED), kinds.count(MessageKind.BOARD_FOUND)) == (1, 1)
    assert said.messages[-1].remedy == "connect SIMULATED-SA1 again"
    assert {frame.type for frame in FrameReader().receive(other.received)} == {MessageType.IDENTIFY}
