"""Panels that fail one by one: the place of a failing panel shows the cause, and the others are drawn all the same."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QWidget

from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common.notices import Notices


class PanelGuard:
    """Shows panels; an error of one is shown in its place, noticed and logged once, until it can be shown again."""

    def __init__(self, notices: Notices) -> None:
        self._notices = notices
        self._covers: dict[tuple[QWidget, str], QLabel] = {}  # by panel and what of it fails

    def show(self, panel: QWidget, name: str, work: Callable[[], object]) -> None:
        """Run `work`, which shows `panel`; where it fails, cover the panel with the cause."""
        try:
            work()
        except Exception as error:  # noqa: BLE001 - no error of one panel may stop the others
            self._cover(panel, name, error)
        else:
            if (panel, name) in self._covers:
                self._covers.pop((panel, name)).deleteLater()

    def _cover(self, panel: QWidget, name: str, error: Exception) -> None:
        if (panel, name) not in self._covers:
            cover = self._covers[panel, name] = controls.label("", "set", name=f"{name} cannot be shown", wrap=True)
            cover.setParent(panel)
            cover.setAutoFillBackground(True)
            cover.setAlignment(Qt.AlignmentFlag.AlignCenter)
            self._notices.attempt(partial(_raise, error))  # to the strip and the log, with its traceback
        cover = self._covers[panel, name]
        cause = f"{type(error).__name__}: {error}"
        controls.set_text(cover, f"{name} cannot be shown: {cause}\nThe recording and the other panels continue.")
        cover.setGeometry(panel.rect())
        cover.show()
        cover.raise_()


def _raise(error: Exception) -> None:
    raise error
