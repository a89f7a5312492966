"""The geometry of one scene, which Python computes, is that of a sweep, which is compiled."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves, frame_of
from analysis.optics.scene.parameters import Design, Face, Light, Waveguide
from analysis.optics.sweep.sweep import SweepRequest, run_sweep
from analysis.optics.tracer.simulation import trace
from tests.conftest import mostly_at_night


@pytest.mark.parametrize("face", mostly_at_night("both", "outer", "inner", "midline"))
def test_a_trace_has_the_bits_of_a_sweep(face: Face) -> None:
    """Counts, energies and errors of 15 states are equal, not close."""
    design, guide, light = Design(7, 0.7, 0.6, 0.9, face), Waveguide(), Light(rays=100, secondary=40)
    swept = run_sweep(SweepRequest((design,), guide, light, default_curves()))
    for state in range(15):
        traced = trace(frame_of(default_curves(), state, guide), design, guide, light)
        assert traced.ndr == swept.ndr[0, state]
        assert traced.power == swept.power[0, state]
        assert traced.power_sd == swept.power_sd[0, state]
        assert np.isfinite(traced.ndr_sd)
