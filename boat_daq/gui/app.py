"""Start of the window: one application, one session, one application model, one window with its commands.

Python's garbage collection is moved to the window's thread meanwhile.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

from PySide6.QtCore import (
    QLocale,
    QMessageLogContext,
    QObject,
    QTimer,
    QtMsgType,
    SignalInstance,
    qInstallMessageHandler,
)
from PySide6.QtGui import QIcon
from PySide6.QtWidgets import QApplication

from boat_daq.engine.link.reader import raise_priority
from boat_daq.engine.screen import WITHOUT_WINDOW
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, home, load_settings, recordings_folder
from boat_daq.gui import actions, style
from boat_daq.gui.main_window import MainWindow
from boat_daq.viewmodels.app_model import AppModel
from protocol.base.errors import RequestError

EVERY_MS = 1000
SETTLED_MS = 3000  # after which a new page has loaded what it needs
INTERRUPTED = 130  # a shell's code for Ctrl-C


class Collector(QObject):
    """Python's garbage collection while the window is open: on the thread of `parent` only, in short steps.

    By default it runs on whichever thread allocates next, mostly the reading thread; a widget or a timer that is
    garbage is then deleted on a foreign thread, and Qt may still call it. A full collection also visits the million
    objects that live as long as the window, which froze the plots for 130 ms: what window and libraries have loaded,
    page by page, is left out.

    Parameters
    ----------
    parent : object destroyed with the window; collection is then automatic again.
    """

    def __init__(self, parent: QObject, page_made: SignalInstance) -> None:
        super().__init__(parent)
        gc.disable()
        self.destroyed.connect(lambda *_: gc.enable())
        self.due, self.settled = QTimer(self), QTimer(self, singleShot=True, interval=SETTLED_MS)
        self.due.timeout.connect(self.collect)
        self.settled.timeout.connect(self.settle)
        self.due.start(EVERY_MS)
        page_made.connect(self.settled.start)
        self.settled.start()

    def collect(self) -> None:
        """Collect the oldest generation that is due by Python's own thresholds."""
        for generation in (2, 1, 0):
            if gc.get_count()[generation] > gc.get_threshold()[generation]:
                gc.collect(generation)
                return

    def settle(self) -> None:
        """Collect all, and exempt what is left from later collections."""
        gc.collect()
        gc.freeze()


def _report(kind: QtMsgType, _: QMessageLogContext, text: str) -> None:
    """Print what Qt reports while it starts; leave with exit code 1 where it would abort the process."""
    fatal = kind == QtMsgType.QtFatalMsg
    print(f"error: Qt cannot open a window: {text.splitlines()[0]}" if fatal else text, file=sys.stderr)
    if fatal:
        print(f"  try: {WITHOUT_WINDOW}", file=sys.stderr, flush=True)
        os._exit(1)


def make_application() -> QApplication:
    """Return the one application with the program's font and base style."""
    app = QApplication.instance()
    if not isinstance(app, QApplication):
        qInstallMessageHandler(_report)
        app = QApplication(sys.argv[:1])
        qInstallMessageHandler(None)
    app.setApplicationName("boat-daq")
    app.setDesktopFileName("boat-daq")
    app.setWindowIcon(QIcon(str(style.HERE / "boat-daq.svg")))
    app.setStyle("Fusion")
    app.setFont(style.font())
    QLocale.setDefault(QLocale.c())
    return app


def make_window(rate_hz: int | None = None) -> MainWindow:
    """Return a window on a new session with the stored settings, at another rate where one is given.

    Stored settings that are refused open it in safe mode: the defaults are used, and a bar names the cause.
    """
    refused: RequestError | None = None
    try:
        stored = load_settings()
    except RequestError as error:
        stored, refused = Settings(), error
    settings = replace(stored, rate_hz=rate_hz or stored.rate_hz)
    model = AppModel(Session(settings), home("config"), recordings_folder(settings))
    model.settings.refused = refused
    for key in ("unit", "port", "profile"):  # proposed until another one was used
        if (proposed := getattr(settings, key)) and not model.preferences.get(key, ""):
            model.preferences.set(key, proposed)
    return window_on(model)


def window_on(model: AppModel) -> MainWindow:
    """Return the window on `model`, with its commands."""
    window = MainWindow(model)
    actions.register(window)
    return window


def run(
    port: str | None = None,
    *,
    board: bool = False,
    profile: str = "",
    file: Path | None = None,
    first_steps: bool = False,
) -> int:
    """Open the window, connected to `port` or to a virtual board where asked; returns the exit code.

    Parameters
    ----------
    profile : path of the text profile of the firmware on `port`.
    first_steps : whether to show them, whatever page was left.
    """
    raise_priority()  # Python's lock, which the reading thread waits for, is mostly held by this one
    app = make_application()
    window = make_window()
    model = window.model
    Collector(window, window.page_made)
    model.compile_ahead()
    model.notices.attempt(model.windows.join)
    window.fit_screen()
    window.show()
    if first_steps:
        window.live.show_first_steps()
    if board:
        model.notices.attempt(lambda: model.connection.start_virtual_board(speed=1.0))
    elif port:
        model.notices.attempt(lambda: model.connection.connect(port, profile))
    if file is not None:
        model.notices.attempt(lambda: window.open_file(file.absolute()))
    interrupted = []

    def stop(*_: object) -> None:
        interrupted.append(True)
        window.close()  # vents, and closes the recording

    hangup = getattr(signal, "SIGHUP", None)  # nohup has it ignored
    closing = () if hangup is None or signal.getsignal(hangup) == signal.SIG_IGN else (hangup,)
    for number in (
        signal.SIGINT,
        signal.SIGTERM,
        *closing,
    ):  # handled between two ticks; an exception would be lost in a slot
        signal.signal(number, stop)
    code = app.exec()
    return INTERRUPTED if interrupted else code
