"""What the tests of several parts of the window share."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QApplication

from boat_daq.engine.snapshot import Phase, Progress, ReadingRequest
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring, window_on

if TYPE_CHECKING:
    from boat_daq.gui.main_window import MainWindow

SAMPLE = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"
PATIENCE_MS = 120_000  # for a helper process
NARROW = 853  # width of the window on a screen of 1280 pixels at 150 %
CALIBRATED = ("SA1", "SA1  \u00b7  calibrated", "SA1  \u00b7  calibrated 2026-11-22")
RAMPING = Progress(4, 37, 1, 2, 0, (), "unloading", Phase.RAMPING, 20.0, 1.0, 20.0, 130.0)
ASKED = ReadingRequest(4, 1, "unloading", 20.0, 20.0)


class Grid:
    """In place of the virtual board's process: a grid that shows one elongation."""

    unit, url, camera_url = "SA1", "/dev/pts/7", ""

    def __init__(self, mm):
        self.mm = mm

    def grid_mm(self):
        return self.mm

    def close(self):
        """Nothing runs."""


def close_all(windows: list[MainWindow]) -> None:
    """Close and delete windows, so that no timer outlives its test."""
    for window in windows:
        window.close()
        window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)  # else each window slows the next one down
    windows.clear()
    gc.collect()  # here, not on a helper's thread later: a timer that ends on another thread than its own still fires


@contextmanager
def shared_window(folder: Path) -> Iterator[MainWindow]:
    """A window on a connected board for several tests, which refresh it themselves."""
    from boat_daq.gui.app import make_application

    make_application()
    windows = [window_on(RecordedSession(connected(), filled_ring(300.0)), folder)]
    for timer in (windows[0].frame_timer, windows[0].calm_timer):
        timer.stop()
    windows[0].show()
    QApplication.processEvents()
    try:
        yield windows[0]
    finally:
        close_all(windows)


def run_shortcut(window, keys: str) -> None:
    """Do what these keys do, where it may be done."""
    next(s for s in window.findChildren(QShortcut) if s.key() == QKeySequence(keys)).activated.emit()


def run_command(window, text: str) -> None:
    """Do a command by its text, as the palette does, where it may be done."""
    window.commands.run(next(command for command in window.commands.actions if command.text == text))


def choose(window, button) -> None:
    """Give a button the focus as the operator does: one that gets it otherwise loses it again."""
    window.window_keys._chosen = button
    button.setFocus()


def pause(seconds):
    """Wait."""
    time.sleep(seconds)
