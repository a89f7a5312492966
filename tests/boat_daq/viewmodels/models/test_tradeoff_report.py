"""A measured trade-off as the page shows it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from boat_daq.viewmodels.models.tradeoff import error_text, merged, read_report
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.models.reports import point, report

RECORDED = Path(__file__).resolve().parents[4] / "docs" / "tradeoff" / "tradeoff.json"


def test_points_are_numbered_from_the_cheapest_and_keep_their_marks():
    """Order by processor time; default, choice and front are those of the result."""
    chart = read_report(report())["inverse"]
    assert [(p.number, p.setting) for p in chart.points] == [(1, "rough"), (2, "fine")]
    assert [p.marks for p in chart.points] == [("front",), ("default", "chosen", "front")]
    assert chart.margin == 2.0
    assert chart.default_is_chosen
    assert chart.when == "quick, 2026-01-02"


def test_failed_setting_is_listed_but_not_drawn():
    """An error of null is no number: it has no place in the chart, and the table reports it; zero has one."""
    chart = read_report(report(points=[point("broken", 1.0, None), point("exact", 2.0, 0.0)]))["inverse"]
    assert [p.drawn for p in chart.points] == [False, True]
    assert error_text(chart.points[0].error) == "failed"
    assert 0 < chart.floor < chart.tolerance / chart.margin


@pytest.mark.parametrize("content", [[], {}, {"machine": {}}, report() | {"methods": [{"name": "x"}]}, "text", None])
def test_file_without_a_result_is_refused(content):
    """Another file's content is refused with what to choose instead."""
    with pytest.raises(RequestError, match="not a measured trade-off"):
        read_report(content)


def test_merged_result_keeps_methods_measured_before():
    """A new result keeps the other methods, also those of another computer; each has its date and its processor."""
    old, new = merged(None, report("tracer", date="2026-01-01T00:00:00")), report("inverse", processor="another")
    both = read_report(json.loads(json.dumps(merged(merged(old, new), report("inverse", processor="a third")))))
    assert {name: (chart.when, chart.processor) for name, chart in both.items()} == {
        "inverse": ("quick, 2026-01-02", "a third"),
        "tracer": ("quick, 2026-01-01", "this one"),
    }


@pytest.mark.parametrize("method", json.loads(RECORDED.read_text(encoding="utf-8"))["methods"], ids=lambda m: m["name"])
def test_line_at_what_is_noticeable_names_the_choice_of_the_rule(method):
    """One rule for both: at the method's own tolerance the line names what the rule chooses for the default."""
    chart = read_report(json.loads(RECORDED.read_text(encoding="utf-8")))[method["name"]]
    assert chart.choice(chart.tolerance).setting == method["chosen"]


def test_tolerance_is_met_with_the_margin_of_the_defaults():
    """An error of half the tolerance is accepted, more is not; without a setting the least error is named."""
    chart = read_report(report(points=[point("rough", 1.0, 0.1), point("fine", 2.0, 0.001)]))["inverse"]
    assert [chart.choice(t).setting for t in (0.2, 0.19, 0.002)] == ["rough", "fine", "fine"]
    assert chart.choice(0.0019) is None
    assert chart.asked_text(0.2) == "Tolerance 0.20 mm: 1\u2009s with rough"
    assert "no setting is accepted, the least error is 0.0010 mm" in chart.asked_text(0.0019)
    assert "at most half the tolerance: the default, fine." in chart.explanation
