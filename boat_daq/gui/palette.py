"""The command palette (type what you want) and the shortcut sheet (?): both read the one list of commands."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent, QKeySequence, QShowEvent
from PySide6.QtWidgets import (
    QDialog,
    QGridLayout,
    QHBoxLayout,
    QHeaderView,
    QScrollArea,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from boat_daq.gui import style
from boat_daq.gui.registry import Command, Registry
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common.matching import ranked

SHEET = (("Session", "Edit", "Go", "Help"), ("View", "Models"), ("Sequence", "Runs"))  # the menus in columns
NARROW_SHEET = (("Session", "Edit", "Sequence", "Go", "Help"), ("View", "Runs", "Models"))

ALSO = {  # what people type for a command that says it in other words
    "Vent now": "emergency release deflate",
    "Close the window": "quit exit leave",
    "Mark this moment \u2026": "marker note comment",
    "Connect \u2026": "port serial board",
    "Start the virtual board": "demo simulate simulation",
    "Start": "begin run",
    "Stop": "abort end",
    "Set the pressure by hand": "manual",
    "Cursor A": "statistics measure",
    "Cursor B": "statistics measure",
    "Copy the plot": "screenshot picture clipboard",
    "Save the plot as PNG \u2026": "screenshot picture image export",
    "Save the plot's data as CSV \u2026": "export",
    "Dark": "night theme",
    "Light": "day theme",
    "Compute uncertainty bands (emcee)": "mcmc posterior sample",
    "Report of the run shown \u2026": "pdf html print",
    "Report of the chosen runs \u2026": "pdf html print",
    "Calibrate": "fit curve hysteresis",
    "Repeat": "repeatability drift hysteresis",
    "Runs": "recordings units export replay compare recover report",
    "Keys": "shortcuts help",
}


class Palette(QDialog):
    """A field and the commands that match it; Enter does the first."""

    def __init__(self, parent: QWidget, registry: Registry) -> None:
        super().__init__(parent, Qt.WindowType.Popup)
        self.over, self.registry = parent, registry
        self.setAccessibleName("Command palette")
        self.setFixedWidth(style.FORM_WIDTH)
        self.field = widgets.field("Command", placeholder="What do you want to do?")
        self.list = QTreeWidget()
        self.list.setAccessibleName("Matching commands")
        self.list.setColumnCount(2)
        self.list.setHeaderHidden(True)
        self.list.setRootIsDecorated(False)
        self.list.header().setStretchLastSection(False)
        self.list.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.list.header().setSectionResizeMode(1, QHeaderView.ResizeMode.ResizeToContents)
        self.list.setFixedHeight(8 * style.STRIP_HEIGHT)
        layout = QVBoxLayout(self)
        layout.addWidget(self.field)
        layout.addWidget(self.list)
        self.field.textChanged.connect(self._match)
        self.field.returnPressed.connect(self._run)
        self.list.itemActivated.connect(lambda _: self._run())
        self.list.itemClicked.connect(lambda _: self._run())
        self.field.installEventFilter(self)

    def open_fresh(self) -> None:
        """Show an empty palette under the header."""
        self.field.clear()
        self._match("")
        self.move(self.over.mapToGlobal(self.over.rect().center()) - self.rect().center())
        self.show()
        self.field.setFocus()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Let the arrow keys of the field move in the list."""
        if (
            isinstance(event, QKeyEvent)
            and event.type() is QEvent.Type.KeyPress
            and event.key() in (Qt.Key.Key_Down, Qt.Key.Key_Up)
        ):
            self.list.keyPressEvent(event)
            return True
        return super().eventFilter(watched, event)

    def _match(self, text: str) -> None:
        self.list.clear()
        able = [c for c in self.registry.commands if c.available()]
        found = ranked(text, able, lambda c: f"{c.menu} {c.text} {ALSO.get(c.text, '')}")
        for command in sorted(found, key=lambda c: c.text.lower() != text.strip().lower()):  # its own name goes first
            item = QTreeWidgetItem([command.text, shown(command)])
            item.setData(0, Qt.ItemDataRole.UserRole, command)
            self.list.addTopLevelItem(item)
        first = self.list.topLevelItem(0)
        if first is not None:
            self.list.setCurrentItem(first)

    def _run(self) -> None:
        item = self.list.currentItem()
        self.hide()
        if item is not None:
            command: Command = item.data(0, Qt.ItemDataRole.UserRole)
            self.registry.run(command)


class ShortcutSheet(QDialog):
    """Every command with its keys, by menu."""

    def __init__(self, parent: QWidget, registry: Registry) -> None:
        super().__init__(parent)
        self.over = parent
        self.setWindowTitle("Keys")
        self.setModal(False)
        body = QWidget()
        line = QHBoxLayout(body)
        line.setSpacing(8 * style.STEP)
        self._columns = [widgets.column(spacing=4 * style.STEP) for _ in SHEET]
        for column in self._columns:
            line.addLayout(column)
        self._blocks = {
            menu: widgets.holder(self._block(menu, [c for c in registry.commands if c.menu == menu]))
            for menus in SHEET
            for menu in menus
        }
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setWidget(body)
        layout = QVBoxLayout(self)
        layout.addWidget(scroll)
        self._body = body

    def showEvent(self, event: QShowEvent) -> None:
        """Be as large as all the keys are, where the window has the room."""
        super().showEvent(event)
        self._arrange(SHEET if self.over.width() >= style.NARROW_BELOW else NARROW_SHEET)
        wanted, room = self._body.sizeHint(), self.over.size()
        margin = 2 * style.STRIP_HEIGHT
        self.resize(min(wanted.width() + margin, room.width()), min(wanted.height() + margin, room.height()))
        self.move(self.over.geometry().center() - self.rect().center())  # Qt has placed it by its size before

    def _arrange(self, menus_of: tuple[tuple[str, ...], ...]) -> None:
        """Stand the menus in so many columns."""
        for place, column in enumerate(self._columns):
            menus = menus_of[place] if place < len(menus_of) else ()
            while column.takeAt(0) is not None:
                pass
            for menu in menus:
                column.addWidget(self._blocks[menu])
                self._blocks[menu].show()  # a layout asks nothing for what is only about to be shown
            column.addStretch(1)

    @staticmethod
    def _block(menu: str, lines: list[Command]) -> QGridLayout:
        block = QGridLayout()
        block.setVerticalSpacing(2)
        block.setHorizontalSpacing(4 * style.STEP)
        block.addWidget(widgets.label(menu, "subtitle"), 0, 0, 1, 2)
        for i, command in enumerate(lines, 1):
            block.addWidget(widgets.label(shown(command), "muted"), i, 0)
            block.addWidget(widgets.label(command.text), i, 1)
        block.setColumnStretch(1, 1)
        return block


def shown(command: Command) -> str:
    """Return a command's keys as the system writes them."""
    return QKeySequence(command.shortcut).toString(QKeySequence.SequenceFormat.NativeText)
