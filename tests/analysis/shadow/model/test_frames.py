"""Frames for the window."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.model.frames import Shadow, triangles
from analysis.shadow.model.reduced import ReducedModel
from protocol.base.errors import DataError, RequestError


@pytest.fixture(scope="module")
def shadow(table: ReducedModel) -> Shadow:
    """The paper's actuator with its table."""
    return Shadow(table=table)


def test_a_frame_holds_what_the_pane_draws(shadow: Shadow) -> None:
    """Shapes, tip, deviation and band of a measured state."""
    state = shadow.state(elongation_mm=3.5, pressure_kpa=50.0)
    assert repr(shadow) == "<Shadow: -41.5 to 55.0 kPa, -3.4 to 4.9 mm>"
    nodes = len(shadow.topology.rest_mm)
    assert state.model == "reduced"
    assert state.nodes_mm.shape == (nodes, 2)
    assert state.strain.shape == state.displacement_mm.shape == (nodes,)
    assert state.tracked_points_mm.shape == (2, 7, 2)
    assert state.deviation_mm == pytest.approx(3.5 - 3.8, abs=1e-3)
    assert state.nominal_sd_mm == pytest.approx(0.139, abs=5e-3)
    assert state.tip_force_mn < 0  # held back: the plate must be pushed
    assert state.pressure_residual_kpa == pytest.approx(50 - 46.7, abs=0.2)
    tip = state.nodes_mm[shadow.model.mesh.tip, 1]
    np.testing.assert_allclose(tip, 75.0 + 3.5, atol=1e-6)


def test_reduced_and_full_frames_agree(shadow: Shadow) -> None:
    """Every node within a micrometre, strain within 1e-4."""
    fast = shadow.state(elongation_mm=-1.5, pressure_kpa=-25.0)
    slow = shadow.state(elongation_mm=-1.5, pressure_kpa=-25.0, model="full")
    assert slow.model == "full"
    np.testing.assert_allclose(fast.nodes_mm, slow.nodes_mm, atol=1e-3)
    np.testing.assert_allclose(fast.strain, slow.strain, atol=1e-3)


@pytest.mark.parametrize("given", [{"pressure_kpa": 30.0}, {"elongation_mm": 2.0}])
def test_one_measured_value_is_enough(shadow: Shadow, given: dict[str, float]) -> None:
    """The other follows from the nominal actuator, so there is no deviation and no force."""
    state = shadow.state(**given)  # type: ignore[arg-type]
    assert state.deviation_mm == pytest.approx(0.0, abs=1e-4)
    assert abs(state.tip_force_mn) < 1.0


@pytest.mark.fault(46, how="states outside the table, requested from the shadow", times=3)
def test_outside_the_table_the_full_model_answers(shadow: Shadow) -> None:
    """Beyond the rectangle the frame comes from the full model and names it; beyond the limit it is refused."""
    assert shadow.state(pressure_kpa=60.0, elongation_mm=4.0).model == "full"
    assert shadow.state(pressure_kpa=60.0).model == "full"
    with pytest.raises(RequestError, match="critical pressure"):
        shadow.state(pressure_kpa=-70.0)


@pytest.mark.parametrize("given", [{"pressure_kpa": np.nan}, {"elongation_mm": np.inf, "pressure_kpa": 0.0}])
def test_nan_is_never_drawn(shadow: Shadow, given: dict[str, float]) -> None:
    """What a calibration gives outside its range is refused."""
    with pytest.raises(DataError):
        shadow.state(**given)  # type: ignore[arg-type]
    with pytest.raises(RequestError):
        shadow.state()


def test_a_homogeneous_stretch_has_its_strain(shadow: Shadow) -> None:
    """The greatest principal stretch of diag(1.01, 1.05, 1.01) is 1.05 at every node."""
    strain = shadow.strain(shadow.model.mesh.nodes * (0.01, 0.05))
    np.testing.assert_allclose(strain, 0.05, atol=1e-12)


def test_triangles_cover_the_elements(shadow: Shadow) -> None:
    """Their area is the half section's, and none is turned over."""
    nodes, cut = shadow.topology.rest_mm, triangles(shadow.model.mesh.quads)
    a, b, c = (nodes[cut[:, i]] for i in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (areas > 0).all()
    mean_radius = (4.3165 + 7.5) / 2
    assert areas.sum() == pytest.approx(75 * (25 - mean_radius), rel=2e-3)


def test_lines_follow_their_edges(shadow: Shadow) -> None:
    """The outline starts and ends at the hole, the cavity and the wall run from base to tip."""
    top = shadow.topology
    assert top.rest_mm[top.outline[0], 1] == 0.0
    assert top.rest_mm[top.outline[-1], 1] == 75.0
    for line in (top.cavity, top.interface):
        assert (np.diff(top.rest_mm[line, 1]) > 0).all()
