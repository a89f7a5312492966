"""An elongation from clicks on a picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.viewmodels.live.photograph import Photograph


@given(st.floats(0, 2 * math.pi), st.floats(2.0, 40.0), st.floats(-5.0, 5.0), st.floats(-200.0, 200.0))
def test_rotated_and_scaled_picture_gives_the_same_elongation(angle, pixels_per_mm, mm, shift):
    """Turning, scaling and shifting the camera changes nothing; a sideways miss of the tip does not count."""
    along = np.array([math.cos(angle), math.sin(angle)]) * pixels_per_mm
    across = np.array([-along[1], along[0]])
    place = np.array([shift, -shift])
    photo = Photograph(distance_mm=10.0)
    for spot in (0 * along, 10 * along, 60 * along, (60 + mm) * along + 0.7 * across):
        photo = photo.click(*(place + spot))
    assert photo.elongation_mm == pytest.approx(mm, abs=1e-9)
    assert photo.resolution_mm > math.sqrt(24) * photo.click_px / pixels_per_mm * 0.999


def test_clicks_are_undone_and_the_scale_stays():
    """A fifth click corrects the tip; the next picture keeps scale and rest; two clicks on one spot give no scale."""
    photo = Photograph().click(0, 0).click(100, 0).click(50, 0).click(60, 0).click(70, 0)
    assert photo.elongation_mm == pytest.approx(2.0)
    assert photo.next_picture().clicks == photo.clicks[:3]
    assert photo.back().elongation_mm is None
    assert Photograph().click(5, 5).click(5, 5).mm_per_pixel is None
    with pytest.raises(ValueError, match="0"):
        photo.with_distance(0.0)
