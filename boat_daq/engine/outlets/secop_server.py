"""Carries the lines of SECoP clients to a node: one thread, one asyncio loop, nothing unbounded.

Rules:

- A connection is new until its first line. It has `FIRST_LINE_S` for it, in a pool of its own: where that is full, the
  oldest new connection is closed. A first line that is no SECoP request, such as that of HTTP or TLS, ends the
  connection before anything is executed.
- Control needs a token, on this computer too. Beyond loopback nothing is answered before it. A wrong one costs 1 s.
- VENT is answered even where all places of clients are taken, and leaves on threads of its own.
- A client has one request under way and a bounded line; requests beyond `MOST_A_SECOND` wait; updates are coalesced, so
  that a client which does not read holds back its own values; one that is stuck for `STUCK_S` is closed.
- Where the client that set a pressure has left, and none that may control is connected, the unit is vented after
  `hold_s`.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
import math
import os
import re
import secrets
import socket
import stat
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from boat_daq.engine.log import note, note_failure
from boat_daq.engine.outlets.secop_node import MAX_LINE, SecopNode, is_vent
from protocol.base.errors import RequestError
from protocol.base.regular_file import read_regular

_PORT = 10767
CLIENTS = 8
MOST_A_SECOND = 200
UPDATE_S = 0.1
BACKLOG_BYTES = 1 << 18
STUCK_S = 30.0
NEW_CLIENTS = 8  # connections that have sent no line yet
FIRST_LINE_S = 5.0
TOKEN_LEAST = 16  # letters
_KEEPALIVE = {"TCP_KEEPIDLE": 5, "TCP_KEEPINTVL": 2, "TCP_KEEPCNT": 3, "TCP_USER_TIMEOUT": 11_000}  # 11 s in all
_CLOSING = "error_connect . "
_FIRST_LINE = re.compile(
    rb"(?:\*IDN\?|describe|ping|activate|deactivate|read|change|do|logging|help|_authenticate)(?: [^\r\n]*)?\r?\n"
)


@dataclass(slots=True, eq=False)
class _Client:
    """One connection: what it is subscribed to, and what it was sent of it."""

    writer: asyncio.StreamWriter
    may_control: bool = False
    subscribed: set[str] = field(default_factory=set)  # modules; "" for all
    sent: dict[str, str] = field(default_factory=dict)  # value of each parameter, without its time
    stuck_since_s: float | None = None

    @property
    def backlog(self) -> int:
        return self.writer.transport.get_write_buffer_size()


class SecopServer:
    """Serves a node until `close`.

    Parameters
    ----------
    address : host and port; port 0 for a free one.
    token : what a client sends as ``_authenticate TOKEN`` before control, and beyond loopback before anything.
    hold_s : how long a pressure is held after the client that set it has left, s; inf holds it.
    """

    def __init__(
        self,
        node: SecopNode,
        address: tuple[str, int] = ("127.0.0.1", _PORT),
        *,
        token: str = "",
        hold_s: float = math.inf,
    ) -> None:
        self._local = is_loopback(address[0])
        if not token and not self._local:
            raise RequestError(f"{address[0]} can be reached from other computers", "give a token file")
        if not token and node.allow_control:
            raise RequestError("control of the unit needs a token", "give a token file")
        self._node, self._token, self._hold_s = node, token.encode(), hold_s
        self.port = self.requests = self.refused = 0
        self._new: dict[asyncio.StreamWriter, None] = {}  # connections without a first line, the oldest first
        self._driver: _Client | None = None  # the client that set the pressure in force
        self._left_s: float | None = None  # when it left, with no other client that may control
        self._clients: set[_Client] = set()
        self._connections: set[asyncio.Task[None]] = set()  # the loop itself keeps none alive
        self._urgent = ThreadPoolExecutor(2, "SECoP vent")
        self._work = ThreadPoolExecutor(4, "SECoP")
        self._runner = asyncio.Runner()
        self._begun = threading.Event()
        self._failures: list[OSError] = []
        self._thread = threading.Thread(target=self._run, args=address, name="SECoP server", daemon=True)
        self._thread.start()
        self._begun.wait()
        if self._failures:
            self._thread.join()
            cause = f"{address[0]}:{address[1]} cannot be listened on: {self._failures[0].strerror}"
            raise RequestError(cause, "choose another address or port") from self._failures[0]

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return len(self._clients)

    def close(self) -> None:
        """Close every connection; the session stays as it is."""
        if self._thread.is_alive():
            with contextlib.suppress(RuntimeError):  # the loop has just ended by itself
                self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()
        self._urgent.shutdown(wait=False)
        self._work.shutdown(wait=False)

    def _run(self, host: str, port: int) -> None:
        try:
            with self._runner:  # its end cancels and awaits every task
                self._runner.run(self._serve(host, port))
        except OSError as error:
            self._failures.append(error)
        except Exception as error:  # noqa: BLE001 - a server's fault must not end the session
            note_failure("SECoP server", error)
        finally:
            self._begun.set()

    async def _serve(self, host: str, port: int) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        server = await asyncio.start_server(self._accept, host, port, limit=MAX_LINE)
        self.port = server.sockets[0].getsockname()[1]
        note("info", f"SECoP on {host}:{self.port}, control {'allowed' if self._node.allow_control else 'not allowed'}")
        self._begun.set()
        async with server:
            while not self._stop.is_set():
                self._update()
                await self._vent_after_driver()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._stop.wait(), UPDATE_S)
            server.close()
            if accepting := asyncio.all_tasks() - self._connections - {asyncio.current_task()}:
                await asyncio.wait(accepting, timeout=1.0)
            for task in self._connections:  # Python 3.12 waits for them
                task.cancel()

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a connection; asyncio would report a task of its own that is cancelled before its first step."""
        task = self._loop.create_task(self._connected(reader, writer))
        self._connections.add(task)
        task.add_done_callback(self._connections.discard)
        task.add_done_callback(lambda _: writer.close())

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(writer)
        _notice_a_dead_peer(writer.get_extra_info("socket"))
        try:
            line = await self._first_line(reader, writer)
            if line and (self._local or await self._authenticated(client, line)):
                await self._admitted(client, reader, line if self._local else b"")
        except (ConnectionError, TimeoutError, asyncio.CancelledError):
            return  # it left, does not read, or the server is closed
        except ValueError:  # a line beyond its limit
            writer.write(f'{_CLOSING}["ProtocolError", "a line has more than {MAX_LINE} bytes", {{}}]\n'.encode())
        finally:
            self._clients.discard(client)
            self._note_absence()
            await _closed(writer)

    async def _first_line(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
        """Return the first line; empty where it is no request of this protocol, or does not come in time."""
        if len(self._new) >= NEW_CLIENTS:
            oldest = next(iter(self._new))
            del self._new[oldest]
            oldest.transport.abort()
            self.refused += 1
        self._new[writer] = None
        try:
            line = await asyncio.wait_for(reader.readline(), FIRST_LINE_S)
        finally:
            self._new.pop(writer, None)
        if line and not _FIRST_LINE.fullmatch(line):
            self.refused += 1
            return b""
        return line

    async def _admitted(self, client: _Client, reader: asyncio.StreamReader, line: bytes) -> None:
        """Answer a client until it leaves; where no place is free, one VENT and no more."""
        if len(self._clients) < CLIENTS:
            self._clients.add(client)
            await self._requests(client, reader, line)
            return
        self.refused += 1
        line = line or await asyncio.wait_for(reader.readline(), FIRST_LINE_S)
        if _is_vent(line.decode("utf-8", "replace").strip()):
            await self._answer(client, line)
        client.writer.write(f'{_CLOSING}["IsBusy", "{CLIENTS} clients are connected", {{}}]\n'.encode())

    async def _authenticated(self, client: _Client, line: bytes) -> bool:
        """Answer a line that should be the token; return whether it is."""
        good = bool(self._token) and hmac.compare_digest(line.strip(), b"_authenticate " + self._token)
        if not good:
            self.refused += 1
            await asyncio.sleep(1.0)
        answer = "_authenticated\n" if good else f'{_CLOSING}["Disabled", "a token is required", {{}}]\n'
        client.writer.write(answer.encode())
        client.may_control |= good
        if good and self._left_s is not None:
            self._driver, self._left_s = client, None
        return good

    async def _requests(self, client: _Client, reader: asyncio.StreamReader, line: bytes) -> None:
        """Answer the first line, where it is not answered yet, and those that follow."""
        due_s = time.monotonic()
        while (line := line or await reader.readline()).endswith(b"\n"):  # a client may die within a line
            due_s = max(due_s + 1.0 / MOST_A_SECOND, time.monotonic() - 1.0)
            if not _is_vent(line.decode("utf-8", "replace").strip()) and due_s > time.monotonic():
                await asyncio.sleep(due_s - time.monotonic())
            if line.startswith(b"_authenticate"):
                if not await self._authenticated(client, line):
                    return
            else:
                await self._answer(client, line)
            await asyncio.wait_for(client.writer.drain(), STUCK_S)
            line = b""

    async def _answer(self, client: _Client, line: bytes) -> None:
        """Have the node answer one request."""
        self.requests += 1
        text = line.decode("utf-8", "replace").strip()
        pool = self._urgent if _is_vent(text) else self._work
        answers = await self._loop.run_in_executor(
            pool, lambda: list(self._node.answer(text, may_control=client.may_control))
        )
        if answers[-1].startswith(("changed pressure ", "changed pressure:target ")):
            self._driver, self._left_s = client, None
        for answer in answers:
            client.writer.write(answer.encode() + b"\n")
        self._subscribe(client, answers[-1])

    def _note_absence(self) -> None:
        """Begin to count the time of a pressure once no client that may control is connected."""
        if self._driver is not None and self._left_s is None and not any(one.may_control for one in self._clients):
            self._left_s = time.monotonic()

    async def _vent_after_driver(self) -> None:
        """Vent a pressure whose client has been gone for `hold_s`."""
        if self._left_s is None or time.monotonic() - self._left_s < self._hold_s:
            return
        self._left_s = self._driver = None
        await self._loop.run_in_executor(self._urgent, self._node.vent_abandoned, self._hold_s)

    def _subscribe(self, client: _Client, answer: str) -> None:
        """Follow what a client was told: active or inactive, all or a module."""
        word, _, where = answer.partition(" ")
        if word == "active":
            client.subscribed.add(where.partition(":")[0])
        elif word == "inactive":
            client.subscribed -= {where.partition(":")[0]} if where else client.subscribed.copy()

    def _update(self) -> None:
        """Send to each client what has changed for it; the newest value only, where it does not keep up."""
        listening = [client for client in self._clients if client.subscribed]
        updates = self._node.updates() if listening else {}
        for client in listening:
            if client.backlog > BACKLOG_BYTES:
                client.stuck_since_s = client.stuck_since_s or time.monotonic()
                if time.monotonic() - client.stuck_since_s > STUCK_S:
                    client.writer.transport.abort()
                continue
            client.stuck_since_s = None
            for name, line in updates.items():
                value = line.rpartition(", {")[0]
                if client.sent.get(name) != value and client.subscribed & {"", name.partition(":")[0]}:
                    client.sent[name] = value
                    client.writer.write(line.encode() + b"\n")


def _notice_a_dead_peer(connection: socket.socket) -> None:
    """Have the system end a connection whose computer or cable has failed: it closes nothing itself."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _KEEPALIVE.items():
        if hasattr(socket, name):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


async def _closed(writer: asyncio.StreamWriter) -> None:
    """Close a connection; one that is broken already is closed.

    A server that is closed meanwhile ends the wait: a task that ended as cancelled would be reported by asyncio.
    """
    writer.close()
    with contextlib.suppress(OSError, asyncio.TimeoutError, asyncio.CancelledError):
        await asyncio.wait_for(writer.wait_closed(), 1.0)


def _is_vent(text: str) -> bool:
    action, _, where = text.partition(" ")
    return action == "do" and is_vent(where.split(" ")[0])


def is_loopback(host: str) -> bool:
    """Return whether an address is one of this computer alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def read_token(path: Path) -> str:
    """Return the token of a file."""
    try:
        if os.name == "posix" and stat.S_IMODE(path.stat().st_mode) & 0o077:
            raise RequestError(f"{path} can be read by other users", f"chmod 600 {path}")
        token = read_regular(path, 4096).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise RequestError(f"{path} cannot be read as a token", "write one line of letters and digits") from error
    if len(token) < TOKEN_LEAST or not token.isalnum():
        remedy = f"write one line of {TOKEN_LEAST} or more letters and digits"
        raise RequestError(f"{path} holds no usable token", remedy)
    return token


def own_token(path: Path) -> str:
    """Return the token of this user's file, which is made where there is none."""
    if not path.exists():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
                file.write(secrets.token_hex(TOKEN_LEAST) + "\n")
        except FileExistsError:
            return read_token(path)  # another program of this user has just made it
        except OSError as error:
            raise RequestError(f"{path} cannot be written: {error.strerror}", "give a token file") from error
    return read_token(path)
