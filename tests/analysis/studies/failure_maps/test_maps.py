"""The atlas as JSON and files."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.studies.failure_maps.maps import atlas_json, method_atlas, write_atlas
from analysis.studies.failure_maps.sweep import Axis, Study, StudyMap, StudyResult, sweep
from protocol.base.errors import DataError


def ladder(x: float, y: float) -> StudyResult:
    """Right below 2, a warning from 2, refused from 3; wrong without warning where x and y are 1."""
    if x >= 3:
        raise DataError("too far", "Come back.")
    return StudyResult(5.0 if x == y == 1 else 0.0, "far" if x >= 2 else "")


def ladder_study() -> Study:
    return Study(
        "ladder-x", "ladder", "A ladder", "itself", "mm", 1.0, Axis("x", "mm", (0, 1, 2, 3)),
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


def test_a_map_shows_outcomes_without_colour(tmp_path: Path) -> None:
    """Letters in the cells, words in the legend; the fourth outcome is named only where it is found."""
    figure = method_atlas([ladder_map()])
    letters = [text.get_text() for text in figure.axes[0].texts]
    assert sorted(letters) == ["!", "d", "d", "r", "r"]
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(legend) == 4
    files = write_atlas([ladder_map()], tmp_path)
    assert [f.name for f in files] == ["atlas.json", "ladder.png", "ladder.svg"]
    assert all(f.stat().st_size > 1000 for f in files)
