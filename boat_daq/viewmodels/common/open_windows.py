"""The other windows open on this computer, each a process for another board, and one key that vents all."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import monotonic

from boat_daq.engine.session.session import Session
from boat_daq.engine.session.shared_vent import SharedVent, VentAnswer
from boat_daq.viewmodels.common.notices import Notices, Severity
from boat_daq.workflows.jobs import Background

LOOK_S = 2.0  # between two looks for other windows


def start_window() -> None:
    """Open another window, in a process of its own."""
    command = [sys.executable] if getattr(sys, "frozen", False) else [sys.executable, "-m", "boat_daq"]
    nothing = subprocess.DEVNULL
    subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True)


class OpenWindows:
    def __init__(self, session: Session, name: Callable[[], str], notices: Notices, folder: Path) -> None:
        self._session, self._name, self._notices, self._folder = session, name, notices, folder
        self._shared: SharedVent | None = None
        self._looks: Background[list[str]] = Background("windows")
        self._vents: Background[list[VentAnswer]] = Background("vent all")
        self._next_s = 0.0
        self.others: list[str] = []

    def join(self) -> None:
        """Take part in VENT ALL; OSError where the user's folder cannot be written."""
        self._shared = SharedVent(self._session.vent, self._name, self._folder)

    def vent_all(self) -> None:
        """Vent this session at once, and those of all other windows at the same time."""
        if self._shared is not None:
            self._vents.call(self._shared.vent_others)
        self._session.vent()

    def follow(self) -> None:
        """Look for other windows now and then; report what they answered to VENT ALL."""
        if self._shared is None:
            return
        if monotonic() >= self._next_s and not self._looks.pending:
            self._next_s = monotonic() + LOOK_S
            self._looks.call(self._shared.others)
        self.others = next((found for found in [self._looks.take()] if found is not None), self.others)
        answers = self._vents.take()
        if answers is not None:
            self._report(answers)

    def _report(self, answers: list[VentAnswer]) -> None:
        vented = [answer.name for answer in answers if answer.vented]
        if vented:
            self._notices.add(Severity.INFORMATION, f"also vented: {', '.join(vented)}")
        for answer in (answer for answer in answers if not answer.vented):
            remedy = "Vent in that window, or open its valve manually. Without its program a board vents by itself."
            self._notices.add(Severity.FAULT, f"the session {answer.name} did not confirm the vent", remedy)

    def close(self) -> None:
        """Take part no longer."""
        if self._shared is not None:
            self._shared.close()
            self._shared = None
        for helper in (self._looks, self._vents):
            helper.close()
