"""What the tests of several parts of the window share."""

from __future__ import annotations

import time
from pathlib import Path

from PySide6.QtGui import QKeySequence, QShortcut

from boat_daq.engine.snapshot import Phase, Progress, ReadingRequest

SAMPLE = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"
PATIENCE_MS = 120_000  # for a helper process
NARROW = 853  # width of the window on a screen of 1280 pixels at 150 %
RAMPING = Progress(4, 37, 1, 2, 0, (), "unloading", Phase.RAMPING, 20.0, 1.0, 20.0, 130.0)
ASKED = ReadingRequest(4, 1, "unloading", 20.0, 20.0)


class Grid:
    """In place of the virtual board's process: a grid that shows one elongation."""

    unit, url = "SA1", "/dev/pts/7"

    def __init__(self, mm):
        self.mm = mm

    def grid_mm(self):
        return self.mm

    def close(self):
        """Nothing runs."""


def run_shortcut(window, keys: str) -> None:
    """Do what these keys do, where it may be done."""
    next(s for s in window.findChildren(QShortcut) if s.key() == QKeySequence(keys)).activated.emit()


def choose(window, button) -> None:
    """Give a button the focus as the operator does: one that gets it otherwise loses it again."""
    window.window_keys._chosen = button
    button.setFocus()


def pause(seconds):
    """Wait."""
    time.sleep(seconds)
