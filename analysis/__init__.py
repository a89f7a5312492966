"""Offline analysis: arrays and files in, figures out. What a script imports.

    from analysis import analyse, load_recording
    analysis = analyse(load_recording("run.boat"), "readings.csv")
    print(analysis.sensors[0].figures["sensitivity_mv_per_mm"].value)

Names are imported when first used, so that other parts (optics, shadow) load none. `fit_calibration` fits any two
arrays, `Inverse` and `Fusion` turn mV into mm, `sample_posterior` gives bands, `write_report` writes HTML or PDF.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any


def _require_own_protocol() -> None:
    """Refuse another `protocol` than the one beside this package, as `boat_daq.own_packages` does, by its place."""
    spec = find_spec("protocol")
    found = spec and Path(spec.origin or next(iter(spec.submodule_search_locations or [""])))
    if found and found.resolve() != Path(__file__).resolve().parents[1] / "protocol" / "__init__.py":
        cause = f"{found} would be imported in place of boat-daq's package 'protocol'."
        remedy = "Rename it, or move it to another folder; a package's: use an environment without that package."
        raise ImportError(f"{cause} {remedy}", name="protocol")


_require_own_protocol()

from protocol.base.errors import BoatDaqError  # noqa: E402 - the check comes first

if TYPE_CHECKING:
    from analysis.calibration.fit import Calibration as Calibration
    from analysis.calibration.fit import fit_calibration as fit_calibration
    from analysis.calibration.inverse import Fusion as Fusion
    from analysis.calibration.inverse import Inverse as Inverse
    from analysis.calibration.posterior import Posterior as Posterior
    from analysis.calibration.posterior import sample_posterior as sample_posterior
    from analysis.calibration_export.run_record import load_recording as load_recording
    from analysis.data.recording import Recording as Recording
    from analysis.figures.figure import Figure as Figure
    from analysis.figures.pipeline import Analysis as Analysis
    from analysis.figures.pipeline import analyse as analyse
    from analysis.figures.sensor_analysis import Options as Options
    from analysis.reports.build import write_report as write_report
    from analysis.segmentation.cycles import find_cycles as find_cycles
    from analysis.segmentation.plateaus import PlateauSettings as PlateauSettings
    from analysis.segmentation.plateaus import find_plateaus as find_plateaus
    from analysis.segmentation.plateaus import plateau_table as plateau_table

_NAMES = {  # by module
    "calibration.fit": ("Calibration", "fit_calibration"),
    "calibration.inverse": ("Fusion", "Inverse"),
    "calibration.posterior": ("Posterior", "sample_posterior"),
    "calibration_export.run_record": ("load_recording",),
    "data.recording": ("Recording",),
    "figures.figure": ("Figure",),
    "figures.pipeline": ("Analysis", "analyse"),
    "figures.sensor_analysis": ("Options",),
    "reports.build": ("write_report",),
    "segmentation.cycles": ("find_cycles",),
    "segmentation.plateaus": ("PlateauSettings", "find_plateaus", "plateau_table"),
}
_MODULES = {name: f"analysis.{module}" for module, names in _NAMES.items() for name in names}
AnalysisError = BoatDaqError  # the name that scripts import
__all__ = list(_MODULES | {"AnalysisError": __name__})


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(importlib.import_module(_MODULES[name]), name)
    raise AttributeError(f"module 'analysis' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
