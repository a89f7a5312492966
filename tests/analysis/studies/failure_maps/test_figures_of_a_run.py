"""Where the figures of a sensor lose their meaning: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("span_mv", "noise_mv", "outcome", "message"),
    [
        pytest.param(255.0, 1.49, WORKS, "", marks=pytest.mark.nightly),
        pytest.param(0.3, 1.49, WARNS, "no more than noise alone makes", marks=pytest.mark.nightly),
        (1.0, 1e-9, WORKS, ""),
        (255.0, 0.0, REFUSES, "no noise was found: infinite"),
        pytest.param(0.0, 0.0, REFUSES, "the signal is flat", marks=pytest.mark.nightly),
        (0.0, 1e-9, WARNS, "no more than noise alone makes"),
    ],
)
def test_borders_of_the_signal_to_noise_ratio(
    span_mv: float, noise_mv: float, outcome: CellOutcome, message: str
) -> None:
    """Within a decibel; without noise infinite and without span nothing, both with the reason; rounding is no noise."""
    check_point("figures-snr", span_mv, noise_mv, outcome, message)


@pytest.mark.parametrize(
    ("read_percent", "bulge_at", "outcome", "message"),
    [
        (100.0, 0.1, WORKS, ""),
        pytest.param(67.0, 0.1, WARNS, "the branches share only", marks=pytest.mark.nightly),
        (44.0, 0.5, REFUSES, "share no stretch"),
    ],
)
def test_borders_of_the_hysteresis(read_percent: float, bulge_at: float, outcome: CellOutcome, message: str) -> None:
    """A loop of 5 % FSO; where branches share a part of the range, a wider loop elsewhere is warned of."""
    check_point("figures-overlap", read_percent, bulge_at, outcome, message)
