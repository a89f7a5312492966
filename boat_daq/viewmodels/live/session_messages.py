"""The session's messages as notices; those about a broken link are dismissed once it is up again."""

from __future__ import annotations

from boat_daq.engine.snapshot import LinkState, MessageKind, SessionSnapshot
from boat_daq.viewmodels.common.notices import Notice, Notices, Severity

DOWN = (LinkState.OPENING, LinkState.FAILED, LinkState.SILENT, LinkState.LOST)
LEVELS = {"info": Severity.INFORMATION, "warning": Severity.WARNING, "error": Severity.FAULT}


class SessionMessages:
    """Adds each new message of the session to the notices.

    Parameters
    ----------
    notices : of the window.
    snapshot : its messages are old.
    """

    def __init__(self, notices: Notices, snapshot: SessionSnapshot) -> None:
        self._notices = notices
        self._last = max((m.number for m in snapshot.messages), default=0)
        self._of_link: list[Notice] = []

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Add what is new; dismiss what a restored link has settled."""
        connected = snapshot.link is LinkState.UP
        for message in snapshot.messages:
            if message.number <= self._last:
                continue
            self._last = message.number
            over = message.kind is MessageKind.SILENT and connected  # data arrive again
            level = Severity.INFORMATION if over else LEVELS.get(message.level, Severity.WARNING)
            notice = self._notices.add(level, message.cause, "" if over else message.remedy)
            if snapshot.link in DOWN:
                self._of_link.append(notice)
        if connected:
            for notice in self._of_link:
                self._notices.dismiss(notice)
            self._of_link.clear()
