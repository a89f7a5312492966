"""The command palette and the shortcut sheet."""

from __future__ import annotations

import re

import pytest
from PySide6.QtCore import Qt, QUrl
from PySide6.QtGui import QTextDocument
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QScrollArea,
)

from boat_daq.engine.snapshot import (
    SessionState,
)
from boat_daq.gui import style
from boat_daq.gui.command_palette import Tutorial
from tests.boat_daq.gui.windows import NARROW, run_shortcut
from tests.conftest import mostly_at_night


def test_shortcut_closes_the_palette_and_runs(live):
    """The key of a page left the palette open."""
    live.palette_.open_fresh()
    assert live.palette_.isVisible()
    run_shortcut(live, "Ctrl+2")
    assert not live.palette_.isVisible()
    assert (live.place, live.model.session.calls) == ("Calibration", [])


def test_palette_finds_synonyms(live):
    """ "quit" proposed to edit the plan, and "night", "marker", "begin" nothing at all."""
    palette = live.palette_
    live.model.session.change(state=SessionState.ARMED)
    live.refresh()
    for typed, meant in (
        ("quit", "Close the window"), ("exit", "Close the window"), ("night", "Dark"), ("start", "Start"),
        ("marker", "Add marker \u2026"), ("begin", "Start"), ("screenshot", "Copy the plot"),
        ("statistics", "Cursor A"), ("emergency", "Vent now"), ("compare", "Recordings"),
        ("fit", "Calibration"),
    ):  # fmt: skip
        palette._match(typed)
        assert palette.list.topLevelItem(0).text(0) == meant, typed
    palette._match("accept")  # once this ran "Save the plot" by letters scattered in its text
    found = [palette.list.topLevelItem(i) for i in range(palette.list.topLevelItemCount())]
    assert [(item.text(0), item.text(1)) for item in found] == [("Accept the calibration", "not now")]


@pytest.mark.parametrize("width", mostly_at_night(NARROW, 1280))
def test_shortcut_sheet_does_not_scroll_sideways(live, width):
    """At 853 px a third of the keys was out of sight to the right."""
    live.resize(width, 533)
    live.show_keys()
    QApplication.processEvents()
    area = live.keys.findChild(QScrollArea)
    assert area.horizontalScrollBar().maximum() == 0
    assert live.keys.height() >= min(533, area.widget().sizeHint().height())
    assert area.viewport().width() > 500
    assert abs(live.keys.geometry().center().x() - live.geometry().center().x()) < 8
    assert live.keys.frameGeometry().top() > live.header.mapToGlobal(live.header.rect().bottomLeft()).y()
    assert all(block.isVisible() for block in live.keys._blocks.values())
    live.keys.close()


def test_shortcut_sheet_fits_a_window_that_grew(live):
    """Opened at 853 px and again at 1280, its third column was out of sight to the right."""
    for width in (NARROW, 1280):
        live.resize(width, 533)
        live.show_keys()
        QApplication.processEvents()
        assert live.keys.findChild(QScrollArea).horizontalScrollBar().maximum() == 0
        live.keys.close()


def test_the_tutorial_is_shown_with_its_pictures(live):
    """Rendered, as wide as the text; links to pages that are not installed are plain words."""
    live.palette_._match("tutorial")
    assert live.palette_.list.topLevelItem(0).text(0) == "Tutorial"
    live.show_tutorial()
    QApplication.processEvents()
    shown = live.findChild(Tutorial).shown
    kind = QTextDocument.ResourceType.ImageResource
    names = re.findall(r'src="([^"]+)"', shown.toHtml())
    assert len(names) == 7
    assert {shown.document().resource(kind, QUrl(name)).width() for name in names} == {720}
    assert "href" not in shown.toHtml()
    placed = live.findChild(Tutorial).geometry()
    lowest = live.mapToGlobal(live.rect().bottomLeft()).y() - style.STRIP_HEIGHT
    assert placed.bottom() <= lowest  # neither strip nor readouts are covered
    assert placed.top() >= live.mapToGlobal(live.rect().topLeft()).y() + 3 * style.STRIP_HEIGHT
    assert shown.horizontalScrollBar().maximum() == 0
    live.findChild(Tutorial).close()


def test_palette_finds_and_runs_a_command(live):
    """Typing a few letters finds a command, Enter does it."""
    live.palette_.open_fresh()
    QTest.keyClicks(live.palette_.field, "repeat")
    QTest.keyClick(live.palette_.field, Qt.Key.Key_Return)
    assert live.place == "Repeatability"
