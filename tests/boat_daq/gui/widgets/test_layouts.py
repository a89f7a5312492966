"""Empty states, parts with movable borders, and buttons with a menu."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtWidgets import QBoxLayout, QWidget

from boat_daq.gui.widgets import controls
from boat_daq.gui.widgets.layouts import Shares
from boat_daq.viewmodels.common.preferences import Preferences
from tests.boat_daq.gui.windows import PATIENCE_MS


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["Calibration", "Repeatability", "Recordings"])
def test_empty_page_never_scrolls(empty, qtbot, name):
    """An empty Calibrate page used to require the height of the filled one behind it."""
    empty.resize(853, 533)
    empty.go(name)
    scroll = empty.scrolls[name]
    qtbot.waitUntil(lambda: scroll.verticalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    assert scroll.horizontalScrollBar().maximum() == 0
    assert empty.pages[name].stack.currentIndex() == 0


def parts(preferences, width: int, height: int) -> Shares:
    """Two parts with the shares 3 and 1, shown."""
    made = Shares("test", preferences, (QWidget(), 3), (QWidget(), 1))
    made.resize(width, height)
    made.show()
    return made


def test_shares_are_moved_and_kept(qtbot, tmp_path):
    """The border is dragged; another window has the same shares, whatever its size; stacked, nothing is stored."""
    preferences = Preferences(tmp_path)
    first = parts(preferences, 100, 408)
    qtbot.addWidget(first)
    assert first.sizes()[0] == pytest.approx(300, abs=4)
    first.moveSplitter(200, 1)
    preferences.set("geometry", "as the window closes")
    second = parts(Preferences(tmp_path), 100, 808)
    qtbot.addWidget(second)
    assert second.sizes()[0] == pytest.approx(400, abs=4)
    second.setDirection(QBoxLayout.Direction.LeftToRight)
    second.resize(400, 100)
    second.moveSplitter(100, 1)
    assert Preferences(tmp_path).get("shares test")[0] == pytest.approx(0.5, abs=0.02)
    preferences.set("shares test", [1.0, -2.0])
    assert parts(preferences, 100, 408).sizes()[0] == pytest.approx(300, abs=4)


def test_a_button_is_not_tinted_after_its_menu_is_closed_elsewhere(qtbot, monkeypatch):
    """Qt keeps the button hovered until the mouse moves: no part of it leaves while the menu has the mouse."""
    button = controls.menu_button("More", "tip")
    qtbot.addWidget(button)
    button.show()
    for at, hovered in ((button.rect().center(), True), (QPoint(0, 300), False)):
        button.setAttribute(Qt.WidgetAttribute.WA_UnderMouse)
        monkeypatch.setattr(controls, "QCursor", SimpleNamespace(pos=lambda at=at: button.mapToGlobal(at)))
        button.menu().aboutToHide.emit()
        qtbot.wait(1)
        assert button.underMouse() is hovered
