"""Levels of fidelity: ordered, and what the program does by default."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.fidelity import LEVELS, fidelity
from protocol.base.errors import RequestError


def test_levels_by_name() -> None:
    """Three levels, each with its name; another one is refused with the valid ones."""
    assert [fidelity(level).level for level in LEVELS] == list(LEVELS)
    assert fidelity() == fidelity("normal")
    with pytest.raises(RequestError, match="no precision 'best'"):
        fidelity("best")


def test_finer_levels_are_nowhere_coarser() -> None:
    """Every number of a level grows, or stays, from draft to reference."""
    draft, normal, reference = (fidelity(level) for level in LEVELS)
    for name in (
        "rays",
        "ranking_rays",
        "walkers",
        "posterior_samples",
        "resamples",
        "points_a_column",
        "mesh",
        "table",
    ):
        values = np.array([np.prod(getattr(level, name)) for level in (draft, normal, reference)])
        assert (np.diff(values) >= 0).all(), name


def test_the_normal_level_is_the_default() -> None:
    """Defaults written elsewhere (tracer, shadow, live plot) are normal's."""
    from analysis.optics.scene.parameters import Light
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.frames import actuator, table_settings
    from analysis.shadow.model.reduced import TableSettings
    from boat_daq.viewmodels.live.live_model import LiveModel

    normal = fidelity("normal")
    assert Light().rays == normal.rays
    assert LiveModel(lambda: None).points_a_column == normal.points_a_column
    assert actuator(normal) == ActuatorParameters()
    assert table_settings(normal) == TableSettings()


def test_a_mesh_of_ones_own_keeps_ones_own_material() -> None:
    """The level's fitted numbers belong to the default actuator only."""
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.frames import actuator

    mine = replace(ActuatorParameters(), wall_modulus_kpa=900.0)
    assert actuator(fidelity("reference"), mine).wall_modulus_kpa == 900.0
    assert actuator(fidelity("reference"), mine).axial_elements == fidelity("reference").mesh[0]


def test_the_error_of_a_mesh_is_the_measured_one() -> None:
    """To two digits, that of the setting in the table of the trade-off."""
    file = Path(__file__).parents[2] / "analysis/studies/tradeoff/references/measured.json"
    methods = {one["name"]: one for one in json.loads(file.read_text(encoding="utf-8"))["methods"]}
    measured = {point["setting"]: point["error"] for point in methods["full-fem"]["points"]}
    for level in map(fidelity, LEVELS):
        along, wall, lattice = level.mesh
        assert level.mesh_error_mm == float(f"{measured[f'mesh {along} x ({wall} + {lattice})']:.2g}")
