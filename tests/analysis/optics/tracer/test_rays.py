"""What of a fan is followed: half of it where the other half is its mirror image, with the same result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.optics.scene.curves import default_curves, frame_of, parametric_curves
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import FACES, Design, Light, Waveguide, light_by
from analysis.optics.sweep.sweep import common_of, run_item
from analysis.optics.tracer.rays import share_of

LIGHTS = [
    Light(rays=60, secondary=24),
    Light(rays=60, secondary=0, order="bounce"),
    replace(light_by("power", 250), rays=60),
    Light(rays=10_000, secondary=0),
]


@pytest.mark.parametrize("light", LIGHTS, ids=["budget", "no secondaries", "power", "blocks"])
def test_half_of_a_mirrored_fan_gives_the_result_of_the_whole(light: Light) -> None:
    """Ledgers and hits are the same; powers, and changes along the fan, but for the last digits."""
    some = 1 if light.rays > 1_000 else len(FACES)
    patterns = np.array([pattern_of(Design(5, 1.0, 0.5, 0.9, face)) for face in FACES[:some]])
    for curves in (default_curves(), parametric_curves()):
        frames = [frame_of(curves, state, Waveguide()) for state in ((7,) if some == 1 else (0, 9))]
        stacked, rules, fan, shares = common_of(frames, Waveguide(), light)
        assert np.all(2 * shares[:, 0] == light.rays)
        whole = np.array([(light.rays, light.secondary)] * len(frames))
        half, full = (run_item((stacked, rules, fan, each), patterns) for each in (shares, whole))
        np.testing.assert_array_equal(half[0], full[0])
        np.testing.assert_allclose(half[1], full[1], rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(half[2], full[2], rtol=1e-9)


def test_the_whole_fan_is_followed_where_its_halves_differ() -> None:
    """A turned or odd fan, guides that are not mirror images, and a budget that may accept one of two images."""
    frame = frame_of(default_curves(), 7, Waveguide())
    assert share_of(frame, Light()) == (125, 50)
    assert share_of(frame, light_by("power", 250)) == (125, -1)
    for light in (Light(phase=0.25), Light(rays=251), Light(secondary=99), Light(order="bounce"), Light(order="index")):
        assert share_of(frame, light) == (light.rays, light.secondary)
    curves = default_curves()
    curves[7, 1, 3, 0] += 1e-9
    assert share_of(frame_of(curves, 7, Waveguide()), Light()) == (250, 100)
