"""The run's line under the plots with its staircase and buttons, and the plan and the manual pressure in a form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QPoint, QPointF, QRectF, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor, QGuiApplication, QPainter, QPaintEvent, QPen, QPolygonF, QResizeEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QCheckBox,
    QComboBox,
    QFrame,
    QGridLayout,
    QLabel,
    QLayout,
    QLineEdit,
    QMenu,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QWidget,
)

from boat_daq.engine.snapshot import SessionSnapshot, SessionState
from boat_daq.gui import style
from boat_daq.gui.plotting.plot_card import add_exports, save_export
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.common.services import Panel, Services
from boat_daq.viewmodels.live.end_at import EndAt
from boat_daq.viewmodels.live.run_model import RunModel
from boat_daq.viewmodels.live.sequence import (
    HELD,
    PLAN_ENTRIES,
    Entry,
    SequenceModel,
    StaircaseDrawing,
    elongation_text,
    holding_text,
    limits_text,
    progress_text,
    state_text,
)
from protocol.base.units import STORED_UNITS

BUTTONS = {  # key -> text, explanation
    "arm": ("Arm", "Check the plan against every limit; nothing moves yet"),
    "disarm": ("Disarm", "Unload the plan; nothing has moved"),
    "start": ("Start", "Start recording and run the plan"),
    "pause": ("Pause", "Vent and wait; the current cycle is left out"),
    "resume": ("Resume", "Resume with the next whole cycle"),
    "stop": ("Stop", "Vent and end the run"),
    "clear": ("Clear fault", "Clear the fault once its cause is removed"),
}
PRIMARY = ("arm", "start", "resume", "clear")
FIELD_WIDTH = 60
_OF_CYCLES = ("high_kpa", "low_kpa", "step_kpa", "ramp_kpa_per_s", "max_dwell_s", "settling_s")  # not of segments
END_AT = {  # label and explanation of the uncertainty at which a run ends, by its unit
    "mm": ("Stop at U \u2264", "Ends the run after the first cycle with this U (k = 2) of an elongation, mm"),
    "% FSO": (
        "Stop at \u00b1 \u2264",
        "Ends the run once drift (per 100 cycles) and repeatability have this 95 % uncertainty, % FSO",
    ),
    "": ("Stop at U \u2264", "A plan of segments runs all its cycles"),
}
START_OVER = ("Start over", "Arm the whole plan from its first cycle, in a new recording")


class StaircasePicture(QWidget):
    """The staircase of the plan with limits, its done part filled; drawn from points of the unit square."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.setAccessibleName(name)
        self.drawing: StaircaseDrawing | None = None
        self.theme: Theme = style.LIGHT
        self.setMinimumHeight(2 * style.CONTROL_HEIGHT)

    def show_drawing(self, drawing: StaircaseDrawing) -> None:
        if drawing != self.drawing:
            self.drawing = drawing
            self.update()

    def paint_theme(self, theme: Theme) -> None:
        self.theme = theme
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw limits, zero, the done part and the staircase."""
        if self.drawing is None:
            return
        painter = QPainter(self)
        box = QRectF(self.rect()).adjusted(1, style.STEP, -1, -style.STEP)

        def at(point: tuple[float, float]) -> QPointF:
            return QPointF(box.left() + point[0] * box.width(), box.bottom() - point[1] * box.height())

        for height in self.drawing.limits:
            painter.setPen(QPen(QColor(self.theme.warn), 1, Qt.PenStyle.DotLine))
            painter.drawLine(at((0.0, height)), at((1.0, height)))
        painter.setPen(QPen(QColor(self.theme.line), 1))
        painter.drawLine(at((0.0, self.drawing.zero)), at((1.0, self.drawing.zero)))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(style.colour(self.theme.accent, 2 * style.BAND_ALPHA_WIDE))
        painter.drawPolygon(QPolygonF([at(p) for p in self.drawing.done]))
        painter.setPen(QPen(QColor(self.theme.pressure), 1))
        painter.drawPolyline(QPolygonF([at(p) for p in self.drawing.line]))
        if self.drawing.done:
            painter.setPen(QPen(QColor(self.theme.accent), 2))
            x = self.drawing.done[-1][0]
            painter.drawLine(at((x, 0.0)), at((x, 1.0)))
        painter.end()


class SequencePanel(QFrame):
    def __init__(self, run: RunModel, notices: Notices) -> None:
        super().__init__()
        self.run, self.notices = run, notices
        self.picture = StaircasePicture("The plan and its progress")
        self.picture.setContextMenuPolicy(Qt.ContextMenuPolicy.CustomContextMenu)
        self.picture.customContextMenuRequested.connect(self._open_menu)
        self.state = controls.label("", "subtitle")
        self.progress = controls.label("", "muted", name="Progress of the run", wrap=True)
        self.progress.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # the buttons are not cut
        self.uncertainty = controls.label("", "muted", name="Progress and uncertainty of the run", wrap=True)
        self.uncertainty.hide()
        self._low = False
        self.buttons: dict[str, QPushButton] = {
            key: controls.button(text, partial(self.press, key), "primary" if key in PRIMARY else "", tip=tip)
            for key, (text, tip) in BUTTONS.items()
        }
        rest, fit = "Run the remaining cycles, in the same recording", "Fit the curve to the readings of this run"
        self.resume = controls.button("", self._resume, "primary", tip=rest)
        self.calibrate = controls.button("Calibrate", self._calibrate, "primary", tip=fit)
        head = controls.row(self.state, (self.progress, 1), *self.buttons.values(), self.resume, self.calibrate)
        self.inside = controls.column(head, self.uncertainty, (self.picture, 1))
        controls.as_card(self, self.inside)

    def _open_menu(self, at: QPoint) -> None:
        menu = QMenu(self)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        add_exports(menu, partial(self.notices.attempt, self._copy, done="Copied: Plan"), self._ask_save)
        menu.popup(self.picture.mapToGlobal(at))

    def _copy(self) -> None:
        QGuiApplication.clipboard().setPixmap(self.picture.grab())

    def _ask_save(self, suffix: str) -> None:
        ask_save(self, self.run.services, "Plan", suffix, self.save)

    def save(self, path: Path) -> None:
        """Save the picture as .png or .svg, its ends of ramps and steps as .csv. OSError: it cannot be written."""
        columns = partial(self.run.sequence.columns, self.run.snapshot)
        save_export(path, "Plan", self.picture, self.picture.grab, columns)

    def fold(self, low: bool) -> None:
        """Show no picture of the plan in a low window."""
        self._low = low
        self.picture.setVisible(not low)
        upright = style.STEP if low else style.GAP
        self.inside.setContentsMargins(style.CARD_PADDING, upright, style.CARD_PADDING, upright)
        self._fit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Take the height of buttons, progress and uncertainty in a low window, at least this in any other."""
        margins = self.inside.contentsMargins()
        least = style.CONTROL_HEIGHT + margins.top() + margins.bottom() + style.STEP  # with the frame
        if not self.uncertainty.isHidden():
            width = self.contentsRect().width() - margins.left() - margins.right()
            least += self.uncertainty.heightForWidth(width) + self.inside.spacing()
        if not self._low:
            least += self.picture.minimumHeight() + self.inside.spacing()
        self.setMinimumHeight(least)
        self.setMaximumHeight(least if self._low else style.UNLIMITED)

    def _show_progress(self, snapshot: SessionSnapshot) -> None:
        """Show the longest text of the progress that fits, without a run of the estimate; no word of it is cut.

        It is in one line, else in two beside the buttons, else below them with the uncertainty.
        """
        texts = [progress_text(snapshot, leave_out, self.run.sequence.units) for leave_out in range(3)]
        texts = texts if texts[0] else self.run.sequence.lines(snapshot)
        metrics, width = self.progress.fontMetrics(), self.progress.width()
        shown = next((text for text in texts if metrics.horizontalAdvance(text) <= width), texts[-1])
        shown = shown.replace(" min", "\u00a0min")
        wrapped = metrics.boundingRect(0, 0, width, 0, Qt.TextFlag.TextWordWrap, shown)
        beside = wrapped.width() <= width and wrapped.height() <= style.CONTROL_HEIGHT
        controls.set_text(self.progress, shown if beside else "")
        below = "" if beside else shown, self.run.interrupted_text(snapshot), self.run.uncertainty_text(snapshot)
        self._show_below("\n".join(filter(None, below)))

    def _show_below(self, text: str) -> None:
        if text != self.uncertainty.text():
            self.uncertainty.setText(text)
            self.uncertainty.setVisible(bool(text))
            self._fit()

    def press(self, key: str) -> None:
        """Press a button and show its effect at once."""
        self.run.press(key)
        self.refresh(self.run.snapshot)

    def _resume(self) -> None:
        self.notices.attempt(self.run.resumption.arm)
        self.refresh(self.run.snapshot)

    def _calibrate(self) -> None:
        self.notices.attempt(self.run.calibration.take)

    def _show_choice(self, snapshot: SessionSnapshot) -> None:
        """Offer to resume an interrupted run beside starting over, and to calibrate after a run that was read.

        The button that resumes names the cycle: offered, armed and paused.
        """
        offered, first_cycle = self.run.calibration.open, self.run.resumption.first_cycle
        self.calibrate.setVisible(offered)
        self.resume.setVisible(bool(first_cycle) and not self.buttons["arm"].isHidden())
        controls.set_text(self.resume, f"Resume at cycle {first_cycle}")
        controls.set_text(self.buttons["start"], f"Start at cycle {first_cycle}" if first_cycle else "Start")
        paused = snapshot.progress if snapshot.state is SessionState.PAUSED else None
        controls.set_text(self.buttons["resume"], f"Resume at cycle {paused.cycle + 1}" if paused else "Resume")
        arm, (text, tip) = self.buttons["arm"], START_OVER if first_cycle else BUTTONS["arm"]
        controls.set_text(arm, text)
        held = bool(holding_text(snapshot))  # vent or set another pressure first; arming is possible
        controls.set_state(arm, "" if first_cycle or offered or held else "primary", "role")
        controls.set_state(self.calibrate, "" if self.resume.isVisible() else "primary", "role")
        obstacle = self.run.sequence.why_not_arm(snapshot)
        controls.allow(arm, obstacle)
        arm.setToolTip(obstacle or tip)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        model = self.run.sequence
        controls.set_text(self.state, state_text(snapshot, self.run.sequence.units))
        self._show_progress(snapshot)
        allowed = model.allowed(snapshot)
        for key, button in self.buttons.items():
            if key not in allowed and button.hasFocus():
                button.clearFocus()  # else the next button gets the focus, and Space presses it
            button.setVisible(key in allowed)
        self._show_choice(snapshot)
        self.picture.show_drawing(model.drawing(snapshot))


class PlanForm(QScrollArea):
    changed = Signal()  # the plan, by the operator

    def __init__(self, sequence: SequenceModel, end_at: EndAt, services: Services) -> None:
        super().__init__()
        self.sequence, self.end_at, self.services = sequence, end_at, services
        self._revision: tuple[object, ...] = ()
        self.units: list[tuple[QLabel, str]] = []
        self._typed_in = STORED_UNITS
        self.setWidgetResizable(True)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # it scrolls to the control that gets it
        self.setAccessibleName("Plan, manual pressure and elongation")
        self.insides: list[QLayout] = []  # of the cards
        layout = controls.column(
            self._plan_card(), self._pressure_card(), self._elongation_card(), None, spacing=style.GAP
        )
        self.setWidget(controls.holder(layout))
        layout.setContentsMargins(0, style.GAP, 0, 0)

    def _plan_card(self) -> QFrame:
        sequence = self.sequence
        self.choice = controls.choice("Plan", [(name, name) for name in sequence.plans], self._choose)
        self.choice.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)  # any name
        self.fields = {entry.key: self._field(entry.key, entry.label, entry.help) for entry in PLAN_ENTRIES}
        self.refused = controls.label("", wrap=True, name="Why the entry is invalid")
        self.estimate = controls.label("", "muted", wrap=True)
        policy = self.estimate.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.estimate.setSizePolicy(policy)
        self.ask_readings = QCheckBox("Wait for each reading")
        self.ask_readings.setChecked(sequence.wait_for_reading)
        self.ask_readings.toggled.connect(self._require_readings)
        tip = "Pressures, rates, segments, files of the plan"
        self.edit = controls.button("Edit \u2026", lambda: self.more.setVisible(self.edit.isChecked()), tip=tip)
        self.edit.setCheckable(True)
        shown, more = PLAN_ENTRIES[:1], PLAN_ENTRIES[1:]
        self.more = controls.inside(controls.column(*self._more(more), spacing=style.GAP))
        self.more.hide()
        plan, inside = controls.card(
            controls.row(controls.label("Plan", "subtitle"), (self.choice, 1)),
            _form((entry.label, self.fields[entry.key], entry.unit) for entry in shown),
            self.refused,
            self.ask_readings,
            controls.row((self.estimate, 1), self.edit),
            self.more,
        )
        self.insides.append(inside)
        return plan

    def _more(self, entries: Sequence[Entry]) -> tuple[QLayout, ...]:
        """Return what is seldom changed: the other entries, when a run ends early, segments and files."""
        self.rows: dict[str, tuple[QWidget, QWidget, QWidget]] = {
            entry.key: (controls.label(entry.label), self.fields[entry.key], self._unit(entry.unit))
            for entry in entries
        }
        grid = _form(self.rows.values())
        self.asked = controls.field("", width=FIELD_WIDTH, placeholder="off")
        self.asked.editingFinished.connect(self._ask)
        self.asked_label, self.asked_unit = controls.label(), controls.label("", "muted")
        for k, widget in enumerate((self.asked_label, self.asked, self.asked_unit)):
            grid.addWidget(widget, len(entries), k)
        show = partial(self.services.show, Panel.SEGMENTS)
        self.segments = controls.button("Segments \u2026", show, tip="Steps, ramps, sines, loops, readings")
        files = controls.button("Open \u2026", self.open), controls.button("Save \u2026", self.save)
        self.buttons = controls.row(controls.row(*files, spacing=style.STEP), self.segments, None, spacing=style.STEP)
        return grid, self.buttons

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the last button below the others in a narrow pane, and all closer in a low window."""
        upright = style.STEP if self.window().height() < style.LOW_BELOW else style.GAP
        for inside in self.insides:
            inside.setContentsMargins(style.CARD_PADDING, upright, style.CARD_PADDING, upright)
        way = QBoxLayout.Direction
        self.buttons.setDirection(way.TopToBottom if self.width() < style.PANE_WIDTH else way.LeftToRight)
        super().resizeEvent(event)

    def _pressure_card(self) -> QFrame:
        self.limits = controls.label("", "muted", wrap=True)
        self.target = controls.field("Target pressure", "0", self._set_pressure, width=FIELD_WIDTH)
        self.ramp = controls.field("Ramp of the pressure", "5", width=FIELD_WIDTH)
        self.set_button = controls.button("Set pressure", self._set_pressure, tip="Within limits, without a run")
        manual, inside = controls.card(
            controls.label("Manual pressure", "subtitle"),
            _form((("Target", self.target, self._unit("kPa")), ("Ramp", self.ramp, self._unit("kPa/s")))),
            controls.row((self.limits, 1), self.set_button),
        )
        self.insides.append(inside)
        return manual

    def _elongation_card(self) -> QFrame:
        self.mm = controls.field("Target elongation", "0", self._set_elongation, width=FIELD_WIDTH)
        tip = "Control the pressure to hold this elongation"
        self.elongation_button = controls.button("Set elongation", self._set_elongation, tip=tip)
        self.elongation = controls.label("", "muted", wrap=True)
        self.hold = QCheckBox("Hold pressure if it stops")
        self.hold.setToolTip("Hold, not vent, if sensors disagree or the elongation does not follow")
        self.hold.toggled.connect(self._hold)
        elongation, inside = controls.card(
            controls.label("Manual elongation", "subtitle"),
            _form((("Target", self.mm, self._unit("mm")),)),
            self.hold,
            controls.row((self.elongation, 1), self.elongation_button),
        )
        self.insides.append(inside)
        return elongation

    def _field(self, key: str, name: str, tip: str) -> QLineEdit:
        field = controls.field(name, self.sequence.value(key), width=FIELD_WIDTH)
        field.setToolTip(tip)
        field.editingFinished.connect(lambda: self._edit(key, field))
        return field

    def _show_units(self) -> None:
        """Show the units; what was typed in the ones before is converted: 5 kPa/s must not become 5 bar/s."""
        for label, stored in self.units:
            controls.set_text(label, self.sequence.unit(stored))
        if self._typed_in != self.sequence.units:
            for field, stored in ((self.target, "kPa"), (self.ramp, "kPa/s"), (self.mm, "mm")):
                field.setText(self.sequence.converted(field.text(), self._typed_in, stored))
            self._typed_in = self.sequence.units

    def _unit(self, stored: str) -> QLabel:
        """Return a label with the unit in which values of a stored one are typed."""
        label = controls.label("", "muted")
        self.units.append((label, stored))
        return label

    def _ask(self) -> None:
        """Set the uncertainty at which runs end; an empty field runs all cycles."""
        taken = self.services.notices.attempt(partial(self.end_at.enter, self.asked.text()))
        controls.set_state(self.asked, "" if taken else "true", "wrong")

    def _show_asked(self) -> None:
        """Show the uncertainty of the plan's kind, with its unit; an entry that is refused stays with its unit."""
        unit = self.end_at.unit
        if self.asked.property("wrong") == "true" and unit == self.asked_unit.text():
            return
        name, tip = END_AT[unit]
        controls.set_text(self.asked_label, name)
        controls.set_text(self.asked_unit, unit)
        controls.set_text(self.asked, self.end_at.text)
        controls.set_state(self.asked, "", "wrong")
        self.asked.setAccessibleName(", ".join(filter(None, ("Uncertainty at which a run ends", unit))))
        self.asked.setToolTip(tip)

    def _edit(self, key: str, field: QLineEdit) -> None:
        self.sequence.edit(key, field.text())
        self._show_refused()
        self.changed.emit()

    def _choose(self, name: str) -> None:
        self.sequence.choose(name)
        self.changed.emit()

    def _require_readings(self, wanted: bool) -> None:
        self.sequence.require_readings(wanted)
        self.changed.emit()

    def _show_refused(self) -> None:
        """Mark the fields with invalid entries, and show why the last one is."""
        refused = self.sequence.refused
        for key, field in self.fields.items():
            controls.set_state(field, "true" if key in refused else "", "wrong")
        controls.set_text(self.refused, list(refused.values())[-1] if refused else "")
        controls.set_state(self.refused, "warning" if refused else "")
        self.refused.setVisible(bool(refused))
        self.estimate.setVisible(not refused)

    def open(self) -> None:
        ask_open(self, self.services, "Open a plan", "toml", self.load)

    def load(self, path: Path) -> None:
        self.sequence.open(path)

    def save(self) -> None:
        ask_save(self, self.services, self.sequence.plan.name, "toml", self.sequence.save)

    def _set_elongation(self) -> None:
        self.services.notices.attempt(lambda: self.sequence.set_elongation(self.mm.text()))

    def _hold(self, hold: bool) -> None:
        self.sequence.hold = hold

    def _set_pressure(self) -> None:
        self.services.notices.attempt(lambda: self.sequence.set_pressure(self.target.text(), self.ramp.text()))

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the plan in force where it has changed; lock it while it is armed or runs."""
        model, plan = self.sequence, self.sequence.in_force(snapshot)
        idle = snapshot.state not in HELD or not snapshot.can_command
        for field in (*self.fields.values(), self.choice, self.ask_readings, self.asked):
            field.setEnabled(idle)
        self.asked.setEnabled(idle and bool(self.end_at.unit))
        why = model.why_not_set(snapshot)
        for button in (self.set_button, self.elongation_button):
            controls.allow(button, why)
        self.hold.setEnabled(snapshot.elongation is None)
        controls.set_text(self.elongation, elongation_text(snapshot, model.units) or why or "Not controlled")
        limits, whose = limits_text(snapshot.limits, model.units)
        controls.set_text(self.limits, why or limits)
        self.limits.setToolTip("" if why else whose)
        revision = (model.revision, self.end_at.revision, model.units, plan, model.waits_in_force(snapshot))
        if revision == self._revision:
            return
        self._revision = revision
        self._show_asked()
        with QSignalBlocker(self.ask_readings):  # of the plan that runs, not a choice
            self.ask_readings.setChecked(model.waits_in_force(snapshot))
        if self.choice.findData(plan.name) < 0:
            self.choice.addItem(plan.name, plan.name)
        self.choice.setCurrentIndex(self.choice.findData(plan.name))
        self.choice.setToolTip(controls.as_words(plan.name))  # a long one is cut in a narrow pane
        for key, field in self.fields.items():
            if key not in model.refused or not idle:
                controls.set_text(field, model.value(key, plan))
        unused = {"staircase": (), "continuous": ("step_kpa",)}.get(plan.kind, _OF_CYCLES)
        for key, cells in self.rows.items():
            for cell in cells:
                cell.setVisible(key not in unused)
        self._show_units()
        controls.set_text(self.estimate, model.lines(snapshot)[-1].replace(" min", "\u00a0min"))
        self._show_refused()


def _form(rows: Iterable[tuple[str | QWidget, QWidget, str | QWidget]]) -> QGridLayout:
    """Return a form whose fields are below those of the other cards, whatever their units."""
    grid = controls.form((name, field, controls.label() if unit == "" else unit) for name, field, unit in rows)
    grid.setHorizontalSpacing(style.STEP)
    grid.setColumnMinimumWidth(2, style.text_width(style.font(), "kPa/s"))
    return grid
