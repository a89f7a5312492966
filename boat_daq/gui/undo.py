"""Changes in Qt's undo stack."""

from __future__ import annotations

from PySide6.QtGui import QUndoCommand, QUndoStack

from boat_daq.viewmodels.common.changes import Change
from boat_daq.viewmodels.common.notices import Notices


class _Command(QUndoCommand):
    """A change that has been done already when it is pushed: an error in it must not leave a command behind."""

    def __init__(self, change: Change, notices: Notices) -> None:
        super().__init__(change.text)
        self._change, self._notices = change, notices
        self._done = True

    def redo(self) -> None:
        """Do it again; Qt calls this on the push too, when it is done already."""
        if self._done:
            self._done = False
        else:
            self._notices.attempt(self._change.redo)

    def undo(self) -> None:
        """Take it back."""
        self._notices.attempt(self._change.undo)


class UndoStack:
    """The window's history of changes."""

    def __init__(self, notices: Notices) -> None:
        self.stack = QUndoStack()
        self._notices = notices

    def push(self, change: Change) -> None:
        """Do the change and keep it; one that raises is not kept."""
        change.redo()
        self.stack.push(_Command(change, self._notices))
