"""Everything that numba compiles, compiled once and kept, so that no later call waits for it (`boat-daq setup`).

Each step makes the calls whose machine code it keeps. That all is there is noted in the cache's folder, with the dates
of the sources: numba compiles again what lies in a file of another date, as after a new installation.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import numpy as np

from analysis.compiled import CACHE_FOLDER, PACKAGES, expect_all
from protocol.base.whole_file import write_whole

_DONE = "complete"
_HERE = Path(__file__).parent
_ALONE = ("segmentation/cycles.py",)  # compiled functions outside `PACKAGES`


def compile_calibration() -> None:
    """Find the turning points of a pressure."""
    from analysis.segmentation.cycles import turning_points

    turning_points(np.sin(np.arange(6.0)), 0.1)


def compile_optics() -> None:
    """Trace one scene of too many rays for Python, and sweep one design."""
    from analysis.optics.scene.curves import default_curves, frame_of
    from analysis.optics.scene.parameters import Design, Light, Waveguide
    from analysis.optics.sweep.sweep import SweepRequest, run_sweep
    from analysis.optics.tracer.simulation import BLOCK, trace

    trace(frame_of(default_curves(), 0, Waveguide()), Design(), Waveguide(), Light(rays=2 * BLOCK))
    run_sweep(SweepRequest((Design(),), Waveguide(), Light(rays=10, secondary=4), default_curves()))


def compile_shadow() -> None:
    """Compute a frame of a small shadow by its table and by the full model, and the energy."""
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.table import build_table

    parameters = ActuatorParameters(cells=2, axial_elements=6, wall_elements=1, lattice_elements=3)
    actuator = Shadow(parameters, build_table(parameters))
    problem = actuator.model.problem
    actuator.state(pressure_kpa=20.0, elongation_mm=1.0)
    full = actuator.state(pressure_kpa=10.0, model="full")
    problem.potential(full.nodes_mm - problem.nodes, full.pressure_kpa)


COMPILE_STEPS: dict[str, Callable[[], None]] = {
    "calibration": compile_calibration,
    "rays": compile_optics,
    "shadow": compile_shadow,
}


def is_complete() -> bool:
    """Return whether all has been compiled from the sources as they are."""
    if CACHE_FOLDER is None or not (CACHE_FOLDER / _DONE).is_file():
        return False
    return (CACHE_FOLDER / _DONE).read_text(encoding="utf-8") == _dates()


def _dates() -> str:
    """Return when each file with compiled functions was written."""
    files = [file for name in PACKAGES for file in sorted((_HERE / name).glob("*.py"))]
    return "\n".join(str(file.stat().st_mtime_ns) for file in (*files, *(_HERE / name for name in _ALONE)))


def compile_all(*, notify: Callable[[str], None] | None = None) -> bool:
    """Compile what is not in the cache; return whether something was to be done.

    `notify`: function of the name of each step, as it begins.
    """
    if is_complete():
        return False
    for name in ("optics.tracer.simulation", "shadow.fem.problem", "segmentation.cycles"):
        import_module(f"analysis.{name}")
    expect_all()
    for name, step in COMPILE_STEPS.items():
        if notify is not None:
            notify(name)
        step()
    if CACHE_FOLDER is not None:
        write_whole(CACHE_FOLDER / _DONE, _dates())
    return True
