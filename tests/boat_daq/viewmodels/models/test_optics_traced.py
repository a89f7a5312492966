"""Designs traced and swept in a helper process."""

from __future__ import annotations

import numpy as np

from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.models import optics
from boat_daq.viewmodels.models.optics import PAPER_DESIGN, OpticsModel
from boat_daq.workflows.jobs import JobRunner


def test_design_is_traced_in_all_states():
    """Fifteen scenes, one NDR each; the rays of a scene lie between emitter and receiver."""
    found = optics.trace_design(PAPER_DESIGN, 60)
    assert len(found.scenes) == found.ndr.size == 15
    assert np.all((found.ndr >= 0) & (found.ndr <= 350))
    rays = found.scenes[7].released
    assert np.nanmin(rays[:, 0]) >= -1.0
    model = OpticsModel(JobRunner(), Notices())
    model.result = found
    model.state = 0
    assert "state 0 of 14" in model.state_text()
    assert model.scene() is found.scenes[0]


def test_no_more_rays_are_drawn_than_help():
    """The picture holds 250 rays and their secondary rays at most, whatever the number traced."""
    found = optics.trace_design(PAPER_DESIGN, 500)
    assert found.rays == 500 > optics.DRAWN_RAYS
    assert np.all(found.error >= 2 * found.ndr_sd)
    for scene in found.scenes:
        assert np.sum(np.isnan(scene.released[:, 0])) <= optics.DRAWN_RAYS
        assert np.sum(np.isnan(scene.secondary[:, 0])) <= 100
