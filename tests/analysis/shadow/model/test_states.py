"""Fifteen states of the guides for the optics: solved, cached, written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.optics.scene.curve_file import read_curves
from analysis.optics.scene.curves import checked_curves, default_curves, elongations
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.states import (
    PAPER_LOWEST_KPA,
    STIFFER_WALL,
    GuideStates,
    guide_states,
    kept_states,
    write_states,
)
from protocol.base.errors import RequestError, StorageError


@pytest.fixture(scope="module")
def states(actuator: FullModel) -> GuideStates:
    """The paper's range."""
    return guide_states(actuator)


def test_fifteen_states_from_compression_to_elongation(states: GuideStates) -> None:
    """Seven even steps of pressure each way, rest in the middle, elongation rising from -2.7 to +3.8 mm."""
    assert states.curves_mm.shape == (15, 2, 7, 2)
    assert states.pressure_kpa[7] == 0.0
    assert (np.diff(states.elongation_mm) > 0).all()
    np.testing.assert_allclose(states.elongation_mm[[0, 7, 14]], [-2.7, 0.0, 3.8], atol=1e-3)
    np.testing.assert_allclose(states.curves_mm[:, 1, :, 0], -states.curves_mm[:, 0, :, 0], atol=1e-12)


def test_the_optics_default_is_this_model(states: GuideStates) -> None:
    """The file that ships with the optics holds what the full model gives now: written anew where this fails."""
    np.testing.assert_allclose(default_curves(), states.curves_mm, atol=2e-6)
    np.testing.assert_allclose(elongations(), states.elongation_mm, atol=2e-6)


def test_states_are_kept_by_parameters(states: GuideStates, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second time they come from the cache, bit for bit; a damaged cache is made anew, as for other parameters."""
    solved = []

    def solve(model: FullModel, *, lowest_kpa: float) -> GuideStates:
        solved.append(model.parameters.digest)
        return states

    monkeypatch.setattr("analysis.shadow.model.states.guide_states", solve)
    for _ in range(2):
        np.testing.assert_array_equal(kept_states(folder=tmp_path).curves_mm, states.curves_mm)
    assert solved == [states.parameters]
    next(tmp_path.iterdir()).write_bytes(b"PK not a table")
    kept_states(folder=tmp_path)
    kept_states(replace(ActuatorParameters(), wall_modulus_kpa=300.0), folder=tmp_path)
    kept_states(lowest_kpa=-30.0, folder=tmp_path)
    assert len(solved) == 4
    assert len(set(solved)) == 2


@pytest.mark.nightly
def test_stiffer_wall_reaches_the_pressures_that_the_paper_simulated() -> None:
    """-50 to +50 kPa are solved without buckling; -40 and +50 kPa give the elongations of the default wall."""
    model = FullModel(STIFFER_WALL)
    assert model.vacuum_limit.pressure_kpa < PAPER_LOWEST_KPA - 5.0
    states = guide_states(model, lowest_kpa=PAPER_LOWEST_KPA)
    np.testing.assert_allclose(states.pressure_kpa[[0, 14]], [-50.0, 50.0])
    assert model.solve(pressure_kpa=-40.0).elongation_mm == pytest.approx(-2.7, abs=1e-3)
    assert states.elongation_mm[14] == pytest.approx(3.8, abs=1e-3)
    assert states.elongation_mm[0] < -3.0


def test_guides_straighten_as_the_actuator_lengthens(states: GuideStates) -> None:
    """Unlike in the paper: curvature falls with elongation, by a tenth in all."""
    curvature = states.curvature_per_mm()
    assert (np.diff(curvature) < 0).all()
    assert 1 - curvature[-1] / curvature[0] == pytest.approx(0.10, abs=0.02)
    assert np.ptp(states.bow_mm()) < 0.2


def test_the_optics_reads_what_is_written(states: GuideStates, tmp_path: Path) -> None:
    """CSV and arrays come back as they went, and pass the optics' own check."""
    made = states
    write_states(made, tmp_path / "curves.csv")
    np.testing.assert_allclose(read_curves(tmp_path / "curves.csv"), made.curves_mm, atol=1e-6)
    checked_curves(made.curves_mm)
    write_states(made, tmp_path / "curves.npz")
    with np.load(tmp_path / "curves.npz") as kept:
        np.testing.assert_array_equal(kept["curves_mm"], made.curves_mm)


def test_states_that_cannot_be(actuator: FullModel, states: GuideStates, tmp_path: Path) -> None:
    """Pressures on one side, beyond the limit, or a file in no folder."""
    with pytest.raises(RequestError):
        guide_states(actuator, lowest_kpa=10.0)
    with pytest.raises(RequestError, match="critical pressure"):
        guide_states(actuator, lowest_kpa=-60.0)
    with pytest.raises(StorageError):
        write_states(states, tmp_path / "none" / "curves.csv")
