"""The SECoP node over TCP: two clients, and some that are silent, flooding, lying or killed."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import logging
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from boat_daq.engine.outlets import secop_server
from boat_daq.engine.outlets.secop_node import IDENT, SecopNode
from boat_daq.engine.outlets.secop_server import SecopServer, read_token
from boat_daq.engine.plan import built_in_plans, plans_in
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import SessionState
from protocol.base.errors import RequestError
from protocol.recording import BoardState
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached
from tests.docs.pages import ROOT, block

TOKEN = "0123456789abcdef"


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    """A session on a virtual board, 20 times as fast as a real one."""
    with serve_in_thread(BoardSettings(speed=20.0)) as board:
        found = Session(Settings(), UnitLibrary(tmp_path / "units"))
        try:
            found.connect(board.url)
            found.wait_connected()
            reached(found, lambda s: s.last is not None, 5)
            yield found
        finally:
            found.close()


@pytest.fixture
def server(session: Session, tmp_path: Path) -> Iterator[SecopServer]:
    """A server that allows control."""
    found = SecopServer(SecopNode(session, tmp_path, allow_control=True), ("127.0.0.1", 0), token=TOKEN)
    yield found
    found.close()


class Client:
    """A client written from the specification alone: lines over TCP."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self.file = self.socket.makefile("rb")

    def authenticated(self) -> Client:
        """Send the token."""
        self.send(f"_authenticate {TOKEN}")
        assert self.line() == "_authenticated"
        return self

    def send(self, text: str) -> None:
        self.socket.sendall(text.encode() + b"\n")

    def line(self) -> str:
        return self.file.readline().decode().strip()

    def ask(self, text: str) -> list[Any]:
        """Return action, specifier and data of the answer; updates in between are left out."""
        self.send(text)
        while (answer := self.line()).startswith("update "):
            pass
        action, _, rest = answer.partition(" ")
        where, _, data = rest.partition(" ")
        return [action, where, json.loads(data) if data else None]

    def close(self) -> None:
        self.file.close()
        self.socket.close()


def test_a_client_of_the_specification_reads_and_drives(session: Session, server: SecopServer) -> None:
    """Identification, description, reading, a pressure within limits, a run, a recording, VENT."""
    assert signature(SecopServer).parameters["address"].default == ("127.0.0.1", 10767)
    client = Client(server.port).authenticated()
    client.send("*IDN?")
    assert client.line() == IDENT
    _, _, described = client.ask("describe")
    assert described["modules"]["pressure"]["interface_classes"] == ["Drivable"]
    assert described["description"].startswith("SIMULATED")
    assert 1000 < client.ask("read s1:value")[2][0] < 2500
    assert client.ask("change pressure:target 1000")[0:3:2] == [
        "error_change", ["RangeError", "1000 is outside -45 to 55", {}]
    ]  # fmt: skip
    assert client.ask("change pressure:_ramp 50")[2][0] == 50
    assert client.ask("change pressure:target 10")[0] == "changed"
    reached(session, lambda s: s.last.state is BoardState.HOLDING, 10)
    assert client.ask("read pressure")[2][0] == pytest.approx(10, abs=1.5)
    assert client.ask("do vent:_vent")[0] == "done"
    reached(session, lambda s: s.last.state is BoardState.VENTED and abs(s.last.pressure_kpa) < 0.5, 10)
    assert client.ask('do recording:_start "by_secop"')[0] == "done"
    assert client.ask("read recording:_file")[2][0] == "by_secop.boat"
    assert client.ask('do sequence:_arm "calibration"')[0] == "done"
    assert client.ask("do sequence:_start")[0] == "done"
    assert session.wait(lambda s: s.state is SessionState.RUNNING, 5).state is SessionState.RUNNING
    assert client.ask("do sequence:_abort")[0] == "done"
    assert client.ask("do recording:_stop")[0] == "done"
    assert session.snapshot().recording is None
    client.close()


def test_the_client_of_frappy_reads_and_drives(session: Session, server: SecopServer) -> None:
    """The framework's own client understands the description, receives updates, and drives the pressure."""
    frappy = pytest.importorskip("frappy.client", reason="frappy-core is not installed")
    client = frappy.SecopClient(f"localhost:{server.port}")
    client.connect(5)
    client.request("_authenticate", TOKEN)
    try:
        assert {"s1", "s2", "elongation", "pressure", "sequence", "vent", "recording"} <= set(client.modules)
        value, _, error = client.getParameter("s1", "value", trycache=False)
        assert error is None
        assert 1000 < value < 2500
        client.setParameter("pressure", "_ramp", 50.0)
        client.setParameter("pressure", "target", 8.0)
        reached(session, lambda s: s.last.state is BoardState.HOLDING, 10)
        deadline = time.monotonic() + 5
        while client.cache["pressure", "value"][0] < 6.5 and time.monotonic() < deadline:
            time.sleep(0.05)
        assert client.cache["pressure", "value"][0] == pytest.approx(8, abs=1.5)
        client.execCommand("vent", "vent")
        seen = reached(session, lambda s: s.last.state is BoardState.VENTED, 5)
        assert seen.last.state is BoardState.VENTED
    finally:
        client.disconnect()


PAGE = "docs/how-to/stream-live.md"


def test_the_program_of_the_page_drives_and_vents(
    session: Session, server: SecopServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Word for word, but for the port."""
    pytest.importorskip("frappy.client", reason="frappy-core is not installed")
    (tmp_path / "token.txt").write_text(f"{TOKEN}\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(block(PAGE, "drive.py").replace("10767", str(server.port)), {})
    seen = reached(session, lambda s: s.last.state is BoardState.VENTED, 5)
    assert seen.last.state is BoardState.VENTED


def test_replies_are_those_of_the_page(session: Session, server: SecopServer) -> None:
    """Each line of its table, with its reply."""
    table = (ROOT / PAGE).read_text(encoding="utf-8").partition("reply begins with")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| `(.+)` \| `(.+)` \|$", table, re.MULTILINE)
    assert rows[-1][0] == "do vent:_vent"
    client = Client(server.port)
    for line, reply in rows:
        client.send(line.replace("TOKEN", TOKEN))
        assert client.line().startswith(reply)
    client.close()
    reached(session, lambda s: s.last.state is BoardState.VENTED, 5)


@pytest.fixture
def frappy_client(server: SecopServer) -> Iterator[Any]:
    """The client of the reference implementation, connected."""
    frappy = pytest.importorskip("frappy.client", reason="frappy-core is not installed")
    client = frappy.SecopClient(f"localhost:{server.port}")
    client.connect(5)
    client.request("_authenticate", TOKEN)
    yield client
    client.disconnect()


def test_frappy_takes_every_module(frappy_client: Any) -> None:
    """Each description is one of its data types, each value is of that type, now, or has an error of the protocol."""
    unknown = set()
    for module, about in frappy_client.modules.items():
        assert set(about["properties"]) >= {"description", "interface_classes"}
        assert {"value", "status"} <= set(about["parameters"])
        for name, parameter in about["parameters"].items():
            value, timestamp, error = frappy_client.getParameter(module, name, trycache=False)
            assert abs(timestamp - time.time()) < 60
            if error is None:
                assert parameter["datatype"](value) == value
            else:
                assert type(error).__name__ == "ImpossibleError"
                unknown.add((module, name))
            assert (module, name) in frappy_client.cache  # each was sent at the activation
    assert unknown == {("elongation", "value"), ("elongation", "uncertainty")}  # there is no calibration


def test_frappy_knows_every_refusal(frappy_client: Any) -> None:
    """Each is an error of its own class, as the protocol names it."""
    for request_, error in (
        (("change", "pressure:target", 1000), "RangeError"), (("change", "pressure:target", "x"), "WrongTypeError"),
        (("change", "pressure:value", 1), "ReadOnlyError"), (("change", "none:target", 1), "NoSuchModuleError"),
        (("change", "pressure:none", 1), "NoSuchParameterError"), (("do", "vent:none", None), "NoSuchCommandError"),
        (("do", "sequence:_arm", "none"), "RangeError"), (("do", "sequence:_start", None), "ImpossibleError"),
        (("activate", "none", None), "NoSuchModuleError"), (("logging", "none", "off"), "NoSuchModuleError"),
    ):  # fmt: skip
        with pytest.raises(Exception, match=r"\w") as refusal:
            frappy_client.request(*request_)
        assert type(refusal.value).__name__ == error, request_


def test_frappy_receives_the_answers_of_the_protocol(frappy_client: Any) -> None:
    """Identifiers are repeated, remote logging is off, and nothing is sent after a deactivation."""
    for request_, answer in (
        (("ping", "any", None), ("pong", "any")), (("logging", "pressure", "debug"), ("logging", "pressure", "off")),
        (("do", "pressure:stop", None), ("done", "pressure:stop")), (("deactivate", None, None), ("inactive", None)),
    ):  # fmt: skip
        assert frappy_client.request(*request_)[: len(answer)] == answer


def test_updates_follow_an_activation(session: Session, server: SecopServer) -> None:
    """All values at once, then `active`, then what changes; nothing after a deactivation."""
    client = Client(server.port)
    client.send("activate pressure")
    lines = []
    while not (line := client.line()).startswith("active"):
        lines.append(line)
    assert {line.split()[1] for line in lines} >= {"pressure:value", "pressure:status", "pressure:target"}
    told = [client.line().rpartition(", {")[0] for _ in range(12)]
    assert all(line.startswith("update pressure:") for line in told)
    assert len([line for line in told if line.startswith("update pressure:status")]) == 1  # what changes, and no more
    assert client.ask("deactivate pressure")[0] == "inactive"
    time.sleep(0.3)
    client.send("ping 1")
    assert client.line().startswith("pong 1")
    client.send("ping " + 9000 * "x")
    assert "more than 8192 bytes" in client.line()
    client.close()


def test_requests_are_limited_but_not_vent(server: SecopServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """At twenty a second the last ten of thirty take half a second; VENT with and without its data goes on at once."""
    client = Client(server.port)
    client.ask("ping 1")
    monkeypatch.setattr(secop_server, "MOST_A_SECOND", 20)
    began_s = time.monotonic()
    for _ in range(30):
        assert client.ask("do nothing:_at_all")[0] == "error_do"
    assert time.monotonic() - began_s >= 0.4
    monkeypatch.setattr(secop_server, "MOST_A_SECOND", 0.05)
    for line in ("do vent:_vent", "do vent:_vent null", "do vent:_vent"):
        assert client.ask(line)[0] == "done"
    assert (server.requests, server.refused) == (34, 0)
    client.close()


@pytest.mark.skipif(sys.platform != "linux", reason="the options of its sockets")
def test_a_client_whose_computer_fails_has_left(server: SecopServer) -> None:
    """It closes nothing: the system ends the connection after 11 s, then the dead-man time begins."""
    client = Client(server.port)
    client.ask("ping 1")
    (served,) = server._clients
    connection = served.writer.get_extra_info("socket")
    options = [socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT]
    idle_s, each_s, count = (connection.getsockopt(socket.IPPROTO_TCP, option) for option in options)
    assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
    assert 1000 * (idle_s + each_s * count) == connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT)
    assert (idle_s, each_s, count) == (5, 2, 3)
    client.close()


def test_an_address_in_use_is_refused_with_its_cause(session: Session, server: SecopServer, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=rf"^127\.0\.0\.1:{server.port} cannot be listened on: ") as refusal:
        SecopServer(SecopNode(session, tmp_path), ("127.0.0.1", server.port))
    assert isinstance(refusal.value.__cause__, OSError)


def test_a_client_arms_the_plans_that_it_is_given_and_no_file(session: Session, tmp_path: Path) -> None:
    """By name, from the node's own list; a path from the network is the name of no plan, even where the file exists."""
    own = dataclasses.replace(built_in_plans()["calibration"], name="own plan", cycles=2)
    (tmp_path / "own.toml").write_text(own.to_toml(), encoding="utf-8")
    node = SecopNode(session, tmp_path, allow_control=True, plans=lambda: plans_in(tmp_path))
    server = SecopServer(node, ("127.0.0.1", 0), token=TOKEN)
    client = Client(server.port).authenticated()
    assert client.ask("read sequence:_plans")[2][0] == [*built_in_plans(), "own plan"]
    for path in (str(tmp_path / "own.toml"), "../own.toml", "own.toml", "own"):
        assert client.ask(f"do sequence:_arm {json.dumps(path)}")[2][0] == "RangeError"
    assert session.snapshot().plan is None
    assert client.ask('do sequence:_arm "own plan"')[0] == "done"
    assert session.snapshot().plan == own
    client.close()
    server.close()


def test_read_only_refuses_all_but_vent(session: Session, tmp_path: Path) -> None:
    server = SecopServer(SecopNode(session, tmp_path), ("127.0.0.1", 0))
    client = Client(server.port)
    assert client.ask("describe")[2]["modules"]["pressure"]["interface_classes"] == ["Readable"]
    assert client.ask("change pressure:target 10")[2][0] == "ReadOnly"
    for command in ('sequence:_arm "calibration"', "sequence:_start", "pressure:stop", 'recording:_start "x"'):
        assert client.ask(f"do {command}")[2][0] == "Disabled"
    assert client.ask("do vent:_vent")[0] == "done"
    reached(session, lambda s: s.last.state is BoardState.VENTED, 5)
    client.close()
    server.close()


def test_other_computers_need_a_token(session: Session, tmp_path: Path) -> None:
    """No address beyond loopback without one; without it not even VENT; a wrong one is refused late."""
    node = SecopNode(session, tmp_path)
    assert secop_server.is_loopback("localhost")
    for host in ("0.0.0.0", "lab.example"):
        with pytest.raises(RequestError, match=f"^{host} can be reached from other computers"):
            SecopServer(node, (host, 0))
    path = tmp_path / "token"
    path.write_text("short\n")
    path.chmod(0o600)
    with pytest.raises(RequestError, match="no usable token"):
        read_token(path)
    path.write_text("0123456789abcdef\n")
    for mode in (0o644, 0o640, 0o601):
        path.chmod(mode)
        with pytest.raises(RequestError, match="can be read by other users"):
            read_token(path)
    path.chmod(0o600)
    server = SecopServer(node, ("0.0.0.0", 0), token=read_token(path))
    wrong, right = Client(server.port), Client(server.port)
    wrong.send("do vent:_vent")
    right.send("_authenticate 0123456789abcdef")
    assert right.line() == "_authenticated"
    assert right.ask("read s1:value")[0] == "reply"
    assert "a token is required" in wrong.line()
    assert wrong.line() == ""
    for client in (wrong, right):
        client.close()
    server.close()


def test_a_server_closes_while_a_connection_does() -> None:
    """The task of a connection ends as done: asyncio printed a traceback for one that ended as cancelled."""

    class Slow:
        def close(self) -> None:
            return

        async def wait_closed(self) -> None:
            await asyncio.sleep(60)

    async def cancelled() -> bool:
        task = asyncio.create_task(secop_server._closed(Slow()))  # type: ignore[arg-type]
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return task.cancelled()

    assert not asyncio.run(cancelled())


def test_a_server_closes_while_clients_connect(caplog: pytest.LogCaptureFixture) -> None:
    """Stopped at each turn of its loop after it takes them: nothing is left, and asyncio has nothing to report."""
    node = SimpleNamespace(allow_control=False, answer=lambda *_, **__: ["pong"], updates=lambda *_: [])
    for turns in range(12):
        server = SecopServer(node, ("127.0.0.1", 0))  # type: ignore[arg-type]

        def stop_after(turns: int, server: SecopServer = server) -> None:
            if turns:
                server._loop.call_soon(stop_after, turns - 1)
            else:
                server._stop.set()

        server._loop.call_soon_threadsafe(time.sleep, 0.03)  # meanwhile they wait to be accepted
        clients = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(6)]
        server._loop.call_soon_threadsafe(stop_after, turns)
        server._thread.join(10)
        assert not server._thread.is_alive()
        server.close()
        for client in clients:
            client.close()
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING] == []


@pytest.mark.fault(57, how="eight idle clients")
def test_the_number_of_clients_is_limited_but_not_for_vent(session: Session, server: SecopServer) -> None:
    """With all places taken by idle clients a further one is refused, and its VENT carried out."""
    clients = [Client(server.port) for _ in range(8)]
    for client in clients:
        assert client.ask("ping 1")[0] == "pong"
    more, venting = Client(server.port), Client(server.port)
    more.send("ping 1")
    assert "IsBusy" in more.line()
    clients[0].authenticated()
    assert clients[0].ask("change pressure:target 10")[0] == "changed"
    reached(session, lambda s: s.last.pressure_kpa > 2, 5)
    assert venting.ask("do vent:_vent")[0] == "done"
    assert server.refused == 2
    assert session.wait(lambda s: s.last.state is BoardState.VENTED, 5).last.state is BoardState.VENTED
    for client in (*clients, more, venting):
        client.close()


def test_vent_does_not_wait_for_requests_under_way(
    session: Session, server: SecopServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many requests as there are threads for them, none of which ends: VENT has threads of its own."""
    end, busy, answer = threading.Event(), threading.Semaphore(0), server._node.answer

    def slow(line: str, *, may_control: bool = False) -> list[str]:
        if line.startswith("read"):
            busy.release()
            end.wait(20)
        return list(answer(line, may_control=may_control))

    monkeypatch.setattr(server._node, "answer", slow)
    clients = [Client(server.port) for _ in range(secop_server.CLIENTS)]
    for client in clients[1:]:
        client.send("read pressure")
    assert all(busy.acquire(timeout=5) for _ in range(4))
    clients[0].socket.settimeout(5)
    assert clients[0].ask("do vent:_vent")[0] == "done"
    end.set()
    for client in clients[1:]:
        assert client.line().startswith("reply pressure")
    for client in clients:
        client.close()


@pytest.mark.fault(57, how="twenty connections that send nothing")
def test_connections_without_a_line_do_not_keep_vent_out(session: Session, server: SecopServer) -> None:
    """Twenty connections that send nothing: the next client is served."""
    silent = [Client(server.port) for _ in range(20)]
    good = Client(server.port)
    assert good.ask("do vent:_vent")[0] == "done"
    assert session.wait(lambda s: s.last.state is BoardState.VENTED, 5).last.state is BoardState.VENTED
    for client in (*silent, good):
        client.close()


def test_a_connection_without_a_first_line_is_closed(server: SecopServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(secop_server, "FIRST_LINE_S", 0.2)
    silent = Client(server.port)
    assert silent.line() == ""
    silent.close()


@pytest.mark.fault(56, how="first lines of HTTP, TLS, SMTP, SSH, binary, without end", times=11)
def test_another_protocol_is_closed_at_its_first_line(session: Session, server: SecopServer) -> None:
    """Nothing of it is executed, so that no web page can drive the unit; VENT is answered meanwhile."""
    orders = f"_authenticate {TOKEN}\nchange pressure:target 40\ndo recording:_start\n".encode()
    firsts = [
        b"POST / HTTP/1.1\r\nHost: localhost\r\n\r\n", b"GET /do HTTP/1.1\r\n\r\n", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\n", b"\n", b"EHLO lab\r\n", b"SSH-2.0-OpenSSH_9\r\n",
        bytes(range(11, 256)) * 9 + b"\n", b"x" * 1_000_000 + b"\n", b"describe " + b"x" * 9000 + b"\n", b" ",
    ]  # fmt: skip
    for number, first in enumerate(firsts):
        stranger = Client(server.port)
        answer = b""
        try:
            stranger.socket.sendall(first + orders)
            answer = stranger.socket.recv(1000)
        except (ConnectionResetError, BrokenPipeError):
            assert server.refused == number + 1 or len(first) > 8192
        assert answer == b"" or (len(first) > 8192 and b"ProtocolError" in answer)
        stranger.close()
        good = Client(server.port)
        assert good.ask("do vent:_vent")[0] == "done"
        good.close()
    assert server.requests == len(firsts)  # the VENTs
    assert session.snapshot().last.state in (BoardState.IDLE, BoardState.VENTED)
    assert not session.snapshot().recording


def test_control_needs_the_token_on_this_computer_too(session: Session, server: SecopServer, tmp_path: Path) -> None:
    """Without it a client reads and vents; a wrong one is closed late; the user's own file is 0600, and made once."""
    driver, client, wrong = Client(server.port).authenticated(), Client(server.port), Client(server.port)
    assert driver.ask("change pressure:target 5")[0] == "changed"
    driver.close()
    assert client.ask("read s1:value")[0] == "reply"
    assert client.ask("change pressure:target 10")[2][0] == "Disabled"
    assert client.ask('do sequence:_arm "calibration"')[2][0] == "Disabled"
    assert client.ask("do vent:_vent")[0] == "done"
    began_s = time.monotonic()
    wrong.send("_authenticate fedcba9876543210")
    assert "a token is required" in wrong.line()
    assert time.monotonic() - began_s >= 1.0
    assert wrong.line() == ""
    assert server.refused == 1
    assert server._left_s is not None
    assert server._left_s <= began_s  # the dead-man time of the driver that left goes on
    assert client.authenticated().ask("change pressure:target 10")[0] == "changed"
    made = secop_server.own_token(tmp_path / "new" / "home" / "secop-token")
    assert secop_server.own_token(tmp_path / "new" / "home" / "secop-token") == made
    assert secop_server.own_token(tmp_path / "secop-token") != made  # its folder is there already
    assert (tmp_path / "new" / "home" / "secop-token").stat().st_mode & 0o777 == 0o600
    with pytest.raises(RequestError, match="needs a token"):
        SecopServer(SecopNode(session, tmp_path, allow_control=True), ("127.0.0.1", 0))
    for one in (client, wrong):
        one.close()


@pytest.mark.fault(58, how="client that set a pressure is closed")
def test_a_pressure_whose_client_left_is_vented(session: Session, tmp_path: Path) -> None:
    """After the time stated, with a message; not while another client that may control is connected."""
    node = SecopNode(session, tmp_path, allow_control=True)
    server = SecopServer(node, ("127.0.0.1", 0), token=TOKEN, hold_s=0.5)
    driver, other = Client(server.port).authenticated(), Client(server.port).authenticated()
    assert driver.ask("change pressure:target 10")[0] == "changed"
    reached(session, lambda s: s.last.pressure_kpa > 5, 5)
    driver.close()
    time.sleep(1.0)
    assert session.snapshot().last.target_kpa == 10
    driver = Client(server.port).authenticated()
    assert driver.ask("change pressure:target 12")[0] == "changed"
    other.close()
    time.sleep(0.2)
    driver.close()
    seen = reached(session, lambda s: s.last.state is BoardState.VENTED, 5)
    assert seen.last.state is BoardState.VENTED
    first, last = Client(server.port).authenticated(), Client(server.port).authenticated()
    deadline_s = time.monotonic() + 10.0
    while first.ask("change pressure:target 10")[0] != "changed":  # until the mean of the last samples is zero
        assert time.monotonic() < deadline_s
        time.sleep(0.1)
    reached(session, lambda s: s.last.pressure_kpa > 5, 5)
    first.close()
    time.sleep(0.2)
    last.close()
    assert session.wait(lambda s: s.last.state is BoardState.VENTED, 5).last.state is BoardState.VENTED
    assert any("left 0.5 s ago" in message.cause for message in seen.messages)
    server.close()


@pytest.mark.fault(57, how="200 VENTs of four clients")
def test_a_flood_of_vents_is_one_event_each_100_ms(session: Session, server: SecopServer) -> None:
    """Counted at the board's port and among the messages; each client gets its answer."""
    before = len([m for m in session.snapshot().messages if "vented" in m.cause])
    clients = [Client(server.port) for _ in range(4)]
    began_s = time.monotonic()
    for _ in range(50):
        for client in clients:
            client.send("do vent:_vent")
    for client in clients:
        assert [client.line().split()[0] for _ in range(50)] == ["done"] * 50
    took_s = time.monotonic() - began_s
    found = len([m for m in session.snapshot().messages if "vented" in m.cause]) - before
    assert 1 <= found <= 2 + took_s / 0.1
    for client in clients:
        client.close()


def test_bad_clients_leave_vent_and_others_at_once(session: Session, server: SecopServer) -> None:
    """One that never reads, one that floods, one without lines, one that is killed: VENT by another is at once."""
    session.set_pressure(15.0, 50.0)
    silent, flooding, endless, killed = (Client(server.port) for _ in range(4))
    silent.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    silent.send("activate")
    flooding.socket.setblocking(False)
    for bad, data in ((flooding, b"describe\n" * 20_000), (endless, b"x" * 100_000)):
        try:
            bad.socket.send(data)
        except (BlockingIOError, ConnectionError):
            continue
    killed.send("activate")
    killed.close()
    good = Client(server.port)
    assert good.ask("do vent:_vent")[0] == "done"
    assert session.wait(lambda s: s.last.state is BoardState.VENTED, 5).last.state is BoardState.VENTED
    assert good.ask("read s1:value")[0] == "reply"
    assert session.snapshot().health.statistics.lost == 0
    for client in (silent, flooding, endless, good):
        client.close()


def test_the_ros_bridge_of_the_documentation_publishes(server: SecopServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the page has it, with stand-ins for rclpy and its messages: the values of the node, each to its topic."""
    page = (Path(__file__).parents[4] / "docs" / "how-to" / "ros.md").read_text(encoding="utf-8")
    program = next(part for part in page.split("```") if "rclpy.init()" in part).partition("\n")[2]
    published: dict[str, list[float]] = {}

    class Node:
        def create_publisher(self, _: Any, topic: str, __: int) -> Any:
            return SimpleNamespace(publish=lambda message: published.setdefault(topic, []).append(message.data))

    rclpy = SimpleNamespace(init=lambda: None, create_node=lambda _: Node())
    monkeypatch.setitem(sys.modules, "rclpy", rclpy)
    monkeypatch.setitem(sys.modules, "std_msgs", SimpleNamespace())
    monkeypatch.setitem(sys.modules, "std_msgs.msg", SimpleNamespace(Float64=SimpleNamespace))
    bridge = threading.Thread(target=exec, args=(program.replace("10767", str(server.port)), {}))
    bridge.start()
    deadline = time.monotonic() + 10
    while len(published) < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    server.close()  # ends the bridge
    bridge.join()
    assert published.keys() == {"/boat/s1_mv", "/boat/s2_mv", "/boat/pressure_kpa"}
    assert all(1000 < value < 2500 for value in published["/boat/s1_mv"])


REFUSED = [
    ("change pressure:target NaN", "BadJSON"), ("change pressure:target 1e999", "WrongType"),
    ("change pressure:target true", "WrongType"), ('change pressure:target "5"', "WrongType"),
    ("change pressure:target [5]", "WrongType"), ("change pressure:target", "ProtocolError"),
    ("change pressure:target {}", "WrongType"), ("change pressure:target null", "WrongType"),
    ("change pressure:target 5 5", "BadJSON"), ("change pressure:target 1000", "RangeError"),
    (f"change pressure:target {10**399}", "WrongType"), ("change pressure:target " + 5000 * "9", "WrongType"),
    ('change pressure:target "\\ud800"', "WrongType"),
    ("change pressure:target " + "[" * 8000, "BadJSON"), ("change pressure:value 5", "ReadOnly"),
    ("change nothing 5", "NoSuchModule"), ("read s1:none", "NoSuchParameter"), ("do vent:open", "NoSuchCommand"),
    ("do vent:_vent 5", "WrongType"), ("do sequence:_arm 5", "WrongType"), ('do sequence:_arm "x"', "RangeError"),
    ("do sequence:_arm", "WrongType"), ("do vent", "NoSuchCommand"), ("do nothing:stop", "NoSuchModule"),
    ("do sequence:_start", "Impossible"), ('do recording:_start "../x"', "Impossible"),
    ('do recording:_start "a\\u0000b"', "WrongType"), ("burn", "ProtocolError"), ("", "ProtocolError"),
    ("change pressure:_ramp 1e9", "RangeError"), ("change pressure:_ramp -1", "RangeError"),
    ("\x00\xff", "ProtocolError"), ("Read s1:value", "ProtocolError"), ("reply s1:value 5", "ProtocolError"),
    ("read", "ProtocolError"), ("change", "ProtocolError"), ("do", "ProtocolError"), ("read :value", "ProtocolError"),
    ("read pressure:", "NoSuchParameter"), ("read " + "a" * 3000, "NoSuchModule"), ("update x", "ProtocolError"),
    ("activate nothing", "NoSuchModule"), ("deactivate nothing", "NoSuchModule"), ("logging nothing", "NoSuchModule"),
]  # fmt: skip


def test_a_lie_is_refused_by_name(session: Session, server: SecopServer) -> None:
    """Wrong types, values, names and texts: an error of the protocol's class, and the pressure stays as it is.

    A line without its end is no request.
    """
    client = Client(server.port).authenticated()
    answers = [(line[:40], *client.ask(line)) for line, _ in REFUSED]
    assert [(line, data[0]) for line, _, _, data in answers] == [(line[:40], name) for line, name in REFUSED]
    for line, action, where, (_, text, more) in answers:
        begun = re.match(r"[a-z]*(?= |$)", line)
        assert action == f"error_{(begun and begun[0]) or 'request'}", line
        assert where and text and more == {}, line
    client.socket.sendall(b"change pressure:target 4")  # the half of 45: the client was killed
    client.socket.shutdown(socket.SHUT_WR)
    assert client.line() == ""
    assert session.snapshot().last.state is BoardState.IDLE
    client.close()
