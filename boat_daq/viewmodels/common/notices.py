"""Notices for the status strip: a new one first, then by severity and time.

Rules: a notice has a cause and, where there is one, a remedy and an action; details are shown on request. Faults and
warnings stay until dismissed; the refusal of an action and information without an action expire. The session's messages
about a broken link or a slow disk are dismissed once it is over.
"""

from __future__ import annotations

import math
import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from pathlib import Path
from time import monotonic
from typing import Any

from boat_daq.engine.log import note_failure
from boat_daq.engine.snapshot import LinkState, MessageKind, SessionSnapshot, SessionState
from boat_daq.formatting import as_shown
from boat_daq.workflows.jobs import Job, JobState
from protocol.base.errors import cause_and_remedy
from protocol.base.units import STORED_UNITS

Offer = tuple[str, Callable[[], object]]
"""Label and function of a button."""
INFORMATION_S, SAVED_S, _REFUSED_S = 6.0, 30.0, 60.0
NEW_S = 6.0  # so long a notice is shown before older, more severe ones
_KEPT = 200


class Severity(IntEnum):
    INFORMATION = 0
    WARNING = 1
    FAULT = 2


DOWN = (LinkState.OPENING, LinkState.FAILED, LinkState.SILENT, LinkState.LOST)
_ENDED = (SessionState.ABORTED, SessionState.FAULT)
_LEVELS = {"info": Severity.INFORMATION, "warning": Severity.WARNING, "error": Severity.FAULT}
NOT_SAVING = "\u25a0 NOT SAVING"  # of the recording in progress
TITLES = ("\u25cf  Note", "\u25b2  Warning", "\u25a0  Fault")  # by severity


@dataclass(frozen=True, slots=True)
class Notice:
    severity: Severity
    cause: str
    remedy: str = ""
    details: str = ""
    action_text: str = ""
    action: Callable[[], object] | None = None
    at_s: float = 0.0
    time: str = ""  # of the day, for the history
    saved: Path | None = None  # a file that was written: it can be opened, or its folder
    refusal: bool = False  # why an action of the operator was not done

    @property
    def stays(self) -> bool:
        """Return whether it waits to be dismissed: a warning, a fault, or one with an action."""
        return self.severity is not Severity.INFORMATION or self.action is not None

    @property
    def shown_s(self) -> float:
        """Return how long it is shown: a saved file longer, so that it can be opened."""
        if self.refusal:
            return _REFUSED_S
        return math.inf if self.stays else SAVED_S if self.saved is not None else INFORMATION_S

    @property
    def sentences(self) -> str:
        return " ".join(sentence(part) for part in (self.cause, self.remedy) if part)

    @property
    def text(self) -> str:
        return "\n".join(part for part in (self.cause, self.remedy, self.details) if part)


class Notices:
    """The notices of a session, newest last."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self.history: list[Notice] = []
        self._open: list[Notice] = []
        self.units = STORED_UNITS  # in which they are shown
        self.offers: dict[type[Exception], Offer] = {}  # what settles an error

    def add(
        self,
        severity: Severity,
        cause: str,
        remedy: str = "",
        *,
        details: str = "",
        action: Offer | None = None,
        saved: Path | None = None,
        refusal: bool = False,
    ) -> Notice:
        """Add a notice; one with the same cause is replaced, and the more severe of the two kept."""
        cause, remedy = (as_shown(text, self.units) for text in (cause, remedy))
        action_text, run = action or ("", None)
        severity = max([severity, *(other.severity for other in self._open if other.cause == cause)])
        time = datetime.now().astimezone().strftime("%H:%M:%S")
        notice = Notice(severity, cause, remedy, details, action_text, run, self._clock(), time, saved, refusal)
        self._open = [*(other for other in self._open if other.cause != cause), notice]
        self.history = [*self.history[-_KEPT + 1 :], notice]
        return notice

    def inform(self, cause: str) -> None:
        self.add(Severity.INFORMATION, cause)

    def inform_saved(self, path: Path) -> None:
        self.add(Severity.INFORMATION, f"Saved {path.name}", saved=path)

    def ended(self, done: Callable[[Any], object]) -> Callable[[Job], None]:
        """Return what takes a job that has ended: its failure becomes a warning, its result goes to `done`."""

        def take(job: Job) -> None:
            if job.state is JobState.DONE:
                done(job.result)
            elif job.failure is not None:
                self.add(Severity.WARNING, job.failure.cause, job.failure.remedy, details=job.failure.details)

        return take

    def history_text(self) -> str:
        """Return all messages, the newest first: time, severity, cause and remedy."""
        lines = (f"{n.time}  {TITLES[n.severity]}  {n.sentences}" for n in reversed(self.history))
        return "\n".join(lines) or "No message yet."

    def attempt(self, action: Callable[[], object], *, done: str = "") -> bool:
        """Run `action`; add `done` if it succeeds, its cause and remedy if not. Return whether it succeeded.

        Success closes earlier refusals that have been read: what they named no longer stops the operator.
        """
        try:
            action()
        except Exception as error:  # noqa: BLE001 - the outermost handler: no error of an action may end the window
            self._add_error(error)
            return False
        now = self._clock()
        self._open = [n for n in self._open if not n.refusal or now - n.at_s < NEW_S]
        if done:
            self.inform(done)
        return True

    def _add_error(self, error: Exception) -> None:
        """Add an error; one that is not the program's own with its traceback, which is logged too."""
        if (known := cause_and_remedy(error)) is not None:
            self.add(Severity.WARNING, *known, refusal=True, action=self.offers.get(type(error)))
        else:
            note_failure("in the window", error)
            self.add(Severity.WARNING, _plain(error), details="".join(traceback.format_exception(error)))

    def current(self) -> Notice | None:
        """Return the newest notice while it is new, then the most severe, the newest of equals; None without one."""
        now = self._clock()
        self._open = [n for n in self._open if now - n.at_s < n.shown_s]
        new = [n for n in self._open if now - n.at_s < NEW_S]
        return max(reversed(new or self._open), key=lambda n: (n.severity, n.at_s), default=None)

    def waiting(self) -> int:
        """Return how many notices are open besides the current one."""
        return max(0, len(self._open) - 1)

    def dismiss(self, notice: Notice | None) -> None:
        """Close a notice, if there is one; it stays in the history."""
        self._open = [other for other in self._open if other is not notice]

    def dismiss_all(self, severity: Severity) -> None:
        """Close all notices of one severity; they stay in the history."""
        self._open = [other for other in self._open if other.severity is not severity]


class SessionMessages:
    """Adds each new message of the session to the notices."""

    def __init__(self, notices: Notices, snapshot: SessionSnapshot) -> None:
        self._notices = notices
        self._last = max((m.number for m in snapshot.messages), default=0)
        self._of_link: list[Notice] = []
        self._of_slow_disk: list[Notice] = []
        self._of_disk: list[Notice] = []  # that failed
        self._failing = False
        self._of_control: list[Notice] = []  # that ended what was held by hand, until something is held again
        self._commanded = False
        self._of_run: list[Notice] = []  # that ended it, until the fault is cleared or the next one begins
        self._alarms: dict[str, Notice] = {}  # of sensors and pressure, by cause

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Add what is new; dismiss what a restored link has settled."""
        connected = snapshot.link is LinkState.UP
        before, self._commanded = self._commanded, snapshot.commanded
        if self._commanded and not before:
            self._settle(self._of_control)
        for message in snapshot.messages:
            if message.number <= self._last:
                continue
            self._last = message.number
            if message.kind is MessageKind.RUN_ENDED and message.level == "info":
                continue  # reported with what was read
            over = message.kind is MessageKind.SILENT and connected  # data arrive again
            level = Severity.INFORMATION if over else _LEVELS.get(message.level, Severity.WARNING)
            cause = f"{message.cause}; data resumed" if over else message.cause
            notice = self._notices.add(level, cause, "" if over else message.remedy)
            if message.kind is MessageKind.STORAGE:
                (self._of_disk if level is Severity.FAULT else self._of_slow_disk).append(notice)
            elif snapshot.link in DOWN or (message.kind is MessageKind.VENT and not connected):
                self._of_link.append(notice)
            elif message.cause in snapshot.alarms:
                self._alarms[message.cause] = notice
            elif level is Severity.FAULT:
                (self._of_run if snapshot.state in _ENDED else self._of_control).append(notice)
        before, self._failing = self._failing, bool(snapshot.not_saving)
        if snapshot.recording is None or (before and not self._failing):
            self._settle(self._of_disk)
        if before and not self._failing and snapshot.recording is not None:
            self._notices.add(Severity.INFORMATION, "the recording is saved again")
        if snapshot.recording is None or (snapshot.health is not None and not snapshot.health.late):
            self._settle(self._of_slow_disk)
        if connected:
            if self._of_link and snapshot.state is SessionState.FAULT:
                ended = "the lost link has ended what was under way", "Clear the fault on Measure."
                self._of_run.append(self._notices.add(Severity.WARNING, *ended))
            self._settle(self._of_link)
        if snapshot.state not in _ENDED:
            self._settle(self._of_run)
        for cause in self._alarms.keys() - set(snapshot.alarms):
            self._notices.dismiss(self._alarms.pop(cause))

    def _settle(self, over: list[Notice]) -> None:
        for notice in over:
            self._notices.dismiss(notice)
        over.clear()


def sentence(text: str) -> str:
    """Return `text` with a capital and a full stop; one that begins with a path or a file keeps its first letter."""
    text = text.strip()
    head = text if re.match(r"\S*(/|\w\.\w)", text) else text[:1].upper() + text[1:]
    return head if head.endswith((".", "!", "?", "\u2026")) else f"{head}."


def _plain(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error) or type(error).__name__
