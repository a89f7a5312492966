"""The page Measure: measured values, plots, the line of the run, the reading bar, and the pane beside them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, partial

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QFont, QFontMetrics, QResizeEvent, QShowEvent
from PySide6.QtWidgets import QBoxLayout, QFrame, QGridLayout, QScrollArea, QTabWidget, QWidget

from boat_daq import formatting
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.live.camera_panel import CameraPanel
from boat_daq.gui.live.live_plots import LivePlots, OverlayPlots
from boat_daq.gui.live.photograph_panel import PhotographPanel
from boat_daq.gui.live.plan_editor_panel import PlanEditorPanel
from boat_daq.gui.live.readings_panel import ReadingBar, ReadingsTab, ReadingsTable
from boat_daq.gui.live.sequence_panel import PlanForm, SequencePanel
from boat_daq.gui.plotting.shadow_pane import ShadowPane
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.layouts import Divided, Leaves
from boat_daq.gui.widgets.panel_guard import PanelGuard
from boat_daq.viewmodels.common.services import Page, Panel, Services
from boat_daq.viewmodels.live.camera import CameraModel
from boat_daq.viewmodels.live.connection import age_text
from boat_daq.viewmodels.live.layout import Layout, Layouts
from boat_daq.viewmodels.live.live_model import HEADINGS_SHORT, STATISTICS_HEADINGS, WINDOWS_S, OverlayModel, Span
from boat_daq.viewmodels.live.run_model import RunModel
from boat_daq.viewmodels.live.shadow_live import ShadowLive
from protocol.base.units import NOTHING, as_text

SPACING = 6  # between the parts of a value
ELONGATION_NOTES = (("\u00b18.88 stated", "\u25b2 out of range"), ("\u00b18.88 end", "was +8.88"))
TARGET_NOTES = (("was +88.8",), ("\u2192 +88.8", "was +88.8"))
_SPANS_BESIDE = 2  # in the tab: the next ones are below
_SENSORS, _BESIDE = 4, 2  # of a board at most; of those at most whose values are beside the others
BAND = (
    "Expanded uncertainty, k = 2; not valid where sensors disagree or the elongation is out of range\n"
    "Stated: it includes a value from the unit's file or history, as the calibration run did not show it"
)
TRIAL = "See a whole calibration in half a minute: three cycles of a simulated unit, read automatically."
_STEPS = {
    "Connect": "Plug in the board and choose its port, or practise on the virtual board, a simulated unit.",
    "Run the plan": "Press Arm, then Start. At each plateau type the elongation on the grid and press Enter.",
    "Accept the calibration": "Look at the verdict on Results and press Accept: the elongation is then shown live.",
}


Notes = tuple[Sequence[str], Sequence[str]]
_SHOWN = {  # value -> its stored unit, its widest text, the decimals of it
    "s": ("mV", "8 888.8", 1),
    "mm": ("mm", "+88.88", 2),
    "kpa": ("kPa", "+88.8", 1),
    "target": ("kPa", "+88.8", 1),
}


class ValueDisplay(QWidget):
    """One measured value: name, large digits, unit; `notes` are the widest in a wide and in a narrow window."""

    def __init__(self, title: str, unit: str, example: str, notes: Notes = ((), ())) -> None:
        super().__init__()
        self.title, self.example, self.notes = title, example, notes
        self._size = (0, False)
        self.swatch = QFrame()
        self.swatch.setFixedSize(style.STEP, 4 * style.STEP)
        self.name = controls.label(title, "muted")
        self.value = controls.label(NOTHING)
        self.value.setAlignment(Qt.AlignmentFlag.AlignRight)  # keeps the decimal point in place
        self.unit = controls.label(unit, "set")
        self.note = controls.ElidedLabel()
        self.note.setProperty("role", "small")
        line = controls.row(self.value, self.unit, None)
        self.rows = controls.row(self.swatch, self.name, self.note, None), line
        for widget in (self.value, self.unit):
            line.setAlignment(widget, Qt.AlignmentFlag.AlignBaseline)
        self.setLayout(controls.column(*self.rows, spacing=0, margins=(0, 0, 0, 0)))
        self.resize_text(style.FONT_MEASURED)

    def _needs(self, pixels: int, *, narrow: bool) -> tuple[QFont, tuple[QFont, QFont, QFont], int, int]:
        """Return the fonts of the value and of name, note and unit, the width of the value, and that of everything."""
        font = style.font(pixels, QFont.Weight.DemiBold)
        chrome, small, unit = style.font(), style.small_font(), style.font(style.FONT_SET)
        if narrow:
            chrome = small = unit = style.font(style.FONT_NARROW)
        value = style.text_width(font, self.example) + style.STEP
        space = style.STEP if narrow else SPACING
        head = self.swatch.width() + space + style.text_width(chrome, self.title)
        if notes := self.notes[narrow]:
            head += space + max(style.text_width(small, note) for note in notes)
        line = value + space + style.text_width(unit, self.unit.text())
        return font, (chrome, small, unit), value, max(head, line) + style.STEP

    def width_at(self, pixels: int, *, narrow: bool) -> int:
        return self._needs(pixels, narrow=narrow)[3]

    def resize_text(self, pixels: int, *, narrow: bool = False) -> None:
        """Set the size of the value, and a width for the longest one so that nothing moves."""
        if (pixels, narrow) == self._size:
            return
        self._size = (pixels, narrow)
        font, beside, value, width = self._needs(pixels, narrow=narrow)
        self.value.setFont(font)
        self.value.setStyleSheet(f"font-size: {pixels}px; font-weight: 600;")
        for label, shown in zip((self.name, self.note, self.unit), beside, strict=True):
            label.setStyleSheet(f"font-size: {shown.pixelSize()}px;")
        for row in self.rows:
            row.setSpacing(style.STEP if narrow else SPACING)
        # width and height: a text that changes several times a second has nothing to be laid out again
        self.value.setFixedSize(value, QFontMetrics(font).height())
        self.setFixedWidth(width)

    def set_unit(self, unit: str, example: str) -> None:
        """Show values in another unit, whose widest one is `example`; the size is to be set again."""
        if (unit, example) != (self.unit.text(), self.example):
            self.example, self._size = example, (0, False)
            self.unit.setText(unit)

    def set(self, text: str, note: str = "", age: str = "") -> None:
        """Show a value; grey where it has an `age`, as that of data that have ended."""
        controls.set_text(self.value, text)
        controls.set_text(self.note, note)
        controls.set_state(self.value, "off" if age else "")
        self.value.setAccessibleName(" ".join(filter(None, (f"{self.title}: {text} {self.unit.text()}", note, age))))


def table(rows: Sequence[Sequence[str]], spacing: int) -> str:
    """Return rows of cells as rich text, aligned right, `spacing` pixels between the columns."""
    between = f"</td><td align='right' style='padding-left: {spacing}px'>"
    lines = (f"<tr><td align='right'>{between.join(cells)}</td></tr>" for cells in rows)
    return f"<table cellspacing='0' cellpadding='0'>{''.join(lines)}</table>"


class FirstSteps(QScrollArea):
    """Three steps from a board to a calibration; before the first recording, a quick trial of them."""

    def __init__(self, run: RunModel, services: Services) -> None:
        super().__init__()
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)  # it scrolls to the control that gets it
        self.recordings, attempt = services.recordings, services.notices.attempt
        self.trial = controls.button("Quick trial", partial(attempt, run.trial.start), "primary", tip=TRIAL)
        self.board = controls.button("Connect a board …", partial(services.show, Panel.CONNECT))
        self.virtual = controls.button("Start the virtual board", partial(attempt, run.connection.start_virtual_board))
        self.first = controls.card(controls.row((controls.label(TRIAL, "muted", wrap=True), 1), self.trial))[0]
        buttons = ((self.virtual, self.board), (), ())
        rows = zip(_STEPS.items(), buttons, strict=True)
        steps = [self._step(str(i), title, text, *each) for i, ((title, text), each) in enumerate(rows, 1)]
        frame, self.inside = controls.card(controls.label("From a board to a calibration", "title"), self.first, *steps)
        frame.setMaximumWidth(style.FORM_WIDTH + style.PANE_WIDTH)
        across = controls.row(None, (frame, 1000), None, spacing=0)  # an aligned frame does not wrap its text
        self.setWidgetResizable(True)
        self.setWidget(controls.holder(controls.column(None, across, None)))

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put all closer in a low window: it shows the three steps without scrolling at 853 x 600."""
        low = self.window().height() < style.LOW_BELOW
        self.inside.setContentsMargins(*((style.GAP if low else 6 * style.STEP),) * 4)
        self.inside.setSpacing(style.STEP if low else style.GAP)
        super().resizeEvent(event)

    def showEvent(self, event: QShowEvent) -> None:
        """Offer the quick trial first where nothing has been recorded yet."""
        new = not any(self.recordings.glob("*.boat"))
        self.first.setVisible(new)
        controls.set_state(self.virtual, "" if new else "primary", "role")
        super().showEvent(event)

    def _step(self, number: str, title: str, text: str, *buttons: QWidget) -> QFrame:
        grid = QGridLayout()
        grid.setColumnStretch(1, 1)
        grid.setHorizontalSpacing(style.CARD_PADDING)
        digit = controls.label(number, "title")
        digit.setFixedWidth(6 * style.STEP)
        grid.addWidget(digit, 0, 0)
        grid.addWidget(controls.label(title, "subtitle"), 0, 1)
        grid.addWidget(controls.label(text, "muted", wrap=True), 1, 1)
        if buttons:
            grid.addLayout(controls.row(*buttons, None), 2, 1)
        return controls.card(grid)[0]


class LivePage(QWidget):
    def __init__(
        self,
        run: RunModel,
        overlay: OverlayModel,
        layouts: Layouts,
        shadow: ShadowLive,
        camera: CameraModel,
        services: Services,
    ) -> None:
        super().__init__()
        self.run, self.model, self.layouts, self.services = run, run.live, layouts, services
        self.guard = PanelGuard(services.notices)
        self.plots = LivePlots(self.model)
        self.plots.layout_wanted.connect(self._change_layout)
        self.figures = self._figures()
        self.spans = controls.label("", "small")
        self.spans.hide()
        self.between = controls.label("", "small", name="Statistics between the cursors")
        for statistics in (self.spans, self.between):
            statistics.setTextFormat(Qt.TextFormat.RichText)
        self._before = 0  # the tab shown before the statistics
        self.between.setAlignment(Qt.AlignmentFlag.AlignTop)
        self.between.setContentsMargins(0, style.GAP, 0, 0)
        self.sequence = SequencePanel(run, services.notices)
        self.reading = ReadingBar(run, services)
        self.pane = self._pane(shadow, camera)
        self.middle = Leaves()
        self.first_steps, self.overlay = FirstSteps(run, services), OverlayPlots(overlay)
        for leaf in (self.first_steps, self.plots, self.overlay):
            self.middle.addWidget(leaf)
        back = controls.button("Back to the plots", self.toggle_overlay, tip="Show all values over time again")
        self.overlay.bar.insertWidget(self.overlay.bar.count() - 1, back)
        self.overlaid = self.narrow = self.low = False
        self.sensors = _BESIDE
        self.photograph = PhotographPanel(self, run, services)
        self.marker = self._marker()
        self.head = self._head()
        self.frozen = self._frozen()
        self.plots.bar.insertWidget(self.plots.bar.indexOf(self.freeze), self.frozen)  # in its place
        above = controls.column((self.middle, 1), self.spans, spacing=style.GAP)
        height = self.sequence.sizeHint().height()
        self.run_border = Divided(
            "run", services.preferences, controls.holder(above), self.sequence, height, below=True
        )
        parts = (self.head, self.marker, (self.run_border, 1), self.reading)
        self.left = controls.column(*parts, spacing=style.GAP)
        self.sides = Divided("live", services.preferences, controls.holder(self.left), self.pane, style.PANE_WIDTH)
        self.page = controls.page_layout(self)
        self.page.addWidget(self.sides)

    @cached_property
    def plan_editor(self) -> PlanEditorPanel:
        """The editor of segments, made where it is first shown."""
        panel = PlanEditorPanel(self, self.run.sequence, self.services)
        panel.paint_theme(self.plots.theme)
        return panel

    def _figures(self) -> dict[str, ValueDisplay]:
        figures = {f"s{n}": ValueDisplay(f"Sensor {n}", *_SHOWN["s"][:2]) for n in range(1, _SENSORS + 1)} | {
            "mm": ValueDisplay("Elongation", *_SHOWN["mm"][:2], ELONGATION_NOTES),
            "kpa": ValueDisplay("Pressure", *_SHOWN["kpa"][:2], TARGET_NOTES),
            "target": ValueDisplay("Target", *_SHOWN["target"][:2]),
        }
        figures["mm"].note.explain(BAND)
        return figures

    def _head(self) -> QFrame:
        values = list(self.figures.values())
        self.figure_rows = [controls.row(*part) for part in (values[:_SENSORS], values[_SENSORS:])]
        self.figure_line = controls.row(*self.figure_rows)
        for part in self.figure_rows:
            self.figure_line.setAlignment(part, Qt.AlignmentFlag.AlignLeft)
        windows = [("all" if math.isinf(s) else formatting.span(s), s) for s in WINDOWS_S]
        self.window_choice = controls.choice("Time shown", windows, self.model.set_window, tip="Time shown")
        self.show_ = controls.label("Show", "muted")
        self.freeze = controls.button("Freeze plot", self.plots.toggle_freeze, tip="Recording continues (Space)")
        for widget in (self.freeze, self.show_, self.window_choice):
            self.plots.bar.insertWidget(self.plots.bar.count() - 1, widget)
        frame, self.head_card = controls.card(controls.row(self.figure_line, None))
        frame.setMinimumWidth(1)  # else figures too large for a new width would push the pane aside
        return frame

    def _frozen(self) -> QFrame:
        """Return the banner of plots that do not follow the data."""
        self.follow = controls.button("Follow", self.plots.toggle_freeze, tip="Show the newest data (Space)")
        mark = controls.label("FROZEN", "subtitle")
        controls.set_state(mark, "warning")
        mark.setToolTip("The plots show the past. Sampling continues.")
        frame, inside = controls.card(controls.row(mark, self.follow))
        inside.setContentsMargins(style.GAP, 0, 0, 0)
        controls.set_state(frame, "warning", "level")
        frame.hide()
        return frame

    def _marker(self) -> QFrame:
        self.note = controls.field("Note of the marker", on_enter=self._mark, placeholder="What happened?")
        add = controls.button("Add", self._mark, name="Add marker")
        cancel = controls.button("Cancel", self.close_marker, name="Cancel marker")
        frame, _ = controls.card(controls.row(controls.label("Marker", "subtitle"), self.note, add, cancel))
        frame.hide()
        return frame

    def ask_marker(self) -> None:
        self.services.show(Page.MEASURE)
        self.note.clear()
        self.marker.show()
        self.note.setFocus()

    def _mark(self) -> None:
        self.run.mark(self.note.text().strip())
        self.close_marker()

    def close_marker(self) -> None:
        self.marker.hide()
        self.focus_reading()

    def focus_reading(self) -> None:
        """Give the keyboard to the reading field while a plateau waits."""
        if self.reading_is_due() and self.reading.isVisible():
            self.reading.field.setFocus()

    def open_photograph(self) -> None:
        """Show the panel for a photograph in the middle, nearly as large as the window, above the strip of messages."""
        if self.photograph.isHidden():
            size = self.window().size()
            most = size.height() - 2 * (style.STRIP_HEIGHT + style.CONTROL_HEIGHT)  # with its title bar
            self.photograph.resize((size * style.PANEL_SHARE).boundedTo(QSize(size.width(), most)))
        self.photograph.show()
        self.photograph.raise_()

    def toggle_overlay(self) -> None:
        """Show the last cycles overlaid, or the plots again."""
        self.overlaid = not self.overlaid

    def show_first_steps(self) -> None:
        """Show the first steps until a board is connected."""
        self.services.show(Page.MEASURE)
        self.middle.setCurrentWidget(self.first_steps)

    def _pane(self, shadow: ShadowLive, camera: CameraModel) -> QTabWidget:
        self.shadow = ShadowPane(shadow, self.services)
        self.table = ReadingsTable(self.run.readings, self.services)
        self.table.model.corrected.connect(self.focus_reading, Qt.ConnectionType.QueuedConnection)
        self.plan = PlanForm(self.run.sequence, self.run.end_at, self.services)
        self.plan.changed.connect(self._show_plan_now)
        self.camera = CameraPanel(camera, self.services)
        self.readings = ReadingsTab(self.run, self.table, self.camera, self.services)
        pages = ((self.plan, "Plan"), (self.readings, "Readings"), (self.shadow, "Shadow"))
        tabs = controls.tabs("Plan, readings, shadow", *pages)
        tabs.setMinimumWidth(style.PANE_WIDTH_NARROW)
        return tabs

    def remember(self) -> None:
        """Store zoom and selected tab for the next start."""
        seconds, store = self.model.window_s, self.services.preferences.set
        store("window_s", seconds if math.isfinite(seconds) else -1.0)
        store("tab", self.pane.currentIndex())

    def restore(self) -> None:
        stored = self.services.preferences.get
        seconds = float(stored("window_s", 60.0))
        self.model.set_window(seconds if seconds > 0 else math.inf)
        self.pane.setCurrentIndex(stored("tab", 0))

    def _change_layout(self, layout: Layout) -> None:
        self.services.notices.attempt(partial(self.layouts.change, layout))
        self.plots.arrange()

    def use_usual_layout(self) -> None:
        """Give each quantity a plot of its own again."""
        self._change_layout(Layout())

    def show_plan(self) -> None:
        self.services.show(Page.MEASURE)
        self.pane.setCurrentWidget(self.plan)
        self.plan.choice.setFocus()

    def _show_plan_now(self) -> None:
        for panel in (self.plan, self.sequence):
            panel.refresh(self.run.snapshot)

    def edit_segments(self) -> None:
        self.plan_editor.open_fresh(self.run.snapshot)

    def show_manual(self) -> None:
        """Show the fields for a manual pressure and a manual elongation, and focus the first."""
        self.show_plan()
        for widget in (self.plan.elongation_button, self.plan.target):
            self.plan.ensureWidgetVisible(widget, 0, style.GAP)
        self.plan.target.setFocus()
        self.plan.target.selectAll()

    def reading_is_due(self) -> bool:
        return self.run.snapshot.waiting_for_reading is not None

    def show_readings(self) -> ReadingsTable:
        """Show the table of readings, and return it."""
        self.services.show(Page.MEASURE)
        self.pane.setCurrentWidget(self.readings)
        self.table.refresh(self.run.snapshot)  # while hidden it is not refreshed
        self.table.view.setFocus()
        return self.table

    def draw(self) -> None:
        if self.plots.isVisible():
            self.guard.show(self.plots, "Live plots", self.plots.draw)
        if self.shadow.isVisible():
            self.guard.show(self.shadow, "The shadow", self.shadow.draw)
        if self.camera.isVisible():
            self.guard.show(self.camera, "The camera", self.camera.draw)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show values, run and readings; called a few times a second."""
        self.guard.show(self.head, "The values", partial(self._show_values, snapshot))
        with_data = self.overlay if self.overlaid else self.plots
        self.middle.setCurrentWidget(with_data if self.model.has_data() else self.first_steps)
        if self.overlay.isVisible():
            self.guard.show(self.overlay, "The overlay", self.overlay.draw)
        if "plan_editor" in vars(self):
            self.guard.show(self.plan_editor, "The plan of segments", partial(self.plan_editor.refresh, snapshot))
        shown, other = (self.freeze, self.frozen) if self.model.following else (self.frozen, self.freeze)
        other.hide()  # first: both together would push the pane aside
        shown.show()
        shown_s, frozen_s = self.model.window_s, self.model.frozen_s
        if frozen_s is not None and not math.isclose(frozen_s[1] - frozen_s[0], shown_s, rel_tol=0.01):
            shown_s = math.nan  # zoomed
        self.window_choice.setCurrentIndex(WINDOWS_S.index(shown_s) if shown_s in WINDOWS_S else -1)
        self.guard.show(self.plots, "The marks in the plots", partial(self._show_marks, snapshot))
        self.guard.show(self.sequence, "The run", partial(self.sequence.refresh, snapshot))
        self.guard.show(self.reading, "The reading", partial(self.reading.refresh, snapshot))
        self.guard.show(self.photograph, "The photograph", self.photograph.refresh)
        for tab, name in ((self.shadow, "The shadow"), (self.plan, "The plan"), (self.readings, "The readings")):
            if tab is self.pane.currentWidget():
                self.guard.show(tab, name, partial(tab.refresh, snapshot))

    def _show_values(self, snapshot: SessionSnapshot) -> None:
        """Show the values; of data that have ended none: what was is noted beside it where it fits."""
        head, age, figures = self.model.headline(snapshot), age_text(snapshot), self.figures
        sensors = self.model.sensors() or _BESIDE
        if sensors != self.sensors:
            self.sensors = sensors
            self._fit_figures()
        signals = (*head.signals, *[NOTHING] * (_SENSORS - len(head.signals)))
        shown = dict(zip(list(figures)[:_SENSORS], signals, strict=True))
        shown |= {"mm": head.elongation, "kpa": head.pressure, "target": head.target}
        if age:  # nothing tells whether the unit is still under pressure
            for name, text in shown.items():
                noted = text != NOTHING and name in ("kpa", "mm")  # a signal is too long for its place
                figures[name].set(NOTHING, f"was {text}" if noted else "", age)
            return
        for name, text in shown.items():
            figures[name].set(text)
        figures["mm"].set(head.elongation, head.band_short if self.narrow else head.band)
        figures["kpa"].set(head.pressure, f"\u2192 {head.target}" if self.narrow and head.target != NOTHING else "")

    def _show_marks(self, snapshot: SessionSnapshot) -> None:
        limits = snapshot.limits
        self.plots.show_limits(limits.min_kpa if limits else None, limits.max_kpa if limits else None)
        self.plots.arrange()
        self.plots.show_markers()
        self.plots.show_readings(self.run.reading_points())
        self.plots.show_age(age_text(snapshot))
        self.plots.show_values()
        self._show_spans(self.model.statistics())

    def _show_spans(self, spans: list[Span]) -> None:
        """Show the statistics between the cursors under the plots; in a small window in a tab beside them."""
        rows = [(self.model.difference(), *STATISTICS_HEADINGS[1:]), *(span.cells for span in spans)]
        beside = self.narrow or self.low
        self.spans.setVisible(bool(spans) and not beside)
        self.spans.setText(table(rows, 4 * style.STEP) if self.spans.isVisible() else "")
        self._show_between(spans if beside else [])

    def _show_between(self, spans: list[Span]) -> None:
        at = self.pane.indexOf(self.between)
        if spans:
            cells = [(s.name, s.unit, *s.cells[1:-1], s.cells[-1].removesuffix(" dB")) for s in spans]
            parts = (cells[i : i + _SPANS_BESIDE] for i in range(0, len(cells), _SPANS_BESIDE))
            upright = (list(zip(("", "", *HEADINGS_SHORT), *part, strict=True)) for part in parts)
            tables = (table([row for row in rows if set(row[1:]) != {NOTHING}], 4 * style.STEP) for rows in upright)
            size = style.FONT_SMALL if len(spans) <= 2 * _SPANS_BESIDE else style.FONT_NARROW
            shown = f"<p>{self.model.difference()}</p>{'<br>'.join(tables)}"
            self.between.setText(f"<div style='font-size: {size}px'>{shown}</div>")
            if at < 0:
                self._before = self.pane.currentIndex()
                self.pane.setCurrentIndex(self.pane.addTab(self.between, "A\u2013B"))
        elif at >= 0:
            if self.pane.currentIndex() == at:
                self.pane.setCurrentIndex(self._before)
            self.pane.removeTab(at)

    def paint_theme(self, theme: Theme) -> None:
        for name, figure in self.figures.items():
            stored, example, decimals = _SHOWN[name.rstrip("1234")]
            shown = theme.units.shown(stored)
            if shown.symbol != stored:
                widest = shown.value(float(example.replace(" ", "")))
                example = formatting.number(widest, shown.decimals(decimals), sign=example.startswith("+"))
            figure.set_unit(as_text(shown.symbol), example)
        self._fit_figures()
        colours = (*theme.sensors, theme.elongation, theme.pressure, theme.target)
        for figure, colour in zip(self.figures.values(), colours, strict=True):
            figure.swatch.setStyleSheet(f"background: {colour}; border-radius: 2px;")

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fit values and pane to the size of the window."""
        width = self.window().width()
        self.narrow = width < style.NARROW_BELOW
        self.show_.setVisible(not self.narrow)  # else the age of the last data was cut
        low = self.low = self.window().height() < style.LOW_BELOW
        margin = style.STEP if low else style.PAGE_MARGIN
        self.page.setContentsMargins(margin, margin, margin, margin)
        space = style.STEP if low else style.GAP
        self.left.setSpacing(space)
        self.run_border.setHandleWidth(space)
        self.plots.inside.setContentsMargins(style.CARD_PADDING, space, style.STEP, style.STEP)
        self.sequence.fold(low)
        self.reading.fold(self.narrow, low)
        self._fit_figures()
        super().resizeEvent(event)

    def _fit_figures(self) -> None:
        """Fit the values and the pane to the width: those of more than two sensors in a row of their own."""
        width = self.window().width()
        pane, figure = style.PANE_WIDTH, style.FONT_MEASURED
        if width >= style.WIDE_FROM:
            pane, figure = style.PANE_WIDTH_WIDE, style.FONT_MEASURED_WIDE
        elif self.narrow:
            pane, figure = style.PANE_WIDTH_NARROW, style.FONT_MEASURED_NARROW
        self.sides.prefer(pane)
        for n, name in enumerate(list(self.figures)[:_SENSORS], 1):
            self.figures[name].setVisible(n <= self.sensors)
        self.figures["target"].setVisible(not self.narrow)  # else it is shown beside the pressure
        apart = self.sensors > _BESIDE
        way = QBoxLayout.Direction.TopToBottom if apart else QBoxLayout.Direction.LeftToRight
        self.figure_line.setDirection(way)
        space = style.STEP if self.narrow else 5 * style.STEP
        self.figure_line.setSpacing(style.STEP if apart else space)
        for part in self.figure_rows:
            part.setSpacing(space)
        beside = style.GAP if self.narrow else style.CARD_PADDING
        upright = style.STEP if self.low else style.GAP
        self.head_card.setContentsMargins(beside, upright, beside, upright)
        available = self.width() - pane - 2 * style.PAGE_MARGIN - style.GAP - 2 * style.CARD_PADDING
        figure = figure if not apart or self.narrow else style.FONT_MEASURED
        while self._figures_width(figure) > available and figure > style.FONT_MEASURED_NARROW:  # in a wide font
            figure -= 2
        for value in self.figures.values():
            value.resize_text(figure, narrow=self.narrow)

    def _figures_width(self, pixels: int) -> int:
        space, values = self.figure_rows[0].spacing(), list(self.figures.values())
        shown = [
            [v.width_at(pixels, narrow=self.narrow) for v in part if not v.isHidden()]
            for part in (values[:_SENSORS], values[_SENSORS:])
        ]
        widths = [sum(part) + space * (len(part) - 1) for part in shown]
        return max(widths) if self.sensors > _BESIDE else sum(widths) + space
