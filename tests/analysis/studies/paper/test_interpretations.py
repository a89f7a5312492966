"""Readings of what the paper leaves open: what is swept, ranks and factors, influences, and resumption."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves, parametric_curves
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light
from analysis.optics.sweep.fans import turned
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.studies.paper import interpretations
from analysis.studies.paper.interpretations import AXES, influences, plan, readings_json, reproduce
from protocol.base.errors import FileError, RequestError

CURVES = {"solved": default_curves(), "the same": default_curves(), "formula": parametric_curves()}
FEW = (PAPER_OPTIMUM, Design(5, 1.0, 0.6, 0.9), Design(5, 0.9, 0.5, 0.9), Design(7, 1.0, 0.5, 0.6))


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweep four designs, in one face and one thickness."""
    monkeypatch.setattr(interpretations, "paper_grid", lambda face: list(FEW))
    monkeypatch.setattr(interpretations, "FACES", ("outer",))
    monkeypatch.setattr(interpretations, "THICKNESSES_MM", (2.0,))


def test_each_single_change_is_swept_as_in_the_paper_and_with_more_rays() -> None:
    """The default reading and nine with one change, with turns of the fan and 250 rays, and then with more rays."""
    todo = plan(["a", "b", "c"], 3, 1_000)
    found = [reading for reading, _ in todo[:10]]
    assert len(set(found)) == 10
    assert [reading for reading, _ in todo[10:]] == found
    assert all(sum(getattr(r, axis) != getattr(found[0], axis) for axis in AXES) == 1 for r in found[1:])
    assert [(s.rays, s.fans) for _, s in todo] == [(250, 3)] * 10 + [(1_000, 1)] * 10
    with pytest.raises(RequestError, match="turns of the fan"):
        reproduce(CURVES, fans=0)


@pytest.mark.usefixtures("few")
def test_ranks_are_those_of_the_sweep_and_factors_multiply_to_the_ratio() -> None:
    """The outcome of each turn of the fan is the sweep's; the best P over the paper's is the product of its factors."""
    found = reproduce(CURVES, fans=2, rays=40)
    first = found[0]
    for turn in range(2):
        result = run_sweep(SweepRequest(FEW, light=turned(Light(), turn)))
        assert first.ranks["all"][turn] == result.ranks()[0]
    assert first.of == {"all": 4, "same_cavities": 3, "paper_map": 2}
    for outcome in found:
        assert np.prod(list(outcome.factors.values())) == pytest.approx(outcome.best_p / outcome.paper_p)
        assert outcome.won("all") == np.mean(np.array(outcome.ranks["all"]) == 1)
    same = [i.correlation for i in influences(found) if i.value == "the same"]
    assert same == pytest.approx([1.0])
    content = readings_json(found)
    assert len(content["readings"]) == len(found)
    assert next(iter(content["decided_by"])) == influences(found)[0].axis
    text = interpretations.readings_text(found)
    assert "250 rays, 2 turns, 6 readings" in text
    assert interpretations.readings_table(found).count("\n") == 2 + len(found)


@pytest.mark.usefixtures("few")
def test_a_stopped_call_resumes_from_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was finished is not swept again; the end is that of a call that was not stopped; other curves are not it."""
    curves = {"solved": CURVES["solved"]}

    def stop(done: float, total: float) -> None:
        if done > total / 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reproduce(curves, fans=1, rays=20, folder=tmp_path, progress=stop)
    swept: list[SweepRequest] = []

    def counted(request: SweepRequest, **options: object) -> object:
        swept.append(request)
        return run_sweep(request)

    monkeypatch.setattr(interpretations, "run_sweep", counted)
    again = reproduce(curves, fans=1, rays=20, folder=tmp_path)
    resumed = len(swept)
    assert again == reproduce(curves, fans=1, rays=20)
    assert 0 < resumed < len(swept) - resumed
    (tmp_path / "optics.json").write_text("[]")
    with pytest.raises(FileError, match="damaged"):
        reproduce(curves, fans=1, rays=20, folder=tmp_path)
