"""The dynamic calibration of a unit from a run with steps or sines of elongation."""

from __future__ import annotations

from analysis.calibration.inverse import Fusion
from analysis.data.recording import Recording
from analysis.elongation_control.dynamic_figures import BodePoint, DynamicCalibration
from analysis.elongation_control.dynamics import bandwidth
from analysis.elongation_control.run_response import (
    StepResponse,
    bode_of_run,
    mean_response,
    recorded_segments,
    step_response_figures,
    step_responses,
)
from analysis.elongation_control.sensor_loop import SensorLoops
from protocol.base.errors import DataError


def dynamic_calibration(
    recording: Recording,
    fusion: Fusion,
    tolerance_mm: float = 0.05,
    *,
    loops: SensorLoops | None = None,
    calibration_utc: str = "",
) -> DynamicCalibration:
    """Return the dynamics of a run with steps or sines of elongation."""
    segments = recorded_segments(recording)
    stepped, swept = any(one.step_mm for one in segments), any(one.is_sine_of_elongation for one in segments)
    if not (stepped or swept):
        raise DataError(
            "this run has neither steps nor sines of elongation", "Record one with the plan steps-mm or sine-sweep-mm."
        )
    steps: dict[float, list[StepResponse]] = step_responses(recording, fusion, loops) if stepped else {}
    bode: tuple[BodePoint, ...] = bode_of_run(recording, fusion, loops) if swept else ()
    return DynamicCalibration(
        recording.unit,
        recording.simulated,
        recording.source,
        tolerance_mm,
        {size: step_response_figures(rows, tolerance_mm) for size, rows in steps.items()},
        bode,
        bandwidth(bode),
        {size: mean_response(rows) for size, rows in steps.items()},
        {size: len(rows) for size, rows in steps.items()},
        recording.started_utc,
        calibration_utc,
    )
