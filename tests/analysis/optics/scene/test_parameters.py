"""Parameters of a simulation check themselves."""

from __future__ import annotations

import pytest

from analysis.optics.scene.parameters import ALL, Design, Light, Waveguide
from protocol.base.errors import RequestError


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"spacing_mm": 0.0}, "overlap"),
        ({"spacing_mm": -0.2}, "overlap"),
        ({"width_mm": 0.0}, "width"),
        ({"width_mm": float("nan")}, "not a number"),
        ({"depth_mm": -1.0}, "depth"),
        ({"cavities": -1}, "cavities"),
        ({"face": "top"}, "face"),
    ],
)
def test_parameters_outside_their_range_are_refused(change: dict[str, object], word: str) -> None:
    """Each parameter is refused by its name, with a remedy."""
    with pytest.raises(RequestError, match=word) as refused:
        Design(**change)  # type: ignore[arg-type]
    assert refused.value.remedy


@pytest.mark.parametrize(
    "bad",
    [
        lambda: Waveguide(index=0.9),
        lambda: Waveguide(thickness_mm=0.0),
        lambda: Waveguide(attenuation_db_per_cm=-1),
        lambda: Waveguide(receiver_mm=-1),
        lambda: Waveguide(knots=3),
        lambda: Light(rays=0),
        lambda: Light(cone_deg=180.0),
        lambda: Light(order="colour"),
        lambda: Light(emission="laser"),
        lambda: Light(secondary=-2),  # type: ignore[arg-type]
        lambda: Light(path_cap_mm=float("inf")),
        lambda: Light(secondary=ALL, faintest=0.0),  # it would never end
    ],
)
def test_unphysical_guide_and_light_are_refused(bad: object) -> None:
    """Unphysical guides and lights never come to be."""
    with pytest.raises(RequestError) as refused:
        bad()  # type: ignore[operator]
    assert refused.value.remedy


def test_one_cavity_needs_no_spacing() -> None:
    """With a single cavity there is no neighbour to overlap."""
    assert Design(1, 1.0, 0.5, 0.0).row_mm == 1.0


def test_proportional_are_the_same_model() -> None:
    """The budget of secondaries grows with the rays."""
    assert Light().with_rays(25_000).secondary == 10_000
