"""A virtual board served by a thread of the test's own, which starts sooner than a process."""

from __future__ import annotations

import threading

from boat_daq.engine.simulator.server import BoardServer, BoardSettings, ServedBoard


def serve_in_thread(settings: BoardSettings) -> ServedBoard:
    """Serve a board until it is closed."""
    server, stop = BoardServer(settings), threading.Event()

    def work() -> None:
        server.run(stop.is_set)
        server.close()

    thread = threading.Thread(target=work, name="virtual board", daemon=True)
    thread.start()

    def close() -> None:
        stop.set()
        thread.join()

    return ServedBoard(server.url, close)
