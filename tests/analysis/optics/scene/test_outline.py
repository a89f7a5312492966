"""Outlines: closed contours of the right area, arcs on their surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.outline import outline
from analysis.optics.scene.parameters import Design


def test_outline_is_two_closed_loops_of_the_right_area(frames: list[SceneFrame]) -> None:
    """Outside less hole is the guides' and stems' area; cavities take away theirs."""
    frame = frames[7]
    area = []
    for design in (Design(cavities=0), Design()):
        contours = outline(frame, design).contours
        assert len(contours) == 2
        area.append(abs(contours[0].area) - abs(contours[1].area))
    assert area[0] - area[1] == pytest.approx(2 * 5 * 1.0 * 0.5, rel=0.02)
    assert area[0] == pytest.approx(2 * 2 * frame.guide(0).length + 2 * 6.1, rel=0.04)


def test_arc_points_lie_on_their_surfaces(frames: list[SceneFrame]) -> None:
    """Every arc's middle keeps the guide's half thickness or its cavity's floor from the centreline."""
    from analysis.optics.scene.frame import offset_of

    frame = frames[3]
    for contour in outline(frame, Design()).contours:
        middles = contour.middles[~np.isnan(contour.middles[:, 0])]
        near = np.minimum(*(np.abs(offset_of(frame.guide(g), middles)[0]) for g in (0, 1)))
        assert np.all(np.isclose(near, 1.0, atol=1e-9) | np.isclose(near, 0.5, atol=1e-9))
