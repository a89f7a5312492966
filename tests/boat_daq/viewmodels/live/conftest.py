"""A ring of signals, and the shadow."""

from __future__ import annotations

import pytest

from analysis.shadow.model.frames import Shadow
from tests.boat_daq.gui.recorded_session import filled_ring


@pytest.fixture(scope="module")
def ring():
    """Ten minutes of signals."""
    return filled_ring(600.0)


@pytest.fixture(scope="session")
def model():
    """The shadow."""
    return Shadow()
