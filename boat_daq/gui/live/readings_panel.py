"""The reading bar with its field, and the tab of the readings: their source, and the table of all of them."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt, Signal
from PySide6.QtGui import QFont, QFontMetrics, QGuiApplication, QKeyEvent, QKeySequence, QResizeEvent, QShowEvent
from PySide6.QtWidgets import (
    QApplication,
    QBoxLayout,
    QCheckBox,
    QFrame,
    QHeaderView,
    QLineEdit,
    QSizePolicy,
    QTableView,
    QWidget,
)

from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.engine.toml_values import read_text
from boat_daq.formatting import duration
from boat_daq.gui import style
from boat_daq.gui.live.camera_panel import CameraPanel
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.data_table import dress
from boat_daq.gui.widgets.file_dialogs import ask_open
from boat_daq.viewmodels.common.notices import Notice, Notices, Severity
from boat_daq.viewmodels.common.services import Panel, Services
from boat_daq.viewmodels.live.readings import NOW, SOON_S, TABLE_COLUMNS, ReadingsModel, Row, place
from boat_daq.viewmodels.live.run_model import RunModel
from protocol.base.errors import RequestError

BRANCH, EDITABLE, REMARK = 1, 3, 4  # columns
SIGN = "\u25b2 "
BY_HAND, BY_PHOTOGRAPH, BY_CAMERA = "typed", "photograph", "camera"
WAYS = (("Typed", BY_HAND), ("Photograph", BY_PHOTOGRAPH), ("Camera", BY_CAMERA))
WAYS_TIP = "Where readings come from; each can be corrected in the table"
AGAIN = "Enter again"
TYPE = ": type, press Enter"  # after the question, where the unit beside the field stands alone
NEW_LINE = "\n"
Index = QModelIndex | QPersistentModelIndex


class ReadingBar(QFrame):
    """Takes the elongation of the plateau that waits; its field has the focus, Enter continues the run.

    It keeps its place for the whole run, so that the plots do not move at every plateau. What is typed belongs to the
    plateau it was typed for: where the run moves on first, it is kept there and can still be entered.
    """

    def __init__(self, run: RunModel, services: Services) -> None:
        super().__init__()
        self.run, self.notices = run, services.notices
        self.step_id: int | None = None
        self._refusal: Notice | None = None
        self._offers: dict[int, tuple[Notice, Path | None]] = {}  # by plateau: to enter what was typed, and the file
        self._due = ""  # the question of the plateau
        self._doubted: tuple[int | None, str] | None = None  # what Enter takes when it is pressed again
        self.question = controls.label("", "set", name="Reading that is due", elide=True)
        self.question.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # none moves the field
        self.question.setMinimumHeight(QFontMetrics(style.font(style.FONT_SET)).height())  # nor does a small warning
        self.field = controls.field("Elongation in mm", on_enter=self.enter, width=3 * style.CONTROL_HEIGHT)
        self.field.setProperty("role", "reading")
        show = partial(services.show, Panel.PHOTOGRAPH)
        self.photo = controls.button("Photograph …", show, tip="Read it from a picture of the grid")
        self.simulated = controls.button(
            "Simulate", run.read_grid, tip="Take the elongation of the simulated unit (F2)"
        )
        self.all = QCheckBox("Always")
        self.all.setToolTip("Simulate the reading at every plateau")
        self.all.setAccessibleName("Simulate the reading at every plateau")
        self.all.clicked.connect(run.toggle_read_all)
        self.skip = controls.button("Skip", self.run.skip_reading, tip="Continue without a reading")
        self.field.textChanged.connect(self._ask)
        self.unit = controls.label(f"{run.readings.unit}, press Enter", "muted")
        self._narrow = self._short = False
        self._fitted: tuple[object, ...] = ()
        self.left = controls.label("", "muted", name="Time left for the reading, or the value taken")
        self.left.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.left.setToolTip("The run continues without a reading when its time is over")
        self.left.setFixedWidth(
            max(style.text_width(self.left.font(), text) for text in ("skipped in 0:00:00", "+88.88 taken"))
        )
        self.answer = controls.row(
            self.field, self.unit, self.left, None, self.simulated, self.all, self.photo, self.skip
        )
        self.lines = controls.row((self.question, 1), (self.answer, 1))
        controls.as_card(self, self.lines)
        self.setMinimumWidth(1)
        self.hide()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the plateau that waits and take the focus once; else show the next one."""
        waiting = snapshot.waiting_for_reading
        step = waiting.step_id if waiting else None
        shown = waiting is not None or self.run.sequence.needs_readings(snapshot)
        self.setVisible(shown)
        if step != self.step_id:
            self._leave()
        for at, (offer, file) in list(self._offers.items()):
            if at not in self.run.readings.typed or file != snapshot.recording:
                self.notices.dismiss(offer)
                del self._offers[at]
        if not shown:
            self.step_id = None
            return
        self._due = self.run.readings.question(snapshot)
        self._pause(snapshot.state is SessionState.PAUSED)
        self._ask()
        left_s = waiting.time_left_s if waiting is not None else math.inf
        taken = self.run.readings.taken() if waiting is None else ""
        controls.set_text(self.left, f"skipped in {duration(left_s)}" if math.isfinite(left_s) else taken)
        self._show_unit()
        controls.set_state(self.left, "warning" if left_s <= SOON_S else "")
        simulated = self.run.connection.board is not None
        for control, visible in ((self.simulated, simulated), (self.all, simulated), (self.photo, not simulated)):
            control.setVisible(visible)
        self._fit()
        self.all.setChecked(self.run.read_all)
        if step == self.step_id and self.field.isReadOnly() is (step is None):
            return
        self.step_id = step
        self.field.setText("")  # not clear(): undo would put the last plateau's reading into this field
        self._enable(step is not None)
        elsewhere = isinstance(QGuiApplication.focusObject(), QWidget) and not self.window().isActiveWindow()
        focus = QApplication.focusWidget()
        typing = isinstance(focus, QLineEdit) and focus is not self.field and focus.isModified()  # a marker's note
        if step is not None and not elsewhere and not typing:
            self.field.setFocus()

    def _ask(self, _: str = "") -> None:
        """Show the reading that is due, or why what is typed is implausible; a second Enter takes it nevertheless."""
        step, text = self.step_id, self.field.text()
        warning = self.run.readings.warning(step, text) if step is not None and text else ""
        if self._doubted is not None and self._doubted != (step, text):
            self._doubted = None
        without_cycle = self._due.rpartition(", ")[0]  # which the line of the run names, too
        if warning:
            keep, again = ("Keep ", f", {AGAIN}" if self._short else "") if self._doubted is not None else ("", "")
            place, why = without_cycle + (": " if self._narrow else NEW_LINE), warning + again
            whole = f"\u25b2 {place}{keep}{text.strip()}? {why}"
            controls.set_text(self.question, whole, shorter=f"\u25b2 {place}{why}")
        else:
            how = TYPE if self._short and step is not None else ""
            controls.set_text(self.question, f"{self._due}{how}", shorter=without_cycle)
        controls.set_state(self.question, "small" if warning else "set", "role")
        self._show_unit()
        controls.set_state(self.question, "warning" if warning else "")
        if self.field.accessibleDescription() != warning:
            self.field.setAccessibleDescription(warning)

    def _leave(self) -> None:
        """Keep what was typed for the plateau before with that plateau, report it and offer to enter it."""
        self.notices.dismiss(self._refusal)
        step, text, readings = self.step_id, self.field.text(), self.run.readings
        at = readings.leave(step, text) if step is not None else ""
        if at and step is not None:
            cause = f'"{text}" was typed at {at}, but not entered before the run continued'
            offer = ("Enter it there", partial(readings.enter, step, text))
            why = readings.warning(step, text)
            remedy = " ".join(filter(None, (why and f"{why}.", "It is kept in the table of readings.")))
            notice = self.notices.add(Severity.WARNING, cause, remedy, action=offer)
            self._offers[step] = notice, self.run.snapshot.recording

    def _pause(self, paused: bool) -> None:
        """Take no entry while the run is paused; the focus goes to no button instead."""
        if paused and self.field.isEnabled():
            self.field.clearFocus()
        self.field.setEnabled(not paused)

    def _enable(self, due: bool) -> None:
        """Allow an entry, or none; the focus stays in the field instead of moving to the next button."""
        controls.set_state(self, "true" if due else "false", "attention")
        if not due and self.isAncestorOf(QApplication.focusWidget() or self):
            self.field.setFocus()
        self.field.setReadOnly(not due)
        for button in (self.simulated, self.photo, self.skip):
            button.setEnabled(due)

    def fold(self, narrow: bool, low: bool) -> None:
        """Stack question and answer in a narrow window, and put all closer; in a low one the edges, too."""
        self._narrow = narrow
        self.answer.setSpacing(style.STEP if narrow else style.GAP)
        self.lines.setSpacing(style.STEP if narrow else style.GAP)
        upright = style.STEP if low else style.GAP
        self.lines.setContentsMargins(style.CARD_PADDING, upright, style.CARD_PADDING, upright)
        way = QBoxLayout.Direction.TopToBottom if narrow else QBoxLayout.Direction.LeftToRight
        self.lines.setDirection(way)
        self.question.setMinimumWidth(0 if narrow else style.QUESTION_LEAST - 10 * style.STEP)
        self.question.setMaximumWidth(style.UNLIMITED if narrow else 2 * style.QUESTION_LEAST)
        self._fit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Use short words where the long ones do not fit: the bar never pushes the pane aside."""
        super().resizeEvent(event)
        self._fit()

    def showEvent(self, event: QShowEvent) -> None:
        """Choose the words again: hidden, the controls have not had the sizes of the style sheet."""
        super().showEvent(event)
        self._fitted = ()

    def _fit(self) -> None:
        """Use the long words where they fit; tried once for each width and set of controls."""
        asked = (self.width(), self._narrow, self.simulated.isHidden(), self.run.readings.unit)
        if asked == self._fitted:
            return
        self._fitted = asked
        for short in (self._narrow, True):
            self._short = short
            self._ask()
            self.answer.invalidate()  # Qt tells only the outer layout
            self.lines.invalidate()
            if self.lines.minimumSize().width() <= self.width():
                return

    def _show_unit(self) -> None:
        unit = self.run.readings.unit
        press = "press Enter" if self._doubted is None else AGAIN
        alone = self._short or not self.field.isEnabled()
        controls.set_text(self.unit, unit if alone else f"{unit}, {press}")
        self.field.setAccessibleName(f"Elongation in {unit}")

    def enter(self) -> None:
        """Enter what was typed; ask first where it is far from what pressure and model allow."""
        text, step = self.field.text(), self.step_id
        if step is None or not text.strip():
            return
        if self._doubted != (step, text) and self.run.readings.warning(step, text):
            self._doubted = step, text
            self._ask()
            self.field.selectAll()  # what is typed next replaces it
            return
        self.notices.dismiss(self._refusal)
        kept = self.notices.attempt(lambda: self.run.readings.enter(step, text))
        self._refusal = None if kept else self.notices.history[-1]
        if kept:
            self.field.setText("")
        else:
            self.field.selectAll()
        controls.set_state(self.field, "" if kept else "true", "wrong")


def side(column: int) -> Qt.AlignmentFlag:
    """Return the alignment of a column: numbers right, text left."""
    across = Qt.AlignmentFlag.AlignRight if column in (0, 2, 3) else Qt.AlignmentFlag.AlignLeft
    return across | Qt.AlignmentFlag.AlignVCenter


class ReadingsTableModel(QAbstractTableModel):
    """Qt's view of the rows of `ReadingsModel`."""

    corrected = Signal()  # a reading was edited

    def __init__(self, readings: ReadingsModel, notices: Notices) -> None:
        super().__init__()
        self.readings, self.notices = readings, notices
        self.rows: list[Row] = []
        self._doubted: tuple[int, str] | None = None  # taken when it is entered again
        self.narrow = False  # a sign tells which rows have a remark, which their tooltips show

    def show_rows(self, rows: list[Row]) -> None:
        """Show other rows; present ones are updated in place, so that an edit is not lost."""
        if rows == self.rows:
            return
        if len(rows) < len(self.rows):
            self.beginResetModel()
            self.rows = rows
            self.endResetModel()
        if len(rows) > len(self.rows):
            self.beginInsertRows(QModelIndex(), len(self.rows), len(rows) - 1)
            self.rows = rows
            self.endInsertRows()
        self.rows = rows
        if rows:
            self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, TABLE_COLUMNS - 1))
            self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, TABLE_COLUMNS - 1)

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: B008
        return 0 if parent.isValid() else TABLE_COLUMNS

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation is Qt.Orientation.Vertical:
            return None
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return side(section)
        return self.readings.headings[section] if role == Qt.ItemDataRole.DisplayRole else None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.EditRole and index.column() == EDITABLE and row.typed:
            return row.typed
        if role in (Qt.ItemDataRole.DisplayRole, Qt.ItemDataRole.EditRole):
            sign = SIGN if self.narrow and index.column() == 0 and row.cells[REMARK] not in ("", NOW) else ""
            return f"{sign}{row.cells[index.column()]}"
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return side(index.column())
        marked = row.current or row.apart_mm is not None or row.far
        if role == Qt.ItemDataRole.FontRole and marked and side(index.column()) & Qt.AlignmentFlag.AlignRight:
            return style.font(weight=QFont.Weight.Bold)  # of the numbers: a remark is not cut
        if role == Qt.ItemDataRole.ToolTipRole:
            return row.tip or None
        return None

    def setData(self, index: Index, value: Any, role: int = Qt.ItemDataRole.EditRole) -> bool:
        """Enter a reading; ask first, as the bar does, where it is far from what pressure and model allow."""
        row, text = self.rows[index.row()], str(value).strip()
        step, changed = row.step, row.typed or text != row.cells[EDITABLE]
        warning = self.readings.warning(step.number, text) if changed else ""
        asked, self._doubted = self._doubted, (step.number, text)
        kept = False
        if warning and asked != self._doubted:
            self.readings.typed[step.number] = text
            cause = f"{text}? {warning}, at {place(step, self.readings.units)}"
            self.notices.add(Severity.WARNING, cause, f"Enter {text} again to take it.")
        else:
            kept = self.notices.attempt(lambda: self.readings.enter(step.number, text))
        self.corrected.emit()
        return kept

    def flags(self, index: Index) -> Qt.ItemFlag:
        """Only the reading can be edited."""
        base = Qt.ItemFlag.ItemIsSelectable | Qt.ItemFlag.ItemIsEnabled
        return base | Qt.ItemFlag.ItemIsEditable if index.column() == EDITABLE else base


class ReadingsView(QTableView):
    """The table; Ctrl+V pastes a column from the selected plateau on, Delete withdraws."""

    def __init__(self, rows: ReadingsTableModel) -> None:
        super().__init__()
        self.rows, self.readings, self.notices = rows, rows.readings, rows.notices
        self.setModel(rows)
        dress(self, "Readings of elongation")
        self.setAlternatingRowColors(True)
        self.horizontalHeader().setSectionResizeMode(REMARK, QHeaderView.ResizeMode.Stretch)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave the remarks to the tooltips in a narrow pane: pressures and readings are never cut."""
        narrow = self.width() < style.PANE_WIDTH_NARROW + 4 * style.STEP
        self.rows.narrow = narrow
        self.setColumnHidden(REMARK, narrow)
        mode = QHeaderView.ResizeMode
        self.horizontalHeader().setSectionResizeMode(BRANCH, mode.Stretch if narrow else mode.ResizeToContents)
        for table in (self, self.horizontalHeader()):
            controls.set_state(table, "dense" if self.width() < style.PANE_WIDTH_WIDE else "", "role")
        super().resizeEvent(event)
        self.show_asked()

    def show_asked(self) -> None:
        """Scroll to the plateau that waits for its reading, else to the last one."""
        rows = self.rows.rows
        if rows:
            asked = next((i for i, row in enumerate(rows) if row.current), len(rows) - 1)
            self.scrollTo(self.rows.index(asked, 0))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.matches(QKeySequence.StandardKey.Paste):
            self.paste(QGuiApplication.clipboard().text())
        elif event.key() == Qt.Key.Key_Delete:
            self._withdraw()
        else:
            super().keyPressEvent(event)

    def paste(self, text: str) -> None:
        """Enter a column from the selected plateau on, or from the first without a reading."""
        steps = [row.step.number for row in self.rows.rows]

        def enter() -> None:
            if not steps:
                raise RequestError("there is no plateau yet", "Start the plan, or select a run.")
            selected = [index.row() for index in self.selectionModel().selectedRows()]  # the current row need not be
            self.readings.paste(text, steps[min(selected)] if selected else None)

        self.notices.attempt(enter)

    def _withdraw(self) -> None:
        row = self.currentIndex().row()
        if row >= 0:
            self.notices.attempt(lambda: self.readings.put(self.rows.rows[row].step.number, None, "typed"))


class ReadingsTable(QWidget):
    def __init__(self, readings: ReadingsModel, services: Services) -> None:
        super().__init__()
        self.readings, self.services = readings, services
        self.model = ReadingsTableModel(readings, services.notices)
        self.view = ReadingsView(self.model)
        empty = "Each plateau is listed here. Arm, then start."
        self.empty = controls.label(empty, "muted", wrap=True)
        self.empty.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.count = controls.label("", "small")
        paste = controls.button("Paste", self.paste, tip="A column from a spreadsheet, from the selected row on")
        buttons = controls.row(paste, controls.button("Import …", self.import_), None)
        parts = (self.empty, self.view, self.count, buttons)
        self.setLayout(controls.column(*parts, spacing=style.GAP, margins=(0, 0, 0, 0)))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        before = len(self.model.rows)
        rows = self.readings.rows(snapshot)
        self.model.show_rows(rows)
        self.empty.setVisible(not rows)
        self.view.setVisible(bool(rows))
        controls.set_text(self.count, self.readings.summary(snapshot, rows))
        if len(rows) > before:
            self.view.show_asked()

    def paste(self) -> None:
        """Paste the clipboard's column from the selected plateau on."""
        self.view.paste(QGuiApplication.clipboard().text())

    def import_(self) -> None:
        paste = self.view.paste
        ask_open(self, self.services, "Import readings", "csv txt tsv", lambda path: paste(read_text(path)))


class ReadingsTab(QWidget):
    """The readings with their source: typed, from a photograph, or by a camera."""

    def __init__(self, run: RunModel, table: ReadingsTable, camera: CameraPanel, services: Services) -> None:
        super().__init__()
        self.run, self.table, self.camera, self.services = run, table, camera, services
        self.choice = controls.choice("Source of the readings", WAYS, self.choose, tip=WAYS_TIP)
        show = partial(services.show, Panel.PHOTOGRAPH)
        self.photograph = controls.button("Open a photograph \u2026", show, tip="Clicks on the grid give the reading")
        head = controls.row(controls.label("Source", "muted"), self.choice, None)
        parts = (head, self.photograph, (camera, 3), (table, 2))
        self.parts = controls.column(*parts, spacing=style.GAP, margins=(0, style.GAP, 0, 0))
        self.setLayout(self.parts)
        self.choose(services.preferences.get("reading_source", BY_HAND))

    def choose(self, source: str) -> None:
        known = max(self.choice.findData(source), 0)
        self.choice.setCurrentIndex(known)
        self.photograph.setVisible(WAYS[known][1] == BY_PHOTOGRAPH)
        self.camera.setVisible(WAYS[known][1] == BY_CAMERA)
        self.services.preferences.set("reading_source", WAYS[known][1])

    def refresh(self, snapshot: SessionSnapshot) -> None:
        self.table.refresh(snapshot)
        sequence = self.run.sequence
        at_rest = "Arm, then start." if "arm" in sequence.allowed(snapshot) else sequence.why_not_set(snapshot)
        following = "Press Start." if snapshot.state is SessionState.ARMED else at_rest
        controls.set_text(self.table.empty, f"Each plateau is listed here. {following}")
        if self.camera.isVisible():
            self.camera.refresh(snapshot)
            self.parts.setStretch(self.parts.indexOf(self.camera), 0 if self.camera.picture.isHidden() else 3)
