"""The dynamic calibration of a unit: figures of its steps and sines of elongation, as one value for every output."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

from analysis.arrays import FloatArray
from analysis.calibration.inverse import Fusion
from analysis.data.recording import Recording
from analysis.errors import DataError
from analysis.twin.dynamics import BodePoint, DynamicFigure, bandwidth_hz
from analysis.twin.runs import StepResponse, bode_of_run, mean_response, step_response_figures, step_responses


@dataclass(frozen=True, slots=True)
class DynamicCalibration:
    """The dynamics of a run.

    Attributes
    ----------
    unit, simulated, recording : whose, and of which run.
    tolerance_mm : of settling.
    steps : figures by the size of the step, mm.
    bode : a point for each sine. bandwidth_hz : at -3 dB; NaN where no sine reaches it.
    responses : times and mean response of the steps of each size [2, n], as a share of the step; drawn only.
    """

    unit: str
    simulated: bool
    recording: str
    tolerance_mm: float
    steps: dict[float, dict[str, DynamicFigure]]
    bode: tuple[BodePoint, ...]
    bandwidth_hz: float
    responses: dict[float, FloatArray] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Return the figures, steps as a list."""
        steps = [
            {"step_mm": size, **{name: asdict(figure) for name, figure in figures.items()}}
            for size, figures in self.steps.items()
        ]
        head = {"unit": self.unit, "simulated": self.simulated, "recording": self.recording}
        bode = [asdict(point) for point in self.bode]
        return {
            **head, "tolerance_mm": self.tolerance_mm, "steps": steps, "bode": bode, "bandwidth_hz": self.bandwidth_hz
        }  # fmt: skip


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
