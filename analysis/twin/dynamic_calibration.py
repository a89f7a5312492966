"""The dynamic calibration of a unit: figures of its steps and sines of elongation, as one value for every output."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from analysis.calibration.inverse import Fusion
from analysis.data.recording import Recording
from analysis.errors import DataError
from analysis.twin.dynamics import BodePoint, DynamicFigure, bandwidth_hz
from analysis.twin.runs import bode_of_run, step_response_figures


@dataclass(frozen=True, slots=True)
class DynamicCalibration:
    """The dynamics of a run.

    Attributes
    ----------
    unit, simulated, recording : whose, and of which run.
    tolerance_mm : of settling.
    steps : figures by the size of the step, mm.
    bode : a point for each sine. bandwidth_hz : at -3 dB; NaN where no sine reaches it.
    """

    unit: str
    simulated: bool
    recording: str
    tolerance_mm: float
    steps: dict[float, dict[str, DynamicFigure]]
    bode: tuple[BodePoint, ...]
    bandwidth_hz: float

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
    found: dict[str, Any] = {"steps": {}, "bode": ()}
    causes = []
    for name, compute in (
        ("steps", lambda: step_response_figures(recording, fusion, tolerance_mm)),
        ("bode", lambda: bode_of_run(recording, fusion)),
    ):
        try:
            found[name] = compute()
        except DataError as error:
            causes.append(error)
    if len(causes) == 2:
        raise causes[0]
    edge = bandwidth_hz(found["bode"]) if found["bode"] else math.nan
    return DynamicCalibration(
        recording.unit, recording.simulated, recording.source, tolerance_mm, found["steps"], found["bode"], edge
    )
