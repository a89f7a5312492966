"""Python's garbage collection while the window is open: on the window's thread only, in short steps.

By default it runs on whichever thread allocates next, mostly the reading thread; a widget or a timer that is garbage
is then deleted on a foreign thread, and Qt may still call it. A full collection also visits the million objects that
live as long as the window, which froze the plots for 130 ms.
"""

from __future__ import annotations

import gc

from PySide6.QtCore import QObject, QTimer, SignalInstance

EVERY_MS = 1000
SETTLED_MS = 3000  # after which a new page has loaded what it needs


class Collector(QObject):
    """Collects on the thread of `parent`, leaving out what window and libraries have loaded, page by page.

    Parameters
    ----------
    parent : is destroyed with the window; collection is then automatic again.
    page_made : is emitted when a new page has loaded its libraries.
    """

    def __init__(self, parent: QObject, page_made: SignalInstance) -> None:
        super().__init__(parent)
        gc.disable()
        self.destroyed.connect(_restore)
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
        """Collect all, and exempt what is left from later collections."""
        gc.collect()
        gc.freeze()


def _restore() -> None:
    gc.enable()
