"""Identification of what is on a port: a board, another device, or nothing; nothing moves."""

from __future__ import annotations

import json
import os
import pty
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import typer
from typer.testing import CliRunner

from boat_daq.commands.board import ports
from boat_daq.engine.link import opening
from boat_daq.engine.link.opening import identify_port
from boat_daq.engine.link.ports import PortInfo, open_transport
from boat_daq.engine.settings import Unit, UnitLibrary
from protocol.link.messages import MessageType
from protocol.simulator.board import VirtualBoard
from protocol.simulator.faults import parse_fault


@contextmanager
def served(answer: Callable[[bytes], bytes]) -> Iterator[str]:
    """A pseudo-terminal whose other end answers with `answer(what came)`, every 5 ms."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    stop = threading.Event()

    def serve():
        while not stop.wait(0.005):
            try:
                came = os.read(master, 4096)
            except BlockingIOError:
                came = b""
            if data := answer(came):
                os.write(master, data)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        stop.set()
        thread.join()
        os.close(master)
        os.close(slave)


class Board:
    """A virtual board behind `served`, that keeps what it received."""

    def __init__(self, *faults: str) -> None:
        self.board = VirtualBoard(faults=[parse_fault(fault) for fault in faults])
        self.received_bytes = b""

    def __call__(self, came: bytes) -> bytes:
        self.received_bytes += came
        self.board.receive(came)
        return self.board.advance(5_000)


def test_a_board_is_known_by_its_hello_and_the_port_is_free_again():
    """Its identity, within a second; afterwards another program can open the port."""
    board = Board()
    with served(board) as port:
        began = time.monotonic()
        answer = identify_port(port)
        assert time.monotonic() - began < 1.0
        assert answer.hello is not None
        assert "SIM" in answer.hello.board_id
        open_transport(port).close()


def test_identification_sets_no_pressure():
    """IDENTIFY is the only command on the wire."""
    board = Board()
    with served(board) as port:
        identify_port(port)
    from protocol.link.framing import FrameReader

    types = {frame.type for frame in FrameReader().receive(board.received_bytes)}
    assert types == {MessageType.IDENTIFY}


@pytest.mark.fault(14, how="a silent port, another device, another version, while boards are looked for", times=3)
def test_a_silent_port_another_device_and_another_version_are_distinguished():
    """Each has its own status, within little more than a second."""
    cases = [
        (lambda _came: b"", "no answer"),
        (lambda _came: b"$GPGGA,1,2\r\n", "not a BOAT board"),
        (Board("wrong_protocol@0"), "protocol version 2"),
    ]
    for answer, text in cases:
        with served(answer) as port:
            began = time.monotonic()
            shown = identify_port(port)
            assert time.monotonic() - began < 1.5
            assert shown.hello is None
            assert text in shown.problem


def test_a_port_that_cannot_be_opened_has_a_reason():
    """Listing ports never fails because one of them is busy or gone."""
    with served(Board()) as port:
        mine = open_transport(port)
        assert "in use" in identify_port(port).problem
        mine.close()
    assert "no port" in identify_port("/dev/ttyNOWHERE").problem


def test_only_boards_used_before_are_queried(monkeypatch, tmp_path):
    """`ports` sends nothing; `--ask` sends to the serial number stored with a unit, and to no other instrument."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    UnitLibrary().save(Unit("SA7", usb_serial="PSOC-7"))
    app, board, other, twin = typer.Typer(), Board(), Board(), Board()
    app.command()(ports)
    with served(other) as thermometer, served(board) as port, served(twin) as copy:
        found = [PortInfo(thermometer, "", "T-1"), PortInfo(port, "KitProg", "PSOC-7"), PortInfo(copy, "")]
        monkeypatch.setattr(opening, "list_ports", lambda: found)
        listed, asked = (json.loads(CliRunner().invoke(app, [*o, "--json"]).stdout)["ports"] for o in ((), ("--ask",)))
        assert [row["unit"] for row in listed] == ["", "SA7", ""]
        assert not any(row["queried"] or row["boat"] for row in listed)
        assert [row["boat"] for row in asked] == [row["queried"] for row in asked] == [False, True, False]
        assert board.received_bytes
        found[2] = PortInfo(copy, "", "PSOC-7")  # a number that two devices have identifies none
        assert not any(answer.unit for answer in opening.listed_ports(UnitLibrary().boards()))
    assert other.received_bytes == twin.received_bytes == b""


@pytest.mark.parametrize("as_json", [False, True])
def test_the_command_marks_the_board(as_json):
    """`ports` shows what answered, for readers and for programs."""
    app = typer.Typer()
    app.command()(ports)
    with served(Board()) as port:
        done = CliRunner().invoke(app, ["--port", port, *(["--json"] if as_json else [])])
    assert done.exit_code == 0
    if as_json:
        row = json.loads(done.stdout)["ports"][0]
        assert row["boat"] is True
        assert row["hello"]["n_sensors"] == 2
    else:
        assert done.stdout.startswith(f"* {port}")


def test_listening_sends_nothing():
    """What a device prints arrives with the time it took, and not a byte goes to the device."""
    sent = [b"t=1 p=2\n"] * 5
    came: list[bytes] = []
    with served(lambda data: came.append(data) or (sent.pop() if sent else b"")) as port:
        data, seconds = opening.listen(port, 0.3)
    assert data == b"t=1 p=2\n" * 5
    assert 0 < seconds < 0.3
    assert not any(came)
