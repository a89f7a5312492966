"""Tolerances as they are typed: units, refusals, undo, and what is kept."""

from __future__ import annotations

import pytest

from boat_daq.viewmodels.common.tolerance import AUTOMATIC, TypedTolerance, tolerance_choice, tolerance_of
from protocol.base.errors import RequestError
from tests.boat_daq.gui.recorded_session import services_in

SUGGESTED = (TypedTolerance(0.1, "%FSO"), TypedTolerance(0.01, "mm"))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("0.05%FSO", TypedTolerance(0.05, "%FSO")),
        (" \u00b1 0,05 % fso ", TypedTolerance(0.05, "%FSO")),
        ("+-3e-3 mm", TypedTolerance(0.003, "mm")),
        ("automatic", None),
        ("", None),
    ],
)
def test_any_number_with_its_unit_is_read(text, found):
    """As on the command line, and as it is shown."""
    assert tolerance_of(text, ("%FSO", "mm")) == found
    if found is not None:
        assert tolerance_of(str(found), ("%FSO", "mm")) == found


@pytest.mark.parametrize(
    ("text", "cause"),
    [("0.05", "has no unit"), *((text, "is not a tolerance") for text in ("0 mm", "-1 mm", "1e999 mm", "nan mm", "x"))],
)
def test_refusal_names_cause_and_units(text, cause):
    """Zero, negative, infinite and no number at all; a number without its unit where there are two."""
    with pytest.raises(RequestError, match=cause) as refused:
        tolerance_of(text, ("%FSO", "mm"))
    assert "0.01 % FSO or 0.01 mm" in refused.value.remedy
    assert tolerance_of("0.05", ("mm",)) == TypedTolerance(0.05, "mm")


def test_choice_is_applied_kept_and_undone(tmp_path):
    """A typed value outlasts the window; undo brings back the one before; a damaged one is left out."""
    services, applied = services_in(tmp_path), []
    choice = tolerance_choice(services, "the tolerance", SUGGESTED, applied.append)
    assert (choice.text, choice.suggestions) == (AUTOMATIC, (AUTOMATIC, "\u00b10.1 % FSO", "\u00b10.01 mm"))
    choice.choose("0.07 mm")
    choice.choose("\u00b10.07 mm")  # the same
    assert applied == [TypedTolerance(0.07, "mm")]
    again = services_in(tmp_path)
    assert tolerance_choice(again, "the tolerance", SUGGESTED, applied.append).text == "\u00b10.07 mm"
    assert applied == 2 * [TypedTolerance(0.07, "mm")]
    services.undo.undo()
    assert (choice.text, applied[-1]) == (AUTOMATIC, None)
    again.preferences.set("the tolerance", "7 bananas")
    assert tolerance_choice(again, "the tolerance", SUGGESTED, applied.append).value is None
