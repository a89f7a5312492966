"""The optics page: designs chosen on a map."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.sweep.figure_of_merit import Merit
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.models.optics import (
    CAVITIES,
    PAPER_DESIGN,
    SHIPPED,
    OpticsModel,
    SweepSummary,
    shipped_sweep,
    store_sweep,
    sweep,
)
from boat_daq.workflows.jobs import JobRunner


def test_cell_of_a_map_selects_its_design():
    """A click takes spacing across and depth up; beside the map it takes nothing."""
    chosen = []
    model = OpticsModel(JobRunner(), Notices())
    model.choose = lambda values, face: chosen.append((values, face))
    model.pick(5, 1.0, 4.3, 0.2)
    model.pick(5, 1.0, 6.5, 0.2)
    assert chosen == [((5, 1.0, 0.5, 0.9), "outer")]


def test_map_holds_each_design_in_its_cell():
    """P is at [spacing, depth]; what was not simulated is NaN."""
    values = np.array([[5, 1.0, 0.5, 0.9], [5, 1.0, 1.0, 0.5], [3, 1.0, 0.5, 0.9]])
    flags = np.zeros(3, bool)
    p = np.array([0.3, 0.7, 1.0])
    sweep = SweepSummary(values, Merit(*[p] * 8), flags, 2, 0, np.array([3, 2, 1]), 1.0, 45, 250)
    grid = sweep.grid(5, 1.0, (0.5, 0.6, 0.7, 0.8, 0.9, 1.0))
    assert grid[4, 0] == 0.3
    assert grid[0, 5] == 0.7
    assert np.isnan(grid).sum() == 34


def test_shipped_sweep_holds_every_design_with_its_figures(tmp_path):
    """Truth: P = Delta / (max(n_sign, 1) RMSE), the ranks by it, the paper's grid; stored again it is the same file."""
    shipped = shipped_sweep()
    m = shipped.merit
    assert len(np.unique(shipped.values, axis=0)) == len(shipped.values) == 648
    assert m.p == pytest.approx(m.delta / (np.maximum(m.n_sign, 1.0) * m.rmse), rel=1e-5)
    assert shipped.ranks[np.argsort(-m.p)].tolist() == sorted(shipped.ranks)
    assert tuple(shipped.values[shipped.paper]) == PAPER_DESIGN
    assert shipped.tied[shipped.best]
    store_sweep(shipped, tmp_path / "again.json")
    again = (tmp_path / "again.json").read_text()
    assert again == SHIPPED.read_text()


@pytest.mark.nightly
def test_shipped_sweep_is_what_a_sweep_gives_now():
    """648 designs in 15 states with the paper's 250 rays."""
    now, shipped = sweep(CAVITIES, 250), shipped_sweep()
    assert now.merit.p == pytest.approx(shipped.merit.p, rel=1e-5)
    assert (now.tied == shipped.tied).all()
    assert (now.rank_text, now.winners) == (shipped.rank_text, shipped.winners)
