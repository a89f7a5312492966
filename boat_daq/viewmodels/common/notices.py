"""What needs attention: the strip at the foot of the window, in order of weight, then of time.

Rules: a notice has a cause and, where there is one, a remedy and an action; details are for whoever asks. Faults and
warnings stay until dismissed or replaced by weightier ones; an information without an offer leaves by itself.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from time import monotonic

from boat_daq.engine.log import note_failure

INFORMATION_S = 6.0
KEPT = 200


class Severity(IntEnum):
    """Weight of a notice."""

    INFORMATION = 0
    WARNING = 1
    FAULT = 2


WORDS = {Severity.INFORMATION: "Note", Severity.WARNING: "Attention", Severity.FAULT: "Fault"}
SHAPES = {Severity.INFORMATION: "\u25cf", Severity.WARNING: "\u25b2", Severity.FAULT: "\u25a0"}


@dataclass(frozen=True, slots=True)
class Notice:
    """One thing to say."""

    level: Severity
    cause: str
    remedy: str = ""
    details: str = ""
    action_text: str = ""
    action: Callable[[], None] | None = None
    at_s: float = 0.0

    @property
    def stays(self) -> bool:
        """Whether it waits to be dismissed: a warning, a fault, or an offer."""
        return self.level is not Severity.INFORMATION or self.action is not None

    @property
    def text(self) -> str:
        """Return all of it as plain text, for the clipboard."""
        return "\n".join(part for part in (self.cause, self.remedy, self.details) if part)


class Notices:
    """The notices of a session, newest last.

    Parameters
    ----------
    clock : seconds, monotonic.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self.history: list[Notice] = []
        self._standing: list[Notice] = []
        self.revision = 0

    def say(
        self,
        level: Severity,
        cause: str,
        remedy: str = "",
        *,
        details: str = "",
        action_text: str = "",
        action: Callable[[], None] | None = None,
    ) -> Notice:
        """Add a notice; one with the same cause takes the older one's place."""
        notice = Notice(level, cause, remedy, details, action_text, action, self._clock())
        self._standing = [other for other in self._standing if other.cause != cause]
        self._standing.append(notice)
        self.history = [*self.history[-KEPT + 1 :], notice]
        self.revision += 1
        return notice

    def inform(self, cause: str) -> None:
        """Say something that needs no deed."""
        self.say(Severity.INFORMATION, cause)

    def fault(self, error: Exception) -> None:
        """Say what an error says of itself; one that says nothing is shown with its details."""
        cause = str(getattr(error, "cause", "")) or _plain(error)
        if not hasattr(error, "cause"):
            note_failure("in the window", error)
        details = "" if hasattr(error, "cause") else "".join(traceback.format_exception(error))
        self.say(Severity.WARNING, cause, str(getattr(error, "remedy", "")), details=details)

    def attempt(self, deed: Callable[[], object], *, done: str = "") -> bool:
        """Do `deed`; say `done` if it went well, its cause and remedy if not. Returns whether it did."""
        try:
            deed()
        except Exception as error:  # noqa: BLE001 - the window's last line: nothing a user does may end it
            self.fault(error)
            return False
        if done:
            self.inform(done)
        return True

    def current(self) -> Notice | None:
        """Return the weightiest standing notice, the newest of equals; None when all is well."""
        now = self._clock()
        kept = [n for n in self._standing if n.stays or now - n.at_s < INFORMATION_S]
        if len(kept) != len(self._standing):
            self._standing = kept
            self.revision += 1
        return max(kept, key=lambda n: (n.level, n.at_s), default=None)

    def waiting(self) -> int:
        """Return how many notices stand behind the current one."""
        return max(0, len(self._standing) - 1)

    def dismiss(self, notice: Notice) -> None:
        """Take a notice away; it stays in the history."""
        self._standing = [other for other in self._standing if other is not notice]
        self.revision += 1

    def dismiss_all(self, level: Severity) -> None:
        """Take all notices of one weight away; they stay in the history."""
        self._standing = [other for other in self._standing if other.level is not level]
        self.revision += 1


def _plain(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error) or type(error).__name__
