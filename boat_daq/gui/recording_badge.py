"""The recording in the header: time, size and disk left; the folder opens on a click; a button starts and stops it."""

from __future__ import annotations

from PySide6.QtWidgets import QPushButton

from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import open_folder
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.recording_status import RecordingStatus, RecordingText

_KEY = "Ctrl+R"


class RecordingBadge:
    """The two widgets; the header places them."""

    def __init__(self, status: RecordingStatus, services: Services) -> None:
        self.status = status
        self.badge: QPushButton = controls.button("", lambda: open_folder(status.folder, services), "rec")
        self.button: QPushButton = controls.button("", status.toggle)
        self._text = RecordingText()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the recording in progress, or that one can be started."""
        self._text = found = self.status.text(snapshot)
        controls.set_state(self.badge, found.state)
        self.badge.setToolTip(controls.as_words(found.tip))
        self.badge.setAccessibleName(f"Recording: {found.text or 'none'}")
        self.badge.setVisible(bool(found.text))
        controls.set_text(self.button, found.button)
        self.button.setToolTip(controls.as_words(f"{found.button} ({_KEY})" if found.text else f"{found.tip} ({_KEY})"))
        self.button.setAccessibleName("Stop recording" if found.text else "Record")
        self.button.setVisible(bool(found.button))

    def fold(self, *, short: bool) -> None:
        """Show the short text, or the whole one."""
        controls.set_text(self.badge, self._text.short if short else self._text.text)

    def lengths(self) -> tuple[object, ...]:
        """Return what the width depends on: digits have one width."""
        return len(self._text.text), len(self._text.short), self._text.button
