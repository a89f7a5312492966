"""The atlas as files: one JSON of all maps, and one picture per method: where it works, warns or refuses.

Rules: every outcome has a colour, a hatching and a letter, so that it is recognised without colour; the fourth, wrong
without warning, must never occur. Values are drawn at equal distances along both axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from analysis import figure_style as style
from analysis.machine import machine
from analysis.studies.failure_maps.sweep import CellOutcome, StudyMap
from analysis.studies.harness import Picture, write_json, write_pictures

LOOK: dict[CellOutcome, tuple[str, str, str, str]] = {
    CellOutcome.WORKS: ("#9AD0F0", "", "", "works: within its tolerance"),
    CellOutcome.WARNS: ("#F0E442", "///", "d", "d: works with a warning"),
    CellOutcome.REFUSES: ("#C9CED6", "xx", "r", "r: refuses, with the reason"),
    CellOutcome.WRONG_UNWARNED: ("#000000", "", "!", "!: wrong without warning (must not occur)"),
}
"""Colour, hatching, letter and entry in the legend of each outcome."""
PANEL_INCH = (4.4, 3.7)
MOST_COLUMNS = 3


def draw_map(axes: Axes, drawn: StudyMap) -> None:
    """Draw one map into given axes."""
    study = drawn.study
    for j, row in enumerate(drawn.cells):
        for i, cell in enumerate(row):
            colour, hatch, letter, _ = LOOK[cell.outcome]
            ink = style.PAPER_COLOUR if cell.outcome is CellOutcome.WRONG_UNWARNED else style.SOFT
            axes.add_patch(Rectangle((i - 0.5, j - 0.5), 1, 1, fc=colour, ec=style.PAPER_COLOUR, hatch=hatch, lw=0.8))
            if letter:
                axes.text(i, j, letter, ha="center", va="center", fontsize=7, color=ink)
    axes.set(xlim=(-0.5, len(study.x.values) - 0.5), ylim=(-0.5, len(study.y.values) - 0.5), title=study.title)
    axes.set(xlabel=study.x.title, ylabel=study.y.title)
    axes.set_xticks(range(len(study.x.values)), study.x.ticks, fontsize=6.5, rotation=45, ha="right")
    axes.set_yticks(range(len(study.y.values)), study.y.ticks, fontsize=6.5)
    axes.grid(visible=False)


def method_atlas(maps: Sequence[StudyMap]) -> Figure:
    """Draw the maps of one method side by side, with a legend of the outcomes."""
    columns = 2 if len(maps) == 4 else min(len(maps), MOST_COLUMNS)
    rows = -(-len(maps) // columns)
    size = (max(PANEL_INCH[0] * columns, 6.4), PANEL_INCH[1] * rows + 0.5)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, drawn in zip(grid, maps, strict=False):
        draw_map(axes, drawn)
    for axes in grid[len(maps) :]:
        axes.set_axis_off()
    seen = [o for o in CellOutcome if any(m.counts[o] for m in maps) or o is not CellOutcome.WRONG_UNWARNED]
    handles = [Patch(fc=LOOK[o][0], hatch=LOOK[o][1], ec=style.SOFT, label=LOOK[o][3]) for o in seen]
    figure.legend(handles=handles, loc="outside upper center", ncols=2 if columns < MOST_COLUMNS else len(handles))
    return figure


def atlas_json(maps: Sequence[StudyMap]) -> dict[str, Any]:
    """Return what `atlas --json` prints."""
    return {
        "machine": machine(),
        "outcomes": {outcome.value: text for outcome, (*_, text) in LOOK.items()},
        "quiet_wrong": sum(len(m.found(CellOutcome.WRONG_UNWARNED)) for m in maps),
        "maps": [m.as_json() for m in maps],
    }


def write_atlas(maps: Sequence[StudyMap], folder: Path) -> list[Path]:
    """Write atlas.json and, for each method, METHOD.png and METHOD.svg; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(atlas_json(maps), folder / "atlas.json")
    methods = dict.fromkeys(m.study.method for m in maps)
    pictures = [Picture(name, partial(method_atlas, [m for m in maps if m.study.method == name])) for name in methods]
    return [folder / "atlas.json", *write_pictures(pictures, folder, hatch_linewidth=0.3)]
