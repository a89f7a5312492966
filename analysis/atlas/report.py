"""The atlas as files: one JSON of all maps, one picture per method."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from PIL import Image

from analysis import figure_style as style
from analysis.atlas.chart import LEGEND, method_atlas
from analysis.atlas.sweep import CellOutcome, StudyMap
from analysis.machine import machine

DPI = 110
COLOURS = 64
"""Of a PNG: enough for the maps, and the file is a third as large."""
HATCH = {"hatch.linewidth": 0.3}


def atlas_json(maps: Sequence[StudyMap]) -> dict[str, Any]:
    """Return what `atlas --json` prints."""
    return {
        "machine": machine(),
        "outcomes": {outcome.value: text for outcome, text in LEGEND.items()},
        "quiet_wrong": sum(len(m.found(CellOutcome.WRONG_UNWARNED)) for m in maps),
        "maps": [m.as_json() for m in maps],
    }


def write_atlas(maps: Sequence[StudyMap], folder: Path) -> list[Path]:
    """Write atlas.json and, for each method, METHOD.png and METHOD.svg; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / "atlas.json"]
    text = json.dumps(atlas_json(maps), indent=1, ensure_ascii=False, allow_nan=False)
    files[0].write_text(text + "\n", encoding="utf-8")
    with mpl.rc_context(style.RC | HATCH):
        for method in dict.fromkeys(m.study.method for m in maps):
            figure = method_atlas([m for m in maps if m.study.method == method])
            for kind in ("png", "svg"):
                files.append(folder / f"{method}.{kind}")
                figure.savefig(files[-1], dpi=DPI, metadata={"Date": None} if kind == "svg" else None)
            _reduce(folder / f"{method}.png")
    return files


def _reduce(picture: Path) -> None:
    with Image.open(picture) as full:
        small = full.convert("RGB").quantize(COLOURS)
    small.save(picture, optimize=True)
