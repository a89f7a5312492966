"""The names of the curves that can be chosen."""

from __future__ import annotations

import pytest

from analysis.calibration.curve_choice import CURVES, degree_of
from protocol.base.errors import RequestError


def test_choice_names_a_curve() -> None:
    """A degree by its number, the others by their word; any other word is refused with those that are known."""
    assert [degree_of(name) for name in CURVES] == [1, 2, 3, 4, 5, 6, "spline"]
    assert degree_of("auto") == "auto"
    for name in ("7", "cubic", ""):
        with pytest.raises(RequestError, match="is not a curve") as refused:
            degree_of(name)
        assert "auto, spline, 1" in refused.value.remedy
