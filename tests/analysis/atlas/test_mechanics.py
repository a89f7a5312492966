"""Where the mechanics ends: both sides of each border."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from analysis.atlas.sweep import Outcome
from analysis.errors import RequestError
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from boat_daq.cli import app
from tests.analysis.atlas.borders import DEGRADED, REFUSED, WORKS, place


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "said"),
    [
        ("fem-incompressible", 2e-6, 0.4, WORKS, ""),
        ("fem-incompressible", 1e-7, 0.0, REFUSED, "Poisson's ratio"),
        ("fem-incompressible", 0.2, 0.4, WORKS, ""),
        ("fem-incompressible", 0.2, 0.6, REFUSED, "folded"),
        ("fem-limit", -40.0, 2.2, WORKS, ""),
        ("fem-limit", -45.0, 2.2, REFUSED, "critical pressure of -44."),
        ("fem-coarse", 8.0, 4.0, WORKS, ""),
        ("fem-coarse", 4.0, 4.0, DEGRADED, "the mesh is coarse"),
        ("reduced-edge", -20.0, -3.4, WORKS, ""),
        ("reduced-edge", -20.0, -3.6, DEGRADED, "the full model answered"),
        ("reduced-edge", 54.9, 0.0, WORKS, ""),
        ("reduced-edge", 55.1, 0.0, DEGRADED, "the full model answered"),
        ("reduced-edge", -45.0, 0.0, REFUSED, "critical pressure"),
    ],
)
def test_borders_of_the_mechanics(name: str, x: float, y: float, outcome: Outcome, said: str) -> None:
    """Lame, scikit-fem, a finer mesh and the full model on one side; a reservation or a refusal on the other."""
    place(name, x, y, outcome, said)


def test_a_solid_stiffer_than_rounding_is_refused() -> None:
    """At nu = 0.5 - 1e-9 no displacement at all passed for a solution; such a material is not made any more."""
    assert NeoHookean(1000.0, 0.5 - 1.1e-6).d1_per_kpa > 0
    with pytest.raises(RequestError, match="Poisson's ratio of 0"):
        NeoHookean(1000.0, 0.5 - 1e-9)


def test_a_coarse_mesh_is_told_where_it_is_used() -> None:
    """The default mesh has no reservation; a coarse one has, in Python and on the command line."""
    assert FullModel().reservations == ()
    assert "2 in the lattice" in FullModel(ActuatorParameters(cells=2, lattice_elements=2)).reservations[0]
    solved = CliRunner().invoke(app, ["shadow", "solve", "--pressure", "10", "--json"])
    assert json.loads(solved.stdout)["notes"] == []
