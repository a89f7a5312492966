"""The strip at the foot: the one thing that needs attention, its remedy, its button; long work and its cancel."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QHBoxLayout, QPlainTextEdit, QProgressBar, QSizePolicy, QVBoxLayout, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.tooltips import as_words
from boat_daq.viewmodels.common.jobs import JobRunner
from boat_daq.viewmodels.common.notices import SHAPES, WORDS, Notice, Notices, Severity

LEVELS = {Severity.INFORMATION: "information", Severity.WARNING: "warning", Severity.FAULT: "fault"}


class Strip(QWidget):
    """The strip; `refresh` shows what stands."""

    def __init__(self, notices: Notices, jobs: JobRunner) -> None:
        super().__init__()
        self.notices, self.jobs = notices, jobs
        self._shown: Notice | None = None
        self.setObjectName("strip")
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.mark = widgets.label()
        self.text = widgets.label(name="What needs attention")
        self.text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # the buttons keep their room
        self.text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.act = widgets.button("", self.do_it, name="Do what the message proposes")
        self.more = widgets.button("Details", self._toggle_details, "link")
        self.copy = widgets.button("Copy", self._copy, "link", name="Copy the message")
        self.close_ = widgets.button("Dismiss", self.dismiss, "link", name="Dismiss the message")
        self.behind = widgets.label("", "small")
        self.work = widgets.label("", "muted")
        self.bar = QProgressBar()
        self.bar.setFixedWidth(style.VENT_WIDTH)
        self.bar.setAccessibleName("Progress")
        self.cancel = widgets.button("Cancel", self.cancel_work, name="Cancel the work under way")
        self.details = QPlainTextEdit()
        self.details.setReadOnly(True)
        self.details.setAccessibleName("Details of the message")
        self.details.setFixedHeight(4 * style.STRIP_HEIGHT)
        self.details.hide()
        self._lay_out()
        self._show(None)

    def _lay_out(self) -> None:
        line = QHBoxLayout()
        line.setContentsMargins(style.PAGE_MARGIN, 0, style.PAGE_MARGIN, 0)
        line.setSpacing(style.GAP)
        line.addWidget(self.mark)
        line.addWidget(self.text, 1)
        for widget in (self.behind, self.act, self.more, self.copy, self.close_, self.work, self.bar, self.cancel):
            line.addWidget(widget)
        head = QWidget()
        head.setFixedHeight(style.STRIP_HEIGHT)
        head.setLayout(line)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.setSpacing(0)
        whole.addWidget(head)
        whole.addWidget(self.details)

    def refresh(self) -> None:
        """Show the weightiest notice and the work under way."""
        notice = self.notices.current()
        if notice is not self._shown:
            self._show(notice)
        waiting = self.notices.waiting()
        widgets.set_text(self.behind, f"{waiting} more" if waiting else "")
        self._show_work()

    def _show(self, notice: Notice | None) -> None:
        self._shown = notice
        self.details.hide()
        level = LEVELS[notice.level] if notice else ""
        widgets.set_state(self, level, "level")
        self.mark.setText(f"{SHAPES[notice.level]}  {WORDS[notice.level]}" if notice else "")
        widgets.set_state(self.mark, {"warning": "warning", "fault": "fault"}.get(level, "ok"))
        self.text.setText(" ".join(sentence(part) for part in (notice.cause, notice.remedy) if part) if notice else "")
        self.text.setToolTip(as_words(notice.text) if notice else "")
        self.act.setText(notice.action_text if notice else "")
        self.act.setVisible(bool(notice and notice.action))
        self.more.setVisible(bool(notice and notice.details))
        standing = bool(notice and notice.level is not Severity.INFORMATION)
        self.copy.setVisible(standing)
        self.close_.setVisible(notice is not None and notice.stays)
        self.details.setPlainText(notice.text if notice else "")

    def _show_work(self) -> None:
        running = self.jobs.running()
        for widget in (self.work, self.bar, self.cancel):
            widget.setVisible(bool(running))
        if running:
            work = running[-1]
            widgets.set_text(self.work, work.label)
            self.bar.setRange(0, 0 if work.fraction is None else 1000)
            if work.fraction is not None:
                self.bar.setValue(work.permille)

    def offers(self) -> bool:
        """Whether the message proposes a deed."""
        return self._shown is not None and self._shown.action is not None

    def stands(self) -> bool:
        """Whether a message stands."""
        return self._shown is not None

    def works(self) -> bool:
        """Whether work is under way."""
        return bool(self.jobs.running())

    def do_it(self) -> None:
        """Do what the message proposes."""
        notice = self._shown
        if notice is not None and notice.action is not None:
            self.notices.dismiss(notice)
            self.notices.attempt(notice.action)

    def dismiss(self) -> None:
        """Take the message away."""
        if self._shown is not None:
            self.notices.dismiss(self._shown)
        self.refresh()

    def _copy(self) -> None:
        if self._shown is not None:
            QGuiApplication.clipboard().setText(self._shown.text)

    def _toggle_details(self) -> None:
        self.details.setVisible(not self.details.isVisible())

    def cancel_work(self) -> None:
        """Cancel the newest piece of work."""
        running = self.jobs.running()
        if running:
            running[-1].cancel()


def sentence(text: str) -> str:
    """Return `text` as a sentence."""
    text = text.strip()
    place = "/" in text.partition(" ")[0]  # a port or a file is written as it is
    head = text if place else text[:1].upper() + text[1:]
    return head if head.endswith((".", "!", "?", "\u2026")) else f"{head}."
