"""The trade-off page: the shipped measurement, and one of this computer that is kept between starts."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from analysis.studies.failure_maps.methods import METHOD_TITLES
from analysis.studies.tradeoff.methods import METHODS as MEASURED
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.models.failure_maps import AtlasModel
from boat_daq.viewmodels.models.tradeoff import ENTRIES, METHOD_NAMES, OVERVIEW, TradeoffModel
from boat_daq.workflows.jobs import JobRunner, JobState
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.models.reports import report


def model_in(folder):
    return TradeoffModel(JobRunner(), folder, Preferences(folder))


def measured(model, content):
    """End a measurement with this result."""
    model._ended(SimpleNamespace(state=JobState.DONE, failure=None, result=content))


def test_page_lists_the_methods_of_the_commands():
    """No method of the commands is missing in the window, none is invented."""
    assert set(METHOD_NAMES) == {*MEASURED, "decimation", "tracking"}
    assert set(METHOD_TITLES) <= set(ENTRIES)


def test_shipped_measurement_is_shown_at_once(tmp_path):
    """Every method has a default that was measured; computer and date are named."""
    model = model_in(tmp_path)
    assert set(model.charts) == set(METHOD_NAMES)
    assert all(default.point is not None for default in model.defaults)
    assert model.measured.startswith("Measured on the computer of the shipped measurement (")
    assert not model.path.exists()


def test_own_measurement_replaces_the_shipped_one_and_is_restored_at_the_next_start(tmp_path):
    """It is stored; where its file is broken, the shipped one is shown and the problem reported."""
    model = model_in(tmp_path)
    measured(model, report())
    assert list(model.charts) == ["inverse"]
    again = model_in(tmp_path)
    assert list(again.charts) == ["inverse"]
    assert again.measured == "Measured on this computer (this one), 2026-01-02"
    again.path.write_text("{", encoding="utf-8")
    broken = model_in(tmp_path)
    assert set(broken.charts) == set(METHOD_NAMES)
    assert "measure again" in broken.status()


def test_overview_lists_every_method_and_has_no_map(tmp_path):
    """Methods that were not measured have no point; F12 with Shift names what to choose."""
    model = model_in(tmp_path)
    assert model.shown == OVERVIEW
    measured(model, report("tracer"))
    assert [d.name for d in model.defaults] == list(METHOD_NAMES)
    assert [d.name for d in model.defaults if d.point is not None] == ["tracer"]
    assert model.entry("inverse") == "not measured"
    assert model.defaults[0].share == pytest.approx(0.05)
    with pytest.raises(RequestError, match="no method is shown"):
        AtlasModel(JobRunner(), tmp_path).toggle(OVERVIEW)
