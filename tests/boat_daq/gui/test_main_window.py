"""The window: pages, keys, names, undo, themes, nothing modal."""

from __future__ import annotations

import pytest
from PySide6.QtWidgets import QDialog, QPushButton

from boat_daq.gui import style
from boat_daq.viewmodels.common.services import PLACES, Panel
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import ASKED
from tests.conftest import mostly_at_night


def test_no_dialog_is_modal(live):
    """No panel of the window stops the rest of it."""
    live.show_keys()
    live.live.open_photograph()
    live.show_place(Panel.CONNECT)
    assert [dialog for dialog in live.findChildren(QDialog) if dialog.isModal()] == []


def test_every_plot_saves(live, tmp_path):
    """The live plots save as picture, vectors and undecimated numbers."""
    live.refresh()
    live.draw()
    for suffix, head in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("csv", b"time_s,pressure_kpa")):
        path = tmp_path / f"plot.{suffix}"
        live.live.plots.save(path)
        assert path.read_bytes().startswith(head)
    times = [float(row.split(",")[0]) for row in (tmp_path / "plot.csv").read_text().splitlines()[1:]]
    assert len(times) == round((times[-1] - times[0]) * 100) + 1  # every sample at 100 Hz
    column_s = 60.0 / live.live.plots.width()  # the picture ends at a whole column of pixels
    assert 60.0 - 2 * column_s <= times[-1] - times[0] <= 60.0


def test_window_restores_its_state(make, tmp_path):
    """Page, length of the picture and theme are there again at the next start."""
    first = make(RecordedSession(connected(), filled_ring(10.0)))
    first.go("Recordings")
    first.live.model.set_window(300.0)
    first.choose_theme("dark")
    first.close()
    second = make(RecordedSession(connected(), filled_ring(10.0)))
    assert second.page == "Recordings"
    assert second.model.live.window_s == 300.0
    assert second.theme is style.DARK


@pytest.mark.fault(54, how="the window on the virtual board", times=1)
def test_simulated_board_is_marked(live):
    """A simulated board is named in the header and in the title."""
    live.refresh()
    assert live.header.simulated.isVisible()
    assert "SIMULATED" in live.windowTitle()


def test_waiting_reading_is_marked_on_every_page(running):
    """F6 on the Calibrate page used to start a run whose plateau waited for a reading without a prompt."""
    running.go("Recordings")
    running.model.run.press("start")
    assert running.page == "Measure"
    running.model.session.change(waiting_for_reading=ASKED)
    running.refresh()
    live = running.navigation.buttons["Measure"]
    assert live.text() == "Measure"
    running.go("Recordings")
    running.refresh()
    assert live.text() != "Measure"
    assert live.accessibleName() == "Measure: a reading is due"
    running.go("Measure")
    running.refresh()
    assert (live.text(), live.accessibleName()) == ("Measure", "Measure")


@pytest.mark.parametrize("state", mostly_at_night("running", "empty", "live"))
def test_each_page_has_one_primary_button_at_most(request, state):
    """What to do next is marked once; two accents are none."""
    window = request.getfixturevalue(state)
    window.model.optics.choose = lambda *_: None
    for page in PLACES:
        window.go(page)
        primary = [b for b in window.findChildren(QPushButton) if b.property("role") == "primary" and b.isVisible()]
        assert len(primary) <= 1, (page, [button.text() for button in primary])
