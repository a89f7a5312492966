"""The shadow's pane: the actuator as it is now, drawn from pressure and measured elongation.

Without a calibration the elongation is not known and the outline stays at rest, in words too. Lengths in mm, r to the
right, z upwards from the fixed base.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boat_daq.viewmodels.formatting import number
from boat_daq.viewmodels.live import Inverse, Ring, signals

Array = NDArray[np.float64]

LENGTH_MM = 75.0  # six cells of 12.5 mm
RADIUS_MM = 25.0
RECENT_S = 0.1


@dataclass(frozen=True, slots=True)
class ShadowPicture:
    """What the pane draws.

    Attributes
    ----------
    rest, now : [k, 2] closed outlines (r, z) mm.
    nominal_mm, measured_mm : elongation by the model at this pressure, and as measured; NaN where unknown.
    lines : (name, value, state) under the picture.
    """

    rest: Array
    now: Array
    nominal_mm: float
    measured_mm: float
    lines: tuple[tuple[str, str, str], ...]


def outline(elongation_mm: float) -> Array:
    """Return the actuator's outline, its length changed by `elongation_mm`, its volume's width left alone."""
    top = LENGTH_MM + (elongation_mm if math.isfinite(elongation_mm) else 0.0)
    return np.array([[-RADIUS_MM, 0.0], [RADIUS_MM, 0.0], [RADIUS_MM, top], [-RADIUS_MM, top]])


class ShadowLive:
    """State of the pane.

    Parameters
    ----------
    ring : gives the ring of the moment.
    inverse : gives the calibration's inverse of the moment, or None.
    """

    def __init__(self, ring: Callable[[], Ring | None], inverse: Callable[[], Inverse | None]) -> None:
        self._ring, self._inverse = ring, inverse

    def now(self) -> tuple[float, float]:
        """Return pressure (kPa) and measured elongation (mm) of the last moment; NaN where unknown."""
        ring, inverse = self._ring(), self._inverse()
        recent = ring.view(last=10) if ring is not None else {"time_s": np.zeros(0)}
        if not recent["time_s"].size:
            return math.nan, math.nan
        pressure = float(recent["pressure_kpa"].mean())
        if inverse is None:
            return pressure, math.nan
        return pressure, float(inverse(signals(recent).mean(axis=0, keepdims=True)).mm[0])

    def picture(self) -> ShadowPicture:
        """Return the picture of this instant."""
        pressure, measured = self.now()
        words = f"{number(measured, 2, sign=True)} mm" if math.isfinite(measured) else "no calibration yet"
        lines = (
            ("Measured", words, ""),
            ("Pressure", f"{number(pressure, 1, sign=True)} kPa", ""),
        )
        return ShadowPicture(outline(0.0), outline(measured), math.nan, measured, lines)
