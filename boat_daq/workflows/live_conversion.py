"""The live conversion from signals to elongation, by the calibration in force of a unit.

The stored points are fitted again, so that the live conversion is exactly the accepted calibration.
Machine code is compiled in helper processes: nothing compiles in the window's own.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Generator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.record import CalibrationRecord
from analysis.progress import Progress, compiling
from boat_daq.engine.sample_columns import columns
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import LinkError, LinkState, SessionSnapshot
from boat_daq.workflows.calibration_in_force import newest_calibration
from boat_daq.workflows.session_messages import MessagePrinter, Notify
from boat_daq.workflows.unit_control import live_prediction_of
from protocol.base.arrays import FloatArray
from protocol.base.errors import DeviceError, StorageError

if TYPE_CHECKING:
    import pandas as pd

    from analysis.calibration.inverse import Fusion
    from analysis.calibration_export.calibration_file import CalibrationFile
    from analysis.signal_prediction.prediction import LivePrediction
    from boat_daq.engine.session.session import Session

_POLL_S = 0.02
_MOST_WAITING = 100_000  # blocks of samples that the output is behind


@dataclass(frozen=True, slots=True)
class LiveElongation:
    """Elongation with its expanded uncertainty (k = 2), mm; NaN outside the calibrated range, U also where unknown.

    `beyond` marks values a little beyond its end, as `analysis.calibration.inverse` reads them; None marks none.
    `stand_in` is what U rests on besides the run of the calibration; "" where it rests on the run.
    `last` has the last value that is read, and its U, where the signal is farther outside; NaN elsewhere.
    """

    mm: FloatArray
    expanded_mm: FloatArray
    disagree: NDArray[np.bool_]
    beyond: NDArray[np.bool_] | None = None
    stand_in: str = ""
    last: tuple[FloatArray, FloatArray] | None = None

    def drawn(self) -> LiveElongation:
        """Return values for a line through extremes: one outside the range, beside one inside, is at its last value."""
        if self.last is None:
            return self
        known = np.isfinite(self.mm)
        beside = ~known & (np.append(False, known[:-1]) | np.append(known[1:], False))
        mm, expanded = (np.where(beside, end, y) for end, y in zip(self.last, (self.mm, self.expanded_mm), strict=True))
        return replace(self, mm=mm, expanded_mm=expanded)

    def band(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times, lower and upper edge where both are known; the band closes at both ends of a hole."""
        known = np.isfinite(self.mm) & np.isfinite(self.expanded_mm)
        begins, ends = known & ~np.append(False, known[:-1]), known & ~np.append(known[1:], False)
        copies = known.astype(np.int64) + begins + ends
        at = np.repeat(np.arange(known.size), copies)
        width, last = self.expanded_mm[at], np.cumsum(copies)
        width[(last - copies)[begins]] = 0.0
        width[(last - 1)[ends]] = 0.0
        return time_s[at], self.mm[at] - width, self.mm[at] + width


class Conversion:
    """mV -> mm of one unit: all sensors together, or each by itself; with what predicts its signals, if identified."""

    def __init__(self, fusion: Fusion, prediction: LivePrediction | None = None) -> None:
        self.fusion, self.prediction = fusion, prediction

    @property
    def stand_in(self) -> str:
        """What U rests on besides the run of the calibration; "" where it rests on the run."""
        return self.fusion.u_stand_in

    def named(self, calibration: str) -> str:
        """Return the name of its calibration with a mark where U rests on a stand-in, or a curve misses readings."""
        fits = (inverse.calibration for inverse in self.fusion.inverses)
        verdicts = {str(fit.adequacy.verdict) for fit in fits if fit is not None and fit.adequacy is not None}
        worst = next((f"curve {one}" for one in ("inadequate", "doubtful") if one in verdicts), "")
        return ", ".join(filter(None, (calibration, worst, "U with a stated value" if self.stand_in else "")))

    @property
    def sensors(self) -> int:
        return len(self.fusion.inverses)

    def __call__(self, signal_mv: FloatArray) -> LiveElongation:
        """Return the elongation of [n, sensors] signals, sensors fused."""
        found = self.fusion.evaluate(signal_mv)
        expanded, last = 2.0 * found.standard_uncertainty_mm, None
        if found.outside.any():
            ends = np.transpose([inverse.last_signals for inverse in self.fusion.inverses])
            end = self.fusion.evaluate(np.where(found.outside[..., None], np.clip(signal_mv, *ends), np.nan))
            last = end.elongation_mm, 2.0 * end.standard_uncertainty_mm
        return LiveElongation(found.elongation_mm, expanded, found.disagreement, found.beyond, self.stand_in, last)

    def each(self, signal_mv: FloatArray) -> FloatArray:
        """Return the elongation by each sensor, [n, sensors] mm; NaN farther beyond its range than is read."""
        each = (inverse.evaluate(signal_mv[:, i]) for i, inverse in enumerate(self.fusion.inverses))
        return np.column_stack([found.elongation_mm for found in each])


def prepare(record: CalibrationRecord, units: UnitLibrary | None = None) -> Conversion:
    """Return the conversion by a calibration, all sensors fused; with `units` also the prediction of the signals."""
    fusion = record.fusion()
    return Conversion(fusion, live_prediction_of(units, record.unit, fusion) if units is not None else None)


def lacks_code() -> bool:
    from analysis.compile_all import is_complete

    return not is_complete()


def compile_rest(progress: Progress | None = None) -> None:
    """Compile everything that is not in the cache; the progress is counted in functions."""
    from analysis.compile_all import compile_all

    with nullcontext() if progress is None else compiling(progress):
        compile_all()


def conversion_in_force(session: Session, unit: str) -> tuple[Conversion | None, str]:
    """Return the conversion of a connected board's signals, and what names its calibration; else None and why."""
    seen = session.snapshot()
    record = newest_calibration(session.units.of(simulated=seen.simulated), unit)
    if record is None:
        return None, "the unit has no calibration"
    if record.signal_unit != "mV":
        return None, f"the calibration is for signals in {record.signal_unit}"
    conversion = prepare(record)
    if seen.last is None or conversion.sensors != len(seen.last.signal_mv):
        return None, f"the calibration is of {conversion.sensors} sensors"
    return conversion, conversion.named(f"{unit} {record.calibrated_utc}")


def converted_samples(
    found: CalibrationFile,
    port: str,
    profile: str | None = None,
    rate_hz: int | None = None,
    duration_s: float | None = None,
    *,
    notify: Notify,
) -> Generator[pd.DataFrame, None, None]:
    """Yield the rows of a board's samples as they come, converted; nothing is recorded.

    `duration_s` is of board time; None until the link ends.
    """
    from analysis.calibration_export.conversion import check_signals, convert_signals, converted_rows
    from boat_daq.engine.session.session import Session

    session = Session()
    waiting: deque[Any] = deque()
    try:
        session.live.add_sink(waiting.append)
        session.connect(port, profile, rate_hz=rate_hz)
        seen = session.wait_connected()
        first_us: int | None = None
        print_new = MessagePrinter(notify)
        while True:
            print_new(seen)
            ended = _ended(seen)
            while waiting:
                if len(waiting) > _MOST_WAITING:
                    raise StorageError("the output does not keep up with the board", "Write to a file.")
                block = columns(waiting.popleft(), session.mv_per_count)
                if first_us is None:
                    check_signals(found, block.signal_mv.shape[1], simulated=seen.simulated)
                    first_us = int(block.time_us[0])
                time_s = (block.time_us - first_us) / 1e6
                if duration_s is not None and time_s[-1] >= duration_s:
                    block, ended = block.part(time_s < duration_s), True
                    time_s = time_s[time_s < duration_s]
                yield converted_rows(time_s, block.signal_mv, convert_signals(found, block.signal_mv, block.flags))
                if ended and duration_s is not None:
                    return
            if ended:
                return
            time.sleep(_POLL_S)
            seen = session.snapshot()
    finally:
        session.close()


def _ended(seen: SessionSnapshot) -> bool:
    """Return whether the link has ended, or raise why it failed."""
    if seen.link is LinkState.FAILED:
        lost = LinkError("the link was lost", "check the board and its cable")
        cause, remedy, command = seen.link_error or lost
        raise DeviceError(cause, remedy, command=command)
    return seen.link is LinkState.CLOSED
