"""Where a staircase is no longer found, and where the figures of a sensor lose their meaning: both sides."""

from __future__ import annotations

import pytest

from analysis.atlas.sweep import Outcome
from tests.analysis.atlas.borders import DEGRADED, REFUSED, WORKS, place


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "said"),
    [
        ("segmentation-noise", 0.3, 0.8, WORKS, ""),
        ("segmentation-noise", 0.3, 0.5, REFUSED, "does not fit the plateaus"),
        ("segmentation-noise", 2.0, 2.0, DEGRADED, "the pressure's noise of 2 kPa is 2.2% of its span"),
        ("segmentation-noise", 20.0, 2.0, REFUSED, "plateaus"),
        ("segmentation-alone", 0.3, 0.1, WORKS, ""),
        ("segmentation-alone", 10.0, 0.1, DEGRADED, "the pressure's noise"),
        ("segmentation-lost", 1.0, 10.0, DEGRADED, "samples lost"),
        ("segmentation-lost", 40.0, 100.0, REFUSED, "does not fit the plateaus"),
        ("segmentation-wire", 0.0, 3.0, WORKS, ""),
        ("segmentation-wire", 0.1, 10.0, DEGRADED, "too small to be a cycle"),
        ("segmentation-wire", 1.0, 3.0, REFUSED, "does not fit the plateaus"),
        ("segmentation-small", 20.0, 0.05, WORKS, ""),
        ("segmentation-small", 10.0, 0.05, DEGRADED, "noise alone makes up"),
        ("segmentation-small", 1.0, 1.0, REFUSED, "no complete cycle"),
    ],
)
def test_borders_of_the_segmentation(name: str, x: float, y: float, outcome: Outcome, said: str) -> None:
    """Figures of the formula within 0.5 % FSO on one side; what is wrong with the pressure is said on the other."""
    place(name, x, y, outcome, said)


@pytest.mark.parametrize(
    ("span_mv", "noise_mv", "outcome", "said"),
    [
        (255.0, 1.49, WORKS, ""),
        (0.3, 1.49, DEGRADED, "no more than noise alone makes"),
        (1.0, 1e-9, WORKS, ""),
        (255.0, 0.0, REFUSED, "no noise was found: infinite"),
        (0.0, 0.0, REFUSED, "the signal is flat"),
        (0.0, 1e-9, DEGRADED, "no more than noise alone makes"),
    ],
)
def test_borders_of_the_signal_to_noise_ratio(span_mv: float, noise_mv: float, outcome: Outcome, said: str) -> None:
    """Within a decibel; without noise infinite and without span nothing, both with the reason; rounding is no noise."""
    place("figures-snr", span_mv, noise_mv, outcome, said)


@pytest.mark.parametrize(
    ("read_percent", "bulge_at", "outcome", "said"),
    [
        (100.0, 0.1, WORKS, ""),
        (67.0, 0.1, DEGRADED, "the branches share only"),
        (44.0, 0.5, REFUSED, "share no stretch"),
    ],
)
def test_borders_of_the_hysteresis(read_percent: float, bulge_at: float, outcome: Outcome, said: str) -> None:
    """A loop of 5 % FSO; where branches share a part of the range, a wider loop elsewhere is warned of."""
    place("figures-overlap", read_percent, bulge_at, outcome, said)
