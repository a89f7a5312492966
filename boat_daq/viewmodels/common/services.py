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

    MEASURE = "Measure"
    RESULTS = "Results"
    RECORDINGS = "Recordings"
    MODELS = "Models"
    SETTINGS = "Settings"


class Tab(StrEnum):
    """A tab of a page, by its name."""

    CALIBRATION = "Calibration"
    REPEATABILITY = "Repeatability"
    OPTICS = "Optics"
    SHADOW = "Shadow"
    VALUES = "Program and units"
    ACCURACY = "Speed and accuracy"


Place = Page | Tab
TABS: dict[Page, tuple[Tab, ...]] = {
    Page.RESULTS: (Tab.CALIBRATION, Tab.REPEATABILITY),
    Page.MODELS: (Tab.OPTICS, Tab.SHADOW),
    Page.SETTINGS: (Tab.VALUES, Tab.ACCURACY),
}
"""The tabs of the pages that have some."""
PLACES: tuple[Place, ...] = tuple(place for page in Page for place in TABS.get(page, (page,)))
"""Every tab, and the pages without tabs."""


_PAGES = {place: page for page in Page for place in (page, *TABS.get(page, ()))}


def page_of(place: Place) -> Page:
    """Return the page that a tab is of; a page is its own."""
    return _PAGES[place]


class Panel(StrEnum):
    """A part of the window that is not a page: a dialog, or a form of the page Measure."""

    CONNECT = "connect"
    PLAN = "plan"
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
        change = self.done.pop()
        change.undo()  # one that raises is over: those before it can still be undone
        self.undone.append(change)
        self._report(f"Undone: {change.text}")

    def redo(self) -> None:
        """Apply the last undone change again."""
        change = self.undone.pop()
        change.redo()
        self.done.append(change)
        self._report(f"Redone: {change.text}")


@dataclass(slots=True)
class Services:
    """Services of the window, which sets `show`, `choose` and `open`.

    `choose` selects a tab of its page; the page itself is not shown.
    """

    notices: Notices
    preferences: Preferences
    undo: UndoHistory
    recordings: Path
    show: Callable[[Place | Panel], None] = lambda _: None  # there is no window yet
    choose: Callable[[Tab], None] = lambda _: None
    open: Callable[[Path], None] = lambda _: None
