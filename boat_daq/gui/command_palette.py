"""The command palette and the shortcut sheet, both made from the list of commands; the tutorial."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from PySide6.QtCore import QEvent, QObject, QPoint, QSize, Qt, QUrl
from PySide6.QtGui import QImage, QKeyEvent, QKeySequence, QPainter, QPen, QShowEvent, QTextCursor
from PySide6.QtWidgets import (
    QDialog,
    QGridLayout,
    QHeaderView,
    QScrollArea,
    QTextBrowser,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from boat_daq.gui import style
from boat_daq.gui.registry import PAGES, Command, Registry
from boat_daq.gui.widgets import controls

T = TypeVar("T")
_PICTURE = 720  # width of a picture of the tutorial, px
_ABOVE, _BELOW = 4 * style.STRIP_HEIGHT, 2 * style.STRIP_HEIGHT  # of the tutorial: header, readouts; title bar, strip
SHEET = (("Session", "Edit"), ("Run", "View", "Results"), (PAGES, "Help"))  # the menus in columns
SCATTERED = 3  # score of letters that are only in their order
ARROWS = (Qt.Key.Key_Down, Qt.Key.Key_Up)
NARROW_SHEET = (("Session", "Edit", "View"), ("Run", "Results", PAGES, "Help"))


class Palette(QDialog):
    """A field and the commands that match it; Enter runs the selected one."""

    def __init__(self, parent: QWidget, registry: Registry) -> None:
        super().__init__(parent, Qt.WindowType.Popup)
        self.over, self.registry = parent, registry
        self.setObjectName("palette")
        self.setAccessibleName("Command palette")
        self.setFixedWidth(style.FORM_WIDTH)
        self.field = controls.field("Command", on_enter=self._run, placeholder="Type a command")
        self.list = QTreeWidget(columnCount=2)
        self.list.setAccessibleName("Matching commands")
        self.list.setHeaderHidden(True)
        self.list.setRootIsDecorated(False)
        self.list.header().setStretchLastSection(False)
        self.list.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.list.header().setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        self.list.setFixedHeight(8 * style.STRIP_HEIGHT)
        self.setLayout(controls.column(self.field, self.list))
        self.field.textChanged.connect(self._match)
        self.list.itemActivated.connect(lambda _: self._run())
        self.list.itemClicked.connect(lambda _: self._run())
        self.field.installEventFilter(self)

    def open_fresh(self) -> None:
        """Show an empty palette in the middle of the window."""
        self.field.clear()
        self._match("")
        self.adjustSize()  # else the first one is placed by the size of a new window
        self.move(self.over.mapToGlobal(self.over.rect().center()) - self.rect().center())
        self.show()
        self.field.setFocus()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.type() is QEvent.Type.KeyPress and event.key() in ARROWS:
            self.list.keyPressEvent(event)
            return True
        return super().eventFilter(watched, event)

    def _match(self, text: str) -> None:
        self.list.clear()
        able = {command: command.available() for command in self.registry.actions}
        asked = [command for command in able if able[command] or text.strip()]
        found = ranked(text, asked, lambda c: f"{c.menu} {c.text} {c.also}")
        for command in sorted(found, key=lambda c: (c.text.lower() != text.strip().lower(), not able[c])):
            item = QTreeWidgetItem([command.text, shown(command) if able[command] else "not now"])
            item.setData(0, Qt.ItemDataRole.UserRole, command)
            if not able[command]:  # else what is alike would run in its place
                for column in range(2):
                    item.setForeground(column, self.palette().placeholderText())
            self.list.addTopLevelItem(item)
        first = self.list.topLevelItem(0)
        if first is not None:
            self.list.setCurrentItem(first)

    def _run(self) -> None:
        item = self.list.currentItem()
        self.field.clearFocus()  # else it keeps the keyboard where nothing in the window had it
        self.hide()
        if item is not None:
            command: Command = item.data(0, Qt.ItemDataRole.UserRole)
            self.registry.run(command)


class ShortcutSheet(QDialog):
    """The commands that have keys, by menu; the palette finds the others."""

    def __init__(self, parent: QWidget, registry: Registry) -> None:
        super().__init__(parent)
        self.over = parent
        self.setWindowTitle("Keys")
        self._columns = [controls.column(spacing=4 * style.STEP) for _ in SHEET]
        self._body = QWidget()
        self._rows = controls.row(*self._columns, spacing=8 * style.STEP)
        self._body.setLayout(self._rows)
        self._blocks = {
            menu: controls.holder(self._block(menu, [c for c in registry.actions if c.menu == menu and c.shortcut]))
            for menus in SHEET
            for menu in menus
        }
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setWidget(self._body)
        self.setLayout(controls.column(scroll))

    def showEvent(self, event: QShowEvent) -> None:
        """Take the size of all keys, but not more than the window's."""
        super().showEvent(event)
        self._arrange(SHEET if self.over.width() >= style.NARROW_BELOW else NARROW_SHEET)
        self._rows.activate()  # else its size is that of the columns before
        wanted, most = self._body.sizeHint(), self.over.size()
        margin = style.STRIP_HEIGHT
        self.resize(min(wanted.width() + margin, most.width()), min(wanted.height() + margin, most.height()))
        self.move(self.over.geometry().center() - self.rect().center())  # Qt has placed it by its former size

    def _arrange(self, menus_of: tuple[tuple[str, ...], ...]) -> None:
        for place, column in enumerate(self._columns):
            menus = menus_of[place] if place < len(menus_of) else ()
            while column.takeAt(0) is not None:
                pass
            for menu in menus:
                column.addWidget(self._blocks[menu])
                self._blocks[menu].show()  # a layout ignores hidden widgets
            column.addStretch(1)

    @staticmethod
    def _block(menu: str, lines: list[Command]) -> QGridLayout:
        block = QGridLayout()
        block.setVerticalSpacing(2)
        block.setHorizontalSpacing(4 * style.STEP)
        block.addWidget(controls.label(menu, "subtitle"), 0, 0, 1, 2)
        for i, command in enumerate(lines, 1):
            block.addWidget(controls.label(shown(command), "muted"), i, 0)
            block.addWidget(controls.label(command.text), i, 1)
        block.setColumnMinimumWidth(0, style.text_width(style.font(), "Ctrl+Shift+Z") + 2)  # the same in each block
        block.setColumnStretch(1, 1)
        return block


def shown(command: Command) -> str:
    """Return a command's keys as the system writes them."""
    return QKeySequence(command.shortcut).toString(QKeySequence.SequenceFormat.NativeText)


def ranked(typed: str, items: Iterable[T], text: Callable[[T], str]) -> list[T]:
    """Return the items that match `typed`, best first: words' beginnings, letters inside; else letters in order.

    An empty `typed` returns all, in their order.
    """
    words = typed.lower().split()
    scored = [(value, item) for item in items if (value := score(words, text(item).lower())) is not None]
    whole = any(value < SCATTERED for value, _ in scored)
    kept = [(value, item) for value, item in scored if value < SCATTERED or not whole]
    return [item for _, item in sorted(kept, key=lambda s: s[0])]


def score(words: list[str], text: str) -> int | None:
    """Return how far `text` is from the `words` typed (0 is best); None where it does not match."""
    total = 0
    parts = text.split()
    for word in words:
        if any(part.startswith(word) for part in parts):
            continue
        if word in text:
            total += 1
        elif in_order(word, text):
            total += SCATTERED
        else:
            return None
    return total


def in_order(letters: str, text: str) -> bool:
    """Return whether all `letters` occur in `text` in their order."""
    left = iter(text)
    return all(letter in left for letter in letters)


class Tutorial(QDialog):
    def __init__(self, parent: QWidget, page: Path) -> None:
        super().__init__(parent)
        self.setWindowTitle("Your first calibration")
        self.shown = _Pages(page.parent)
        without_links = re.sub(r"(?<!!)\[([^]]+)\]\([^)]+\)", r"\1", page.read_text(encoding="utf-8"))
        self.shown.setMarkdown(without_links)
        block = self.shown.document().begin()
        while block.isValid():
            space = block.blockFormat()
            space.setTopMargin((2 if space.headingLevel() else 1) * style.GAP)
            QTextCursor(block).setBlockFormat(space)
            block = block.next()
        self.setLayout(controls.column(self.shown))
        size = QSize(_PICTURE + 2 * style.STRIP_HEIGHT, parent.height() - _ABOVE - _BELOW)
        self.resize(size)
        self.move(parent.mapToGlobal(QPoint((parent.width() - size.width()) // 2, _ABOVE)))


class _Pages(QTextBrowser):
    """Text whose pictures are as wide as its lines."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self.setAccessibleName("Tutorial")

    def loadResource(self, kind: int, name: QUrl | str) -> object:
        picture = QImage(str(self._folder / QUrl(name).path()))
        if picture.isNull():
            return super().loadResource(kind, name)
        ratio = self.devicePixelRatioF()
        picture = picture.scaledToWidth(round(ratio * _PICTURE), Qt.TransformationMode.SmoothTransformation)
        painter = QPainter(picture)
        painter.setPen(QPen(self.palette().placeholderText(), 2 * style.STEP))  # half of it is seen
        painter.drawRect(picture.rect())
        painter.end()
        picture.setDevicePixelRatio(ratio)
        return picture
