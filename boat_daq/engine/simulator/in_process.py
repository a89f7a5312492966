"""A virtual board on a thread of this process, for notebooks, and its true elongations."""

from __future__ import annotations

import sys
import tempfile
import threading
from pathlib import Path

from boat_daq.engine.simulator.server import BoardServer, BoardSettings


class BoardInThread:
    """A board that is served until it is closed; `url` is its port, `truth` the CSV of its noise-free values."""

    def __init__(self, unit: str, *, speed: float, seed: int) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self.truth = Path(self._folder.name) / "truth.csv"
        port = "127.0.0.1:0" if sys.platform == "win32" else "pty"
        self._server = BoardServer(BoardSettings(port=port, unit=unit, speed=speed, seed=seed, truth=str(self.truth)))
        self.url = self._server.url
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="virtual board", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        self._server.run(self._stop.is_set)
        self._server.close()

    def close(self) -> None:
        """End the board."""
        self._stop.set()
        self._thread.join()
        self._folder.cleanup()
