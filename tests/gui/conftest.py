"""A window on a session that only shows; closed after each test, so that no timer outlives it."""

from __future__ import annotations

import pytest
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QApplication

from tests.gui.recorded_session import RecordedSession, connected, filled_ring, idle


@pytest.fixture
def make(qtbot, tmp_path):
    """Return a function that opens the window on a recorded session."""
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.gui.app import make_application
    from boat_daq.gui.main_window import MainWindow
    from boat_daq.viewmodels.desk import Desk

    make_application()

    def build(session: RecordedSession) -> MainWindow:
        desk = Desk(session, tmp_path / "config", tmp_path / "recordings", UnitLibrary(tmp_path / "units"))
        desk.shadow.prepare = lambda: None  # a helper process has no place in these tests
        window = MainWindow(desk)
        windows.append(window)
        window.show()
        qtbot.waitExposed(window)
        return window

    windows: list[MainWindow] = []
    yield build
    for window in windows:
        window.close()
        window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)  # else each window slows the next one down


@pytest.fixture
def live(make):
    """A window on a connected board with five minutes of signals."""
    return make(RecordedSession(connected(), filled_ring(300.0)))


@pytest.fixture
def whole(live):
    """A window on a connected board with every page made."""
    from boat_daq.viewmodels.desk import PAGES

    for name in PAGES:
        live.open_page(name)
    return live


@pytest.fixture
def empty(make):
    """A window with nothing connected."""
    return make(RecordedSession(idle()))
