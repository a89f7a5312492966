"""The commands of the window: menus, shortcuts, palette and shortcut sheet are made of this one list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QApplication, QMainWindow, QMenu

from boat_daq.gui.widgets.controls import as_words
from boat_daq.viewmodels.common.notices import Notices, Severity

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
        self.commands: list[Command] = []
        self._actions: list[tuple[Command, QAction]] = []
        self._menus: dict[str, QMenu] = {name: window.menuBar().addMenu(f"&{name}") for name in MENUS}
        for menu in self._menus.values():
            menu.aboutToShow.connect(self.refresh)
            menu.aboutToHide.connect(self.enable_all)
            menu.setToolTipsVisible(True)

    def add(self, command: Command) -> QAction:
        """Add a command to its menu; return its action."""
        menu = self._menus[command.menu]
        if command.apart:
            menu.addSeparator()
        action = QAction(command.text, self._window)
        action.setShortcut(QKeySequence(command.shortcut))
        action.setShortcutContext(Qt.ShortcutContext.ApplicationShortcut)
        action.triggered.connect(lambda *_: self._pressed(command))
        menu.addAction(action)
        self.commands.append(command)
        self._actions.append((command, action))
        return action

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
        for command, action in self._actions:
            able = command.available()
            action.setEnabled(able)
            action.setToolTip("" if able else as_words(command.why()))

    def enable_all(self) -> None:
        """Enable every action once the menu is closed: the shortcut of a disabled one would have no effect."""
        for _, action in self._actions:
            action.setEnabled(True)
