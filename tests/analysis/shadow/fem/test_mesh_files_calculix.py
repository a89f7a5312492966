"""The CalculiX deck: complete, and solved to the same state."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from analysis.shadow.fem.element import EDGES
from analysis.shadow.fem.mesh_files import calculix_deck, wetted_faces, write_state
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel


def write(model: FullModel, solution: Solution, path: Path, kind: str) -> None:
    """Write a model's state."""
    write_state(path, kind, model.parameters, model.mesh, solution)


def test_deck_names_every_wetted_face(actuator: FullModel) -> None:
    """The face of each pressure load is the edge of that element that lies in the cavity."""
    for (element, face), edge in zip(wetted_faces(actuator.mesh), actuator.mesh.cavity, strict=True):
        np.testing.assert_array_equal(actuator.mesh.quads[element][EDGES[face]], edge)
    deck = calculix_deck(actuator.parameters, actuator.mesh, 50.0)
    assert max(map(len, deck.splitlines())) < 132
    assert deck.count("TYPE=CAX8R") == 2


@pytest.mark.parametrize("pressure", [50.0, -40.0])
def test_calculix_finds_the_same_state(actuator: FullModel, tmp_path: Path, pressure: float) -> None:
    """The exported deck, run as it is: tip within 0.1 % (required: 1 %), every node within 0.2 % of it."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX (ccx, Debian's calculix-ccx) is not installed")
    state = actuator.solve(pressure_kpa=pressure)
    write(actuator, state, tmp_path / "deck.inp", "inp")
    subprocess.run(["ccx", "deck"], cwd=tmp_path, check=True, capture_output=True, timeout=200)
    lines = [line.split() for line in (tmp_path / "deck.dat").read_text().splitlines()]
    found = np.array([[float(v) for v in line[1:3]] for line in lines if len(line) == 4 and line[0].isdigit()])
    assert found[actuator.mesh.tip[0], 1] == pytest.approx(state.elongation_mm, rel=1e-3)
    assert np.abs(found - state.displacement_mm).max() < 2e-3 * abs(state.elongation_mm)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("values", "pressure"),
    [
        ({"wall_mm": 1.8, "neck_radius_mm": 4.76}, 30.0),
        ({"wall_mm": 2.6, "cells": 3}, -50.0),
        ({"lattice_modulus_kpa": 10.0, "lattice_poisson": 0.1, "wall_poisson": 0.4}, 40.0),
        ({"axial_elements": 12, "wall_elements": 3, "lattice_elements": 6, "wall_poisson": 0.499}, -30.0),
    ],
)
def test_calculix_agrees_for_other_actuators(values: dict[str, float], pressure: float, tmp_path: Path) -> None:
    """Other walls, moduli, Poisson's ratios and meshes: tip within 1 % of CalculiX on the exported deck."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX (ccx, Debian's calculix-ccx) is not installed")
    model = FullModel(ActuatorParameters(**values))  # type: ignore[arg-type]
    state = model.solve(pressure_kpa=pressure)
    write(model, state, tmp_path / "deck.inp", "inp")
    subprocess.run(["ccx", "deck"], cwd=tmp_path, check=True, capture_output=True, timeout=600)
    lines = [line.split() for line in (tmp_path / "deck.dat").read_text().splitlines()]
    found = np.array([[float(v) for v in line[1:3]] for line in lines if len(line) == 4 and line[0].isdigit()])
    assert found[model.mesh.tip[0], 1] == pytest.approx(state.elongation_mm, rel=1e-2)
