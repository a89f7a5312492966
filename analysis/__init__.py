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
    from analysis.calibration.fit import Calibration, fit_calibration
    from analysis.calibration.inverse import Fusion, Inverse
    from analysis.calibration.posterior import Posterior, sample_posterior
    from analysis.data.load import load_recording
    from analysis.data.recording import Recording
    from analysis.errors import AnalysisError
    from analysis.figures.figure import Figure
    from analysis.figures.pipeline import Analysis, analyse
    from analysis.figures.sensor_analysis import Options
    from analysis.reports.build import write_report
    from analysis.segmentation.cycles import find_cycles
    from analysis.segmentation.plateaus import PlateauSettings, find_plateaus, plateau_table

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
    "Analysis": "analysis.figures.pipeline",
    "AnalysisError": "analysis.errors",
    "Calibration": "analysis.calibration.fit",
    "Figure": "analysis.figures.figure",
    "Fusion": "analysis.calibration.inverse",
    "Inverse": "analysis.calibration.inverse",
    "Options": "analysis.figures.sensor_analysis",
    "PlateauSettings": "analysis.segmentation.plateaus",
    "Posterior": "analysis.calibration.posterior",
    "Recording": "analysis.data.recording",
    "analyse": "analysis.figures.pipeline",
    "find_cycles": "analysis.segmentation.cycles",
    "find_plateaus": "analysis.segmentation.plateaus",
    "fit_calibration": "analysis.calibration.fit",
    "load_recording": "analysis.data.load",
    "plateau_table": "analysis.segmentation.plateaus",
    "sample_posterior": "analysis.calibration.posterior",
    "write_report": "analysis.reports.build",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module 'analysis' has no attribute {name!r}")
