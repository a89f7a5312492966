"""A small sweep: six designs, counts of cavities and faces mixed."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, paper_grid, run_sweep


@pytest.fixture(scope="session")
def small_request() -> SweepRequest:
    """Return the sweep to be made."""
    designs = (PAPER_OPTIMUM, *paper_grid((3,))[::60], Design(7, 0.7, 0.6, 0.8, "inner"))
    return SweepRequest(designs, light=Light(rays=100))


@pytest.fixture(scope="session")
def small_result(small_request: SweepRequest) -> SweepResult:
    """Return its result."""
    return run_sweep(small_request)


def same(a: SweepResult, b: SweepResult) -> bool:
    """Return whether every number of two results is the same, to the last bit."""
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("ndr", "ndr_sd", "power", "power_sd", "counts", "energy")
    )
