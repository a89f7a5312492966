"""The shadow's table built, and its compiled parts made, in a process of its own; the window then only loads them."""

from __future__ import annotations

from collections.abc import Callable

from analysis.shadow.shadow import Shadow


def warm(*, progress: Callable[[float, float], None] | None = None) -> float:
    """Build or load the table, answer one state; returns the seconds that one costs."""
    shadow = Shadow(progress=progress)
    return shadow.state(pressure_kpa=20.0, elongation_mm=1.0).seconds
