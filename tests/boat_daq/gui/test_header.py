"""The header: link, unit, VENT."""

from __future__ import annotations

import math
from dataclasses import replace

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.engine.snapshot import (
    HealthSnapshot,
    LinkState,
    SessionState,
)
from boat_daq.gui.header import Vents
from protocol.link.events import LinkStatistics
from tests.boat_daq.gui.results.run_results import run_result
from tests.boat_daq.gui.windows import CALIBRATED, NARROW
from tests.protocol.link.streams import HELLO


def test_vent_is_not_cut_on_a_narrow_window(live):
    """At 853 px a simulated board's header was wider than the window, and VENT was cut."""
    live.resize(853, 500)
    live.refresh()
    QApplication.processEvents()
    header = live.header
    header.layout().activate()
    assert header.width() <= 853
    assert header.rect().contains(header.vent.geometry())
    assert not header.brand.isVisible()
    live.resize(1280, 800)
    QApplication.processEvents()
    assert header.brand.isVisible()


def test_header_is_never_cut(live):
    """At 853 px the figures of the link and the unit's calibration were cut; what is wrong is never left out."""
    health = HealthSnapshot(LinkStatistics(lost=12), 100.0, 100.0, 0.0, 3.0, None, None, None, ())
    live.model.session.change(hello=HELLO, health=replace(health, rate_hz=99.9, lag_ms=10851.0))
    live.refresh()
    assert "Delay 10.9 s" in live.header.link.toolTip()  # 10 851 ms was cut to m
    assert live.header.figures[0].text() == "99.9 Hz\u2007"  # as wide as 100.0 Hz
    live.model.session.change(health=health)
    live.model.unit.texts = lambda _: CALIBRATED
    head = live.header
    for width in (NARROW, 960, 1280):
        live.resize(width, 533)
        live.refresh()
        QApplication.processEvents()
        for widget in (head.link, head.unit, head.vent, *(f for f in head.figures if not f.isHidden())):
            assert widget.width() >= widget.sizeHint().width(), (width, widget.text())
            assert head.rect().contains(widget.geometry()), width
        assert "12 lost" in [f.text() for f in head.figures if f.isVisible()], width
        assert "Delay 3 ms" in head.link.toolTip()
        assert "2026-11-22" in head.unit.toolTip()
        assert head.unit.text() == CALIBRATED[2 if width == 1280 else 1], width
        room = head.width() - head._needed() - head.line.spacing()
        left_out = [f for f in head.figures if f.text() and f.isHidden()]
        assert all(f.sizeHint().width() > room for f in left_out), width  # none that would have room


def test_vent_acts_on_press(live):
    """The red button vents when it is pressed, not when it is let go."""
    QTest.mousePress(live.header.vent, Qt.MouseButton.LeftButton)
    assert live.model.session.calls == ["vent"]


def test_calibration_of_a_virtual_unit_is_not_shown_on_a_real_board(live):
    """A real board with a unit of that name used to read its elongation, without a mark."""
    model = live.model
    content = {"simulated": True, "sensors": [s.record.as_json() for s in run_result().sensors]}
    model.units.of(simulated=True).add_calibration("SA1", content)
    model.calibration.units_revision += 1
    live.refresh()
    assert "not calibrated" not in live.header.unit.text()
    model.session.change(simulated=False)
    live.refresh()
    assert live.header.unit.text() == "SA1  \u00b7  not calibrated"
    assert not live.header.simulated.isVisible()
    assert model.live.inverse is None


def test_narrow_header_does_not_cut_the_verdict_on_a_unit(live):
    """Not calibrated was cut to "not": only a date is left out."""
    live.resize(960, 533)
    live.model.unit.texts = lambda _: ("SA1", "SA1  \u00b7  not calibrated", "SA1  \u00b7  not calibrated")
    live.refresh()
    QApplication.processEvents()
    assert live.header.unit.text() in ("SA1  \u00b7  not calibrated", "SA1")


def test_unplugged_board_leaves_nothing_that_looks_current(live):
    """The header kept "100.0 Hz" and the shadow its verdict for as long as the board was away."""
    health = HealthSnapshot(LinkStatistics(lost=12), 100.0, 100.0, 75.0, 3.0, None, None, None, ())
    live.model.session.change(health=health)
    live.refresh()
    assert live.header.figures[0].text() == "100.0 Hz"
    live.model.session.change(link=LinkState.LOST)
    live.refresh()
    pane = live.live.shadow
    live.live.pane.setCurrentWidget(pane)
    live.refresh()
    assert (live.header.figures[0].text(), live.header.figures[0].property("state")) == ("Last data 1:15 ago", "off")
    assert (pane.names[0].text(), pane.values[0].text(), pane.view.stale) == ("Last data", "1:15 ago", True)
    assert {value.property("state") for value in pane.values if value.text()} == {"off"}
    live.model.session.change(link=LinkState.UP)
    live.refresh()
    assert (live.header.figures[0].text(), pane.view.stale) == ("100.0 Hz", False)


def test_pressure_is_seen_on_every_page(live):
    """Away from Measure a held pressure was seen nowhere; of a lost link none is shown, only that it is unknown."""
    live.go("Recordings")
    live.refresh()
    pressure, change = live.header.pressure, live.model.session.change
    assert pressure.isVisible()
    assert pressure.text() == f"{live.model.live.headline(live.model.snapshot).pressure} kPa"
    last = live.model.snapshot.last
    change(last=replace(last, pressure_kpa=0.1, target_kpa=math.nan))
    live.refresh()
    assert not pressure.isVisible()  # at rest
    change(state=SessionState.RUNNING)
    live.refresh()
    assert pressure.isVisible()
    for link in (LinkState.SILENT, LinkState.LOST, LinkState.OPENING):
        change(link=link, state=SessionState.FAULT)
        live.refresh()
        assert (pressure.text(), pressure.property("state")) == ("pressure unknown", "warning")
    change(link=LinkState.UP, last=last)
    live.go("Measure")
    for panel, seen in ((None, False), (live.live.photograph, True), (live.connect_panel, True), (None, False)):
        if panel is not None:  # it lies over the values of the page
            panel.show()
        live.refresh()
        assert pressure.isVisible() is seen
        if panel is not None:
            panel.reject()


def test_all_windows_are_vented_by_one_key_where_there_are_others(live):
    """The button is shown while another window is open; it and Shift+F4 vent all, F4 this one alone; none is cut."""
    pressed = []
    live.header._vents = Vents(live.vent, lambda: pressed.append("all"), lambda: ["SA2"])
    live.window_keys.vent_all = lambda: pressed.append("key")
    live.window_keys.vent = lambda: pressed.append("this")
    for width in (NARROW, 1280):
        live.resize(width, 533)
        live.refresh()
        QApplication.processEvents()
        for button in (live.header.vent, live.header.vent_all, live.header.link, live.header.unit):
            assert button.isVisible()
            assert button.width() >= button.sizeHint().width(), (width, button.text())
            assert live.header.rect().contains(button.geometry()), width
    assert "SA2" in live.header.vent_all.toolTip()
    QTest.keyClick(live.windowHandle(), Qt.Key.Key_F4, Qt.KeyboardModifier.ShiftModifier)
    QTest.keyClick(live.windowHandle(), Qt.Key.Key_F4)
    assert pressed == ["key", "this"]
    live.header._vents = Vents(live.vent, lambda: None, list)
    live.refresh()
    assert not live.header.vent_all.isVisible()
