"""Names and keyboard of every control."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QWidget,
)

from boat_daq.viewmodels.common.services import Page
from tests.boat_daq.gui.windows import PATIENCE_MS


def test_keyboard_reaches_every_button_of_the_live_page(live, qtbot):
    """Tab goes round all that can be pressed or typed into, and VENT is among it."""
    live.refresh()
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    live.live.pane.setCurrentWidget(live.live.plan)
    live.live.plan.edit.click()  # what is seldom changed is behind it
    reached: list[QWidget] = []
    for _ in range(200):
        QTest.keyClick(live.windowHandle(), Qt.Key.Key_Tab)
        if QApplication.focusWidget() in reached:
            break
        reached.append(QApplication.focusWidget())
    wanted = [live.header.vent, live.header.link, live.live.window_choice, *live.live.plan.fields.values()]
    wanted += [live.navigation.buttons["Measure"], *(b for b in live.live.sequence.buttons.values() if b.isVisible())]
    assert [w.accessibleName() for w in wanted if w not in reached] == []
    assert [w for w in reached if not (w.accessibleName() or getattr(w, "text", str)())] == []
    button = live.navigation.buttons["Measure"]
    at = button.mapTo(live, button.rect().center())
    QTest.mouseClick(live.windowHandle(), Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)
    for name in list(Page)[1:]:  # the pages are one stop of Tab; the arrow keys move from there
        live.window_keys._moving = True  # QTest gives the key to the button, not to the window whose filter sees it
        QTest.keyClick(QApplication.focusWidget() or live.focusWidget(), Qt.Key.Key_Down)
        assert live.page == name
