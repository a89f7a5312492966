"""Analyse a recording with its unit's contributions and the curve that it was accepted with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analysis.fidelity import Level
from analysis.progress import Progress
from boat_daq.workflows.calibration_in_force import (
    NotCalibrated,
    calibration_in_force,
    chosen_curve,
    stated_contributions,
)
from protocol.base.errors import BoatDaqError

if TYPE_CHECKING:
    from analysis.data.recording import Recording
    from analysis.figures.pipeline import Analysis
    from protocol.base.arrays import FloatArray


def load_analysis() -> None:
    from importlib import import_module

    for name in ("analysis.figures.pipeline", "analysis.figures.uncertainty", "analysis.reports.build"):
        import_module(name)


def analysed_run(
    path: Path,
    *,
    elongation: Path | None = None,
    curve: str = "",
    level: Level = "normal",
    mcmc: bool = False,
    progress: Progress | None = None,
) -> Analysis:
    """Return the analysis of a recording; `curve` is a choice of `chosen_curve`.

    `elongation`: file of readings; by default the one beside the recording, or the readings in it.
    """
    from analysis import load_recording
    from analysis.figures.pipeline import analyse
    from analysis.figures.sensor_analysis import Options
    from analysis.history.batch import readings_beside

    recording = load_recording(path)
    type_b = stated_contributions(recording)
    options = Options(chosen_curve(recording, curve), fidelity=level, mcmc=mcmc, type_b=type_b)
    return analyse(recording, elongation or readings_beside(path), options=options, progress=progress)


def elongation_by_sensor(
    path: Path,
    recording: Recording,
    calibration: Path | None = None,
    elongation: Path | None = None,
    *,
    progress: Progress | None = None,
) -> tuple[FloatArray, str]:
    """Return the elongation of every sample by each sensor, [n, sensors], and the calibration that it is by.

    The first of these: that of the run `calibration`, of the run itself, of its unit.

    Parameters
    ----------
    elongation : CSV of the calibration's readings.
    """
    from analysis.calibration_export.conversion import check_read, check_signals
    from analysis.figures.against_shadow import inverses_of, measured_elongation
    from analysis.history.batch import readings_beside

    try:
        if calibration is None:
            check_read(recording, elongation or readings_beside(path))
        found = analysed_run(calibration or path, elongation=elongation, progress=progress)
        return measured_elongation(recording, inverses_of(found.sensors)), str(calibration or path)
    except BoatDaqError as error:
        if calibration is not None or elongation is not None:
            raise
        accepted = calibration_in_force(recording)
        if accepted is None:
            first = f"{error.cause}, and ", "give --calibration RUN, or "
            raise NotCalibrated(recording.unit, simulated=recording.simulated, first=first) from error
    check_signals(accepted, recording.n_sensors, recording.signal_unit, simulated=recording.simulated)
    by = f"unit {recording.unit}, accepted {accepted.head['calibrated_utc']}"
    return measured_elongation(recording, accepted.reader().inverses), by


def count_plateaus(found: Analysis) -> tuple[int, int]:
    """Return the number of plateaus to be read, and of those that were.

    They are the steps of the run without the last; an interrupted one counts where it was read. Without steps they are
    the plateaus of the pressure. Where this has none, the steps are turning points: no reading of them makes a curve.
    """
    if not found.plateaus:
        return 0, 0
    recording = found.recording
    passed = [bool(json.loads(str(detail) or "{}").get("passed")) for detail in recording.steps["detail"]]
    steps = recording.steps[(recording.steps["branch"] != "end") & ~np.asarray(passed, dtype=bool)]
    if not len(steps):
        known = int(found.elongations.known.sum()) if found.elongations is not None else 0
        return sum(bool(p.branch) for p in found.plateaus), known
    if not len(recording.readings) and found.elongations is not None:  # given in a file
        return int((steps["status"] != "aborted").sum()), int(found.elongations.known.sum())
    readings = recording.current_readings
    read = steps["id"].isin(readings["step"][readings["elongation_mm"].notna()])
    return int(((steps["status"] != "aborted") | read).sum()), int(read.sum())
