"""What surrounds every page: header with link, recording, unit, VENT; the pages at the left; the strip at the foot.

The strip shows the most severe notice with its remedy and action, and the running job with its cancel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication, QResizeEvent
from PySide6.QtWidgets import QButtonGroup, QPlainTextEdit, QProgressBar, QPushButton, QSizePolicy, QWidget

from boat_daq.engine.snapshot import LinkState, SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.file_dialogs import open_folder, open_path
from boat_daq.viewmodels.common.notices import TITLES, Notice, Notices, Severity
from boat_daq.viewmodels.common.services import Page, Panel, Services
from boat_daq.viewmodels.live.connection import ConnectionModel, link_text
from boat_daq.viewmodels.live.outlets import OutletsModel
from boat_daq.viewmodels.live.recording_status import RecordingStatus, RecordingText
from boat_daq.viewmodels.live.unit_in_use import UnitInUse
from boat_daq.workflows.jobs import JobRunner

_FIGURES = 4
_CHOOSE = "Choose the port (Ctrl+K)"


@dataclass(frozen=True, slots=True)
class Vents:
    """What the red buttons do: vent this window's board, or those of all windows; `others` names these."""

    this: Callable[[], None]
    all: Callable[[], None]
    others: Callable[[], Sequence[str]]


class Header(QWidget):
    def __init__(
        self,
        connection: ConnectionModel,
        unit: UnitInUse,
        recording: RecordingStatus,
        outlets: OutletsModel,
        vents: Vents,
        services: Services,
    ) -> None:
        super().__init__()
        self._vents, self._outlets = vents, outlets
        self.connection, self.unit_in_use = connection, unit
        self.recording = RecordingBadge(recording, services)
        self.setFixedHeight(style.HEADER_HEIGHT)
        self.simulated = controls.label("SIMULATED", "simulated", name="This board is simulated")
        self.link = controls.button("", partial(services.show, Panel.CONNECT), name="Connection", tip=_CHOOSE)
        self.pressure = controls.label(name="Pressure now")
        self.pressure.hide()
        self.figures = [controls.label("", "muted") for _ in range(_FIGURES)]
        self.unit = controls.button("", partial(services.show, Page.RECORDINGS), name="Unit and calibration")
        show_outlets = partial(services.show, Panel.OUTLETS)
        self.outlets = controls.button("", show_outlets, "outlets", name="Streams and remote control")
        self.outlets.hide()
        self._open_outlets = outlets.view()
        self._units = ("", "", "")  # alone, with its calibration, with the date of that
        self._links = ("", "", "")  # the sign alone, with its word, with the board's name
        self._lengths: tuple[object, ...] = ()
        self.vent = vent_button(vents.this)
        name = "Vent the actuators of all windows now"
        self.vent_all = _pressed_button("ALL   Shift+F4", "vent-all", name, vents.all)
        self.vent_all.hide()
        self.brand = controls.label("boat-daq", "brand")
        left = (self.brand, self.simulated, self.link, self.pressure, *self.figures)
        ends = (style.PAGE_MARGIN, 0, style.PAGE_MARGIN, 0)
        fitted = (self.link, self.unit, self.recording.badge, self.outlets, *self.figures)
        self._levels: dict[QWidget, int] = dict.fromkeys(fitted, 0)
        right = (self.recording.badge, self.recording.button, self.outlets, self.unit, self.vent_all, self.vent)
        self.line = controls.row(*left, None, *right, spacing=style.CARD_PADDING, margins=ends)
        for widget in left:
            self.line.setAlignment(widget, Qt.AlignmentFlag.AlignVCenter)
        controls.surface(self, "header", self.line)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Leave out what does not fit a narrow window: VENT is never cut."""
        self.line.setSpacing(style.GAP if self.width() < style.CLOSE_BELOW else style.CARD_PADDING)
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Show what fits, in the order of its worth; the tooltips of link and unit show all of it.

        Always: VENT, the pressure, the signs of link and recording, the unit. Then the word of the link, the time of
        the recording, figures of the link with a warning, the calibration, the board's name, the other figures, the
        date of the calibration, the names of the outlets, size and disk of the recording.
        """
        wide = self.width() >= style.NARROW_BELOW
        controls.set_text(self.vent_all, "ALL   Shift+F4" if wide else "ALL")
        self.brand.setVisible(wide)
        figures = [label for label in self.figures if label.text()]
        warned = [label for label in figures if label.property("state")]
        link, unit, record, outlets = self.link, self.unit, self.recording.badge, self.outlets
        steps: list[tuple[QWidget, int]] = [(link, 1), (record, 1), *((label, 1) for label in warned)]
        steps += [(unit, 1), (link, 2), (outlets, 1), *((label, 1) for label in figures if label not in warned)]
        steps += [(unit, 2), (outlets, 2), (record, 2)]
        self._levels = dict.fromkeys(self._levels, 0)
        self._fold()
        for part, level in steps:
            before, self._levels[part] = self._levels[part], level
            self._fold()
            if self._needed() > self.width():
                self._levels[part] = before
                self._fold()

    def _fold(self) -> None:
        """Show link, recording, outlets, unit and figures as long as they may be."""
        levels, outlets, sign = self._levels, self._open_outlets, "\u21c4"
        self.recording.fold(levels[self.recording.badge])
        controls.set_text(self.link, self._links[levels[self.link]])
        controls.set_text(self.unit, self._units[levels[self.unit]])
        controls.set_text(self.outlets, (sign, outlets.short, outlets.badge)[levels[self.outlets]])
        controls.set_state(self.outlets, "" if levels[self.outlets] else "sign", "fold")
        for label in self.figures:
            label.setVisible(bool(levels[label]))

    def _needed(self) -> int:
        """Return the width of all that is shown, a space after each, and the margins."""
        margins, space = self.line.contentsMargins(), self.line.spacing()
        items = filter(None, map(self.line.itemAt, range(self.line.count())))
        shown = [widget for item in items if (widget := item.widget()) is not None and not widget.isHidden()]
        return sum(w.sizeHint().width() + space for w in shown) + margins.left() + margins.right() + space

    def refresh(self, snapshot: SessionSnapshot, pressure: str = "") -> None:
        """Show the state of the session; `pressure` is what the page does not show of it."""
        others = self._vents.others()
        if bool(others) is self.vent_all.isHidden():
            self.vent_all.setVisible(bool(others))
            self._lengths = ()  # place all again
        if others:
            self.vent_all.setToolTip(f"Vent the boards of all windows now (Shift+F4), too: {', '.join(others)}")
        text = link_text(snapshot)
        words = "  ".join(filter(None, (text.who, f"{text.word}{text.doing}")))
        starting = "\u25d4  starting the virtual board \u2026"
        whole = starting if self.connection.starting else f"{text.shape}  {words}"
        short = whole if self.connection.starting else f"{text.shape}  {text.word}"
        self._links = text.shape, short, whole
        controls.set_state(self.link, text.state)
        self.simulated.setVisible(snapshot.simulated)
        for i, label in enumerate(self.figures):
            figure, state = text.figures[i] if i < len(text.figures) else ("", "")
            controls.set_text(label, figure)
            controls.set_state(label, state)
        controls.set_text(self.pressure, pressure)
        controls.set_state(self.pressure, "warning" if snapshot.link is not LinkState.UP else "")
        self.pressure.setVisible(bool(pressure))
        self.recording.refresh(snapshot)
        self._refresh_outlets()
        self._units = self.unit_in_use.texts(snapshot)
        self.link.setToolTip("\n".join((_CHOOSE, words, *(figure for figure, _ in text.figures))))
        library = "simulated" if snapshot.simulated else "real"
        self.unit.setToolTip(f"{self._units[-1]}\nThe unit in use and its calibration as a {library} unit")
        widths = ((len(figure), state) for figure, state in text.figures)
        parts = words, snapshot.simulated, len(pressure), self._units, self._open_outlets.badge
        lengths = *parts, *self.recording.lengths(), *widths
        if lengths != self._lengths:  # digits have one width: where no figure is longer, nothing is measured again
            self._lengths = lengths
            self._fit()
        else:
            self._fold()

    def _refresh_outlets(self) -> None:
        view = self._open_outlets = self._outlets.view()
        controls.set_state(self.outlets, "warning" if view.control else "")
        self.outlets.setToolTip(f"LSL: {view.streams}\nSECoP: {view.node}\nStreams and remote control")
        self.outlets.setVisible(bool(view.badge))


def vent_button(vent: Callable[[], None]) -> QPushButton:
    button = _pressed_button("VENT   F4", "vent", "Vent the actuator now", vent)
    button.setToolTip("Vent now, in any state (F4; Esc where nothing is open)")
    return button


def _pressed_button(text: str, style_name: str, name: str, act: Callable[[], None]) -> QPushButton:
    """Return a button that acts on press, not on release."""
    button = QPushButton(text)
    button.setObjectName(style_name)
    button.setAccessibleName(name)
    button.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
    button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    button.pressed.connect(act)
    return button


class Navigation(QWidget):
    """A button for each page, in the order of the shortcuts Ctrl+1, Ctrl+2, ..."""

    def __init__(self, pages: Sequence[Page], go: Callable[[Page], None], show_keys: Callable[[], None]) -> None:
        super().__init__()
        self.setFixedWidth(style.NAVIGATION_WIDTH)
        self.setAccessibleName("Pages")
        self._group = QButtonGroup(self)
        self.buttons: dict[Page, QPushButton] = {}
        for i, name in enumerate(pages, 1):
            button = controls.button(name, partial(go, name), "nav", tip=f"Ctrl+{i}")
            button.setCheckable(True)
            self._group.addButton(button)
            self.buttons[name] = button
        keys = controls.button("Keys", show_keys, "nav", name="Show the keys")
        layout = controls.column(*self.buttons.values(), None, keys, spacing=0, margins=(0, style.GAP, 0, style.GAP))
        controls.surface(self, "navigation", layout)

    def mark(self, name: Page, why: str) -> None:
        """Mark a page that needs the operator, and why; an empty `why` removes the mark."""
        button = self.buttons[name]
        text = f"{name}  \u25c0" if why else name
        if button.text() != text:
            button.setText(text)
            button.setAccessibleName(f"{name}: {why}" if why else name)

    def show_page(self, name: Page) -> None:
        """Mark the page that is shown."""
        self.buttons[name].setChecked(True)


class Strip(QWidget):
    """The strip; `refresh` shows the current notice and the newest job, whose name gives way to a notice."""

    def __init__(self, notices: Notices, jobs: JobRunner) -> None:
        super().__init__()
        self.notices, self.jobs = notices, jobs
        self._shown: Notice | None = None
        self.mark = controls.label()
        self.text = controls.label(name="What needs attention", wrap=True)
        self.text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # the buttons are never cut
        self._least, self._fitted = style.STRIP_HEIGHT, ("", 0, 0)
        self.act = controls.button("", self.apply, name="Apply suggested action")
        self.more = controls.button("Details", self._toggle_details, "link")
        self.open_file = controls.button("Open", self._open_file, name="Open the saved file")
        self.folder = controls.button("Show in folder", self._open_folder, name="Show the saved file in its folder")
        self.messages = controls.button("Messages", self.toggle_history, "link", tip="All messages since the start")
        self.messages.setCheckable(True)
        self.copy = controls.button("Copy", self._copy, "link", name="Copy message")
        self.close_ = controls.button("Dismiss", self.dismiss, "link", name="Dismiss message")
        self.behind = controls.label("", "small")
        self.work = controls.label("", "muted", elide=True, least=style.VENT_WIDTH)
        self.bar = QProgressBar(textVisible=False)
        self.bar.setAccessibleName("Progress")
        self.cancel = controls.button("Cancel", self.cancel_job, name="Cancel task")
        self.details = QPlainTextEdit(readOnly=True)
        self.details.setAccessibleName("Details of the message")
        self._lay_out()
        self._show(None)

    def _lay_out(self) -> None:
        """Place the task at the left and the buttons of a message at the right, so that none moves another."""
        policy = self.close_.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.close_.setSizePolicy(policy)
        line = controls.row(
            self.cancel, self.bar, self.work, self.mark, (self.text, 1), self.behind, self.more, self.copy,
            self.folder, self.open_file, self.act, self.close_, self.messages,
            margins=(style.PAGE_MARGIN, 0, style.PAGE_MARGIN, 0),
        )  # fmt: skip
        self.head = QWidget()
        self.head.setLayout(line)
        self.fold(low=False)
        controls.surface(self, "strip", controls.column(self.head, self.details, spacing=0, margins=(0, 0, 0, 0)))

    def fold(self, *, low: bool) -> None:
        self._least = style.STRIP_HEIGHT_LOW if low else style.STRIP_HEIGHT
        self.details.setFixedHeight((2 if low else 4) * style.STRIP_HEIGHT)
        self._fit()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._fit()

    def _fit(self) -> None:
        """Take the height of the whole message: its remedy, at the end, is never cut."""
        asked = (self.text.text(), self.text.width(), self._least)
        if asked != self._fitted:
            self._fitted = asked
            self.head.setFixedHeight(max(self._least, self.text.heightForWidth(self.text.width()) + style.GAP))

    def refresh(self) -> None:
        """Show the most severe notice and the newest job."""
        notice = self.notices.current()
        if notice is not self._shown:
            self._show(notice)
        waiting = self.notices.waiting()
        controls.set_text(self.behind, f"{waiting} more" if waiting else "")
        running = self.jobs.running()
        crowded = notice is not None and self.width() < style.NARROW_BELOW
        for widget in (self.bar, self.cancel, self.work):  # the palette cancels, too
            widget.setVisible(bool(running) and not crowded)
        if running:
            job = running[-1]
            controls.set_text(self.work, job.counted or job.label)
            most = max(style.VENT_WIDTH, self.width() // 4) if notice is not None else style.UNLIMITED
            self.work.setMaximumWidth(most)  # the rest is the message's
            self.bar.setToolTip(job.label)
            self.bar.setRange(0, 0 if job.fraction is None else 1000)
            self.bar.setValue(job.permille)
        self.bar.setFixedWidth(style.VENT_WIDTH // (2 if self.width() < style.NARROW_BELOW else 1))
        self._fit()

    def _show(self, notice: Notice | None) -> None:
        self._shown = notice
        severity = notice.severity.name.lower() if notice else ""
        controls.set_state(self, severity, "level")
        controls.set_state(self.mark, severity if severity in ("warning", "fault") else "ok")
        self.mark.setText(TITLES[notice.severity] if notice else "")
        self.text.setText(notice.sentences if notice else "")
        self.act.setText(notice.action_text if notice else "")
        if self.messages.isChecked():
            self.details.setPlainText(self.notices.history_text())
        else:
            self.details.setPlainText(notice.text if notice else "")
            self.details.hide()
        for button in (self.open_file, self.folder):
            button.setVisible(bool(notice and notice.saved))
        self.act.setVisible(self.has_action())
        self.more.setVisible(bool(notice and notice.details))
        self.copy.setVisible(bool(notice and notice.severity is not Severity.INFORMATION))
        self.close_.setVisible(bool(notice and notice.stays))

    def _toggle_details(self) -> None:
        shown = self.details.isVisible() and not self.messages.isChecked()
        self.messages.setChecked(False)
        self.details.setPlainText(self._shown.text if self._shown else "")
        self.details.setVisible(not shown)

    def toggle_history(self) -> None:
        """Show all messages, the newest first, or hide them."""
        self.details.setVisible(self.messages.isChecked())
        self.details.setPlainText(self.notices.history_text())

    def is_open(self) -> bool:
        return not self.details.isHidden()

    def close_details(self) -> None:
        self.messages.setChecked(False)
        self.details.hide()

    def _open_file(self) -> None:
        if self._shown is not None and self._shown.saved is not None:
            open_path(self._shown.saved, self.notices)

    def _open_folder(self) -> None:
        if self._shown is not None and self._shown.saved is not None:
            open_path(self._shown.saved.parent, self.notices)

    def has_action(self) -> bool:
        return self._shown is not None and self._shown.action is not None

    def has_notice(self) -> bool:
        return self._shown is not None

    def apply(self) -> None:
        notice = self._shown
        if notice is not None and notice.action is not None:
            self.notices.dismiss(notice)
            self.notices.attempt(notice.action)

    def dismiss(self) -> None:
        self.notices.dismiss(self._shown)
        self.refresh()

    def _copy(self) -> None:
        if self._shown is not None:
            QGuiApplication.clipboard().setText(self._shown.text)

    def cancel_job(self) -> None:
        for job in self.jobs.running()[-1:]:
            job.cancel()
            self.notices.inform(f"{job.label}: cancelled")


_KEY = "Ctrl+R"


class RecordingBadge:
    def __init__(self, status: RecordingStatus, services: Services) -> None:
        self.status = status
        self.badge: QPushButton = controls.button("", lambda: open_folder(status.folder, services), "rec")
        self.button: QPushButton = controls.button("", status.toggle)
        self._text = RecordingText()

    def refresh(self, snapshot: SessionSnapshot) -> None:
        self._text = found = self.status.text(snapshot)
        controls.set_state(self.badge, found.state)
        self.badge.setToolTip(controls.as_words(found.tip))
        self.badge.setAccessibleName(f"Recording: {found.text or 'none'}")
        self.badge.setVisible(bool(found.text))
        controls.set_text(self.button, found.button)
        self.button.setToolTip(controls.as_words(f"{'Stop recording' if found.text else found.tip} ({_KEY})"))
        self.button.setAccessibleName("Stop recording" if found.text else "Record")
        self.button.setVisible(bool(found.button))

    def fold(self, level: int) -> None:
        found = self._text
        controls.set_text(self.badge, (found.least, found.short, found.text)[level])

    def lengths(self) -> tuple[object, ...]:
        """Return what the width depends on: digits have one width."""
        return len(self._text.text), len(self._text.short), self._text.button
