"""Is the link well? Rate, losses, lag, and how the board's clock goes beside the host's."""

from __future__ import annotations

from dataclasses import dataclass

from boat_daq.engine.blocks import Block
from protocol.connection import LinkStatistics


@dataclass(frozen=True, slots=True)
class HealthSnapshot:
    """State of the link at one instant; counters since the link was opened."""

    statistics: LinkStatistics
    rate_hz: float | None  # by the board's clock, over the last seconds
    asked_hz: float | None
    silent_s: float  # since the last byte
    lag_ms: float  # age of the oldest sample not yet on disk
    drift_ppm: float | None  # of the board's clock against the host's; None for a board that is not in real time
    jitter_ms: float | None
    warnings: tuple[str, ...]


class LinkHealth:
    """A sink that watches the link."""

    def __init__(self, *, asked_hz: float | None = None, real_time: bool = True) -> None:
        raise NotImplementedError

    def __call__(self, block: Block) -> None:
        """Take the samples of a block."""

    def snapshot(self) -> HealthSnapshot:
        """Return the state now."""
        raise NotImplementedError
