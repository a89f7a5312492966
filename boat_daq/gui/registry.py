"""Every deed of the window, once: menus, shortcuts, the palette and the shortcut sheet are made of this list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QApplication, QMainWindow, QMenu

from boat_daq.gui.widgets.tooltips import as_words

MENUS = ("Session", "Edit", "View", "Sequence", "Runs", "Models", "Go", "Help")


@dataclass(frozen=True, slots=True)
class Command:
    """One deed.

    Parameters
    ----------
    menu : one of `MENUS`.
    text : what it does, a verb first.
    shortcut : as Qt writes it, e.g. "Ctrl+K"; every command has one.
    run : the deed.
    available : whether it can be done now.
    apart : whether a line stands above it in its menu.
    why : what stands against it now; said where it is greyed, and where its key is pressed all the same.
    """

    menu: str
    text: str
    shortcut: str
    run: Callable[[], object]
    available: Callable[[], bool] = lambda: True
    apart: bool = False
    why: Callable[[], str] = lambda: ""


class Registry:
    """The commands of a window, in the order of its menus."""

    def __init__(self, window: QMainWindow) -> None:
        self._window = window
        self.commands: list[Command] = []
        self._actions: list[tuple[Command, QAction]] = []
        self.refused: Callable[[str, str], object] = lambda what, why: None
        self._menus: dict[str, QMenu] = {name: window.menuBar().addMenu(f"&{name}") for name in MENUS}
        for menu in self._menus.values():
            menu.aboutToShow.connect(self.refresh)
            menu.setToolTipsVisible(True)

    def add(self, command: Command) -> QAction:
        """Add a command to its menu; returns its action."""
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
        """Do a command by its key; what stands open over the window (palette, menu, list) has had its turn."""
        popup = QApplication.activePopupWidget()
        if popup is not None:
            popup.close()
        self.run(command)

    def run(self, command: Command) -> None:
        """Do a command if it can be done now."""
        if command.available():
            command.run()
        elif why := command.why():
            self.refused(command.text, why)

    def refresh(self) -> None:
        """Grey out what cannot be done now; the shortcut of a greyed command asks again when it is pressed."""
        for command, action in self._actions:
            able = command.available()
            action.setEnabled(able)
            action.setToolTip("" if able else as_words(command.why()))

    def wake(self) -> None:
        """Let every shortcut be heard again after a menu has closed."""
        for _, action in self._actions:
            action.setEnabled(True)
