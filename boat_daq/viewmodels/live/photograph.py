"""An elongation from a photograph of the millimetre grid: two clicks for the scale, one for the tip.

Rules: positions are pixels of the picture, not of the screen. The elongation is the displacement of the
tip along the axis from its place at rest; the axis points from the first scale click to the second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

Point = tuple[float, float]
_STEPS = (
    "Click a line of the grid near the base.",
    "Click a second line further along, towards the tip.",
    "Click the tip where it was at rest (0 kPa).",
    "Click the tip now.",
    "Press Enter to take the reading, or click again to correct the tip.",
)


@dataclass(frozen=True, slots=True)
class Photograph:
    """Clicks so far.

    Parameters
    ----------
    distance_mm : distance of the first two clicks, from the grid.
    clicks : pixels: two of the scale, the tip at rest, the tip now.
    click_px : standard deviation of a click, pixels.
    """

    distance_mm: float = 10.0
    clicks: tuple[Point, ...] = ()
    click_px: float = 1.0

    def click(self, x: float, y: float) -> Photograph:
        """Return the state after one more click; a fifth replaces the tip."""
        return replace(self, clicks=(*self.clicks[:3], (x, y)))

    def back(self) -> Photograph:
        return replace(self, clicks=self.clicks[:-1])

    def next_picture(self) -> Photograph:
        """Return the state for the next picture of the same camera: scale and rest stay."""
        return replace(self, clicks=self.clicks[:3])

    def with_distance(self, distance_mm: float) -> Photograph:
        """Return the state with another distance of the scale clicks; ValueError where it is not above 0."""
        if not distance_mm > 0:
            raise ValueError(distance_mm)
        return replace(self, distance_mm=distance_mm)

    @property
    def instruction(self) -> str:
        return _STEPS[len(self.clicks)]

    @property
    def mm_per_pixel(self) -> float | None:
        """Return the scale; None before two distinct clicks."""
        if len(self.clicks) < 2:
            return None
        length = math.dist(self.clicks[0], self.clicks[1])
        return self.distance_mm / length if length > 0 else None

    @property
    def elongation_mm(self) -> float | None:
        """Return the elongation; None before all four clicks."""
        scale = self.mm_per_pixel
        if scale is None or len(self.clicks) < 4:
            return None
        (ax, ay), (bx, by), (rx, ry), (tx, ty) = self.clicks
        length = math.dist((ax, ay), (bx, by))
        return ((tx - rx) * (bx - ax) + (ty - ry) * (by - ay)) / length * scale

    @property
    def resolution_mm(self) -> float | None:
        """Return the reading's resolution that has the clicks' own standard deviation (width of the uniform one)."""
        scale, x = self.mm_per_pixel, self.elongation_mm
        if scale is None or x is None:
            return None
        length_px = self.distance_mm / scale
        sd = scale * self.click_px * math.sqrt(2 + 2 * (x / scale / length_px) ** 2)
        return sd * math.sqrt(12)
