"""Places for the labels of a chart: in sight, over no other label and no point, over as little of the lines as can be.

Strategy: labels are placed one after the other, the important ones first; each takes the best of its own candidates.
All lengths are in pixels; y is downwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

RINGS = 3
"""Candidates about a point are at so many distances; from further off it is unclear whose label it is."""
RANK_COST = 3.0
"""Square pixels that may be covered rather than taking the next candidate."""


class Box(NamedTuple):
    """A rectangle: its left upper corner and its size."""

    left: float
    top: float
    width: float
    height: float

    def covers(self, other: Box) -> float:
        """Return the common area."""
        across = min(self.left + self.width, other.left + other.width) - max(self.left, other.left)
        down = min(self.top + self.height, other.top + other.height) - max(self.top, other.top)
        return across * down if across > 0 and down > 0 else 0.0

    def holds(self, other: Box) -> bool:
        """Return whether `other` is wholly within."""
        return (
            self.left <= other.left
            and self.top <= other.top
            and other.left + other.width <= self.left + self.width
            and other.top + other.height <= self.top + self.height
        )


def beside(x: float, y: float, width: float, height: float, clear: float, rings: int = RINGS) -> Iterator[Box]:
    """Return the candidates of a label about its point, the best first."""
    for ring in range(rings):
        out = clear + ring * height / 2
        right, left, middle = x + clear, x - clear - width, x - width / 2
        above, below, level = y - out - height, y + out, y - height / 2
        near = y - height - out / 2, y + out / 2
        yield from (
            Box(right, near[0], width, height),
            Box(right, near[1], width, height),
            Box(left, near[1], width, height),
            Box(left, near[0], width, height),
            Box(middle, above, width, height),
            Box(middle, below, width, height),
            Box(right + out - clear, level, width, height),
            Box(left - out + clear, level, width, height),
        )


def best_place(candidates: Iterable[Box], view: Box, taken: Sequence[Box], drawn: Sequence[Box]) -> Box | None:
    """Return the candidate that covers least of what is drawn, an earlier one where the difference is small.

    Parameters
    ----------
    taken : what it may not cover: points, and the labels placed before.
    drawn : what it may, such as lines.

    Returns
    -------
    None where every candidate leaves the view or covers what is taken.
    """
    best, least = None, float("inf")
    for rank, box in enumerate(candidates):
        if rank * RANK_COST >= least:
            break
        if not view.holds(box) or any(box.covers(other) for other in taken):
            continue
        cost = rank * RANK_COST + sum(box.covers(other) for other in drawn)
        if cost < least:
            best, least = box, cost
    return best
