"""Speed and accuracy: the shipped measurement, and one of this computer that is kept between starts."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from analysis.studies.tradeoff.jobs import METHODS as MEASURED
from boat_daq.viewmodels.models.tradeoff import METHOD_NAMES, TradeoffModel, read_report
from boat_daq.workflows.jobs import JobRunner, JobState
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.models.reports import point, report


def model_in(folder):
    return TradeoffModel(JobRunner(), folder)


def measured(model):
    return [d.name for d in model.defaults if d.measured]


def test_page_lists_the_methods_of_the_commands():
    """No method of the commands is missing in the window, none is invented."""
    assert set(METHOD_NAMES) == {*MEASURED, "tracking"}


def test_shipped_measurement_is_shown_at_once(tmp_path):
    """Every method has a default that was measured; computer and date are named."""
    model = model_in(tmp_path)
    assert measured(model) == list(METHOD_NAMES)
    assert model.measured.startswith("Shipped measurement: ")
    assert not model.path.exists()


def test_own_measurement_replaces_the_shipped_one_and_is_restored_at_the_next_start(tmp_path):
    """It is stored; where its file is broken, the shipped one is shown and the problem reported."""
    model = model_in(tmp_path)
    model._ended(SimpleNamespace(state=JobState.DONE, failure=None, result=report("tracer")))
    assert measured(model) == ["tracer"]
    assert model.defaults[0].share == pytest.approx(0.05)
    assert (model.defaults[1].setting, math.isnan(model.defaults[1].share)) == ("not measured", True)
    again = model_in(tmp_path)
    assert measured(again) == ["tracer"]
    assert again.measured == "This computer: this one, 2026-01-02"
    again.path.write_text("{", encoding="utf-8")
    broken = model_in(tmp_path)
    assert measured(broken) == list(METHOD_NAMES)
    assert "measure again" in broken.status()


def test_default_that_failed_has_no_place_in_the_chart():
    """An error of null is no number; an error of zero is one. Another choice of the rule is named."""
    content = report(points=[point("broken", 1.0, None), point("exact", 2.0, 0.0)])
    content["methods"][0] |= {"default": "broken", "chosen": "exact"}
    (default,) = [d for d in read_report(content) if d.name == "inverse"]
    assert not default.measured
    assert "exact would be the fastest" in default.explanation
    content["methods"][0]["default"] = "exact"
    (default,) = [d for d in read_report(content) if d.name == "inverse"]
    assert default.measured
    assert "would be" not in default.explanation


@pytest.mark.parametrize("content", [[], {}, {"machine": {}}, report() | {"methods": [{"name": "x"}]}, "text", None])
def test_file_without_a_result_is_refused(content):
    """Another file's content is refused with what to do instead."""
    with pytest.raises(RequestError, match="not a measured trade-off"):
        read_report(content)
