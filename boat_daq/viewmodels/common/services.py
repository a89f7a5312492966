"""What several pages share: notices, preferences, the undo history, and requests to show a page or a panel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.preferences import Preferences


class Page(StrEnum):
    """A page, by its name in the navigation."""

    LIVE = "Live"
    CALIBRATE = "Calibrate"
    REPEAT = "Repeat"
    RUNS = "Runs"
    OPTICS = "Optics"
    SHADOW = "Shadow"
    TRADE_OFF = "Trade-off"
    SETTINGS = "Settings"


class Panel(StrEnum):
    """A part of the window that is not a page: a dialog, or a form of the live page."""

    CONNECT = "connect"
    PLAN = "plan"
    PROFILE = "profile"
    SEGMENTS = "segments"
    PHOTOGRAPH = "photograph"
    REPORT = "report"
    OUTLETS = "outlets"


@dataclass(frozen=True, slots=True)
class Change:
    """A change and its reversal; `text` completes "Undo ..."."""

    text: str
    redo: Callable[[], None]
    undo: Callable[[], None]


class UndoHistory:
    """Changes in order, and those that were undone."""

    def __init__(self, report: Callable[[str], object] = lambda _: None) -> None:
        self._report = report  # takes what was undone
        self.done: list[Change] = []
        self.undone: list[Change] = []

    def push(self, change: Change) -> None:
        """Apply a change and record it; one that raises is not recorded, undone changes are discarded."""
        change.redo()
        self.done.append(change)
        self.undone.clear()

    def undo(self) -> None:
        """Reverse the last change."""
        change = self.done.pop()
        self.undone.append(change)
        change.undo()
        self._report(f"Undone: {change.text}")

    def redo(self) -> None:
        """Apply the last undone change again."""
        change = self.undone.pop()
        self.done.append(change)
        change.redo()
        self._report(f"Redone: {change.text}")


@dataclass(slots=True)
class Services:
    """Services of the window, which sets `show` and `open`."""

    notices: Notices
    preferences: Preferences
    undo: UndoHistory
    recordings: Path
    show: Callable[[Page | Panel], None] = lambda _: None  # there is no window yet
    open: Callable[[Path], None] = lambda _: None
