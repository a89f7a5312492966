"""The shadow's table built, and its compiled parts made, in a process of its own; the window then only loads them."""

from __future__ import annotations

from collections.abc import Callable

from analysis.fidelity import fidelity
from analysis.shadow.fidelity import actuator, table_settings
from analysis.shadow.shadow import Shadow
from analysis.shadow.table import load_table


def shadow_of(level: str = "normal", *, progress: Callable[[float, float], None] | None = None) -> Shadow:
    """Return the shadow at a level of fidelity; its table comes from the cache, or is built.

    Raises
    ------
    RequestError : there is no such level.
    """
    chosen = fidelity(level)
    parameters = actuator(chosen)
    return Shadow(parameters, load_table(parameters, table_settings(chosen), progress=progress))


def warm(level: str = "normal", *, progress: Callable[[float, float], None] | None = None) -> float:
    """Build or load the table, answer one state; returns the seconds that one costs."""
    shadow = shadow_of(level, progress=progress)
    return shadow.state(pressure_kpa=20.0, elongation_mm=1.0).seconds
