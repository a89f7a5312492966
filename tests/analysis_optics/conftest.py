"""What the optical tests share: the default states and the paper's design."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.curves import default_curves, frames_of
from analysis.optics.frame import Frame
from analysis.optics.parameters import Waveguide


@pytest.fixture(scope="session")
def curves() -> np.ndarray:
    """The 15 default states."""
    return default_curves()


@pytest.fixture(scope="session")
def frames(curves: np.ndarray) -> list[Frame]:
    """Their frames with the default guide."""
    return frames_of(curves, Waveguide())
