"""The trade-off page: choice of methods, result kept between starts."""

from __future__ import annotations

import json

import pytest

from analysis.studies.failure_maps.methods import METHOD_TITLES
from analysis.studies.tradeoff.methods import METHODS as MEASURED
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.models.tradeoff import ENTRIES, METHODS, OVERVIEW, AtlasModel, TradeoffModel, merged
from boat_daq.workflows.jobs import JobRunner
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.models.reports import report


def model_in(folder, undo=None):
    return TradeoffModel(JobRunner(), folder, Preferences(folder), undo or UndoHistory())


def test_page_lists_the_methods_of_the_commands():
    """No method of the commands is missing in the window, none is invented."""
    assert set(METHODS) == {*MEASURED, "decimation", "tracking"}
    assert set(METHOD_TITLES) <= set(ENTRIES)


def test_result_is_restored_at_the_next_start(tmp_path):
    """A loaded result is kept; a broken file is reported, not fatal; the CSV has a row for each point."""
    source = tmp_path / "given.json"
    source.write_text(json.dumps(report()), encoding="utf-8")
    model = model_in(tmp_path / "config")
    model.load(source)
    model.save(tmp_path / "out.csv")
    assert len((tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()) == 3
    again = model_in(tmp_path / "config")
    assert list(again.charts) == ["inverse"]
    again.path.write_text("{", encoding="utf-8")
    broken = model_in(tmp_path / "config")
    assert broken.charts == {}
    assert "measure again" in broken.status()


def test_measuring_without_a_method_is_refused(tmp_path):
    """A measurement of no method names what to tick; a tick is remembered."""
    model = model_in(tmp_path)
    for name in METHODS:
        model.choose(name, on=False)
    with pytest.raises(RequestError, match="no method is chosen"):
        model.toggle()
    model.choose("tracer", on=True)
    assert model_in(tmp_path).chosen == ("tracer",)


def test_opened_file_keeps_the_other_methods_and_each_names_its_computer(tmp_path):
    """Another computer's result is marked; what it does not have stays."""
    model = model_in(tmp_path)
    model.processor = "this one"
    model.take(report("tracer"))
    source = tmp_path / "given.json"
    source.write_text(json.dumps(report("inverse", processor="another")), encoding="utf-8")
    model.load(source)
    assert {name: model.where(chart) for name, chart in model.charts.items()} == {
        "inverse": "another computer (another)",
        "tracer": "this computer (this one)",
    }
    assert model.entry("inverse").endswith("of another computer")
    assert model.entry("tracer").endswith("default confirmed")


def test_opening_a_file_is_undone_without_what_was_measured_since(tmp_path):
    """A file replaced the results of its methods for good."""
    undo = UndoHistory()
    model = model_in(tmp_path, undo)
    source = tmp_path / "given.json"
    source.write_text(json.dumps(report("tracer", processor="another")), encoding="utf-8")
    model.load(source)
    undo.undo()
    assert model.charts == {}
    model.take(report("tracer", processor="this one"))
    model.load(source)
    assert model.charts["tracer"].processor == "another"
    model.take(merged(model.content, report("inverse", processor="this one")))
    undo.undo()
    assert {name: chart.processor for name, chart in model.charts.items()} == dict.fromkeys(
        ("tracer", "inverse"), "this one"
    )
    assert model_in(tmp_path).charts == model.charts
    undo.redo()
    assert model.charts["tracer"].processor == "another"
    assert model.charts["inverse"].processor == "this one"


def test_overview_lists_every_method_and_has_no_map(tmp_path):
    """Methods that were not measured have no point; F12 with Shift names what to choose."""
    model = model_in(tmp_path)
    assert model.shown == OVERVIEW
    model.take(report("tracer"))
    assert [d.name for d in model.defaults] == list(METHODS)
    assert [d.name for d in model.defaults if d.point is not None] == ["tracer"]
    assert model.defaults[0].share == pytest.approx(0.05)
    with pytest.raises(RequestError, match="no method is shown"):
        AtlasModel(JobRunner(), tmp_path).toggle(OVERVIEW)
