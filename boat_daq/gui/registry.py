"""The commands of the window: menus, shortcuts, palette and shortcut sheet are made of this one list.

Before the shortcuts some keys are handled: VENT, Esc under an open menu, Space, Enter on a focused button.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, QPoint, QRect, Qt, QTimer
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence, QMouseEvent, QShortcut, QWindow
from PySide6.QtWidgets import (
    QAbstractButton,
    QApplication,
    QDialog,
    QLineEdit,
    QMainWindow,
    QMenu,
    QPushButton,
    QWidget,
)

from boat_daq.gui.widgets.controls import as_words
from boat_daq.viewmodels.common.notices import Notices, Severity

ENTER = (Qt.Key.Key_Return, Qt.Key.Key_Enter)
_MOVING = (
    Qt.Key.Key_Tab, Qt.Key.Key_Backtab, Qt.Key.Key_Left, Qt.Key.Key_Right, Qt.Key.Key_Up, Qt.Key.Key_Down
)  # fmt: skip
PLACED = (QEvent.Type.Move, QEvent.Type.Resize, QEvent.Type.Expose)  # of a window
POINTED = (QEvent.Type.MouseButtonPress, QEvent.Type.TouchBegin)
MENUS = {name.replace("&", ""): name for name in ("&Session", "&Edit", "&View", "&Run", "Res&ults", "&Help")}
PAGES = "Pages"  # the commands that show one: they have keys, but no menu
CHECK = "   \u2713"  # behind what is chosen now
SELDOM = ""  # in place of a menu: the palette alone finds the command


def always() -> bool:
    """Return True: a command that can run at any time."""
    return True


@dataclass(frozen=True, slots=True)
class Command:
    """One command.

    Parameters
    ----------
    menu : one of `MENUS`, `PAGES`, or `SELDOM`.
    shortcut : its keys; empty for none.
    apart : whether a separator precedes it in its menu.
    why : why it cannot run now; shown on hover, and as a notice when its key is pressed.
    also : other words by which the palette finds it.
    checked : whether it is what is chosen now, which its menu marks.
    """

    menu: str
    text: str
    shortcut: str
    run: Callable[[], object]
    available: Callable[[], bool] = always
    apart: bool = False
    why: Callable[[], str] = lambda: ""
    also: str = ""
    checked: Callable[[], bool] = lambda: False


class Registry:
    """The commands of a window, in the order of its menus.

    A menu greys its entries while it is open. The keys are shortcuts of their own, so that no greyed entry takes one
    with it: its key reports why the command cannot run.
    """

    def __init__(self, window: QMainWindow, notices: Notices) -> None:
        self._window, self._notices = window, notices
        self.actions: dict[Command, QAction] = {}
        self._menus: dict[str, QMenu] = {name: window.menuBar().addMenu(title) for name, title in MENUS.items()}
        for menu in self._menus.values():
            menu.aboutToShow.connect(self.refresh)
            menu.setToolTipsVisible(True)

    def add(self, command: Command) -> None:
        keys = QKeySequence(command.shortcut)
        shown = keys.toString(QKeySequence.SequenceFormat.NativeText)
        action = QAction("\t".join(filter(None, (command.text, shown))), self._window)
        action.setData(action.text())
        action.triggered.connect(lambda *_: self._chosen(command))
        menu = self._menus.get(command.menu)
        if menu is not None:
            if command.apart:
                menu.addSeparator()
            menu.addAction(action)
        if command.shortcut:
            shortcut = QShortcut(keys, self._window, context=Qt.ShortcutContext.ApplicationShortcut)
            shortcut.activated.connect(lambda: self._pressed(command))
        self.actions[command] = action

    def _chosen(self, command: Command) -> None:
        """Run a command of a menu; the menu bar keeps the keyboard where nothing had it before."""
        if self._window.menuBar().hasFocus():
            self._window.menuBar().clearFocus()
        self.run(command)

    def _pressed(self, command: Command) -> None:
        """Close a popup that is open over the window (palette, menu, list) and take what is typed, then run it."""
        popup, focus = QApplication.activePopupWidget(), QApplication.focusWidget()
        if popup is not None:
            popup.close()
        elif isinstance(focus, QLineEdit) and command.shortcut != "Esc":  # which undoes it
            focus.editingFinished.emit()  # as when the focus leaves the field
        self.run(command)

    def run(self, command: Command) -> None:
        """Run a command if it is available, else report why not."""
        if command.available():
            command.run()
        else:
            self._notices.add(Severity.INFORMATION, f"\u201c{command.text}\u201d: not now", command.why())

    def refresh(self) -> None:
        """Grey what cannot run now."""
        for command, action in self.actions.items():
            able = command.available()
            action.setEnabled(able)
            action.setText(f"{action.data()}{CHECK if command.checked() else ''}")
            action.setToolTip("" if able else as_words(command.why()))


class WindowKeys(QObject):
    """Event filter of the program's windows, and where the focus may go.

    F4 vents over everything, Shift+F4 all windows, and no dialog covers the header, which has VENT: a click on it vents
    over an open menu or list too, which Qt would only close. Esc closes a menu, a list or a dialog that has the
    keyboard; elsewhere it is a command. Space freezes the plots where they are shown, whatever has the focus but a text
    field other than that of the reading; elsewhere it goes to the control with the focus. Enter presses a focused
    button. Undo and redo go to a field while it has edits to undo, else to the window's history: the reading field has
    the focus for a whole run.

    Where a control with the focus disappears, Qt gives the focus to the next one, and a window that is opened to its
    first: a key would press it. Here it then goes nowhere.
    """

    def __init__(
        self,
        window: QWidget,
        vent: Callable[[], None],
        vent_all: Callable[[], None],
        header: QWidget,
        button: QWidget,
        shows_plots: Callable[[], bool],
    ) -> None:
        super().__init__(window)
        self.window, self.vent, self.vent_all = window, vent, vent_all
        self.header, self.button, self.shows_plots = header, button, shows_plots
        self._moving = False  # whether the operator moves the focus, by mouse, Tab or an arrow
        self._chosen: QWidget | None = None  # the button that the operator gave the focus last

    def watch(self, window: QWindow | None) -> None:
        if window is not None:
            window.installEventFilter(self)
            self._clear_header(window)

    def watch_all(self) -> None:
        """Install the filter on all that is open: a menu or list never has the focus, a new dialog may get it late."""
        for widget in QApplication.topLevelWidgets():
            if widget is not self.window and widget.isVisible():
                self.watch(widget.windowHandle())

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in PLACED and isinstance(watched, QWindow):
            self._clear_header(watched)
        if isinstance(event, QMouseEvent) and event.type() is QEvent.Type.MouseButtonPress:
            button, at = self.button, event.globalPosition().toPoint()
            if QApplication.activePopupWidget() is not None and button.rect().contains(button.mapFromGlobal(at)):
                self.vent()
        if event.type() in POINTED or (isinstance(event, QKeyEvent) and event.key() in _MOVING):
            self._moving = True
            QTimer.singleShot(0, self._moved)
        if not isinstance(event, QKeyEvent):
            return False
        focus = QApplication.focusWidget()
        if event.type() is QEvent.Type.ShortcutOverride:
            return self._overrides(event, focus)
        if event.type() is not QEvent.Type.KeyPress:
            return False
        if event.key() == Qt.Key.Key_F4:
            (self.vent_all if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else self.vent)()
            return True
        if event.key() in ENTER and isinstance(focus, QAbstractButton) and not _has_enter(focus):
            focus.click()
            return True
        return False

    def _clear_header(self, dialog: QWindow) -> None:
        """Move a dialog that covers the header below it, and make one that is too large for this smaller."""
        main, frame = self.window.windowHandle(), dialog.frameGeometry()
        head = QRect(self.header.mapToGlobal(QPoint(0, 0)), self.header.size())
        movable = dialog.type() in (Qt.WindowType.Dialog, Qt.WindowType.Window) and dialog is not main
        if not (movable and dialog.isVisible() and frame.intersects(head)):
            return
        screen = dialog.screen().availableGeometry()
        lowest = max(self.window.frameGeometry().bottom(), screen.bottom())
        too_wide, too_high = frame.width() - screen.width(), frame.height() - (lowest - head.bottom())
        if too_wide > 0 or too_high > 0:
            width, height = dialog.width() - max(0, too_wide), dialog.height() - max(0, too_high)
            dialog.resize(max(dialog.minimumWidth(), width), max(dialog.minimumHeight(), height))
        rightmost = screen.right() - frame.width() + max(0, too_wide) + 1
        dialog.setFramePosition(QPoint(max(screen.left(), min(frame.x(), rightmost)), head.bottom() + 1))

    def _moved(self) -> None:
        self._moving = False

    def _overrides(self, event: QKeyEvent, focus: QWidget | None) -> bool:
        if event.key() == Qt.Key.Key_F4 or (event.key() == Qt.Key.Key_Escape and not _nothing_open()):
            return _keep(event)
        if event.key() == Qt.Key.Key_Space:
            frozen = self.shows_plots() and QApplication.activeWindow() is self.window and _nothing_open()
            if frozen and focus is not None and focus.property("role") == "reading":  # a number has no space
                event.ignore()
                return True
            return False if frozen else _keep(event)
        return _leave_to_shortcuts(event, focus) if isinstance(focus, QLineEdit) else False

    def follow_focus(self, old: QWidget | None, new: QWidget | None) -> None:
        """Take the focus from a control that got it neither from the operator nor from a command."""
        if new is None or new.window() is not self.window:
            return
        gone = old is not None and old.window() is self.window and not (old.isVisible() and old.isEnabled())
        button = isinstance(new, QAbstractButton)
        if gone or (button and not self._moving and new is not self._chosen):
            new.clearFocus()
        elif button:
            self._chosen = new


def _nothing_open() -> bool:
    """Return whether neither a menu, a list nor a panel is in front."""
    over = QApplication.activePopupWidget() or QApplication.activeModalWidget() or QApplication.activeWindow()
    return not isinstance(over, QMenu | QDialog) and QApplication.activePopupWidget() is None


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
