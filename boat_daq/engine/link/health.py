"""Health of the link: rate, losses, lag, and the drift of the board's clock against the host's.

The fit is host = a + b * board, least squares over the newest sample of every read since the last restart of the
board's clock, kept as running means and products (Welford, Technometrics 4 (1962) 419). A read arrives late by a
varying delay, never early: `a` contains the mean delay, and b - 1 is the drift. Raw times are never changed by it.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.block import Block
from boat_daq.engine.snapshot import HealthSnapshot, LinkWarning, LinkWarningCode
from protocol.link.events import LinkStatistics, Samples

WARN_FRACTION = 0.005  # of rate and drift
RATE_WINDOW_US = 5_000_000  # of board time
FIT_MIN_S = 10.0  # of host time, before which no drift is given
SILENT_WARN_S = 1.0
ROUGH_S, REAL_TIME = 0.3, 0.1  # from when on another speed is seen, that of a virtual board; share that is none


class ClockFit:
    """Running least squares of host time over board time."""

    def __init__(self) -> None:
        self._origin: tuple[int, int] | None = None  # first (time_us, host_ns)
        self._n = 0
        self._mean_x = self._mean_y = self._xx = self._xy = self._yy = 0.0
        self._span_s = 0.0
        self._newest_us = -(1 << 62)

    def add(self, time_us: int, host_ns: int) -> None:
        if self._origin is None:
            self._origin = (time_us, host_ns)
        x = (time_us - self._origin[0]) * 1e-6
        y = (host_ns - self._origin[1]) * 1e-9
        self._n += 1
        dx, dy = x - self._mean_x, y - self._mean_y
        self._mean_x += dx / self._n
        self._mean_y += dy / self._n
        self._xx += dx * (x - self._mean_x)
        self._xy += dx * (y - self._mean_y)
        self._yy += dy * (y - self._mean_y)
        self._span_s, self._newest_us = y, time_us

    @property
    def slope(self) -> float | None:
        """Host seconds for one board second; None before `FIT_MIN_S`."""
        return self._xy / self._xx if self._span_s >= FIT_MIN_S and self._xx > 0 else None

    def host_s(self, time_us: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the host's monotonic time of instants of board time, s, once a pair was added.

        A board in real time is believed to run at the host's rate until the fit gives a slope.
        """
        assert self._origin is not None
        first_us, first_ns = self._origin
        rough = self._xy / self._xx if self._span_s > ROUGH_S and self._xx > 0 else 1.0
        slope = self.slope or (1.0 if abs(rough - 1.0) < REAL_TIME else rough)
        x = (time_us - first_us) * 1e-6
        return np.asarray(first_ns * 1e-9 + self._mean_y + slope * (x - self._mean_x), dtype=np.float64)

    def before(self, time_us: int) -> bool:
        """Return whether an instant lies before the newest pair: the board's clock has restarted."""
        return time_us < self._newest_us

    @property
    def jitter_ms(self) -> float | None:
        """Rms of the residuals."""
        if self.slope is None or self._n < 3:
            return None
        return 1e3 * math.sqrt(max(0.0, self._yy - self._xy**2 / self._xx) / (self._n - 2))

    @property
    def offset_ms(self) -> float | None:
        """Host time of board time 0 by the fit, counted from the first pair's arrival."""
        if self.slope is None or self._origin is None:
            return None
        first_s = self._origin[0] * 1e-6
        return 1e3 * (self._mean_y - self.slope * (self._mean_x + first_s))


class LinkHealth:
    """A sink that watches the link.

    `real_time`: False for a virtual board at another speed: its clock is not compared with the host's; `last_ns`: when
    the last samples came on a link before that is sought again.
    """

    def __init__(
        self,
        statistics: Callable[[], LinkStatistics],
        *,
        asked_hz: float | None = None,
        real_time: bool = True,
        lag_ms: Callable[[], float] = lambda: 0.0,
        at_risk_ms: Callable[[], float] = lambda: 0.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        last_ns: int | None = None,
    ) -> None:
        self.statistics = statistics
        self.asked_hz = asked_hz
        self.real_time = real_time
        self.lag_ms, self.at_risk_ms = lag_ms, at_risk_ms
        self._clock_ns = clock_ns
        self._fit = ClockFit()
        self._window: deque[tuple[int, int]] = deque()  # (time_us of the newest, samples that came with it)
        self._in_window = 0
        self.last_ns = clock_ns() if last_ns is None else last_ns

    def __call__(self, block: Block) -> None:
        """Take the times of a block."""
        if block.sent or not block.raw:
            return
        for event in block.events:
            if isinstance(event, Samples) and len(event.array):
                self.last_ns = block.host_ns
                self._add(int(event.array["time_us"][-1]), len(event.array), block.host_ns)

    def snapshot(self) -> HealthSnapshot:
        """Return the state now."""
        statistics, rate_hz = self.statistics(), self._rate_hz()
        silent_s = max(0.0, (self._clock_ns() - self.last_ns) * 1e-9)
        slope = self._fit.slope if self.real_time else None
        drift_ppm = None if slope is None else (slope - 1.0) * 1e6
        return HealthSnapshot(
            statistics,
            rate_hz,
            self.asked_hz,
            silent_s,
            self.lag_ms(),
            drift_ppm,
            self._fit.jitter_ms if self.real_time else None,
            self._fit.offset_ms if self.real_time else None,
            tuple(_warnings(statistics, rate_hz, self.asked_hz, silent_s, drift_ppm)),
            self.at_risk_ms(),
        )

    def _add(self, time_us: int, n: int, host_ns: int) -> None:
        if self._window and time_us < self._window[-1][0]:  # the board's clock restarted
            self._window.clear()
            self._in_window = 0
            self._fit = ClockFit()
        self._fit.add(time_us, host_ns)
        self._window.append((time_us, n))
        self._in_window += n
        while len(self._window) > 2 and time_us - self._window[0][0] > RATE_WINDOW_US:
            self._in_window -= self._window.popleft()[1]

    def _rate_hz(self) -> float | None:
        """Return samples per board time from the oldest to the newest read of the window."""
        try:
            (first_us, first_n), (last_us, _) = self._window[0], self._window[-1]
        except IndexError:
            return None
        return (self._in_window - first_n) * 1e6 / (last_us - first_us) if last_us > first_us else None


def _warnings(
    statistics: LinkStatistics, rate_hz: float | None, asked_hz: float | None, silent_s: float, drift_ppm: float | None
) -> Iterator[LinkWarning]:
    """Give what is out of bounds."""
    if silent_s > SILENT_WARN_S:
        yield LinkWarning(LinkWarningCode.SILENT, f"no data for {silent_s:.0f} s")
    if statistics.lost:
        yield LinkWarning(LinkWarningCode.LOSS, f"{statistics.lost} samples lost")
    if rate_hz is not None and asked_hz and abs(rate_hz / asked_hz - 1.0) > WARN_FRACTION:
        yield LinkWarning(LinkWarningCode.RATE, f"{rate_hz:.1f} samples/s arrive, {asked_hz:g} were requested")
    if drift_ppm is not None and abs(drift_ppm) > WARN_FRACTION * 1e6:
        text = f"the board's clock is {abs(drift_ppm) * 1e-4:.1f} % {'slow' if drift_ppm > 0 else 'fast'}"
        yield LinkWarning(LinkWarningCode.CLOCK, text)
