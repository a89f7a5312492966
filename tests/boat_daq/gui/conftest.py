"""A window on a session that only shows; closed after each test, so that no timer outlives it."""

from __future__ import annotations

import gc
import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from boat_daq.engine.snapshot import SessionState
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring, idle, window_on
from tests.boat_daq.gui.windows import RAMPING, close_all

if TYPE_CHECKING:
    from boat_daq.gui.main_window import MainWindow


_TESTS = itertools.count(1)


@pytest.fixture(scope="session", autouse=True)
def _modules_are_no_garbage() -> None:
    """Leave the modules out of every later collection: each window's end has one, and they are most of it."""
    import boat_daq.gui.actions

    assert boat_daq.gui.actions
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _garbage_between_tests() -> Iterator[None]:
    """Collect garbage between tests, as the window does between events: within a call of Qt it can wait for ever."""
    gc.disable()
    yield
    gc.collect(2 if next(_TESTS) % 20 == 0 else 1)
    gc.enable()


@pytest.fixture
def make(qtbot, tmp_path):
    """Return a function that opens the window on a recorded session."""
    from boat_daq.gui.app import make_application

    make_application()

    def build(session: RecordedSession) -> MainWindow:
        window = window_on(session, tmp_path)
        windows.append(window)
        window.show()
        qtbot.waitExposed(window)
        return window

    windows: list[MainWindow] = []
    yield build
    close_all(windows)


@pytest.fixture
def live(make):
    """A window on a connected board with five minutes of signals."""
    return make(RecordedSession(connected(), filled_ring(300.0)))


@pytest.fixture
def whole(live):
    """A window on a connected board with every page made."""
    from boat_daq.viewmodels.common.services import PLACES

    for name in PLACES:
        live.open_page(name)
    return live


@pytest.fixture
def empty(make):
    """A window with nothing connected."""
    return make(RecordedSession(idle()))


@pytest.fixture
def running(live):
    """A window in a run that stops at its plateaus for readings, between two of them."""
    live.resize(1280, 800)
    live.model.sequence.arm()
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    return live
