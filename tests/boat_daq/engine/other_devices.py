"""Devices on a pseudo-terminal that are no board."""

from __future__ import annotations

import os
import threading
import tty


class Chatter:
    """A thermometer that prints text, whatever it receives."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.url = os.ttyname(self._slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._print, daemon=True)
        self._thread.start()

    def _print(self) -> None:
        while not self._stop.wait(0.05):
            os.write(self._master, b"Temperature 21.5 C\r\n")

    def close(self) -> None:
        """Stop sending."""
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


class TextBoard(Chatter):
    """A board of `profiles/delimited_lines.toml`, whose temperature rises by 0.01 degC a sample; 100 a second."""

    def _print(self) -> None:
        n = 0
        while not self._stop.wait(0.05):
            lines = (f"{10 * i},{i},{0.1 * (i % 50):.2f},2107,41,1988,37,{20 + i / 100:.2f}\n" for i in range(n, n + 5))
            os.write(self._master, "".join(lines).encode())
            n += 5
