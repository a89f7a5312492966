"""Offline analysis: arrays and files in, figures out. What a script imports.

    from analysis import analyse, load_recording
    analysis = analyse(load_recording("run.boat"), "readings.csv")
    print(analysis.sensors[0].figures["sensitivity_mv_per_mm"].value)

Names are imported when they are first used, so that a part that needs none of it (the optics, the shadow) loads none.

`fit_calibration` fits any two arrays, `Inverse` and `Fusion` turn mV into mm, `sample_posterior` gives bands,
`write_report` writes HTML or PDF.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analysis.calibration import Calibration, fit_calibration
    from analysis.cycles import find_cycles
    from analysis.errors import AnalysisError
    from analysis.inverse import Fusion, Inverse
    from analysis.pipeline import Analysis, analyse
    from analysis.plateaus import PlateauSettings, find_plateaus, plateau_table
    from analysis.posterior import Posterior, sample_posterior
    from analysis.recording import Recording, load_recording
    from analysis.reports.writing import write_report
    from analysis.sensor_analysis import Options
    from analysis.statistics import Figure

__all__ = [
    "Analysis",
    "AnalysisError",
    "Calibration",
    "Figure",
    "Fusion",
    "Inverse",
    "Options",
    "PlateauSettings",
    "Posterior",
    "Recording",
    "analyse",
    "find_cycles",
    "find_plateaus",
    "fit_calibration",
    "load_recording",
    "plateau_table",
    "sample_posterior",
    "write_report",
]

_HOME = {
    "Analysis": "analysis.pipeline",
    "AnalysisError": "analysis.errors",
    "Calibration": "analysis.calibration",
    "Figure": "analysis.statistics",
    "Fusion": "analysis.inverse",
    "Inverse": "analysis.inverse",
    "Options": "analysis.sensor_analysis",
    "PlateauSettings": "analysis.plateaus",
    "Posterior": "analysis.posterior",
    "Recording": "analysis.recording",
    "analyse": "analysis.pipeline",
    "find_cycles": "analysis.cycles",
    "find_plateaus": "analysis.plateaus",
    "fit_calibration": "analysis.calibration",
    "load_recording": "analysis.recording",
    "plateau_table": "analysis.plateaus",
    "sample_posterior": "analysis.posterior",
    "write_report": "analysis.reports.writing",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module 'analysis' has no attribute {name!r}")
