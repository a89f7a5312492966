"""What the trade-off page has measured, the painting of the live plot included; called in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from boat_daq.gui.models.tradeoff_painting import painter
from boat_daq.viewmodels.models import tradeoff_jobs as tradeoff_work
from boat_daq.viewmodels.models.tradeoff_decimation import HEIGHT_PX, WIDTH_PX, decimation


def measure_methods(
    names: Sequence[str], quick: bool, *, progress: Callable[[float, float], None] | None = None
) -> dict[str, Any]:
    """Measure as `viewmodels.tradeoff_work.measure_methods`; a curve of the live plot is painted too."""
    painted = decimation(painter(WIDTH_PX, HEIGHT_PX))
    return tradeoff_work.measure_methods(names, quick, painted, progress=progress)
