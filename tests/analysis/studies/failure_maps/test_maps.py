"""The atlas as JSON and files."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
from matplotlib import colormaps

from analysis.studies.failure_maps.maps import atlas_json, group_chart, write_atlas
from analysis.studies.failure_maps.sweep import Axis, Study, StudyMap, StudyResult, sweep
from protocol.base.errors import DataError


def ladder(x: float, y: float) -> StudyResult:
    """Right below 2, a warning from 2, refused from 3; wrong without warning where x and y are 1."""
    if x >= 3:
        raise DataError("too far", "Come back.")
    return StudyResult(5.0 if x == y == 1 else 0.0, "far" if x >= 2 else "")


def ladder_study() -> Study:
    return Study(
        "ladder-x", "alarms", "A ladder", "itself", "mm", 1.0, Axis("x", "mm", (0, 1, 2, 3)),
        Axis("y", "", (0, 1), ("none", "one")), ladder,
    )  # fmt: skip


def ladder_map() -> StudyMap:
    return sweep(ladder_study())


def test_the_json_has_the_map() -> None:
    """Plain JSON without NaN; labels, counts, and null where there is no error."""
    content = json.loads(json.dumps(atlas_json([ladder_map()]), allow_nan=False))
    (drawn,) = content["maps"]
    assert content["quiet_wrong"] == 1
    assert drawn["y"]["labels"] == ["none", "one"]
    assert drawn["cells"][0][3] == {"x": 3, "y": 0, "outcome": "refused", "error": None, "said": "too far"}


def test_a_picture_shows_the_error_and_where_the_warning_begins(tmp_path: Path) -> None:
    """Five times the tolerance has its colour, also without a warning; the border follows the warnings alone."""
    figure = group_chart([ladder_map()])
    axes = figure.axes[0]
    fills = {patch.get_xy(): patch.get_facecolor() for patch in axes.patches}
    viridis = colormaps["viridis"]
    assert fills[-0.5, -0.5] == pytest.approx(viridis(0.22))
    assert fills[0.5, 0.5] == pytest.approx(viridis(0.22 + 0.78 * (math.log10(5.0) + 3.0) / 6.0), abs=0.01)
    marks = {tuple(line.get_xydata()[0]): line.get_marker() for line in axes.lines}
    assert marks == {(1.0, 1.0): "x", (2.0, 0.0): "o", (2.0, 1.0): "o"}
    segments = [part.tolist() for part in axes.collections[0].get_segments()]
    assert segments == [[[1.5, -0.5], [1.5, 0.5]], [[1.5, 0.5], [1.5, 1.5]]]
    assert len(figure.legends[0].get_texts()) == 4
    assert re.search(r"cores.*20\d\d-", figure.get_supxlabel())
    files = write_atlas([ladder_map()], tmp_path)
    assert [f.name for f in files] == ["atlas.json", "shadow.png", "shadow.svg"]
    assert all(f.stat().st_size > 1000 for f in files)
