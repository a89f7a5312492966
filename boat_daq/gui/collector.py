"""Python's garbage collector, while the window is open: on the window's thread alone, and never for long.

Left to itself it runs on whichever thread allocates next, the reading thread more than any other; a widget or a timer
that is garbage then dies on a thread that is not its own, and Qt may still call it. And each full collection looks at
the million objects that live as long as the window: the picture stopped for 130 ms.
"""

from __future__ import annotations

import gc

from PySide6.QtCore import QObject, QTimer, SignalInstance

EVERY_MS = 1000
SETTLED_MS = 3000  # after which a new page has loaded what it needs


class Collector(QObject):
    """Collects on the thread of `parent`, leaving out what window and libraries have loaded, page by page."""

    def __init__(self, parent: QObject, page_made: SignalInstance) -> None:
        super().__init__(parent)
        gc.disable()
        self.destroyed.connect(_by_itself_again)
        self.due = QTimer(self)
        self.due.timeout.connect(self.collect)
        self.due.start(EVERY_MS)
        self.settled = QTimer(self)
        self.settled.setSingleShot(True)
        self.settled.setInterval(SETTLED_MS)
        self.settled.timeout.connect(self.settle)
        page_made.connect(self.settled.start)
        self.settled.start()

    def collect(self) -> None:
        """Collect the oldest generation that is due by Python's own thresholds."""
        for generation in (2, 1, 0):
            if gc.get_count()[generation] > gc.get_threshold()[generation]:
                gc.collect(generation)
                return

    def settle(self) -> None:
        """Collect all, and look at what is left no more."""
        gc.collect()
        gc.freeze()


def _by_itself_again() -> None:
    gc.enable()
