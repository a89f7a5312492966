"""The parametric mesh: its parts, its quality, and what cannot be meshed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.shadow.fem.mesh import WALL, Mesh, bladder_radius, build_mesh, check_quality, scaled_jacobian
from analysis.shadow.fem.parameters import ActuatorParameters
from protocol.base.errors import BoatDaqError, RequestError


def test_parts_lie_where_they_belong() -> None:
    """Base at 0, tip at the length, wetted edges on the bladder's curve, the wall as thick as specified."""
    chosen = ActuatorParameters()
    mesh = build_mesh(chosen)
    assert (mesh.nodes[mesh.base, 1] == 0.0).all()
    assert (mesh.nodes[mesh.tip, 1] == 75.0).all()
    wet = mesh.nodes[np.unique(mesh.cavity)]
    np.testing.assert_allclose(wet[:, 0], bladder_radius(chosen, wet[:, 1]), atol=1e-12)
    wall = mesh.nodes[np.unique(mesh.quads[mesh.material == WALL])]
    assert (wall[:, 0] - bladder_radius(chosen, wall[:, 1])).max() == pytest.approx(chosen.wall_mm)


def test_default_mesh_is_sound() -> None:
    """No element is near folding, none is a needle."""
    mesh = build_mesh(ActuatorParameters())
    corners = mesh.nodes[mesh.quads[:, :4]]
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert scaled_jacobian(mesh) > 0.5
    assert (edges.max(axis=1) / edges.min(axis=1)).max() < 10.0


@given(
    st.fixed_dictionaries(
        {
            "cells": st.integers(1, 4),
            "pitch_mm": st.floats(2.0, 40.0),
            "neck_radius_mm": st.floats(0.05, 12.0),
            "belly_radius_mm": st.floats(0.05, 20.0),
            "wall_mm": st.floats(0.05, 10.0),
            "envelope_radius_mm": st.floats(1.0, 40.0),
            "axial_elements": st.integers(1, 10),
            "wall_elements": st.integers(1, 3),
            "lattice_elements": st.integers(1, 4),
            "grading": st.floats(0.1, 10.0),
        }
    )
)
def test_any_parameters_give_a_mesh_or_a_reason(values: dict[str, float]) -> None:
    """Either a mesh that passes its own check, or an error with cause and remedy: never a folded mesh."""
    try:
        mesh = build_mesh(ActuatorParameters(guide_bow_mm=0.5, **values))  # type: ignore[arg-type]
    except BoatDaqError as refusal:
        assert refusal.cause
        assert refusal.remedy
    else:
        assert scaled_jacobian(mesh) > 0.0


def test_a_folded_mesh_is_refused() -> None:
    """A corner pulled through its element, a NaN, and a mesh beyond the axis are each refused."""
    good = build_mesh(ActuatorParameters(cells=1))
    for place in ((100.0, 0.0), (np.nan, 0.0), (-40.0, 0.0)):
        nodes = good.nodes.copy()
        nodes[good.quads[0, 2]] = place
        with pytest.raises(RequestError):
            check_quality(Mesh(nodes, good.quads, good.material, good.cavity, good.base, good.tip))
