"""Values at which clocks usually begin again, and the fall of a clock that is one of them.

A clock that falls from such a value to its beginning, within a few sampling intervals, wrapped; after a restart it
falls from anywhere.
"""

from __future__ import annotations

from collections.abc import Iterable

NEAR_WRAP = 4.5  # sampling intervals between the samples around a wrap, at most
SHORTEST_WRAP = 8  # intervals
_DURATIONS_S = (60.0, 3600.0, 43_200.0, 86_400.0)
_POWERS = (2**16, 2**24, 2**31, 2**32)  # of ticks
_DECIMALS = (100, 1000, 10_000, 100_000, 1_000_000)


def usual_wraps(tick_s: float, *, decimals: bool = False) -> tuple[float, ...]:
    """Return the usual wraps of a clock in seconds, `tick_s` the unit of its numbers or a power of ten of it."""
    ticks = {n * tick for n in _POWERS for tick in (tick_s, 1e-3, 1e-6)}
    return tuple(sorted({*_DURATIONS_S, *ticks, *(n * tick_s for n in (_DECIMALS if decimals else ()))}))


def wrap_between(before: float, after: float, interval: float, wraps: Iterable[float]) -> float | None:
    """Return the wrap that a clock made between two samples, in their unit; None if it fell for another reason."""
    for wrap in wraps:
        near = 0 < wrap + after - before <= NEAR_WRAP * interval
        if near and before < wrap and wrap > SHORTEST_WRAP * interval:
            return wrap
    return None
