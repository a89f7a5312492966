"""What the shadow's tests share: one full model and one table, made once."""

from __future__ import annotations

import pytest

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.model.table import build_table


@pytest.fixture(scope="session")
def actuator() -> FullModel:
    """The paper's actuator."""
    return FullModel()


@pytest.fixture(scope="session")
def table() -> ReducedModel:
    """Its reduced model, built here and not taken from a cache."""
    return build_table()


@pytest.fixture(scope="session")
def short() -> ActuatorParameters:
    """Two bladders on a coarse mesh: every step at a tenth of the cost."""
    return ActuatorParameters(cells=2, axial_elements=6, wall_elements=1, lattice_elements=3)
