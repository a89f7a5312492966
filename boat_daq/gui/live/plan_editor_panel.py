"""The panel that edits a plan of segments over a preview with its limits. Not modal."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QCheckBox, QDialog, QGridLayout, QScrollArea, QWidget

from boat_daq.engine.plan import QUANTITIES
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import typographic
from boat_daq.gui import style
from boat_daq.gui.plotting.plot_card import PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_save
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.live.plan_editor import COLUMNS, LABELS, PlanEditor
from boat_daq.viewmodels.live.sequence import SequenceModel
from protocol.recording import SEGMENT_KINDS

CELL_WIDTH = 64
NOT_SEGMENTS = "Made in the Plan tab. Convert to segments to edit here."
LOCKED = "A run uses this plan."


class PlanEditorPanel(QDialog):
    """Steps, ramps, sines, loops and readings of the plan; each edit is one step of the undo history."""

    def __init__(self, parent: QWidget, sequence: SequenceModel, services: Services) -> None:
        super().__init__(parent)
        self.model, self.sequence, self.services = PlanEditor(sequence), sequence, services
        self._shown: object = None
        self.setWindowTitle("Plan of segments")
        self.resize(style.FORM_WIDTH + style.PANE_WIDTH_WIDE, style.list_height(self))
        self.fields = {key: self._plan_field(key) for key in LABELS}
        self.quantity = controls.choice("Quantity", [(q, q) for q in QUANTITIES], self._do(self.model.set_quantity))
        self.grid, self.loops = QGridLayout(), QGridLayout()
        self.grid.setColumnStretch(len(COLUMNS) + 6, 1)
        self.loops.setColumnStretch(4, 1)
        self.cells: list[dict[str, Any]] = []
        self.loop_entries = [controls.field(name, width=CELL_WIDTH) for name in ("From segment", "To segment", "Times")]
        self.summary = controls.label("", "muted", wrap=True)
        self.refused = controls.label("", wrap=True, name="Why the entry is invalid")
        controls.set_state(self.refused, "warning")
        self.refused.hide()
        self.card = PlotCard("Preview of the plan", show_title=False)
        self.plot = self.card.add("Pressure", "kPa", x_title="Time", x_unit="s", time=True)
        self.curve = self.plot.curve("Plan", lambda t: t.pressure)
        self.limits = self.plot.curve("Limits", lambda t: t.warn, gaps=True, pen_style=Qt.PenStyle.DotLine)
        self.readings = self.plot.points("Readings", lambda t: t.text, filled=False)
        self.setLayout(self._layout())
        for keys, act in (("Ctrl+Z", self._undo), ("Ctrl+Shift+Z", self._redo)):
            QShortcut(QKeySequence(keys), self).activated.connect(act)

    def _layout(self) -> Any:
        pairs = [part for key, text in LABELS.items() for part in (controls.label(text), self.fields[key])]
        head = controls.row(pairs[0], (pairs[1], 1), *pairs[2:], self.quantity)  # names are long
        adds = [controls.button(f"Add {kind}", self._do(partial(self.model.add, kind))) for kind in SEGMENT_KINDS]
        times = (self.loop_entries[2], controls.label("times"), controls.button("Add loop", self._add_loop))
        span = (controls.label("Repeat segments"), self.loop_entries[0], controls.label("to"), self.loop_entries[1])
        self.tools = controls.inside(controls.row(*adds, None, *span, *times))
        self.new = controls.button("New plan", self._do(self.model.new))
        self.convert = controls.button("Convert to segments", self._do(self.model.from_chosen))
        self.undo = controls.button("Undo", self._undo, tip="Ctrl+Z")
        self.redo = controls.button("Redo", self._redo, tip="Ctrl+Shift+Z")
        save = controls.button("Save …", self._save)
        ends = controls.row(
            self.new, self.convert, self.undo, self.redo, None, save, controls.button("Close", self.close)
        )
        inside = controls.column(self.grid, self.loops, None, spacing=style.GAP)
        self.segments = controls.inside(inside)
        self.area = QScrollArea()
        self.area.setWidgetResizable(True)
        self.area.setWidget(self.segments)
        parts = (head, (self.area, 3), self.tools, self.refused, self.summary, (self.card, 2), ends)
        return controls.column(*parts, spacing=style.GAP, margins=(style.PAGE_MARGIN,) * 4)

    def _plan_field(self, key: str) -> Any:
        field = controls.field(LABELS[key], width=0 if key == "name" else CELL_WIDTH)
        field.editingFinished.connect(lambda: self._attempt(partial(self.model.set_plan, key, field.text())))
        return field

    def paint_theme(self, theme: Theme) -> None:
        self.card.paint_theme(theme)

    def open_fresh(self, snapshot: SessionSnapshot) -> None:
        self._shown = None
        self.show()
        self.refresh(snapshot)
        self.raise_()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the plan where it has changed; lock it during a run."""
        if not self.isVisible():
            return
        model, limits = self.model, snapshot.limits
        locked = model.locked(snapshot)
        for field in (*self.fields.values(), self.quantity, self.segments, self.tools, self.new, self.convert):
            field.setEnabled(not locked and (model.editable or field in (self.new, self.convert)))
        history = self.services.undo
        controls.allow(self.undo, "" if history.done else "Nothing to undo.")
        controls.allow(self.redo, "" if history.undone else "Nothing to redo.")
        shown = (model.revision, limits, locked)
        if shown == self._shown:
            return
        self._shown = shown
        self.convert.setVisible(not model.editable)
        for part in (self.area, self.tools):
            part.setVisible(model.editable)
        controls.set_text(self.summary, LOCKED if locked else model.summary if model.editable else NOT_SEGMENTS)
        for key, field in self.fields.items():
            value = getattr(model.plan, key)
            controls.set_text(field, value if key == "name" else typographic(f"{value:g}"))
        self.quantity.setCurrentIndex(self.quantity.findData(model.plan.quantity))
        self._fill()
        self._draw((limits.min_kpa, limits.max_kpa) if limits else None)

    def _fill(self) -> None:
        focus = self._focused()
        for grid in (self.grid, self.loops):
            controls.clear(grid)
        self.cells = []
        if not self.model.editable:
            return
        for k, text in enumerate(("", "Segment", *self.model.headings(), "Reading")):
            self.grid.addWidget(controls.label(text, "small"), 0, k)
        for i, segment in enumerate(self.model.plan.segments):
            self._add_row(i, segment)
        for i, loop in enumerate(self.model.plan.loops):
            text = f"Segments {loop.first} to {loop.last} are run {loop.times} times"
            remove = controls.button(
                "\u2715", self._do(partial(self.model.remove_loop, i)), name=f"Remove loop {i + 1}"
            )
            self.loops.addWidget(controls.label(text), i, 0)
            self.loops.addWidget(remove, i, 1)
        if focus is not None and focus[0] < len(self.cells):
            self.cells[focus[0]][focus[1]].setFocus()

    def _focused(self) -> tuple[int, str] | None:
        cells = ((i, key) for i, row in enumerate(self.cells) for key in row)
        return next(((i, key) for i, key in cells if self.cells[i][key].hasFocus()), None)

    def _add_row(self, i: int, segment: Any) -> None:
        model, n = self.model, i + 1
        kind = controls.choice(
            f"Kind of segment {n}", [(k, k) for k in SEGMENT_KINDS], self._do(partial(model.set_kind, i))
        )
        kind.setCurrentIndex(kind.findData(segment.kind))
        row: dict[str, Any] = {"kind": kind}
        for key, (heading, of) in COLUMNS.items():
            used = segment.kind in of
            value = typographic(f"{getattr(segment, key):g}") if used else ""
            row[key] = controls.field(f"{heading.partition(' ')[0]} of segment {n}", value, width=CELL_WIDTH)
            row[key].setEnabled(used)
            row[key].editingFinished.connect(partial(self._set, i, key, row[key]))
        row["reading"] = QCheckBox()
        row["reading"].setAccessibleName(f"Reading at the end of segment {n}")
        row["reading"].setChecked(segment.reading)
        row["reading"].clicked.connect(lambda on: self._attempt(partial(model.set_reading, i, on)))
        last = i == len(model.plan.segments) - 1
        for key, sign, act, why in (
            ("up", "\u2191", partial(model.move, i, -1), "" if i else "It is the first one."),
            ("down", "\u2193", partial(model.move, i, 1), "It is the last one." if last else ""),
            ("remove", "\u2715", partial(model.remove, i), ""),
        ):
            row[key] = controls.button(sign, self._do(act), "quiet", name=f"{key.capitalize()}: segment {n}")
            controls.allow(row[key], why)
        self.grid.addWidget(controls.label(str(n), "muted"), n, 0)
        for k, cell in enumerate(row.values(), 1):
            self.grid.addWidget(cell, n, k)
        self.cells.append(row)

    def _draw(self, limits_kpa: tuple[float, float] | None) -> None:
        if not self.model.editable:
            self.card.show_empty("The preview is drawn here once the plan has segments.")
            return
        found = self.model.curve(limits_kpa)
        self.card.show_empty("")
        self.plot.set_title(
            "Elongation" if self.model.plan.controls_elongation else "Pressure", self.model.plan.quantity
        )
        self.curve.set(found.time_s, found.value)
        ends = [0.0, float(found.time_s[-1]), float(found.time_s[-1])]
        self.limits.set(
            np.array(ends * len(found.limits)), np.array([v for y in found.limits for v in (y, y, np.nan)], dtype=float)
        )
        self.readings.set(found.readings_s, found.readings)
        self.plot.fit(x_margin=0.02, smallest=1.0)

    def _set(self, at: int, key: str, field: Any) -> None:
        if field.isEnabled() and at < len(self.model.plan.segments):
            self._attempt(partial(self.model.set_value, at, key, field.text()))

    def _do(self, act: Callable[..., object]) -> Callable[..., None]:
        """Return a function that attempts an edit and shows the plan."""

        def attempt(*values: Any) -> None:
            self._attempt(partial(act, *values))

        return attempt

    def _attempt(self, action: Callable[[], object]) -> None:
        done = self.services.notices.attempt(action)
        if not done:
            self._shown = None  # the entry is taken back
        controls.set_text(self.refused, "" if done else f"\u25b2 {self.services.notices.history[-1].sentences}")
        self.refused.setVisible(not done)
        self.refresh(self.sequence.session.snapshot())

    def _add_loop(self) -> None:
        self._attempt(partial(self.model.add_loop, *(entry.text() for entry in self.loop_entries)))

    def _undo(self) -> None:
        if self.services.undo.done:
            self._attempt(self.services.undo.undo)

    def _redo(self) -> None:
        if self.services.undo.undone:
            self._attempt(self.services.undo.redo)

    def _save(self) -> None:
        ask_save(self, self.services, self.model.plan.name, "toml", self.sequence.save)
