"""Whether samples arrive, by the host's clock: begun, silent, or after a pause."""

from __future__ import annotations

SILENCE_S = 1.0


class StreamWatch:
    """Watches the arrival of one link's samples.

    Attributes
    ----------
    rate_hz : samples per second requested.
    begun : whether any arrived on this link.
    silent : whether none has arrived for `silence_s`, until the next one.
    """

    def __init__(self, rate_hz: int) -> None:
        self.rate_hz = rate_hz
        self.begun = self.silent = False
        self._last_ns = self._pause_ended_ns = 0

    @property
    def silence_s(self) -> float:
        """Time without samples that is allowed."""
        return max(SILENCE_S, 3.0 / self.rate_hz)

    def opened(self, now_ns: int) -> None:
        """Wait for samples on a new link."""
        self.begun = self.silent = False
        self._last_ns = now_ns

    def came(self, now_ns: int) -> None:
        """Take the arrival of samples."""
        if self._pausing(now_ns):
            self._pause_ended_ns = now_ns
        self._last_ns, self.begun, self.silent = now_ns, True, False

    def falls_silent(self, now_ns: int) -> bool:
        """Return whether silence begins now; true once for each silence."""
        if not self.begun or self.silent or now_ns - self._last_ns <= self.silence_s * 1e9:
            return False
        self.silent = True
        return True

    def paused_lately(self, now_ns: int) -> bool:
        """Whether half a silence overlaps the three sendings of a command lost now."""
        return self._pausing(now_ns) or now_ns - self._pause_ended_ns < SILENCE_S * 1e9

    def _pausing(self, now_ns: int) -> bool:
        return now_ns - self._last_ns > self.silence_s / 2 * 1e9
