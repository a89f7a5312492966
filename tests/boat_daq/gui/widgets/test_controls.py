"""The field whose text is chosen or typed."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common.tolerance import AUTOMATIC, TypedTolerance, tolerance_choice
from tests.boat_daq.gui.recorded_session import services_in


@pytest.fixture
def field(qtbot, tmp_path):
    """A field of a tolerance in mm."""
    from boat_daq.gui.app import make_application

    make_application()
    services = services_in(tmp_path)
    choice = tolerance_choice(services, "the tolerance", (TypedTolerance(0.01, "mm"),), lambda _: None)
    made = controls.typed("Tolerance", choice, services.notices.attempt)
    made.services = services
    qtbot.addWidget(made)
    made.show()
    return made


def type_(field, text):
    """Type as the operator does, and press Return."""
    field.typed.setFocus()
    field.typed.selectAll()
    QTest.keyClicks(field.typed, text)
    QTest.keyClick(field.typed, Qt.Key.Key_Return)


def test_any_text_is_typed_and_shown_with_its_unit(field):
    """It is not completed to a suggestion, and a suggestion is chosen as in any list."""
    assert field.accessibleName() == field.typed.accessibleName() == "Tolerance"
    assert field.currentText() == AUTOMATIC
    type_(field, "0,0")
    assert field.property("wrong") == "true"
    type_(field, "0,00307")
    assert field.currentText() == "\u00b10.00307 mm"
    assert not field.property("wrong")
    field.setCurrentIndex(1)
    field.activated.emit(1)
    assert field.shown.value == TypedTolerance(0.01, "mm")


def test_refused_text_stays_and_is_reported_once(field):
    """Return and the loss of the focus both end an edit; the value in force is as before."""
    type_(field, "0.02")
    type_(field, "wide")
    field.typed.editingFinished.emit()
    notices = field.services.notices
    assert "is not a tolerance" in notices.current().cause
    assert notices.waiting() == 0
    field.follow()
    assert (field.currentText(), field.shown.value) == ("wide", TypedTolerance(0.02, "mm"))


def test_field_follows_what_is_undone_but_not_while_typing(field):
    """Another page shows the same value."""
    type_(field, "0.02")
    field.services.undo.undo()
    field.follow()
    assert field.currentText() == AUTOMATIC
    QTest.keyClicks(field.typed, "7")
    field.follow()
    assert "7" in field.currentText()
