"""The page that sets the paper's numbers beside ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.optics.scene.curves import default_curves
from analysis.published import RANGE_MM
from analysis.shadow.model.states import GuideStates
from analysis.studies.paper.numbers import PaperDrawing, Reproduction, draw_states, shadow_rows


def test_the_table_has_a_line_a_row_and_its_drawings(tmp_path):
    states = GuideStates(default_curves(), np.zeros(15), np.linspace(*RANGE_MM, 15), "stored")
    rows = shadow_rows(states, -44.8, 400.0, 2e4)
    path = tmp_path / "states.png"
    draw_states(states.curves_mm, path)
    found = Reproduction(rows, [PaperDrawing("2B", "shapes of the guides", path)])
    text = found.table()
    assert text.count("\n| shadow") == len(rows)
    assert "SIMULATED" in text
    assert "![states](states.png)" in text
    assert "Figure 2B: shapes of the guides." in text
    assert found.as_json()["rows"][0]["paper"] == RANGE_MM[0]
    assert found.as_json()["drawings"] == [{"figure": "2B", "shows": "shapes of the guides", "file": str(path)}]
    assert next(row.ours for row in rows if "points of both" in row.quantity) == 14
    assert Path(path).stat().st_size > 1000
