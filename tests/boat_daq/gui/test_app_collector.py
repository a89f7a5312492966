"""What is garbage ends on the window's thread, soon and cheaply; a closed window leaves nothing behind."""

from __future__ import annotations

import gc
import threading
import weakref

import pytest
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QApplication

from boat_daq.gui.app import Collector, make_window
from boat_daq.viewmodels.common.services import PLACES
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring, window_on


@pytest.fixture
def collected(qtbot):
    """A window at 10 kHz and its collector."""
    window = make_window(10_000)
    collector = Collector(window, window.page_made)
    yield window, collector
    collector.settled.stop()
    gc.unfreeze()
    window.close()
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


def test_a_closed_window_leaves_nothing_behind(qtbot, tmp_path):
    """Its samples are free again and none of its widgets is left, whatever signals its plots exchanged."""
    qtbot.wait(1)
    before = set(QApplication.allWidgets())
    session = RecordedSession(connected(), filled_ring(10.0))
    ring, window = weakref.ref(session.live.ring), window_on(session, tmp_path)
    for name in PLACES:
        window.open_page(name)
    window.show()
    qtbot.waitExposed(window)
    window.close()
    window.deleteLater()
    del session, window
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    gc.collect()
    assert ring() is None
    assert set(QApplication.allWidgets()) <= before


def test_what_lives_as_long_as_the_window_is_not_collected_again(collected):
    """After the start, and after each page that is made, a full collection has next to nothing to look at."""
    window, collector = collected
    assert window.model.session.settings.rate_hz == 10_000
    assert collector.settled.isActive()
    collector.settled.stop()
    collector.settle()
    assert len(gc.get_objects()) < 0.1 * gc.get_freeze_count()
    window.open_page("Recordings")
    assert collector.settled.isActive()


def test_garbage_ends_on_the_windows_thread(collected):
    """What the window drops is not collected on another thread: a timer must be deleted on its own thread."""
    _, collector = collected
    ends: list[int] = []

    class Dropped:
        def __init__(self) -> None:
            self.itself = self

        def __del__(self) -> None:
            ends.append(threading.get_ident())

    kept: list[list[int]] = []

    def allocate() -> None:
        kept.extend([n] for n in range(50 * gc.get_threshold()[0]))

    Dropped()
    busy = threading.Thread(target=allocate)
    busy.start()
    busy.join()
    assert not ends
    collector.collect()
    assert ends == [threading.get_ident()]


def test_python_collects_by_itself_again_once_the_window_is_gone(qtbot):
    """Scripts and tests that open a window and close it are left as they were."""
    window = make_window()
    Collector(window, window.page_made)
    assert not gc.isenabled()
    window.close()
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    assert gc.isenabled()
