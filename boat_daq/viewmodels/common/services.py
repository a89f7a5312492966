"""What several pages share: notices, preferences, undo, and the request to show a page or a panel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.undo import UndoHistory


class Page(StrEnum):
    """A page, by its name in the navigation."""

    LIVE = "Live"
    CALIBRATE = "Calibrate"
    REPEAT = "Repeat"
    RUNS = "Runs"
    OPTICS = "Optics"
    SHADOW = "Shadow"
    TRADE_OFF = "Trade-off"


class Panel(StrEnum):
    """A part of the window that is not a page: a dialog, or a form of the live page."""

    CONNECT = "connect"
    PLAN = "plan"
    PHOTOGRAPH = "photograph"
    REPORT = "report"


def _no_window(place: Page | Panel) -> None:
    """Show nothing: there is no window yet."""


@dataclass(slots=True)
class Services:
    """Services of the window.

    Parameters
    ----------
    notices : the messages of the status strip.
    preferences : values kept between starts.
    undo : the window's undo history.
    recordings : folder of the recordings, where file dialogs start.
    show : shows a page or a panel; set by the window.
    """

    notices: Notices
    preferences: Preferences
    undo: UndoHistory
    recordings: Path
    show: Callable[[Page | Panel], None] = _no_window
