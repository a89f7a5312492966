"""Carries the lines of SECoP clients to a node: one thread, one asyncio loop, nothing unbounded.

Rules: a client has one request under way and a bounded line; requests beyond `MOST_A_SECOND` wait; updates are
coalesced, so that a client which does not read holds back its own values and costs nothing; one that is stuck for
`STUCK_S` is closed. VENT leaves on a thread of its own, behind no other request. Beyond loopback a token is required
before anything else, and a wrong one costs a second.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import ipaddress
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
TOKEN_S = 10.0  # in which a token must come
TOKEN_LEAST = 16  # letters
_CLOSING = "error_connect . "


@dataclass(slots=True, eq=False)
class _Client:
    """One connection: what it is subscribed to, and what it was sent of it."""

    writer: asyncio.StreamWriter
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
    address : host and port to listen on; port 0 for a free one.
    token : that clients must send first, as ``_authenticate TOKEN``; "" for none.
    """

    def __init__(self, node: SecopNode, address: tuple[str, int] = ("127.0.0.1", _PORT), *, token: str = "") -> None:
        if not token and not is_loopback(address[0]):
            raise RequestError(f"{address[0]} can be reached from other computers", "give a token file")
        self._node, self._token = node, token.encode()
        self.port = self.requests = self.refused = 0
        self._clients: set[_Client] = set()
        self._urgent = ThreadPoolExecutor(2, "SECoP vent")
        self._work = ThreadPoolExecutor(4, "SECoP")
        self._loop = asyncio.new_event_loop()
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
        if not self._loop.is_closed():
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()
        self._urgent.shutdown(wait=False)
        self._work.shutdown(wait=False)

    def _run(self, host: str, port: int) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve(host, port))
        except OSError as error:
            self._failures.append(error)
        except Exception as error:  # noqa: BLE001 - a server's fault must not end the session
            note_failure("SECoP server", error)
        finally:
            self._begun.set()
            self._loop.close()

    async def _serve(self, host: str, port: int) -> None:
        self._stop = asyncio.Event()
        server = await asyncio.start_server(self._connected, host, port, limit=MAX_LINE)
        self.port = server.sockets[0].getsockname()[1]
        note("info", f"SECoP on {host}:{self.port}, control {'allowed' if self._node.allow_control else 'not allowed'}")
        self._begun.set()
        async with server:
            while not self._stop.is_set():
                self._update()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._stop.wait(), UPDATE_S)
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        client = _Client(writer)
        if len(self._clients) >= CLIENTS:
            writer.write(f'{_CLOSING}["IsBusy", "{CLIENTS} clients are connected", {{}}]\n'.encode())
            self.refused += 1
            await _closed(writer)
            return
        self._clients.add(client)
        try:
            if not self._token or await self._authenticated(reader, writer):
                await self._requests(client, reader)
        except (ConnectionError, TimeoutError, asyncio.CancelledError):
            return  # it left, does not read, or the server is closed
        except ValueError:  # a line beyond its limit
            writer.write(f'{_CLOSING}["ProtocolError", "a line has more than {MAX_LINE} bytes", {{}}]\n'.encode())
        finally:
            self._clients.discard(client)
            await _closed(writer)

    async def _authenticated(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Return whether the first line is the token."""
        try:
            line = await asyncio.wait_for(reader.readline(), TOKEN_S)
        except TimeoutError:
            return False
        good = hmac.compare_digest(line.strip(), b"_authenticate " + self._token)
        if not good:
            self.refused += 1
            await asyncio.sleep(1.0)
        writer.write(b"_authenticated\n" if good else f'{_CLOSING}["Disabled", "a token is required", {{}}]\n'.encode())
        return good

    async def _requests(self, client: _Client, reader: asyncio.StreamReader) -> None:
        due_s = time.monotonic()
        while line := await reader.readline():
            self.requests += 1
            text = line.decode("utf-8", "replace").strip()
            action, _, where = text.partition(" ")
            vent = action == "do" and is_vent(where.split(" ")[0])
            due_s = max(due_s + 1.0 / MOST_A_SECOND, time.monotonic() - 1.0)
            if not vent and due_s > time.monotonic():
                await asyncio.sleep(due_s - time.monotonic())
            pool = self._urgent if vent else self._work
            answers = await self._loop.run_in_executor(pool, lambda t=text: list(self._node.answer(t)))  # type: ignore[misc]
            for answer in answers:
                client.writer.write(answer.encode() + b"\n")
            self._subscribe(client, answers[-1])
            await asyncio.wait_for(client.writer.drain(), STUCK_S)

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


async def _closed(writer: asyncio.StreamWriter) -> None:
    """Close a connection; one that is broken already is closed.

    A server that is closed meanwhile ends the wait: a task that ended as cancelled would be reported by asyncio.
    """
    writer.close()
    with contextlib.suppress(OSError, asyncio.TimeoutError, asyncio.CancelledError):
        await asyncio.wait_for(writer.wait_closed(), 1.0)


def is_loopback(host: str) -> bool:
    """Return whether an address is one of this computer alone."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def read_token(path: Path) -> str:
    """Return the token of a file. RequestError: it cannot be read, or is too short to be one."""
    try:
        token = read_regular(path, 4096).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise RequestError(f"{path} cannot be read as a token", "write one line of letters and digits") from error
    if len(token) < TOKEN_LEAST or not token.isalnum():
        remedy = f"write one line of {TOKEN_LEAST} or more letters and digits"
        raise RequestError(f"{path} holds no usable token", remedy)
    return token
