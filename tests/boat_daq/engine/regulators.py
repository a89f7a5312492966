"""The regulator of a virtual unit, as the engine drives it."""

from __future__ import annotations

from typing import Any

from boat_daq.engine.control.elongation import Regulator
from boat_daq.workflows.unit_control import as_regulator
from tests.analysis import twin_unit


def regulator(*args: Any, **options: Any) -> Regulator:
    """Return that of `twin_unit.regulator`."""
    return as_regulator(twin_unit.regulator(*args, **options))
