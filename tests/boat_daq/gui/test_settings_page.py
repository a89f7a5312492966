"""The Settings page in a window, and the bar of a window whose settings are refused."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.viewmodels.common.services import Tab
from tests.boat_daq.gui.windows import close_all


@pytest.fixture
def page(empty):
    """The page of a window whose session stores what it is given."""
    session, units = empty.model.session, empty.model.units
    session.settings, session.unit_under_test = Settings(), SimpleNamespace(store=units.save)
    empty.go(Tab.VALUES)
    empty.refresh()
    return empty.pages[Tab.VALUES]


def enter(page, key, text):
    """Type a value into its field and leave it with Enter."""
    field = page.forms[page.subject != ""].rows[key].field
    field.selectAll()
    QTest.keyClicks(field, text)
    QTest.keyClick(field, Qt.Key.Key_Return)


def test_limit_of_a_unit_is_entered_and_undone(page, empty):
    """The bench's unit is listed before it was stored; a wrong value stays in its field, with the reason."""
    page.list.setCurrentRow(1)
    row = page.forms[True].rows["min_kpa"]
    enter(page, "min_kpa", "-250")
    assert "\u2212101.325 to 0 kPa" in row.refused.text()
    assert empty.model.units.names() == []
    enter(page, "min_kpa", "-25")
    assert row.refused.text() == ""
    assert empty.model.units.load("SA1").min_kpa == -25.0
    empty.refresh()
    assert [page.changes.item(0, k).text() for k in (1, 2)] == ["Lowest pressure", "\u221240 \u2192 \u221225"]
    empty.model.undo.undo()
    empty.refresh()
    assert row.field.text() == "\u221240"
    row.field.setText("\u221230")
    row.field.editingFinished.emit()
    assert (empty.model.units.load("SA1").min_kpa, row.field.text()) == (-30.0, "\u221230")
    row.reset.click()
    assert empty.model.units.load("SA1").min_kpa == -40.0


def test_units_are_added_and_a_refused_one_shows_why(page, empty):
    """The other units can still be used; the refused file is not touched."""
    assert page.forms[False].rows["recordings"].field.placeholderText().endswith("recordings")
    page.name.setText("SA7")
    page.add.click()
    empty.refresh()
    assert page.title.text() == "Unit SA7" and page.list.currentItem().text() == "Unit SA7"
    empty.resize(853, 600)
    for _ in range(10):
        QApplication.processEvents()
    assert page.list.verticalScrollBar().maximum() == 0
    assert page.list.height() < 4 * page.list.sizeHintForRow(0)  # no line is empty
    file = empty.model.units.folder / "SA7.toml"
    file.write_text("name = 3\n")
    page.show_subject()
    assert not page.broken.isHidden() and "'min_kpa' is missing" in page.broken.text()
    assert page.leaves.isHidden() and not page.reset.isEnabled()
    file.unlink()
    page.show_subject()
    enter(page, "min_kpa", "nothing")
    page.list.setCurrentRow(1)  # what was refused for one unit is not shown for another
    row = page.forms[True].rows["min_kpa"]
    assert (page.title.text(), row.field.text(), row.refused.text()) == ("Unit SA1", "\u221240", "")
    file.write_text("name = 3\n")
    page.list.setCurrentRow(0)
    assert page.broken.isHidden()
    page.forms[False].rows["allow_remote"].field.setCurrentIndex(1)
    page.forms[False].rows["allow_remote"].field.activated.emit(1)
    assert empty.model.settings.shown("").texts["allow_remote"] == "on"
    assert file.read_text() == "name = 3\n"


def test_refused_settings_open_the_window_in_safe_mode(qtbot, tmp_path, monkeypatch):
    """Defaults, a bar with the cause, and the file as it was; the bar goes when settings are stored."""
    from boat_daq.gui.app import make_application, make_window

    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path))
    file = tmp_path / "settings.toml"
    file.write_text('rate_hz = "fast"\n')
    make_application()
    window = make_window()
    try:
        window.show()
        qtbot.waitExposed(window)
        assert window.safe_mode.isVisible() and "'rate_hz' must be of type int" in window.safe_mode.text.text()
        assert window.model.session.settings == Settings()
        assert file.read_text() == 'rate_hz = "fast"\n'
        window.go(Tab.VALUES)
        window.pages[Tab.VALUES].reset.click()
        window.refresh()
        assert not window.safe_mode.isVisible()
        assert UnitLibrary().names() == []
    finally:
        close_all([window])
