"""The dynamic calibration of a unit from a run with steps or sines of elongation."""

from __future__ import annotations

import math
from contextlib import suppress

from analysis.calibration.inverse import Fusion
from analysis.data.recording import Recording
from analysis.errors import DataError
from analysis.twin.dynamic_figures import BodePoint, DynamicCalibration
from analysis.twin.dynamics import bandwidth_hz
from analysis.twin.runs import StepResponse, bode_of_run, mean_response, step_response_figures, step_responses


def dynamic_calibration(recording: Recording, fusion: Fusion, tolerance_mm: float = 0.05) -> DynamicCalibration:
    """Return the dynamics of a run with steps or sines of elongation.

    Parameters
    ----------
    recording : of a plan in millimetres. fusion : the calibration in force.
    tolerance_mm : of settling.

    Raises
    ------
    DataError : it has neither.
    """
    steps: dict[float, list[StepResponse]] = {}
    bode: tuple[BodePoint, ...] = ()
    try:
        steps = step_responses(recording, fusion)
    except DataError:
        bode = bode_of_run(recording, fusion)
    else:
        with suppress(DataError):  # steps alone
            bode = bode_of_run(recording, fusion)
    edge = bandwidth_hz(bode) if bode else math.nan
    figures = {size: step_response_figures(rows, tolerance_mm) for size, rows in steps.items()}
    responses = {size: mean_response(rows) for size, rows in steps.items()}
    return DynamicCalibration(
        recording.unit, recording.simulated, recording.source, tolerance_mm, figures, bode, edge, responses
    )
