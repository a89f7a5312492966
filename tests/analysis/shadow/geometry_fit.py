"""The one fit: what the paper does not give, from the two elongations that it implies.

Strategy: two unknowns, the wall's modulus (log) and the neck's radius, are found by least squares so that the full
model elongates by +3.8 mm at +50 kPa and -2.7 mm at -40 kPa. The modulus sets the size of both, the neck sets their
ratio: a deeper bellows is softer under vacuum than under pressure. The sensitivities come with the fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from analysis.shadow.fem.mesh import build_mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solver
from analysis.shadow.model.full import actuator_problem
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, ConvergenceError

TARGETS = ((50.0, 3.8), (-40.0, -2.7))
"""Pressure in kPa and elongation in mm (definitions: the range whose end-to-end slope is the paper's sensitivity)."""


@dataclass(frozen=True, slots=True)
class GeometryFit:
    """The fit and its sensitivities.

    Parameters
    ----------
    parameters : the actuator that meets the targets best.
    residual_mm : shape (2,), model minus target.
    sensitivity : shape (2, 2), d(elongation at each target)/d(wall modulus in %, neck radius in mm): mm/% and mm/mm.
    """

    parameters: ActuatorParameters
    residual_mm: FloatArray
    sensitivity: FloatArray


def elongations(parameters: ActuatorParameters) -> FloatArray:
    """Return the elongation at each target's pressure, mm, whether or not other modes are stable there."""
    solver = Solver(actuator_problem(parameters, build_mesh(parameters)))
    return np.array([solver.solve(pressure_kpa=p).elongation_mm for p, _ in TARGETS])


def fit_geometry(start: ActuatorParameters | None = None) -> GeometryFit:
    """Fit wall modulus and neck radius to the two elongations.

    Parameters
    ----------
    start : everything that is not fitted, and where to begin.

    Raises
    ------
    ConvergenceError
        If no geometry near the start meets both within 0.05 mm; the message shows the best.
    """
    first = start or ActuatorParameters()
    wanted = np.array([x for _, x in TARGETS])

    def actuator(values: FloatArray) -> ActuatorParameters:
        neck = float(np.clip(values[1], 0.2, first.belly_radius_mm))
        return replace(first, wall_modulus_kpa=float(np.exp(values[0])), neck_radius_mm=neck)

    def misfit(values: FloatArray) -> FloatArray:
        try:
            return np.asarray(elongations(actuator(values)) - wanted)
        except BoatDaqError:
            return np.full(2, 10.0)  # no equilibrium there: far off, so the search turns back

    found = least_squares(
        misfit, [np.log(first.wall_modulus_kpa), first.neck_radius_mm], diff_step=[1e-4, 1e-4], xtol=1e-9
    )
    if np.abs(found.fun).max() > 0.05:
        raise ConvergenceError(
            f"no sound geometry meets both targets: misfit {found.fun[0]:+.2f} and {found.fun[1]:+.2f} mm at best",
            "start from another wall, belly or envelope",
        )
    scale = np.array([0.01, 1.0])  # a per cent of modulus is 0.01 in its logarithm
    return GeometryFit(actuator(found.x), found.fun, np.asarray(found.jac) * scale)
