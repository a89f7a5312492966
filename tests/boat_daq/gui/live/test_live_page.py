"""The live page: first steps, plots, cursors, markers, pane."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QApplication,
    QScrollBar,
)

from boat_daq.engine.snapshot import HealthSnapshot, LinkState
from boat_daq.gui import style
from boat_daq.viewmodels.live.live_model import HEADINGS_SHORT
from boat_daq.workflows.live_conversion import LiveElongation
from protocol.base.units import NOTHING
from protocol.link.events import LinkStatistics
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import PATIENCE_MS


def test_tab_beside_the_plots_is_restored(make, qtbot):
    """Plan, shadow or readings: the next start shows the tab that was open."""
    first = make(RecordedSession(connected(), filled_ring(5.0)))
    first.live.pane.setCurrentWidget(first.live.plan)
    first.close()
    again = make(RecordedSession(connected(), filled_ring(5.0)))
    assert again.live.pane.currentWidget() is again.live.plan


@pytest.mark.nightly
@pytest.mark.parametrize("index", range(3))
def test_pane_beside_the_plots_does_not_scroll_sideways(live, qtbot, index):
    """Fields, units and words of the pane are whole at 150 % on 1280 x 800."""
    live.resize(853, 533)
    live.live.pane.setCurrentIndex(index)
    live.refresh()
    qtbot.waitUntil(lambda: live.scrolls["Measure"].horizontalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    bars = [bar for bar in live.live.pane.findChildren(QScrollBar) if bar.orientation() is Qt.Orientation.Horizontal]
    assert [bar.maximum() for bar in bars if bar.isVisible()] == []


def test_small_window_shows_the_statistics_in_a_tab(live):
    """Between the cursors at 853 x 533: every figure is beside the plots, whole, and nothing is pushed out."""
    live.resize(853, 533)
    live.model.live.inverse = lambda mv: LiveElongation(
        (mv[:, 0] - 1638) / 40, np.full(len(mv), 0.1), np.zeros(len(mv), bool)
    )
    page = live.live
    before = page.pane.currentWidget()
    for which in "ab":
        page.plots.place_cursor(which)
    live.refresh()
    for _ in range(2):  # the resize, then the layout in the smaller digits
        QApplication.processEvents()
    assert page.between.isVisible()
    assert not page.spans.isVisible()
    assert page.between.sizeHint().width() <= page.between.width()
    assert page.between.sizeHint().height() <= page.between.height()
    shown = page.between.text()  # two quantities beside each other, the others below: no columns that run together
    quantities = ("Sensor 1", "Sensor 2", "Elongation", "Pressure", "mV", "mm", "kPa")
    assert all(f">{words}<" in shown for words in (*HEADINGS_SHORT, *quantities))
    scroll = live.scrolls["Measure"]
    assert (scroll.horizontalScrollBar().maximum(), scroll.verticalScrollBar().maximum()) == (0, 0)
    page.plots.place_cursor("a")
    live.refresh()
    assert page.pane.currentWidget() is before


def test_first_start_shows_the_first_steps(empty):
    """Without a sample the live page lists the first steps, the virtual board among them."""
    empty.refresh()
    assert empty.live.first_steps.isVisible()
    assert empty.live.first_steps.virtual.text() == "Start the virtual board"


def test_first_sample_replaces_the_first_steps(live):
    """With samples the plots replace the steps, and hold the newest sample."""
    live.refresh()
    live.draw()
    assert live.live.plots.isVisible()
    assert live.live.plots.curves["s1_mv"].x[-1] == pytest.approx(299.99)


def test_frozen_plot_keeps_recording(live):
    """A frozen display keeps its range while samples arrive."""
    live.live.model.toggle_freeze()
    before = live.model.live.span_s()
    ring = filled_ring(400.0)
    live.model.session.live.ring = ring
    assert live.model.live.span_s() == before
    live.live.model.toggle_freeze()
    assert live.model.live.span_s()[1] == pytest.approx(399.99)


def test_readouts_keep_their_places(live):
    """A long note, a lost link, a value of another length: Pressure used to jump by 50 px."""
    for size in ((853, 533), (1280, 800), (1920, 1080)):
        live.resize(*size)
        places: set[tuple[tuple[int, int], ...]] = set()
        for mm, apart, link, stand_in in (
            (1.0, False, LinkState.UP, ""),
            (-12.5, False, LinkState.UP, "U rests on a stated stand-in"),
            (-12.5, True, LinkState.UP, ""),
            (np.nan, False, LinkState.LOST, ""),
        ):
            live.model.live.inverse = lambda mv, mm=mm, apart=apart, stand_in=stand_in: LiveElongation(
                np.full(len(mv), mm), np.full(len(mv), 0.1), np.full(len(mv), apart), stand_in=stand_in
            )
            live.model.session.change(link=link)
            live.refresh()
            QApplication.processEvents()
            figures = [figure for figure in live.live.figures.values() if figure.isVisible()]
            places.add(tuple((figure.x(), figure.width()) for figure in figures))
            assert all(f.note.width() >= f.note.sizeHint().width() for f in figures if f.note.text())
        assert len(places) == 1
        head = live.live.figure_line.geometry()
        assert max(figure.geometry().right() for figure in figures) <= head.right()
        assert live.scrolls["Measure"].horizontalScrollBar().maximum() == 0


def test_values_and_curves_of_a_lost_board_are_grey_with_their_age(live):
    """What was measured before the link went is not shown as what is: grey, with its age, until data come again."""
    page, seen = live.live, []
    live.draw()
    for link in (LinkState.UP, LinkState.LOST, LinkState.UP):
        health = HealthSnapshot(LinkStatistics(), 100.0, 100.0, 75.0, 3.0, None, None, None, ())
        live.model.session.change(link=link, health=health)
        live.refresh()
        values = [page.figures[name].value for name in ("s1", "s2", "kpa", "target")]
        assert (NOTHING in {value.text() for value in values}) is (link is LinkState.LOST)  # the pressure is unknown
        opacity = {curve.item.opacity() for curve in page.plots.curves.values()}
        spoken = values[0].accessibleName().endswith("1:15 ago")
        seen.append(({v.property("state") or "" for v in values}, opacity, page.plots.heading.text(), spoken))
    fresh = ({""}, {1.0}, "", False)
    assert seen == [fresh, ({"off"}, {style.STALE_OPACITY}, "Last data 1:15 ago", True), fresh]
    assert page.figures["mm"].note.text() == ""


def test_unplugged_board_shows_no_pressure(live):
    """Unplugged at +30 kPa it went on showing 30.0; the last value stays beside it, with its age elsewhere."""
    health = HealthSnapshot(LinkStatistics(), 100.0, 100.0, 12.0, 3.0, None, None, None, ())
    live.model.session.change(health=health)
    live.refresh()
    before = live.live.figures["kpa"].value.text()
    figures = live.live.figures
    for link in (LinkState.LOST, LinkState.OPENING):  # while it is sought, its port is opened again and again
        live.model.session.change(link=link)
        live.refresh()
        assert figures["kpa"].note.text() == f"was {before}"
        assert {figure.value.text() for figure in figures.values()} == {NOTHING}
    assert live.live.sequence.state.text() == "\u25a0 Link lost, pressure unknown"


def test_frozen_plots_say_so_and_follow_again(live):
    """A whole run showed the old picture; the only sign was a tinted button. The banner moves nothing else."""
    page = live.live
    live.resize(853, 600)
    live.refresh()
    QApplication.processEvents()
    before = page.window_choice.geometry(), page.plots.view.geometry().top()
    page.model.toggle_freeze()
    live.refresh()
    assert page.frozen.isVisible()
    assert not page.freeze.isVisible()
    QApplication.processEvents()
    QApplication.processEvents()
    after = page.window_choice.geometry(), page.plots.view.geometry().top()
    assert after[0].x() == before[0].x()
    assert abs(after[1] - before[1]) <= 4  # its frame
    assert live.scrolls["Measure"].horizontalScrollBar().maximum() == 0
    assert page.frozen.width() >= page.frozen.sizeHint().width()
    page.follow.click()
    live.refresh()
    assert (page.frozen.isVisible(), page.model.following) == (False, True)


def test_arm_is_not_the_next_step_while_something_is_held(live):
    """Under closed loop at +28 kPa the primary button was Arm."""
    arm = live.live.sequence.buttons["arm"]
    live.refresh()
    assert (arm.isVisible(), arm.property("role")) == (True, "")
    last = dataclasses.replace(connected().last, target_kpa=float("nan"), pressure_kpa=0.1)
    live.model.session.change(last=last)
    live.refresh()
    assert arm.property("role") == "primary"
