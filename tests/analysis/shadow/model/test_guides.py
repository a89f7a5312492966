"""The waveguides: carried by the mesh, as in the paper."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.shadow.model.full import FullModel
from analysis.shadow.model.guides import both_guides, embed, make_guides, rest_centreline
from protocol.base.errors import RequestError


def test_guides_are_carried_exactly(actuator: FullModel) -> None:
    """Embedded points follow a displacement field that is linear in r and z to rounding."""
    inside = rest_centreline(actuator.parameters, actuator.length_mm)
    inside = inside[(inside[:, 1] > 0) & (inside[:, 1] < actuator.length_mm)]
    carried = embed(actuator.mesh, inside, actuator.length_mm).positions(actuator.mesh.nodes * (0.02, 0.05))
    np.testing.assert_allclose(carried, inside * (1.02, 1.05), atol=1e-10)


def test_guides_are_as_in_the_paper(actuator: FullModel) -> None:
    """Seven tracked points, centrelines every 0.5 mm, both ends in a common junction, guide 2 the mirror of guide 1."""
    guides = actuator.guides
    assert guides.tracked.rest_mm.shape == (7, 2)
    steps = np.linalg.norm(np.diff(guides.centreline.rest_mm, axis=0), axis=1)
    np.testing.assert_allclose(steps, 0.5, atol=0.003)
    pair = both_guides(guides.tracked.rest_mm)
    np.testing.assert_array_equal(pair[1], pair[0] * (-1, 1))
    np.testing.assert_allclose(pair[:, [0, -1], 0], 0.0, atol=1e-12)


def test_rigid_ends_carry_the_junctions(actuator: FullModel) -> None:
    """The base's junction stays, the tip's moves with the plate."""
    state = actuator.solve(pressure_kpa=50.0)
    moved = actuator.tracked(state) - actuator.guides.tracked.rest_mm
    np.testing.assert_allclose(moved[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(moved[-1], (0.0, state.elongation_mm), atol=1e-12)


def test_a_guide_outside_the_lattice_is_refused(actuator: FullModel) -> None:
    """One that would run through the bladder is refused, with the place."""
    with pytest.raises(RequestError, match="leaves the lattice"):
        make_guides(replace(actuator.parameters, guide_bow_mm=9.0), actuator.mesh)
