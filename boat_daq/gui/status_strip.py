"""The status strip at the foot: the most severe notice, its remedy and action; the running job and its cancel."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QPlainTextEdit, QProgressBar, QSizePolicy, QWidget

from boat_daq.gui import style
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.controls import as_words
from boat_daq.viewmodels.common.jobs import JobRunner
from boat_daq.viewmodels.common.notices import TITLES, Notice, Notices, Severity


class Strip(QWidget):
    """The strip; `refresh` shows the current notice and the newest job."""

    def __init__(self, notices: Notices, jobs: JobRunner) -> None:
        super().__init__()
        self.notices, self.jobs = notices, jobs
        self._shown: Notice | None = None
        self.mark = widgets.label()
        self.text = widgets.label(name="What needs attention")
        self.text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)  # the buttons are never cut
        self.text.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.act = widgets.button("", self.apply, name="Apply suggested action")
        self.more = widgets.button("Details", self._toggle_details, "link")
        self.copy = widgets.button("Copy", self._copy, "link", name="Copy message")
        self.close_ = widgets.button("Dismiss", self.dismiss, "link", name="Dismiss message")
        self.behind = widgets.label("", "small")
        self.work = widgets.label("", "muted")
        self.bar = QProgressBar()
        self.bar.setFixedWidth(style.VENT_WIDTH)
        self.bar.setAccessibleName("Progress")
        self.cancel = widgets.button("Cancel", self.cancel_job, name="Cancel task")
        self.details = QPlainTextEdit(readOnly=True)
        self.details.setAccessibleName("Details of the message")
        self.details.setFixedHeight(4 * style.STRIP_HEIGHT)
        self._lay_out()
        self._show(None)

    def _lay_out(self) -> None:
        line = widgets.row(
            self.mark, (self.text, 1), self.behind, self.act, self.more, self.copy, self.close_, self.work, self.bar,
            self.cancel, margins=(style.PAGE_MARGIN, 0, style.PAGE_MARGIN, 0),
        )  # fmt: skip
        head = QWidget()
        head.setFixedHeight(style.STRIP_HEIGHT)
        head.setLayout(line)
        widgets.surface(self, "strip", widgets.column(head, self.details, spacing=0, margins=(0, 0, 0, 0)))

    def refresh(self) -> None:
        """Show the most severe notice and the newest job."""
        notice = self.notices.current()
        if notice is not self._shown:
            self._show(notice)
        waiting = self.notices.waiting()
        widgets.set_text(self.behind, f"{waiting} more" if waiting else "")
        running = self.jobs.running()
        for widget in (self.work, self.bar, self.cancel):
            widget.setVisible(bool(running))
        if running:
            job = running[-1]
            widgets.set_text(self.work, job.label)
            self.bar.setRange(0, 0 if job.fraction is None else 1000)
            self.bar.setValue(job.permille)

    def _show(self, notice: Notice | None) -> None:
        self._shown = notice
        severity = notice.severity.name.lower() if notice else ""
        widgets.set_state(self, severity, "level")
        widgets.set_state(self.mark, severity if severity in ("warning", "fault") else "ok")
        self.mark.setText(TITLES[notice.severity] if notice else "")
        self.text.setText(notice.sentences if notice else "")
        self.text.setToolTip(as_words(notice.text) if notice else "")
        self.act.setText(notice.action_text if notice else "")
        self.details.setPlainText(notice.text if notice else "")
        self.details.hide()
        self.act.setVisible(self.has_action())
        self.more.setVisible(bool(notice and notice.details))
        self.copy.setVisible(bool(notice and notice.severity is not Severity.INFORMATION))
        self.close_.setVisible(bool(notice and notice.stays))

    def has_action(self) -> bool:
        """Return whether the notice suggests an action."""
        return self._shown is not None and self._shown.action is not None

    def has_notice(self) -> bool:
        """Return whether a notice is shown."""
        return self._shown is not None

    def has_job(self) -> bool:
        """Return whether a job runs."""
        return bool(self.jobs.running())

    def apply(self) -> None:
        """Run the action that the notice suggests."""
        notice = self._shown
        if notice is not None and notice.action is not None:
            self.notices.dismiss(notice)
            self.notices.attempt(notice.action)

    def dismiss(self) -> None:
        """Dismiss the notice."""
        self.notices.dismiss(self._shown)
        self.refresh()

    def _copy(self) -> None:
        if self._shown is not None:
            QGuiApplication.clipboard().setText(self._shown.text)

    def _toggle_details(self) -> None:
        self.details.setVisible(not self.details.isVisible())

    def cancel_job(self) -> None:
        """Cancel the newest job."""
        for job in self.jobs.running()[-1:]:
            job.cancel()
