"""The live conversion from signals to elongation, by the calibration in force of a unit.

The stored points are fitted again, so that the live conversion is exactly the accepted calibration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.record import CalibrationRecord
from boat_daq.engine.settings import UnitLibrary
from boat_daq.workflows.unit_control import live_prediction_of
from protocol.base.arrays import FloatArray

if TYPE_CHECKING:
    from analysis.calibration.inverse import Fusion
    from analysis.signal_prediction.prediction import LivePrediction


@dataclass(frozen=True, slots=True)
class LiveElongation:
    """Elongation with its expanded uncertainty (k = 2), mm; NaN outside the calibrated range.

    `beyond` marks values a little beyond its end, as `analysis.calibration.inverse` reads them; None marks none.
    """

    mm: FloatArray
    expanded_mm: FloatArray
    disagree: NDArray[np.bool_]
    beyond: NDArray[np.bool_] | None = None

    def band(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times, lower and upper edge where the elongation is known; the band closes at both ends of a hole."""
        known = np.isfinite(self.mm)
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
    def sensors(self) -> int:
        """Number of sensors that are converted."""
        return len(self.fusion.inverses)

    def __call__(self, signal_mv: FloatArray) -> LiveElongation:
        """Return the elongation of [n, sensors] signals, sensors fused."""
        found = self.fusion.evaluate(signal_mv)
        expanded = 2.0 * found.standard_uncertainty_mm
        return LiveElongation(found.elongation_mm, expanded, found.disagreement, found.beyond)

    def each(self, signal_mv: FloatArray) -> FloatArray:
        """Return the elongation by each sensor, [n, sensors] mm; NaN farther beyond its range than is read."""
        each = (inverse.evaluate(signal_mv[:, i]) for i, inverse in enumerate(self.fusion.inverses))
        return np.column_stack([found.elongation_mm for found in each])


def prepare(record: CalibrationRecord, units: UnitLibrary | None = None) -> Conversion:
    """Return the conversion by a calibration, all sensors fused; with `units` also the prediction of the signals."""
    fusion = record.fusion()
    conversion = Conversion(fusion, live_prediction_of(units, record.unit, fusion) if units is not None else None)
    conversion(np.zeros((1, len(fusion.inverses))))  # compiles now, not in the first frame
    return conversion
