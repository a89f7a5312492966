"""Levels of fidelity: ordered, and what the program does by default."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.fidelity import LEVELS, fidelity
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import MESH_ERROR_MM
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
    ):
        values = np.array([np.prod(getattr(level, name)) for level in (draft, normal, reference)])
        assert (np.diff(values) >= 0).all(), name


def test_the_normal_level_is_the_default() -> None:
    """The tracer's default, written elsewhere, is normal's."""
    from analysis.optics.scene.parameters import Light

    normal = fidelity("normal")
    assert Light().rays == normal.rays


def test_the_error_of_a_mesh_is_the_measured_one() -> None:
    """To two digits, that of the setting in the table of the trade-off."""
    file = Path(__file__).parents[2] / "analysis/studies/tradeoff/references/measured.json"
    methods = {one["name"]: one for one in json.loads(file.read_text(encoding="utf-8"))["methods"]}
    measured = {point["setting"]: point["error"] for point in methods["full-fem"]["points"]}
    along, wall, lattice = ActuatorParameters().elements
    assert float(f"{measured[f'mesh {along} x ({wall} + {lattice})']:.2g}") == MESH_ERROR_MM
