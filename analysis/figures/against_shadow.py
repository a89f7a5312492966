"""A run compared with the digital shadow, cycle by cycle.

The samples become elongation by the run's own inverse, each sensor alone, and each cycle goes through the monitor that
also watches live. A run whose calibration has no inverse is not compared; nothing is extrapolated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.calibration.inverse import Inverse
from analysis.data.recording import Recording
from analysis.figures.pipeline import Analysis
from analysis.figures.sensor_analysis import SensorAnalysis
from analysis.progress import Progress
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, DataError

if TYPE_CHECKING:
    from analysis.shadow.monitoring.replay import Replay


@dataclass(frozen=True, slots=True)
class AgainstShadow:
    """A run beside the shadow; `result` is None where `void` gives the reason.

    Per compared cycle: `numbers`, mean deviation `level_mm`, standard uncertainty `band_mm` of the band from E, and
    `residual_kpa`, rms of measured pressure less the pressure that the elongation corresponds to.
    """

    result: Replay | None
    void: str
    numbers: tuple[int, ...] = ()
    level_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    band_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    residual_kpa: FloatArray = field(default_factory=lambda: np.empty(0))

    def as_json(self) -> dict[str, Any]:
        """Return what `analyze --json` reports under `shadow`."""
        if self.result is None:
            return {"void": self.void}
        rows = zip(self.numbers, self.level_mm, self.band_mm, self.residual_kpa, strict=True)
        per_cycle = [
            {"cycle": k, "deviation_mm": float(d), "band_mm": float(b), "residual_kpa": float(r)} for k, d, b, r in rows
        ]
        return {"void": "", **self.result.summary(), "per_cycle": per_cycle}


def against_shadow(analysis: Analysis, *, progress: Progress | None = None) -> AgainstShadow:
    """Compare a calibrated run with the shadow of the nominal actuator."""
    from analysis.shadow.model.table import load_table
    from analysis.shadow.monitoring.replay import replay  # compiled code, imported only where it is used

    recording, cycles = analysis.recording, analysis.cycles.used
    try:
        elongations = measured_elongation(recording, inverses_of(analysis.sensors))
        if not cycles:
            raise DataError("the run has no complete cycle")
        table = load_table(progress=progress)
        rows = [cycle.rows for cycle in cycles]
        result = replay(table, recording.time_s, recording.pressure_kpa, elongations, rows)
    except BoatDaqError as error:
        return AgainstShadow(None, error.cause)
    parts = [[column[part] for part in rows] for column in (result.deviation_mm, result.band_mm, result.residual_kpa)]
    deviation, band, residual = parts
    return AgainstShadow(
        result,
        "",
        tuple(cycle.number for cycle in cycles),
        np.asarray([_mean(part) for part in deviation]),
        np.asarray([_mean(part) for part in band]),
        np.sqrt([_mean(part**2) for part in residual]),
    )


def readings_against_shadow(analysis: Analysis, *, progress: Progress | None = None) -> dict[str, float]:
    """Return number, mean and largest absolute deviation (mm) of a run's readings from the nominal elongation."""
    from analysis.shadow.model.table import load_table

    if analysis.elongations is None:
        raise DataError("the run has no readings of elongation to compare with the shadow")
    table = load_table(progress=progress)
    known = analysis.elongations.known
    pressure_kpa = np.array([plateau.pressure_kpa for plateau in analysis.plateaus])[known]
    nominal_mm, _ = table.nominal_elongation(pressure_kpa)
    deviation_mm = analysis.elongations.elongation_mm[known] - nominal_mm
    return {
        "plateaus": int(known.sum()),
        "mean_deviation_mm": float(deviation_mm.mean()),
        "largest_deviation_mm": float(np.abs(deviation_mm).max()),
    }


def inverses_of(sensors: Sequence[SensorAnalysis]) -> tuple[Inverse, ...]:
    """Return the inverse of each sensor of a run. DataError: one is not calibrated, or its curve has none."""
    for sensor in sensors:
        if sensor.calibration is None:
            remedy = "give a run with readings of elongation"
            raise DataError(f"{sensor.name} is not calibrated: {sensor.calibration_void}", remedy)
    return tuple(Inverse.of(sensor.calibration) for sensor in sensors if sensor.calibration is not None)


def measured_elongation(recording: Recording, inverses: Sequence[Inverse]) -> FloatArray:
    """Return the elongation by each sensor's calibration, [n, sensors], NaN outside its range; may raise DataError."""
    if len(inverses) != recording.n_sensors:
        cause = f"the run has {recording.n_sensors} signals, the calibration {len(inverses)}"
        raise DataError(cause, "give a calibration of the same unit")
    signals = np.where(recording.usable, recording.signal_mv, np.nan)
    columns = [np.asarray(inverse(signals[:, n]), dtype=np.float64) for n, inverse in enumerate(inverses)]
    return np.stack(columns, axis=1)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
