"""Compile everything that numba compiles once, before several workers would do so at the same time.

`make test` runs this beside the linters, which need one core. Machine code is kept beside the sources.
"""

from __future__ import annotations

from pathlib import Path

from analysis.figures.pipeline import analyse
from analysis.optics.scene.curves import default_curves, frame_of
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.optics.tracer.simulation import trace
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from tests.outside_writes import temporary_home

SAMPLE = Path(__file__).resolve().parents[1] / "recordings" / "simulated_SA1_two_cycles.boat"


def optics() -> None:
    """Trace one scene, and sweep one design."""
    trace(frame_of(default_curves(), 0, Waveguide()), Design(), Waveguide(), Light())
    run_sweep(SweepRequest((Design(),), Waveguide(), Light(rays=10, secondary=4), default_curves()))


def shadow() -> None:
    """Compute a frame of a small shadow by its table and by the full model, and the energy."""
    actuator = Shadow(ActuatorParameters(cells=2, axial_elements=6, wall_elements=1, lattice_elements=3))
    problem = actuator.model.problem
    actuator.state(pressure_kpa=20.0, elongation_mm=1.0)
    full = actuator.state(pressure_kpa=10.0, model="full")
    problem.potential(full.nodes_mm - problem.nodes, full.pressure_kpa)


if __name__ == "__main__":
    with temporary_home():  # the shadow's table is stored there
        optics()
        shadow()
        analyse(SAMPLE, mcmc=False)
