"""A measured trade-off as the page shows it."""

from __future__ import annotations

import pytest

from boat_daq.viewmodels.models.tradeoff import error_text, read_report
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.models.reports import point, report


def test_points_are_numbered_from_the_cheapest_and_keep_their_marks():
    """Order by processor time; default, choice and front are those of the result."""
    chart = read_report(report())["inverse"]
    assert [(p.number, p.setting) for p in chart.points] == [(1, "rough"), (2, "fine")]
    assert [p.marks for p in chart.points] == [("front",), ("default", "chosen", "front")]
    assert chart.margin == 2.0
    assert chart.default_is_chosen
    assert "at most half the tolerance: the default, fine." in chart.explanation


def test_failed_setting_is_listed_but_not_drawn():
    """An error of null is no number: it has no place in the chart, and the table reports it; zero has one."""
    chart = read_report(report(points=[point("broken", 1.0, None), point("exact", 2.0, 0.0)]))["inverse"]
    assert [p.drawn for p in chart.points] == [False, True]
    assert error_text(chart.points[0].error) == "failed"
    assert 0 < chart.floor < chart.tolerance / chart.margin


@pytest.mark.parametrize("content", [[], {}, {"machine": {}}, report() | {"methods": [{"name": "x"}]}, "text", None])
def test_file_without_a_result_is_refused(content):
    """Another file's content is refused with what to do instead."""
    with pytest.raises(RequestError, match="not a measured trade-off"):
        read_report(content)
