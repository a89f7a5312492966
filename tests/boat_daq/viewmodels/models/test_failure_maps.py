"""The stability atlas: maps read, merged, refused."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import pytest

from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult
from boat_daq.viewmodels.models.failure_maps import MAPPED_BY, AtlasModel, read_maps
from boat_daq.viewmodels.models.tradeoff import ENTRIES
from boat_daq.workflows import measured_methods
from boat_daq.workflows.jobs import JobRunner, JobState
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.models.reports import swept


def study():
    """Right below 1, a warning at 1, a refusal (no number, a reason) at 2."""
    answers = {0.0: StudyResult(0.0), 1.0: StudyResult(0.5, "a flag"), 2.0: StudyResult(math.nan, "too far")}
    return Study(
        "map", "fit", "A map", "truth", "mm", 0.1, Axis("x", "mm", (0.0, 1.0, 2.0)), Axis("y", "", (5.0,), ("five",)),
        lambda x, y: answers[x],
    )  # fmt: skip


def test_swept_map_is_read_with_its_texts(monkeypatch, tmp_path):
    """Outcome, error and message are in their cell; beside the map there is no text."""
    monkeypatch.setattr("analysis.studies.failure_maps.methods.chosen_studies", lambda names: [study()])
    model = AtlasModel(JobRunner(), tmp_path)
    model.take(json.loads(json.dumps(measured_methods.sweep_method("fit"))))
    shown = model.maps["fit"][0]
    assert [p.outcome for p in shown.cells[0]] == ["works", "degraded", "refused"]
    assert shown.cell_text(1, 0) == "x (mm) 1, y five \u2013 works with a warning, error 0.50 mm: a flag"
    assert shown.cell_text(2, 0).endswith("refuses: too far")
    assert shown.cell_text(3, 0) == ""
    assert shown.summary.startswith("works in 1, works with a warning in 1, refuses in 1 of 3 cases")


@pytest.mark.parametrize("content", [{}, {"maps": [{"name": "x"}]}, None])
def test_file_without_an_atlas_is_refused(content):
    """Another file's content is refused by name."""
    with pytest.raises(RequestError, match="not a stability atlas"):
        read_maps(content)


def test_new_sweep_replaces_its_method_only(tmp_path):
    """What the helper sends joins what was kept, and is there at the next start; a broken file is reported."""
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


def test_every_entry_has_a_map_or_states_where_to_look():
    """What the atlas does not study names methods that it does."""
    from analysis.studies.failure_maps.methods import METHOD_TITLES

    assert set(ENTRIES) - set(MAPPED_BY) == set(METHOD_TITLES)
    assert {name for names in MAPPED_BY.values() for name in names} <= set(METHOD_TITLES)
    assert AtlasModel.no_map("tracer") == ""
    assert AtlasModel.no_map("sweep") == "No map of its own: see \u201cRay tracer\u201d."
