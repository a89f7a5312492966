"""The atlas as files: one JSON of all maps, and a picture of each group of methods.

Rules: the colour is the error over the tolerance, on one scale for all; a line goes around the cells with a warning,
which have a dot; what is refused has no error and is hatched. Wrong without warning is a cross, and must never occur.
Values are drawn at equal distances along both axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.patheffects import Normal, Stroke

from analysis import figure_style as style
from analysis.studies.failure_maps import alarms, figures, fit, sessions, shadow, tracer
from analysis.studies.failure_maps.sweep import CellOutcome, Study, StudyMap
from analysis.studies.harness import Picture, chosen, machine, write_json, write_pictures

_STUDIES = (
    fit.FIT_STUDIES,
    sessions.SESSION_STUDIES,
    figures.FIGURE_STUDIES,
    tracer.TRACER_STUDIES,
    shadow.SHADOW_STUDIES,
    alarms.ALARM_STUDIES,
)
STUDIES: dict[str, Study] = {study.name: study for studies in _STUDIES for study in studies}


def chosen_studies(names: Iterable[str]) -> list[Study]:
    """Return the studies of methods or maps by name, each once, in the atlas' order; all for no names."""
    return chosen(list(STUDIES.values()), names, lambda study: (study.method, study.name))


_GROUPS = {
    "calibration": ("fit", "inverse", "posterior"),
    "run": ("segmentation", "figures"),
    "optics": ("tracer",),
    "shadow": ("full-fem", "reduced-fem", "alarms"),
}
"""Methods of each picture."""
_TEXTS = {
    CellOutcome.WORKS: "works: within its tolerance",
    CellOutcome.WARNS: "works with a warning",
    CellOutcome.REFUSES: "refuses, with the reason",
    CellOutcome.WRONG_UNWARNED: "wrong without warning (must not occur)",
}
_PANEL_INCH = (4.0, 3.5)
_SHADES = ListedColormap(colormaps["viridis"](np.linspace(0.22, 1.0, 256)))  # without those that hide a line
_COLOURS = ScalarMappable(Normalize(-3.0, 3.0), _SHADES)
_REFUSED = "#E4E6EA"
_WARNED = (CellOutcome.WARNS, CellOutcome.REFUSES)
_MARKS: dict[CellOutcome, dict[str, Any]] = {
    CellOutcome.WARNS: {"marker": "o", "ms": 4, "mfc": style.PAPER_COLOUR, "mec": style.INK, "mew": 0.6},
    CellOutcome.WRONG_UNWARNED: {"marker": "x", "ms": 7, "mec": style.INK},
}
_CASED = [Stroke(linewidth=4.0, foreground=style.PAPER_COLOUR), Normal()]


def draw_map(axes: Axes, drawn: StudyMap) -> None:
    """Draw one map into given axes."""
    study = drawn.study
    for j, row in enumerate(drawn.cells):
        for i, cell in enumerate(row):
            corner, refused = (i - 0.5, j - 0.5), cell.outcome is CellOutcome.REFUSES
            with np.errstate(divide="ignore"):
                level = np.log10(np.float64(cell.error) / study.tolerance) if cell.error else -np.inf
            colour = _REFUSED if np.isnan(level) else _COLOURS.to_rgba(np.clip(level, -9.0, 9.0))
            edge = style.SOFT if refused else "none"
            axes.add_patch(Rectangle(corner, 1, 1, fc=colour, ec=edge, hatch="///" if refused else "", lw=0))
            if cell.outcome in _MARKS:
                axes.plot(i, j, ls="", **_MARKS[cell.outcome])
    border = LineCollection(_border(drawn), colors=style.INK, linewidths=2.0, capstyle="projecting")
    border.set_path_effects(_CASED)
    axes.add_collection(border)
    axes.set(xlim=(-0.5, len(study.x.values) - 0.5), ylim=(-0.5, len(study.y.values) - 0.5))
    axes.set_title(study.title, fontsize=8)
    axes.set(xlabel=study.x.title, ylabel=study.y.title)
    axes.set_xticks(range(len(study.x.values)), study.x.ticks, fontsize=6.5, rotation=45, ha="right")
    axes.set_yticks(range(len(study.y.values)), study.y.ticks, fontsize=6.5)
    axes.grid(visible=False)


def _border(drawn: StudyMap) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the edges between cells with a warning or refusal, and cells without."""
    warned = np.array([[cell.outcome in _WARNED for cell in row] for row in drawn.cells])
    upright = [((i + 0.5, j - 0.5), (i + 0.5, j + 0.5)) for j, i in np.argwhere(warned[:, 1:] != warned[:, :-1])]
    level = [((i - 0.5, j + 0.5), (i + 0.5, j + 0.5)) for j, i in np.argwhere(warned[1:] != warned[:-1])]
    return upright + level


def group_chart(maps: Sequence[StudyMap]) -> Figure:
    """Draw maps side by side, with the scale of the error, and the computer and date."""
    columns = 2 if len(maps) == 4 else min(len(maps), 3)
    rows = -(-len(maps) // columns)
    size = (max(_PANEL_INCH[0] * columns + 0.9, 6.4), _PANEL_INCH[1] * rows + 0.8)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, drawn in zip(grid, maps, strict=False):
        draw_map(axes, drawn)
    for axes in grid[len(maps) :]:
        axes.set_axis_off()
    scale = figure.colorbar(_COLOURS, ax=grid.tolist(), extend="both", shrink=0.6, aspect=30)
    scale.set_label("error / tolerance")
    scale.set_ticks(range(-3, 4), labels=["0.001", "0.01", "0.1", "1", "10", "100", "1000"])
    scale.ax.axhline(0.0, color=style.PAPER_COLOUR, lw=1.5)
    handles: list[Any] = [Line2D([], [], color=style.INK, lw=2.0, label="a warning or a refusal begins here")]
    for outcome, mark in _MARKS.items():
        if outcome in _WARNED or any(m.counts[outcome] for m in maps):
            handles.append(Line2D([], [], ls="", label=_TEXTS[outcome], **mark))
    handles.append(Patch(fc=_REFUSED, hatch="///", ec=style.SOFT, label=_TEXTS[CellOutcome.REFUSES]))
    figure.legend(handles=handles, loc="outside upper center", ncols=2 if columns == 1 else 4)
    where = "{processor}, {cores} cores, Python {python}, {date_utc}".format(**machine())
    figure.supxlabel(where, fontsize=7, color=style.SOFT)
    return figure


def atlas_json(maps: Sequence[StudyMap]) -> dict[str, Any]:
    """Return what `atlas --json` prints."""
    return {
        "machine": machine(),
        "outcomes": {outcome.value: text for outcome, text in _TEXTS.items()},
        "quiet_wrong": sum(len(m.found(CellOutcome.WRONG_UNWARNED)) for m in maps),
        "maps": [m.as_json() for m in maps],
    }


def write_atlas(maps: Sequence[StudyMap], folder: Path) -> list[Path]:
    """Write atlas.json and, for each group, GROUP.png and GROUP.svg; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(atlas_json(maps), folder / "atlas.json")
    groups = {name: [m for m in maps if m.study.method in methods] for name, methods in _GROUPS.items()}
    pictures = [Picture(name, partial(group_chart, found)) for name, found in groups.items() if found]
    return [folder / "atlas.json", *write_pictures(pictures, folder, hatch_linewidth=0.4)]
