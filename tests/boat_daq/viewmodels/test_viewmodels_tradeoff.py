"""The trade-off and the atlas as the window reads them: results, their words, what is refused, what is remembered."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import pytest

from analysis.atlas.methods import METHOD_TITLES
from analysis.atlas.sweep import Axis, Study, StudyResult
from analysis.tradeoff import METHODS as MEASURED
from analysis.tradeoff import Method, Setting
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.formatting import duration_text, power_text
from boat_daq.viewmodels.common.jobs import JobRunner, JobState
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.models import tradeoff_jobs
from boat_daq.viewmodels.models.atlas import AtlasModel, read_maps
from boat_daq.viewmodels.models.tradeoff import ENTRIES, METHODS, TradeoffModel
from boat_daq.viewmodels.models.tradeoff_report import error_text, merged, read_report


def point(setting, seconds, error, **more):
    return {"setting": setting, "seconds": seconds, "error": error, "spread": 0.0, "cpu_seconds": seconds} | more


def report(name="inverse", processor="this one", date="2026-01-02T00:00:00", points=None):
    """A result as the command prints it."""
    method = {
        "name": name, "title": "Inverse", "reference": "closed form", "consumer": "the reader", "tolerance": 0.02,
        "unit": "mm", "per": "a value", "points": points or [point("fine", 2.0, 0.001), point("rough", 1.0, 0.1)],
        "front": ["rough", "fine"], "default": "fine", "chosen": "fine", "verdict": "the default is the choice",
    }  # fmt: skip
    return {
        "machine": {"processor": processor, "date_utc": date}, "quick": True, "margin": 2.0, "methods": [method]
    }  # fmt: skip


def test_points_are_numbered_from_the_cheapest_and_keep_their_marks():
    """Order by processor time; default, choice and front stand where the result says; half the tolerance is enough."""
    chart = read_report(report())["inverse"]
    assert [(p.number, p.setting) for p in chart.points] == [(1, "rough"), (2, "fine")]
    assert [p.marks for p in chart.points] == [("front",), ("default", "chosen", "front")]
    assert chart.sufficient == 0.01
    assert chart.default_is_chosen
    assert "quick, 2026-01-02" in chart.measured


def test_a_setting_that_failed_is_listed_but_not_drawn():
    """An error of null is no number: it has no place in the chart, and the table says so; zero has one."""
    chart = read_report(report(points=[point("broken", 1.0, None), point("exact", 2.0, 0.0)]))["inverse"]
    assert [p.drawn for p in chart.points] == [False, True]
    assert error_text(chart.points[0].error) == "failed"
    assert 0 < chart.floor < chart.sufficient


@pytest.mark.parametrize("content", [[], {}, {"machine": {}}, report() | {"methods": [{"name": "x"}]}, "text", None])
def test_what_is_no_result_is_refused_by_name(content):
    """Another file's content is refused with what to choose instead."""
    with pytest.raises(OperatorError, match="not a measured trade-off"):
        read_report(content)


def test_methods_measured_before_stay_with_their_own_date():
    """A new result keeps the other methods of the same machine; those of another machine go."""
    old, new = merged(None, report("tracer", date="2026-01-01T00:00:00")), report("inverse")
    both = read_report(merged(old, new))
    assert {name: chart.measured[:17] for name, chart in both.items()} == {
        "inverse": "quick, 2026-01-02", "tracer": "quick, 2026-01-01",
    }  # fmt: skip
    assert list(read_report(merged(old, report("inverse", processor="another")))) == ["inverse"]


def test_the_page_lists_what_the_commands_know():
    """No method of the commands is missing in the window, none is invented."""
    assert set(METHODS) == {*MEASURED, "decimation"}
    assert set(METHOD_TITLES) <= set(ENTRIES)


def test_the_last_result_is_there_at_the_next_start(tmp_path):
    """A loaded result is kept; a broken file is said, not fatal; the CSV has a row for each point."""
    source = tmp_path / "given.json"
    source.write_text(json.dumps(report()), encoding="utf-8")
    model = TradeoffModel(JobRunner(), tmp_path / "config", Preferences(tmp_path / "config"))
    model.load(source)
    model.save(tmp_path / "out.csv")
    assert len((tmp_path / "out.csv").read_text(encoding="utf-8").splitlines()) == 3
    again = TradeoffModel(JobRunner(), tmp_path / "config", Preferences(tmp_path / "config"))
    assert list(again.charts) == ["inverse"]
    again.path.write_text("{", encoding="utf-8")
    broken = TradeoffModel(JobRunner(), tmp_path / "config", Preferences(tmp_path / "config"))
    assert broken.charts == {}
    assert "measure again" in broken.status()


def test_nothing_chosen_is_refused(tmp_path):
    """A measurement of no method says what to tick; a tick is remembered."""
    model = TradeoffModel(JobRunner(), tmp_path, Preferences(tmp_path))
    for name in METHODS:
        model.choose(name, on=False)
    with pytest.raises(OperatorError, match="no method is chosen"):
        model.toggle()
    model.choose("tracer", on=True)
    assert TradeoffModel(JobRunner(), tmp_path, Preferences(tmp_path)).chosen == ("tracer",)


def test_what_the_helper_measures_is_what_the_page_reads(monkeypatch):
    """Two methods measured in the helper come back in one result, progress rising to all of them."""
    settings = [Setting("good", lambda _: 0.0, float), Setting("bad", lambda _: 1.0, float)]
    fake = Method(
        "fake", "Fake", "truth", True, "reader", 0.1, "mm", "a call",
        lambda level: "bad" if level.level == "draft" else "good", lambda quick: settings,
    )  # fmt: skip
    monkeypatch.setattr("analysis.tradeoff.METHODS", {"fake": fake})
    seen = []
    content = tradeoff_jobs.measure_methods(["fake", "fake"], True, progress=lambda done, total: seen.append(done))
    assert seen == sorted(seen)
    assert seen[-1] == 2
    chart = read_report(json.loads(json.dumps(content)))["fake"]
    assert {p.setting: p.error for p in chart.points} == {"good": 0.0, "bad": 1.0}
    assert {p.setting: p.uses for p in chart.points} == {"good": ("default", "chosen", "reference"), "bad": ("draft",)}


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.0, "0"),
        (0.001, "0.0010"),
        (0.00094, "9.4\u00b710\u207b\u2074"),
        (0.000999, "0.0010"),  # rounds up to the border
        (12.34, "12"),
        (99_999.0, "1.0\u00b710\u2075"),
        (3.1e-14, "3.1\u00b710\u207b\u00b9\u2074"),
    ],
)
def test_numbers_that_span_decades(value, words):
    """Plain where it is short, a power of ten where it is not."""
    assert power_text(value, 2) == words


def test_short_times_have_their_unit():
    """Three digits and the unit that keeps them short; NaN is a dash."""
    found = [duration_text(t) for t in (1.5, 0.0123, 4.56e-6, 7e-9, math.nan)]
    assert found == ["1.5\u2009s", "12.3\u2009ms", "4.56\u2009\u00b5s", "7\u2009ns", "\u2013"]


def study():
    """Right below 1, a reservation at 1, a refusal (no number, a reason) at 2."""
    answers = {0.0: StudyResult(0.0), 1.0: StudyResult(0.5, "a flag"), 2.0: StudyResult(math.nan, "too far")}
    return Study(
        "map", "fit", "A map", "truth", "mm", 0.1, Axis("x", "mm", (0.0, 1.0, 2.0)), Axis("y", "", (5.0,), ("five",)),
        lambda x, y: answers[x],
    )  # fmt: skip


def test_a_swept_map_is_read_with_its_words(monkeypatch, tmp_path):
    """Outcome, error and what was said stand at their place; beside the map there are no words."""
    monkeypatch.setattr("analysis.atlas.methods.chosen_studies", lambda names: [study()])
    model = AtlasModel(JobRunner(), tmp_path)
    model.take(json.loads(json.dumps(tradeoff_jobs.sweep_method("fit"))))
    shown = model.maps["fit"][0]
    assert [p.outcome for p in shown.cells[0]] == ["works", "degraded", "refused"]
    assert shown.cell_text(1, 0) == "x (mm) 1, y five \u2013 works with a warning, error 0.50 mm: a flag"
    assert shown.cell_text(2, 0).endswith("refuses: too far")
    assert shown.cell_text(3, 0) == ""
    assert shown.summary.startswith("works in 1, works with a warning in 1, refuses in 1 of 3 cases")


@pytest.mark.parametrize("content", [{}, {"maps": [{"name": "x"}]}, None])
def test_what_is_no_atlas_is_refused(content):
    """Another file's content is refused by name."""
    with pytest.raises(OperatorError, match="not a stability atlas"):
        read_maps(content)


def swept(method, name="map", outcome="works"):
    """A result of the atlas with one map of one place."""
    axis = {"name": "x", "unit": "", "values": [1.0]}
    return {
        "maps": [
            {
                "name": name,
                "method": method,
                "title": "A map",
                "truth": "truth",
                "unit": "mm",
                "tolerance": 0.1,
                "x": axis,
                "y": axis,
                "cells": [[{"outcome": outcome, "error": None, "said": ""}]],
            }
        ]
    }


def test_a_new_sweep_replaces_its_method_and_keeps_the_others(tmp_path):
    """What the helper sends joins what was kept, and is there at the next start; a broken file is said."""
    model = AtlasModel(JobRunner(), tmp_path)
    job = SimpleNamespace(state=JobState.DONE, failure=None, result=None)
    for result in (swept("fit"), swept("alarms"), swept("fit", outcome="refused")):
        job.result = result
        model._ended(job)
    again = AtlasModel(JobRunner(), tmp_path)
    assert {m: shown[0].cells[0][0].outcome for m, shown in again.maps.items()} == {
        "alarms": "works",
        "fit": "refused",
    }
    assert again.status("figures") == "not mapped yet"
    again.path.write_text("[]", encoding="utf-8")
    assert AtlasModel(JobRunner(), tmp_path).status("fit") == "\u25b2 the last maps could not be read; sweep again"
