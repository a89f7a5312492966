"""The page that sets the paper's numbers beside ours."""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.optics.scene.curves import default_curves
from analysis.published import RANGE_MM
from analysis.shadow.model.states import GuideStates
from analysis.studies.paper.numbers import shadow_rows
from analysis.studies.paper.reproduction import TABLE, PaperDrawing, PaperPart, draw_states, write_reproduction


def test_the_page_has_a_line_a_row_and_its_drawings(tmp_path):
    states = GuideStates(default_curves(), np.zeros(15), np.linspace(*RANGE_MM, 15), "stored")
    rows = shadow_rows(states, -43.3, 400.0, 2e4)
    drawn = PaperDrawing("2B", "shapes of the guides", "states", partial(draw_states, states.curves_mm))
    content = write_reproduction([PaperPart(rows[:3], [drawn]), PaperPart(rows[3:], [])], tmp_path)
    text, path = (tmp_path / TABLE).read_text(encoding="utf-8"), tmp_path / "states.png"
    assert text.count("\n| shadow") == len(rows)
    assert "SIMULATED" in text
    assert "![states](states.png)" in text
    assert "Figure 2B: shapes of the guides." in text
    assert content["rows"][0]["paper"] == RANGE_MM[0]
    assert content["drawings"] == [{"figure": "2B", "shows": "shapes of the guides", "file": str(path)}]
    assert next(row.ours for row in rows if "points of both" in row.quantity) == 14
    assert path.stat().st_size > 1000
