"""The error of the shadow's mesh over the actuators that its parameters allow, for `analysis/shadow/model/full.py`.

    python -m tests.verification.mesh_error --actuators 150

Random actuators (cells 2 to 8, wall 1.2 to 3.2 mm, its modulus 500 to 3500 kPa, lattice 5 to 60 kPa, Poisson's ratio 0
to 0.45, belly 6 to 12 mm, neck 0.4 to 0.9 of it) are solved at a random pressure of -30 to +50 kPa, on the
program's mesh and on one of 32 x (4 + 8) elements.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError

MESH, REFERENCE = ActuatorParameters().elements, (32, 4, 8)


def random_actuator(rng: np.random.Generator) -> ActuatorParameters:
    """Return an actuator from the ranges above."""
    belly = rng.uniform(6.0, 12.0)
    return ActuatorParameters(
        cells=int(rng.integers(2, 9)),
        wall_mm=rng.uniform(1.2, 3.2),
        wall_modulus_kpa=math.exp(rng.uniform(math.log(500.0), math.log(3500.0))),
        lattice_modulus_kpa=math.exp(rng.uniform(math.log(5.0), math.log(60.0))),
        lattice_poisson=rng.uniform(0.0, 0.45),
        belly_radius_mm=belly,
        neck_radius_mm=belly * rng.uniform(0.4, 0.9),
    )


def elongation_mm(actuator: ActuatorParameters, kpa: float, mesh: tuple[int, int, int] = MESH) -> float:
    """Return the elongation on a mesh, mm."""
    along, wall, lattice = mesh
    finer = replace(actuator, axial_elements=along, wall_elements=wall, lattice_elements=lattice)
    return FullModel(finer).solver.solve(pressure_kpa=kpa).elongation_mm


def errors(actuators: int, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Return the errors and the elongations [actuators] of those that have a state, mm."""
    rng, rows, found = np.random.default_rng(seed), [], []
    while len(rows) < actuators:
        actuator, kpa = random_actuator(rng), rng.uniform(-30.0, 50.0)
        try:
            true = elongation_mm(actuator, kpa, REFERENCE)
            rows.append(elongation_mm(actuator, kpa) - true)
            found.append(true)
        except BoatDaqError:
            continue  # unstable, or its mesh is folded
    return np.abs(rows), np.asarray(found)


def main() -> None:
    """Print the errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--actuators", type=int, default=150)
    found, true = errors(parser.parse_args().actuators)
    share = 100.0 * found / np.maximum(np.abs(true), 0.1)
    print(
        f"95 % within {np.quantile(found, 0.95):.4f} mm, greatest {found.max():.4f} mm; "
        f"of the elongation 95 % within {np.quantile(share, 0.95):.2f} %, greatest {share.max():.2f} %"
    )


if __name__ == "__main__":
    main()
