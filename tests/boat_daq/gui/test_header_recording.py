"""The recording in the header, in a window."""

from __future__ import annotations

import dataclasses

from PySide6.QtCore import Qt
from PySide6.QtGui import QDesktopServices
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from boat_daq.engine.snapshot import HealthSnapshot, LinkState, SessionState
from boat_daq.gui.header import Header
from protocol.link.events import LinkStatistics
from tests.boat_daq.gui.windows import CALIBRATED, NARROW
from tests.protocol.link.streams import HELLO


def click(widget):
    QTest.mouseClick(widget, Qt.MouseButton.LeftButton)


def test_free_recording_is_started_and_stopped_by_a_button(live, tmp_path):
    """Only the title used to name the recording, and only a key and a menu started one."""
    head, session = live.header, live.model.session
    assert not head.recording.badge.isVisible()
    assert head.recording.button.text() == "Record"
    assert str(tmp_path / "recordings") in head.recording.button.toolTip()
    click(head.recording.button)
    assert session.calls == ["start_recording"]
    assert str(tmp_path / "recordings") in live.model.notices.current().cause
    session.change(recording=tmp_path / "recordings" / "a.boat", recorded_s=65.0)
    live.refresh()
    assert head.recording.badge.isVisible()
    assert "REC 1:05" in head.recording.badge.text()
    assert "free" in head.recording.badge.text() + head.recording.badge.toolTip()
    click(head.recording.button)
    assert session.calls[-1] == "stop_recording"
    session.change(state=SessionState.RUNNING)
    live.refresh()
    assert head.recording.badge.isVisible()
    assert not head.recording.button.isVisible()


def test_click_opens_the_folder(live, tmp_path, monkeypatch):
    """Where no file manager opens it, its path is shown."""
    opened: list[str] = []
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: opened.append(url.toLocalFile()) or False)
    live.model.session.change(recording=tmp_path / "here" / "a.boat")
    live.refresh()
    click(live.header.recording.badge)
    assert opened == [str(tmp_path / "here")]
    assert str(tmp_path / "here") in live.model.notices.current().cause


def test_header_with_a_recording_is_never_cut(live, tmp_path):
    """Size and disk are left out first; time, VENT and what is wrong never are; a new digit moves nothing."""
    for state in (SessionState.IDLE, SessionState.RUNNING):
        for width in (NARROW, 960, 1280, 1920):
            live.resize(width, 600)
            health = HealthSnapshot(LinkStatistics(lost=12), 100.0, 100.0, 0.0, 3.0, None, None, None, ())
            live.model.session.change(
                hello=HELLO, health=health, recording=tmp_path / "a.boat", recorded_s=65.0, state=state
            )
            live.model.unit.texts = lambda _: CALIBRATED
            live.refresh()
            QApplication.processEvents()
            head: Header = live.header
            shown = (head.link, head.recording.badge, head.recording.button, head.unit, head.vent)
            for widget in (w for w in (*shown, *head.figures) if not w.isHidden()):
                assert widget.width() >= widget.sizeHint().width(), widget.text()
                assert head.rect().contains(widget.geometry()), widget.text()
            assert "REC 1:05" in head.recording.badge.text()
            assert ("free" in head.recording.badge.text()) is (width == 1920)
            assert "12 lost" in [f.text() for f in head.figures if f.isVisible()]
            before = [w.geometry() for w in shown]
            live.model.session.change(recorded_s=66.0)
            live.refresh()
            QApplication.processEvents()
            assert "REC 1:06" in head.recording.badge.text()
            assert [w.geometry() for w in shown] == before


def test_header_of_a_full_disk_is_never_cut(live, tmp_path, monkeypatch):
    """At 853 pixels the board's name was cut on both sides, and VENT was beyond the margin."""
    monkeypatch.setattr("boat_daq.viewmodels.live.recording_status.LITTLE_SPACE", float("inf"))
    live.resize(NARROW, 600)
    live.go("Settings")
    pressure = live.model.live.headline(live.model.snapshot).pressure
    live.header._vents = dataclasses.replace(live.header._vents, others=lambda: ["SA2"])
    hello = dataclasses.replace(HELLO, board_id="SIMULATED-SA1")
    view = dataclasses.replace(live.model.outlets.view(), badge="LSL signals, SECoP", short="LSL, SECoP", control=True)
    monkeypatch.setattr(type(live.model.outlets), "view", lambda _: view)
    health = HealthSnapshot(LinkStatistics(lost=12), 100.0, 100.0, 9.0, 75_000.0, None, None, None, ())
    for link, lag in ((LinkState.UP, None), (LinkState.LOST, None), (LinkState.SILENT, health)):
        live.model.session.change(
            health=lag, hello=hello, recording=tmp_path / "a.boat", recorded_s=65.0, link=link, simulated=True
        )
        live.refresh()
        QApplication.processEvents()
        head = live.header
        record = (head.recording.badge, head.recording.button)
        shown = (head.simulated, head.link, head.pressure, *record, head.unit, head.vent_all, head.vent)
        assert head.pressure.text() == (f"{pressure} kPa" if link is LinkState.UP else "pressure unknown")
        for widget in (w for w in (*shown, *head.figures) if not w.isHidden()):
            assert widget.width() >= widget.sizeHint().width(), widget.text()
            assert head.rect().contains(widget.geometry()), widget.text()
