"""Everything that numba compiles, compiled once: workers that come to it at the same moment would each do it.

`make test` runs this beside the linters, which need one core. What is compiled stays beside the sources.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.figures.pipeline import analyse
from analysis.optics.scene.curves import default_curves, frame_of
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.optics.tracer.simulation import trace
from analysis.shadow.fem.band import product
from analysis.shadow.model.frames import Shadow
from tests.outside_writes import temporary_home

SAMPLE = Path(__file__).resolve().parents[1] / "recordings" / "simulated_SA1_two_cycles.boat"


def optics() -> None:
    """One scene, and a sweep of one design."""
    trace(frame_of(default_curves(), 0, Waveguide()), Design(), Waveguide(), Light())
    run_sweep(SweepRequest((Design(),), Waveguide(), Light(rays=10, secondary=4), default_curves()))


def shadow() -> None:
    """A frame of the shadow by its table and by the full model, and what only tests ask: energy and a product."""
    actuator = Shadow()
    problem = actuator.model.problem
    actuator.state(pressure_kpa=20.0, elongation_mm=1.0)
    full = actuator.state(pressure_kpa=10.0, model="full")
    problem.potential(full.nodes_mm - problem.nodes, full.pressure_kpa)
    product(problem.tangent(np.zeros_like(problem.nodes), 0.0), np.zeros(problem.size))


if __name__ == "__main__":
    with temporary_home():  # the shadow's table is stored there
        optics()
        shadow()
        analyse(SAMPLE, mcmc=False)
