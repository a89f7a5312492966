"""The sheet of marks to print: base and tip at true size, with a scale to check the printer by."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.tracking.marks import BASE, MODULES, TIP, interior
from protocol.base.errors import RequestError, writing
from protocol.base.whole_file import written_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAGE_MM = (210.0, 297.0)
MM_PER_INCH = 25.4
SIDES_MM = (2.0, 60.0)
_RULER_MM = 100.0
_TEXT = (
    "Print at 100 % (no scaling) on matt paper. Check: the scale must measure 100.0 mm.\n"
    "Cut along the thin lines, and glue the marks flat, in one plane, edges parallel to the axis.\n"
    "Measure the black square with a caliper, and state its side as the size of the marks."
)


def write_sheet(path: Path, mark_mm: float) -> None:
    """Write the marks of base and tip as a PDF of A4 at true size.

    Raises RequestError: another kind of file, or a side that does not fit.
    """
    if path.suffix.lower() != ".pdf":
        raise RequestError(f"{path.name} does not end in .pdf", "End it in .pdf.")
    if not SIDES_MM[0] <= mark_mm <= SIDES_MM[1]:
        cause = f"a mark of {mark_mm:g} mm is not possible"
        raise RequestError(cause, f"Use {SIDES_MM[0]:g} to {SIDES_MM[1]:g} mm; 10 px of the picture for each module.")
    from matplotlib.backends.backend_pdf import FigureCanvasPdf
    from matplotlib.figure import Figure

    width, height = PAGE_MM
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    FigureCanvasPdf(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0, width), ylim=(0, height), aspect="auto")
    axes.axis("off")
    card_mm = mark_mm * (MODULES + 2) / MODULES
    for column, (number, name) in enumerate(((BASE, "base"), (TIP, "tip"))):
        _draw_mark(axes, 20.0 + column * (card_mm + 15.0), 240.0 - card_mm, mark_mm, number)
        axes.text(20.0 + column * (card_mm + 15.0), 242.0, f"{name}, {mark_mm:g} mm", fontsize=9)
    axes.plot([20, 20 + _RULER_MM], [150, 150], "k-", linewidth=0.4)
    for mm in range(0, round(_RULER_MM) + 1, 10):
        axes.plot([20 + mm, 20 + mm], [150, 154], "k-", linewidth=0.4)
        axes.text(20 + mm, 145, f"{mm}", fontsize=7, ha="center")
    axes.text(20, 125, _TEXT, fontsize=9)
    axes.text(20, 260, "boat-daq: marks for the camera", fontsize=14)
    with writing(path), written_whole(path) as part:
        figure.savefig(part, format="pdf", metadata={"Title": f"Marks of {mark_mm:g} mm", "CreationDate": None})


def _draw_mark(axes: Axes, x_mm: float, y_mm: float, mark_mm: float, number: int) -> None:
    """Draw a mark with its margin and the line to cut along, lower left corner of its card at (x, y)."""
    from matplotlib.patches import Rectangle

    module = mark_mm / MODULES
    card = mark_mm + 2 * module
    axes.add_patch(Rectangle((x_mm, y_mm), card, card, fill=False, edgecolor="0.7", linewidth=0.2))
    axes.add_patch(Rectangle((x_mm + module, y_mm + module), mark_mm, mark_mm, facecolor="black", linewidth=0))
    for row, column in np.argwhere(interior(number)).tolist():
        corner = (x_mm + (column + 1) * module, y_mm + (MODULES - row) * module)
        axes.add_patch(Rectangle(corner, module, module, facecolor="white", linewidth=0))
