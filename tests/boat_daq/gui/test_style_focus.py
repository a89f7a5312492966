"""The ring of the control with the focus, in both themes."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import QApplication

from boat_daq.gui import style
from tests.boat_daq.gui.test_style import contrast
from tests.boat_daq.gui.windows import shared_window

SEEN = 3.0  # contrast of what is not text, WCAG 2.2
LEAST_PX = 40


@pytest.fixture(scope="module")
def window(tmp_path_factory, qapp):
    """A window on a connected board with the plan in its pane."""
    with shared_window(tmp_path_factory.mktemp("focus")) as window:
        window.resize(1280, 800)
        window.live.pane.setCurrentWidget(window.live.plan)
        window.refresh()
        window.activateWindow()
        QApplication.processEvents()
        yield window


def changed(control) -> int:
    """Return how many pixels of a control change visibly when it gets the focus."""
    pictures = []
    for focused in (False, True):
        if focused:
            control.window().window_keys._chosen = control  # as by Tab
            control.setFocus()
            assert control.hasFocus()
        else:
            control.clearFocus()
        at = QRect(control.mapTo(control.window(), QPoint(0, 0)), control.size())
        image = control.window().grab(at).toImage()  # with the ground that a transparent control has
        pictures.append(np.array([[image.pixel(x, y) for x in range(image.width())] for y in range(image.height())]))
    pairs = {(a, b) for a, b in zip(*(p.ravel().tolist() for p in pictures), strict=True) if a != b}
    seen = {pair for pair in pairs if contrast(*(f"#{value & 0xFFFFFF:06x}" for value in pair)) >= SEEN}
    before, after = (p.ravel().tolist() for p in pictures)
    return sum(pair in seen for pair in zip(before, after, strict=True))


@pytest.mark.parametrize("theme", [style.LIGHT, style.DARK], ids=lambda t: t.name)
def test_focus_is_seen_on_every_kind_of_control(window, theme):
    """That of Arm was a dark dotted line on indigo: none could be seen, and Enter armed."""
    window.set_theme(theme)
    live, navigation = window.live, window.navigation.buttons
    controls = {
        "primary": live.sequence.buttons["arm"], "plain": live.freeze, "VENT": window.header.vent,
        "link": window.strip.messages, "page": navigation["Results"], "page shown": navigation["Measure"],
        "box": live.plan.ask_readings, "choice": live.window_choice, "tab": live.pane.tabBar(),
    }  # fmt: skip
    sizes = {name: control.size() for name, control in controls.items()}
    few = {name: count for name, control in controls.items() if (count := changed(control)) < LEAST_PX}
    assert few == {}
    assert {name: control.size() for name, control in controls.items()} == sizes
