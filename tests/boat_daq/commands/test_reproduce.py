"""`boat-daq reproduce`: JSON keys, files and refusals."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves, elongations
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design
from analysis.shadow.model.states import GuideStates
from analysis.studies.paper import interpretations
from tests.boat_daq.commands.calls import call, refusal


@pytest.mark.nightly
def test_optics_ranks_the_papers_design_in_each_reading(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ranks, factors, influences and what would decide are in the JSON; a table and the outcomes are in the folder."""
    wider = GuideStates(default_curves(), np.zeros(15), elongations(), "stored")
    monkeypatch.setattr("analysis.shadow.model.states.kept_states", lambda *_, **__: wider)
    monkeypatch.setattr(interpretations, "paper_grid", lambda face: [PAPER_OPTIMUM, Design(5, 1.0, 0.6, 0.9)])
    monkeypatch.setattr(interpretations, "FACES", ("outer",))
    monkeypatch.setattr(interpretations, "THICKNESSES_MM", (2.0,))
    monkeypatch.setattr(interpretations, "reproduce", partial(interpretations.reproduce, fans=1, rays=260))
    out = call("reproduce", "optics", "--out", str(tmp_path))
    assert isinstance(out["readings"], list)
    assert len(out["readings"]) == 2 * 6
    assert {"face", "thickness_mm", "states", "emission", "ranks", "factors", "best"} <= set(out["readings"][0])
    assert {each["states"] for each in out["readings"]} == {"-40 to +50 kPa", "-50 to +50 kPa", "formula"}
    assert set(out["decided_by"]) == {"states", "emission", "order"}  # type: ignore[call-overload]
    assert {path.name for path in tmp_path.iterdir()} == {"optics.json", "optics.md"}


def test_bad_requests(tmp_path: Path) -> None:
    """A folder that cannot be written is refused."""
    (tmp_path / "file").write_text("")
    assert "cannot be written" in refusal("reproduce", "optics", "--out", str(tmp_path / "file" / "x")).cause
