"""The full model's equilibrium against forces that scikit-fem assembles."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.pressure import volume_gradient
from analysis.shadow.model.full import FullModel
from protocol.base.errors import RequestError
from tests.verification.scikit_fem import make_scikit_fem_problem

WALLS_MM = (1.6, 1.8, 2.0, 2.2, 2.6)
NEAR_LIMIT_KPA = (-45.0, -40.0)
PRESSURES_KPA = (-150.0, -80.0, -60.0, -45.0, -40.0, -30.0, -10.0, 10.0, 50.0, 100.0, 150.0)
WORST_RESIDUAL = 1e-6


@pytest.mark.parametrize(
    ("wall_mm", "pressures_kpa"),
    [(2.2, NEAR_LIMIT_KPA), *(pytest.param(w, PRESSURES_KPA, marks=pytest.mark.nightly) for w in WALLS_MM)],
)
def test_stable_states_are_in_equilibrium_and_others_are_refused(
    wall_mm: float, pressures_kpa: tuple[float, ...]
) -> None:
    """On both sides of the limit of stability: the residual is small, or the state is refused."""
    model, solved = FullModel(ActuatorParameters(wall_mm=wall_mm)), 0
    second = make_scikit_fem_problem(model.problem)
    for kpa in pressures_kpa:
        try:
            state = model.solve(pressure_kpa=kpa)
        except RequestError as error:
            assert "lies beyond" in error.cause
            continue
        solved += 1
        assert model.stability.unstable_mode(state) is None
        load = np.zeros_like(state.displacement_mm)
        volume_gradient(model.mesh.nodes, state.displacement_mm, model.mesh.cavity, load)
        inner = second.internal_force(state.displacement_mm)
        residual = np.linalg.norm(model.problem.gather(inner - state.pressure_kpa * load)) / np.linalg.norm(inner)
        assert residual <= WORST_RESIDUAL, kpa
    assert 0 < solved < len(pressures_kpa)
