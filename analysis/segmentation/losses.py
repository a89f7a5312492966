"""The losses in a figure's window: samples that never came, failed their check, were saturated, flagged, or not finite.

Each reason is counted along the run once, as a running sum, so that any window's count is a difference of two entries.
A sample is counted under the first reason that holds. Above a limit the figure is void, with the share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from analysis.data.recording import Recording
from analysis.numbers import percent
from protocol.base.arrays import IntArray
from protocol.recording import SampleFlag

_MAX_DAMAGED = 0.20  # share of a figure's window that may be lost or left out


@dataclass(frozen=True, slots=True)
class Losses:
    """Samples of a window: `samples` that should be there, and of these how many are missing or left out, by reason.

    `lost` never came; `crc_failed` came in a frame that failed its check; `saturated`; `flagged` invalid or
    implausible by the board or the decoder; `not_finite`; `standing` clipped, frozen or dropped out with no flag.
    """

    samples: int = 0
    lost: int = 0
    crc_failed: int = 0
    saturated: int = 0
    flagged: int = 0
    not_finite: int = 0
    standing: int = 0

    @property
    def damaged(self) -> int:
        """All that is missing or left out."""
        return self.lost + self.crc_failed + self.saturated + self.flagged + self.not_finite + self.standing

    @property
    def share(self) -> float:
        """Share of the window that is missing or left out; 0 of an empty one."""
        return self.damaged / self.samples if self.samples else 0.0

    def void(self, limit: float = _MAX_DAMAGED) -> str:
        """Return why a figure over this window is void, or ""."""
        if self.share <= limit:
            return ""
        lost = f"{percent(self.share)} of its samples lost or left out ({self.reasons()})"
        return f"{lost}, above the limit of {percent(limit)}"

    def reasons(self) -> str:
        """Return the counts that are not zero as text."""
        counts = {name.replace("_", " "): count for name, count in asdict(self).items() if name != "samples" and count}
        return ", ".join(f"{count} {name}" for name, count in counts.items()) or "none"


@dataclass(frozen=True, slots=True)
class LossCounter:
    """One sensor's losses by kind: the rows where they are, and their running sums from 0 on.

    A window's are the difference of the sums at its ends. Few rows of a sound run have any.
    """

    kinds: tuple[tuple[IntArray, IntArray], ...]

    @classmethod
    def of(cls, recording: Recording, sensor: int) -> LossCounter:
        lost, crc = np.zeros(recording.n, np.int64), np.zeros(recording.n, np.int64)
        for gap in recording.gaps:
            crc[gap.row] += gap.crc_failed
            lost[gap.row] += gap.lost - gap.crc_failed
        flags = recording.flags
        saturated = (flags & int(SampleFlag.SATURATED)) != 0
        flagged = (flags & int(SampleFlag.PRESSURE_INVALID | SampleFlag.IMPLAUSIBLE)) != 0
        wrong = ~np.isfinite(recording.signal_mv[:, sensor]) | ~np.isfinite(recording.pressure_kpa)
        flagged &= ~saturated
        wrong &= ~saturated & ~flagged
        standing = ~recording.usable[:, sensor] & ~saturated & ~flagged & ~wrong
        rows = ((a, np.flatnonzero(a)) for a in (lost, crc, saturated, flagged, wrong, standing))
        return cls(tuple((at, np.concatenate([[0], np.cumsum(a[at])])) for a, at in rows))

    def of_windows(self, windows: Sequence[slice]) -> Losses:
        """Count in windows that do not overlap. A gap belongs to the window that holds both its sides."""
        if not windows:
            return Losses()
        first = np.asarray([w.start for w in windows])
        last = np.asarray([max(w.stop, w.start) for w in windows])
        inside = np.maximum(last - 1, first)  # a gap is stored at the row before it
        gaps = [self._between(kind, first, inside) for kind in self.kinds[:2]]
        rows = [self._between(kind, first, last) for kind in self.kinds[2:]]
        return Losses(int((last - first).sum()) + sum(gaps), *gaps, *rows)

    @staticmethod
    def _between(kind: tuple[IntArray, IntArray], first: IntArray, last: IntArray) -> int:
        at, sums = kind
        return int((sums[np.searchsorted(at, last)] - sums[np.searchsorted(at, first)]).sum())

    def of_like_windows(self, windows: Sequence[slice]) -> Losses:
        """Count in windows of about one length: one that a pause prolonged lost no more than a usual one has."""
        each = [self.of_windows([window]) for window in windows]
        if not each:
            return Losses()
        usual = int(np.median([loss.samples for loss in each]))
        whole = {name: sum(getattr(loss, name) for loss in each) for name in Losses.__dataclass_fields__}
        beyond = sum(max(0, loss.lost - usual) for loss in each)
        return replace(Losses(**whole), samples=whole["samples"] - beyond, lost=whole["lost"] - beyond)
