"""A run against the digital shadow: the samples' elongation, cycle by cycle, beside the ideal actuator's.

Strategy: this file has the recording and the calibration, the shadow compares arrays; the samples become elongation by
the run's own inverse (each sensor alone), and each cycle goes through the monitor that also watches live.

Rules: a run without a calibration that has an inverse is not compared, and says why; nothing is extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.arrays import FloatArray
from analysis.calibration.inverse import Inverse
from analysis.errors import AnalysisError, DataError
from analysis.figures.pipeline import Analysis
from analysis.progress import Progress

if TYPE_CHECKING:
    from analysis.shadow.monitoring.replay import Replay


@dataclass(frozen=True, slots=True)
class AgainstShadow:
    """A run beside the shadow, or why not.

    Attributes
    ----------
    result : what the shadow says; None where `void` says why there is none.
    numbers : [cycles] of the cycles compared.
    level_mm, band_mm : [cycles] mean deviation of each cycle, and the mean of its band from E, standard uncertainty.
    residual_kpa : [cycles] rms of measured pressure less the pressure that the elongation stands for.
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
    """Compare a calibrated run with the shadow of the nominal actuator.

    Parameters
    ----------
    progress : of building the shadow's table, where none is kept from before.
    """
    from analysis.shadow.model.table import load_table
    from analysis.shadow.monitoring.replay import replay  # compiled code: only who compares waits for it

    recording, cycles = analysis.recording, analysis.cycles.used
    try:
        elongations = np.stack([_elongation(analysis, i) for i in range(len(analysis.sensors))], axis=1)
        if not cycles:
            raise DataError("the run has no complete cycle")
        table = load_table(progress=progress)
        rows = [cycle.rows for cycle in cycles]
        result = replay(table, recording.time_s, recording.pressure_kpa, elongations, rows)
    except AnalysisError as error:
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


def _elongation(analysis: Analysis, sensor: int) -> FloatArray:
    calibration = analysis.sensors[sensor].calibration
    if calibration is None:
        raise DataError(
            f"{analysis.sensors[sensor].name} is not calibrated: {analysis.sensors[sensor].calibration_void}"
        )
    recording = analysis.recording
    signal = np.where(recording.usable[:, sensor], recording.signal_mv[:, sensor], np.nan)
    return np.asarray(Inverse.of(calibration)(signal), dtype=np.float64)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")
