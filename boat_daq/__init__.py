"""Calibrate soft optical sensors in pneumatic actuators. What scripts and notebooks import.

    from boat_daq import analyse, load_recording
    analysis = analyse(load_recording("run.boat"))
    print(analysis.sensors[0].figures["sensitivity_mv_per_mm"])

Names are imported when first used. `Session` measures, `analyse` evaluates, `Scene` and `trace` are the optical model,
`Shadow` is the finite-element model.
"""

import importlib
import os
from typing import Any

# Linear algebra here is many small systems: threads of the BLAS only get in one another's way on a busy computer.
# It is read when numpy is imported, so it stands before everything else.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.2.0"

_NAMES = {  # by module
    "analysis.calibration.fit": ("Calibration", "fit_calibration"),
    "analysis.calibration.inverse": ("Fusion", "Inverse"),
    "analysis.calibration.posterior": ("Posterior", "sample_posterior"),
    "analysis.calibration_export.run_record": ("elongation_reader", "load_recording"),
    "analysis.data.recording": ("Recording",),
    "analysis.figures.figure": ("Figure",),
    "analysis.figures.pipeline": ("Analysis", "analyse"),
    "analysis.figures.sensor_analysis": ("Options",),
    "analysis.history.batch": ("batch",),
    "analysis.optics.one_scene": ("Scene", "trace"),
    "analysis.reports.build": ("write_report",),
    "analysis.segmentation.cycles": ("find_cycles",),
    "analysis.segmentation.plateaus": ("PlateauSettings", "find_plateaus", "plateau_table"),
    "analysis.shadow.model.frames": ("Shadow",),
    "boat_daq.engine.plan": ("Plan",),
    "boat_daq.engine.session.measured_blocks": ("MeasuredBlock",),
    "boat_daq.engine.session.reading_sources": ("enter_simulated_readings",),
    "boat_daq.engine.session.session": ("Session",),
    "protocol.base.errors": ("BoatDaqError",),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'boat_daq' has no attribute {name!r}")
    from boat_daq.own_packages import adopt_own_packages

    adopt_own_packages()
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
