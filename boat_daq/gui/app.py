"""Start of the window: one application, one session, one application model, one window with its commands."""

from __future__ import annotations

import signal
import sys
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import QLocale
from PySide6.QtWidgets import QApplication

from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import home, load_settings
from boat_daq.gui import actions, style
from boat_daq.gui.collector import Collector
from boat_daq.gui.main_window import MainWindow
from boat_daq.viewmodels.app_model import AppModel

INTERRUPTED = 130  # a shell's code for Ctrl-C


def make_application() -> QApplication:
    """Return the one application with the program's font and base style."""
    app = QApplication.instance()
    if not isinstance(app, QApplication):
        app = QApplication(sys.argv[:1])
    app.setApplicationName("boat-daq")
    app.setDesktopFileName("boat-daq")
    app.setStyle("Fusion")
    app.setFont(style.base_font())
    QLocale.setDefault(QLocale.c())
    return app


def make_window(rate_hz: int | None = None) -> MainWindow:
    """Return a window on a new session with the stored settings, at another rate where one is given.

    Raises
    ------
    OperatorError : the stored settings are refused, by key.
    """
    stored = load_settings()
    settings = replace(stored, rate_hz=rate_hz or stored.rate_hz)
    recordings = Path(settings.recordings).expanduser() if settings.recordings else Path.cwd() / "recordings"
    return window_on(AppModel(Session(settings), home("config"), recordings))


def window_on(model: AppModel) -> MainWindow:
    """Return the window on `model`, with its commands."""
    window = MainWindow(model)
    actions.register(window)
    return window


def run(port: str | None = None, *, board: bool = False, speed: float = 1.0, rate_hz: int | None = None) -> int:
    """Open the window, connected to `port` or to a virtual board where asked; returns the exit code.

    Raises
    ------
    OperatorError : the stored settings or the rate are refused, by key.
    """
    app = make_application()
    window = make_window(rate_hz)
    model = window.model
    Collector(window, window.page_made)
    window.fit_screen()
    window.show()
    if board:
        model.notices.attempt(lambda: model.connection.start_virtual_board(speed=speed))
    elif port:
        model.notices.attempt(lambda: model.connection.connect(port))
    interrupted = []

    def stop(*_: object) -> None:
        interrupted.append(True)
        window.close()  # vents, and closes the recording

    for number in (signal.SIGINT, signal.SIGTERM):  # handled between two ticks; an exception would be lost in a slot
        signal.signal(number, stop)
    code = app.exec()
    return INTERRUPTED if interrupted else code
