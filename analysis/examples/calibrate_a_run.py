"""Calibrate a run and read elongations from its signals.

python -m analysis.examples.calibrate_a_run run.boat [readings.csv]
"""

from __future__ import annotations

import sys

import numpy as np

from analysis import AnalysisError, analyse, load_recording
from analysis.calibration_export.run_record import elongation_reader
from analysis.figures.figure import SENSOR_FIGURES, with_interval


def main(run: str, readings: str | None = None) -> float:
    """Print coefficients and key figures; return the largest elongation that was held, mm, NaN where none is known."""
    analysis = analyse(load_recording(run), readings, mcmc=False)
    for sensor in analysis.sensors:
        if sensor.calibration is None:
            print(f"{sensor.name}: {sensor.calibration_void}")
            continue
        print(f"{sensor.name}: b = {sensor.calibration.coefficients}, R2 = {sensor.calibration.r2:.5f}")
        for name in ("sensitivity_mv_per_mm", "system_hysteresis_percent_fso", "snr_db"):
            print(f"  {SENSOR_FIGURES[name].label}: {with_interval(sensor.figures[name])}")
    try:
        # of the means of holds: the largest of many noisy samples would be too large
        held_mv = np.asarray([plateau.signal_mv for plateau in analysis.plateaus])
        elongation = elongation_reader(analysis).evaluate(held_mv)
    except AnalysisError as error:
        print(f"no elongation: {error.cause}. {error.remedy}")
        return float("nan")
    largest = int(np.nanargmax(elongation.elongation_mm))
    expanded = 2 * elongation.standard_uncertainty_mm[largest]
    print(f"largest elongation: {elongation.elongation_mm[largest]:.2f} mm, U = {expanded:.2f} mm (k = 2)")
    return float(elongation.elongation_mm[largest])


if __name__ == "__main__":
    main(*sys.argv[1:3])
