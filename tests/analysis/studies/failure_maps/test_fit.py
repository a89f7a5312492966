"""Where the polynomial fit and the inverse break down: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "message"),
    [
        ("fit-clusters", 1e-7, 3, WORKS, ""),
        ("fit-clusters", 1e-3, 5, WORKS, ""),
        ("fit-clusters", 1e-4, 5, REFUSES, "clustered"),
        ("fit-clusters", 0.1, 7, WORKS, ""),
        ("fit-clusters", 1e-3, 7, REFUSES, "clustered"),
        ("fit-offset", 1e3, 3, WORKS, ""),
        ("fit-offset", 1e4, 3, WARNS, "fit x - 1"),
        ("fit-offset", 1e9, 1, WORKS, ""),
        ("fit-offset", 1e9, 2, WARNS, "fit x - 1"),
        ("fit-few-points", 3, 3, REFUSES, "only 3 different positions; degree 3 needs 4"),
        ("fit-few-points", 4, 3, WARNS, "no uncertainty"),
        ("fit-few-points", 8, 3, WARNS, "alone determines the curve"),
        ("fit-few-points", 10, 3, WORKS, ""),
        ("fit-few-points", 10, 10, REFUSES, "only 10 different positions; degree 10 needs 11"),
        ("fit-outlier", 4, 20, WORKS, ""),
        ("fit-outlier", 10, 20, WARNS, "off the curve"),
        ("fit-outlier", 1000, 8, WARNS, "it alone determines"),
    ],
)
def test_borders_of_the_fit(name: str, x: float, y: float, outcome: CellOutcome, message: str) -> None:
    """Right to its tolerance on one side; a warning or a refusal with its reason on the other."""
    check_point(name, x, y, outcome, message)


@pytest.mark.parametrize(
    ("gap_mm", "where", "outcome", "message"),
    [
        (0.7, 0.95, WORKS, ""),
        (0.1, 0.95, WARNS, "the curve turns at"),
        (-0.1, 0.5, REFUSES, "no inverse"),
        (1.0, 0.1, WORKS, ""),
        (1.0, -0.03, REFUSES, "outside"),
        (1.0, 1.1, REFUSES, "outside"),
        (0.3, 1.1, WARNS, "is read as one inside"),
    ],
)
def test_borders_of_the_inverse(gap_mm: float, where: float, outcome: CellOutcome, message: str) -> None:
    """Towards the turning point, past it, and on both sides of the calibrated range."""
    check_point("inverse-turning", gap_mm, where, outcome, message)
