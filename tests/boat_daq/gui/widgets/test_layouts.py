"""Empty states."""

from __future__ import annotations

import pytest

from tests.boat_daq.gui.windows import PATIENCE_MS


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["Calibrate", "Repeat", "Runs"])
def test_empty_page_never_scrolls(empty, qtbot, name):
    """An empty Calibrate page used to require the height of the filled one behind it."""
    empty.resize(853, 533)
    empty.go(name)
    scroll = empty.scrolls[name]
    qtbot.waitUntil(lambda: scroll.verticalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    assert scroll.horizontalScrollBar().maximum() == 0
    assert empty.pages[name].stack.currentIndex() == 0
