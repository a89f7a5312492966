"""What the optical tests share: the parametric states and their frames."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.curves import frames_of, parametric_curves
from analysis.optics.scene.frame import Frame
from analysis.optics.scene.parameters import Waveguide


@pytest.fixture(scope="session")
def curves() -> np.ndarray:
    """The 15 states of the parametric set, whose lengths are known."""
    return parametric_curves()


@pytest.fixture(scope="session")
def frames(curves: np.ndarray) -> list[Frame]:
    """Their frames with the default guide."""
    return frames_of(curves, Waveguide())
