"""A camera's readings of a run: one row a frame, in the time of the recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from protocol.base.arrays import BoolArray, FloatArray

LONGEST_BETWEEN = 3.5  # frame intervals: no elongation is interpolated over a longer gap


@dataclass(frozen=True, slots=True)
class CameraRecord:
    """The elongation at every frame in order, and its u; NaN where `fault` has a code.

    `time_s` [frames] is of the recording, except for the camera's delay.
    """

    time_s: FloatArray
    elongation_mm: FloatArray
    u_mm: FloatArray
    fault: npt.NDArray[np.str_]
    dropped: int = 0

    @property
    def valid(self) -> BoolArray:
        """[frames] True where there is a value."""
        return np.isfinite(self.elongation_mm)

    @property
    def faults(self) -> dict[str, int]:
        """Frames without a value, by code."""
        return dict(sorted(Counter(code for code in self.fault.tolist() if code).items()))

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return elongation, its speed, mm/s, and standard uncertainty at times [n]; NaN where no frames are near."""
        rows = np.flatnonzero(self.valid)
        rows = rows[np.diff(self.time_s[rows], prepend=-np.inf) > 0]
        t, x, u = (column[rows] for column in (self.time_s, self.elongation_mm, self.u_mm))
        if t.size < 3:
            nothing = np.full(time_s.size, np.nan)
            return nothing, nothing, nothing
        after = np.clip(np.searchsorted(t, time_s), 1, t.size - 1)
        far = t[after] - t[after - 1] > LONGEST_BETWEEN * float(np.median(np.diff(t)))
        known = ~far & (time_s >= t[0]) & (time_s <= t[-1])
        x, speed, u = (np.where(known, np.interp(time_s, t, y), np.nan) for y in (x, np.gradient(x, t), u))
        return x, speed, u

    def shifted(self, delay_s: float, drift: float = 0.0, about_s: float = 0.0) -> CameraRecord:
        """Return the record on the recording's clock, by the delay of its frames at `about_s` and its drift, s/s."""
        return replace(self, time_s=self.time_s - delay_s - drift * (self.time_s - about_s))
