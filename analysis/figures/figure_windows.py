"""Which samples each figure of a sensor rests on, what they lost, and what that does to the figure.

Rules: figures of the calibration rest on the plateaus whose elongation was read, the others on all plateaus or cycles
that are used; above the limit a figure is void, whatever could still be computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.figures.figure import Figure
from analysis.segmentation.loops import MAX_DAMAGED_CYCLE
from analysis.segmentation.losses import LossCounter, Losses

if TYPE_CHECKING:
    from analysis.figures.sensor_analysis import Run

OF_POINTS = (  # figures of the calibration's points; the others are those of the loops
    "sensitivity_mv_per_mm", "slope_at_rest_mv_per_mm", "least_squares_slope_mv_per_mm",
    "sensor_hysteresis_percent_fso",
)  # fmt: skip


def with_losses(run: Run, sensor: int, figures: Mapping[str, Figure]) -> dict[str, Figure]:
    """Say of every figure what its window lost; void it above the limit, or where the losses left it nothing."""
    counter, chosen = LossCounter.of(run.recording, sensor), set(run.loops.numbers)
    if run.plateaus:
        holds = [p for p in run.plateaus if p.cycle in chosen and p.branch]
        of_loops = counter.of_windows([slice(p.settled_first, p.last + 1) for p in holds])
        read = set() if run.elongations is None else set(np.flatnonzero(run.elongations.known).tolist())
        points = [p for i, p in enumerate(run.plateaus) if i in read and p.cycle in chosen and p.branch]
        of_points = counter.of_windows([slice(p.settled_first, p.last + 1) for p in points])
    else:
        of_loops = of_points = counter.of_windows([c.rows for c in run.cycles.used])
    return {name: _over(figure, of_points if name in OF_POINTS else of_loops) for name, figure in figures.items()}


def _over(figure: Figure, window: Losses) -> Figure:
    void = window.void()
    if void and not figure.void:
        return replace(figure, value=float("nan"), low=float("nan"), high=float("nan"), void=void, window=window)
    if figure.void and window.void(MAX_DAMAGED_CYCLE):
        return replace(figure, void=f"{figure.void}: {window.void(MAX_DAMAGED_CYCLE)}", window=window)
    return replace(figure, window=window)
