"""The commands of the window: menus, shortcuts, palette and shortcut sheet are made of this one list.

Before the shortcuts some keys are handled: Esc under an open menu, Space and Enter on a focused button.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence, QWindow
from PySide6.QtWidgets import QAbstractButton, QApplication, QComboBox, QLineEdit, QMainWindow, QMenu, QPushButton

from boat_daq.gui.widgets.controls import as_words
from boat_daq.viewmodels.common.notices import Notices, Severity

ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
MENUS = ("Session", "Edit", "View", "Sequence", "Runs", "Models", "Go", "Help")


@dataclass(frozen=True, slots=True)
class Command:
    """One command.

    Parameters
    ----------
    menu : one of `MENUS`.
    text : what it does, a verb first.
    shortcut : as Qt writes it, e.g. "Ctrl+K"; every command has one.
    run : the action.
    available : whether it can run now.
    apart : whether a separator precedes it in its menu.
    why : why it cannot run now; shown on hover, and as a notice when its key is pressed.
    also : other words by which the palette finds it.
    """

    menu: str
    text: str
    shortcut: str
    run: Callable[[], object]
    available: Callable[[], bool] = lambda: True
    apart: bool = False
    why: Callable[[], str] = lambda: ""
    also: str = ""


class Registry:
    """The commands of a window, in the order of its menus."""

    def __init__(self, window: QMainWindow, notices: Notices) -> None:
        self._window, self._notices = window, notices
        self.actions: dict[Command, QAction] = {}
        self._menus: dict[str, QMenu] = {name: window.menuBar().addMenu(f"&{name}") for name in MENUS}
        for menu in self._menus.values():
            menu.aboutToShow.connect(self.refresh)
            menu.aboutToHide.connect(self.enable_all)
            menu.setToolTipsVisible(True)

    def add(self, command: Command) -> None:
        """Add a command to its menu."""
        menu = self._menus[command.menu]
        if command.apart:
            menu.addSeparator()
        action = QAction(command.text, self._window)
        action.setShortcut(QKeySequence(command.shortcut))
        action.setShortcutContext(Qt.ShortcutContext.ApplicationShortcut)
        action.triggered.connect(lambda *_: self._pressed(command))
        menu.addAction(action)
        self.actions[command] = action

    def _pressed(self, command: Command) -> None:
        """Close a popup that is open over the window (palette, menu, list), then run the command."""
        popup = QApplication.activePopupWidget()
        if popup is not None:
            popup.close()
        self.run(command)

    def run(self, command: Command) -> None:
        """Run a command if it is available, else report why not."""
        if command.available():
            command.run()
        elif why := command.why():
            self._notices.add(Severity.INFORMATION, f"\u201c{command.text}\u201d: not now", why)

    def refresh(self) -> None:
        """Disable what cannot run now, while a menu is open."""
        for command, action in self.actions.items():
            able = command.available()
            action.setEnabled(able)
            action.setToolTip("" if able else as_words(command.why()))

    def enable_all(self) -> None:
        """Enable every action once the menu is closed: the shortcut of a disabled one would have no effect."""
        for action in self.actions.values():
            action.setEnabled(True)


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
