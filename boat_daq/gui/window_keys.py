"""Keys handled before the window's shortcuts: Esc under an open menu, Space and Enter on a focused button."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence, QWindow
from PySide6.QtWidgets import QAbstractButton, QApplication, QComboBox, QLineEdit, QPushButton

ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class WindowKeys(QObject):
    """Event filter of the program's windows.

    Esc vents where shortcuts have no effect: while a menu, a list or a dialog is open. Space is a shortcut of the
    plots, but goes to a button or a choice that has the focus; Enter presses a focused button too. Undo and redo go to
    a field while it has edits to undo, else to the window's history: the reading field has the focus for a whole run.
    """

    def __init__(self, vent: Callable[[], None]) -> None:
        super().__init__()
        self.vent = vent

    def watch(self, window: QWindow | None) -> None:
        """Install the filter on a window."""
        if window is not None:
            window.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Return whether the key was handled here; Esc is passed on in any case."""
        if not isinstance(event, QKeyEvent):
            return False
        focus = QApplication.focusWidget()
        if event.type() is QEvent.Type.ShortcutOverride and event.key() == Qt.Key.Key_Space:
            return _keep(event) if isinstance(focus, QAbstractButton | QComboBox) else False
        if event.type() is QEvent.Type.ShortcutOverride and isinstance(focus, QLineEdit):
            return _leave_to_shortcuts(event, focus)
        if event.type() is not QEvent.Type.KeyPress:
            return False
        over = QApplication.activePopupWidget() or QApplication.activeModalWidget()
        if event.key() == Qt.Key.Key_Escape and over is not None:
            self.vent()
        if event.key() in ENTER and isinstance(focus, QAbstractButton) and not _has_enter(focus):
            focus.click()
            return True
        return False


def _keep(event: QKeyEvent) -> bool:
    """Keep a key from the shortcuts, so that it arrives as a key press."""
    event.accept()
    return True


def _leave_to_shortcuts(event: QKeyEvent, field: QLineEdit) -> bool:
    """Leave undo and redo to the shortcuts where the field has no edit to undo."""
    undo, redo = (event.matches(key) for key in (QKeySequence.StandardKey.Undo, QKeySequence.StandardKey.Redo))
    if (undo and not field.isUndoAvailable()) or (redo and not field.isRedoAvailable()):
        event.ignore()
        return True
    return False


def _has_enter(button: QAbstractButton) -> bool:
    """Return whether Qt itself presses this button on Enter."""
    return isinstance(button, QPushButton) and button.autoDefault()
