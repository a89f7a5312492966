"""Optical scenes from TOML files."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis.optics.scene.parameters import ALL, FULL_FAINTEST, Light, Waveguide
from analysis.optics.scene.scene_file import read_scene
from protocol.base.errors import FileError, RequestError


def written(folder: Path, text: str) -> Path:
    (path := folder / "scene.toml").write_text(text)
    return path


def test_the_default_scene_is_the_paper() -> None:
    scene = read_scene(None)
    assert (scene.guide, scene.light(250, 100), scene.stated("index", "face")) == (Waveguide(), Light(), [])


def test_a_file_changes_what_it_names(tmp_path: Path) -> None:
    text = 'thickness_mm = 1.5\nreceiver_mm = 1\nface = "inner"\nsecondary = -1\ncurves = "states.csv"'
    scene = read_scene(written(tmp_path, text))
    assert scene.guide == Waveguide(thickness_mm=1.5, receiver_mm=1)
    assert scene.stated("index", "face") == ["face"]
    assert scene.curves == str(tmp_path / "states.csv")
    assert scene.light(500, ALL) == Light(rays=500, secondary=ALL, phase=0.25, faintest=FULL_FAINTEST)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("thicknes_mm = 2", "has 'thicknes_mm'"),
        ('index = "1.5"', "index = '1.5' is not a number"),
        ("secondary = 1.5", "secondary = 1.5 is not a whole number"),
        ("face = 1", "face = 1 is not text"),
        ("phase = true", "phase = True is not a number"),
        ('rank_by = "hits"', "rank_by is 'hits'"),
    ],
)
def test_unknown_keys_and_wrong_values_are_named(tmp_path: Path, text: str, cause: str) -> None:
    with pytest.raises(RequestError) as refusal:
        read_scene(written(tmp_path, text))
    assert cause in refusal.value.cause


def test_what_is_no_toml_is_refused(tmp_path: Path) -> None:
    for path in (written(tmp_path, "index: 1"), tmp_path / "none.toml", tmp_path):
        with pytest.raises(FileError):
            read_scene(path)
