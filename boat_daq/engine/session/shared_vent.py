"""One request vents every session of this user on this computer, in whichever process it runs.

Each process has sessions of its own and shares nothing with the others: a board, a window or a process that fails
leaves them alone. What joins them is a socket on the loopback interface in each, whose port and key are in a file of
the user's folder that no other user can read. A request is answered on a thread of its own, by the session itself: a
window that is busy, or does not respond any more, vents all the same. A process that was killed answers nothing; its
board vents by its own watchdog.
"""

from __future__ import annotations

import hmac
import json
import os
import secrets
import socket
import socketserver
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from boat_daq.engine.log import note
from boat_daq.engine.toml_values import read_json
from protocol.base.errors import RequestError

FOLDER = "open sessions"
ANSWER_S = 1.0
VENT, _NAME = "vent", "name"
_LINE_MAX = 400  # bytes of a request or an answer
_AT_ONCE = 50


@dataclass(frozen=True, slots=True)
class VentAnswer:
    """What another process answered: the name of its session, and whether it has vented."""

    name: str
    vented: bool


class SharedVent:
    """Takes part in venting all sessions."""

    def __init__(self, vent: Callable[[], None], name: Callable[[], str], folder: Path) -> None:
        self._vent, self._name, self._folder = vent, name, folder / FOLDER
        self._key = secrets.token_hex(16)
        server = self
        socketserver.ThreadingTCPServer.daemon_threads = True

        class Handler(socketserver.StreamRequestHandler):
            timeout = ANSWER_S

            def handle(self) -> None:
                with suppress(OSError):
                    self.wfile.write(server._answer(self.rfile.readline(_LINE_MAX)))

        self._server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
        port = self._server.server_address[1]
        self._file = self._folder / f"{os.getpid()}-{port}.json"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="shared vent", daemon=True)
        self._thread.start()
        self._announce(int(port))

    def others(self) -> list[str]:
        """Return the names of the other sessions that answer; files of processes that ended are removed."""
        return [answer.name for answer in self._ask(_NAME)]

    def vent_others(self) -> list[VentAnswer]:
        """Vent every other session; return what each answered, those that did not among them."""
        return self._ask(VENT)

    def close(self) -> None:
        """Take part no longer."""
        with suppress(OSError):  # never written, or the folder is gone
            self._file.unlink()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _announce(self, port: int) -> None:
        """Write where the others find this process; a folder that cannot be written ends no session."""
        content = json.dumps({"port": port, "key": self._key})
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self._file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                file.write(content)
        except OSError as error:
            note("warning", f"other windows cannot vent this session: {error} (try: make the folder writable)")

    def _answer(self, line: bytes) -> bytes:
        """Return the answer to a request, which carries our key; nothing to any other."""
        key, _, request = line.decode("utf-8", "replace").strip().partition(" ")
        if not hmac.compare_digest(key.encode(), self._key.encode()):
            return b""
        if request == VENT:
            self._vent()
        return f"{request} {self._name()}\n".encode()[:_LINE_MAX]

    def _ask(self, request: str) -> list[VentAnswer]:
        files = [path for path in sorted(self._folder.glob("*.json")) if path != self._file]
        with ThreadPoolExecutor(_AT_ONCE) as pool:  # at the same time: one that does not answer delays no other
            found = pool.map(lambda path: _request(path, request), files)
            return [answer for answer in found if answer is not None]


def _request(path: Path, request: str) -> VentAnswer | None:
    """Return what the process of a file answers; None where it has ended."""
    try:
        content = read_json(path)
        port, key = int(content["port"]), str(content["key"])
    except (RequestError, KeyError, TypeError, ValueError):
        return None  # being written, or not ours
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=ANSWER_S) as link:
            link.sendall(f"{key} {request}\n".encode())
            with link.makefile("rb") as lines:
                answer = lines.readline(_LINE_MAX).decode("utf-8", "replace").strip()
    except ConnectionRefusedError:
        path.unlink(missing_ok=True)  # killed: nothing listens there any more
        return None
    except OSError:
        return VentAnswer(path.stem, vented=False)
    verb, _, name = answer.partition(" ")
    if not answer:  # another program has the port now
        path.unlink(missing_ok=True)
        return None
    return VentAnswer(name, vented=verb == VENT)
