"""A ring of signals, and the shadow."""

from __future__ import annotations

import pytest

from boat_daq.workflows.shadow_jobs import shadow_of
from tests.boat_daq.gui.recorded_session import filled_ring


@pytest.fixture(scope="module")
def ring():
    """Ten minutes of signals."""
    return filled_ring(600.0)


@pytest.fixture(scope="session")
def model():
    """The shadow at normal fidelity."""
    return shadow_of()
