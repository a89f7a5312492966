"""The page that sets the paper's numbers beside ours."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.published import RANGE_MM
from analysis.reports.reproduction import Reproduction, draw_states, shadow_rows


def test_the_table_has_a_line_a_row_and_its_drawings(tmp_path):
    rows = shadow_rows(np.linspace(*RANGE_MM, 15), 400.0, 2e4)
    path = tmp_path / "states.png"
    draw_states(np.random.default_rng(0).normal(size=(2, 2, 7, 2)), path)
    found = Reproduction(rows, [path])
    text = found.table()
    assert text.count("\n| shadow") == len(rows)
    assert "SIMULATED" in text
    assert "![states](states.png)" in text
    assert found.as_json()["rows"][0]["paper"] == RANGE_MM[0]
    assert Path(path).stat().st_size > 1000
