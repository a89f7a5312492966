"""The parametric mesh: its parts, its quality, and what makes none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.errors import AnalysisError, FileError, RequestError
from analysis.shadow.fem.mesh import WALL, Mesh, bladder_radius, build_mesh, check_quality, quality
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.parameter_files import read_parameters


def test_parts_lie_where_they_belong() -> None:
    """Base at 0, tip at the length, wetted edges on the bladder's curve, the wall as thick as asked."""
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
    found = quality(build_mesh(ActuatorParameters()))
    assert found.scaled_jacobian > 0.5
    assert found.aspect < 6.0


@settings(max_examples=60, deadline=None)
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
    except AnalysisError as refusal:
        assert refusal.cause
        assert refusal.remedy
    else:
        assert quality(mesh).scaled_jacobian > 0.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("cells", 0),
        ("cells", 2.5),
        ("cells", True),
        ("pitch_mm", float("nan")),
        ("wall_mm", -1.0),
        ("wall_mm", 30.0),
        ("neck_radius_mm", 9.0),
        ("envelope_radius_mm", 9.0),
        ("guide_bow_mm", 26.0),
        ("axial_elements", 100_000),
        ("wall_poisson", 0.5),
        ("lattice_modulus_kpa", 0.0),
        ("pitch_mm", "12.5"),
    ],
)
def test_parameters_that_are_none_are_named(name: str, value: float) -> None:
    """The refusal names the parameter or what is wrong with it, and says what to do."""
    with pytest.raises(RequestError) as refusal:
        replace(ActuatorParameters(), **{name: value})  # type: ignore[arg-type]
    assert refusal.value.cause
    assert refusal.value.remedy


def test_a_folded_mesh_is_refused() -> None:
    """A corner pulled through its element, a NaN, and a mesh beyond the axis are each refused."""
    good = build_mesh(ActuatorParameters(cells=1))
    for place in ((100.0, 0.0), (np.nan, 0.0), (-40.0, 0.0)):
        nodes = good.nodes.copy()
        nodes[good.quads[0, 2]] = place
        with pytest.raises(RequestError):
            check_quality(Mesh(nodes, good.quads, good.material, good.cavity, good.base, good.tip))


def test_digest_follows_every_value() -> None:
    """Equal parameters share a table, any change gets its own."""
    base = ActuatorParameters()
    assert base.digest == ActuatorParameters().digest
    assert base.digest != replace(base, wall_mm=2.2000001).digest


@pytest.mark.fault(53, how="an actuator's parameters with a misspelt name, and no TOML", times=2)
def test_parameter_files(tmp_path: Path) -> None:
    """A file changes what it names; a misspelt name is refused with the right one; no TOML is refused."""
    path = tmp_path / "actuator.toml"
    path.write_text("cells = 4\nwall_mm = 1.9\n")
    assert read_parameters(path) == replace(ActuatorParameters(), cells=4, wall_mm=1.9)
    path.write_text("wall = 1.9\n")
    with pytest.raises(RequestError) as refusal:
        read_parameters(path)
    assert "wall" in refusal.value.remedy
    path.write_text("cells: 4")
    with pytest.raises(FileError):
        read_parameters(path)
    with pytest.raises(FileError):
        read_parameters(tmp_path / "none.toml")
