"""Where the posterior ends: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.studies.failure_maps.sweep import CellOutcome
from tests.analysis.studies.failure_maps.borders import REFUSES, WARNS, WORKS, check_point


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "message"),
    [
        ("posterior-start", 10.0, 400.0, WORKS, ""),
        ("posterior-start", 1e3, 100.0, WARNS, "not converged"),
        ("posterior-start", 1.0, 20.0, WARNS, "not converged"),
        pytest.param("posterior-reading", 0.02, 50.0, WORKS, "", marks=pytest.mark.nightly),
        pytest.param("posterior-reading", 0.7, 1.49, WORKS, "", marks=pytest.mark.nightly),
        ("posterior-reading", 0.0, 1e-6, WORKS, ""),
        ("posterior-reading", 0.0, 0.0, REFUSES, "no noise to sample"),
    ],
)
def test_borders_of_the_posterior(name: str, x: float, y: float, outcome: CellOutcome, message: str) -> None:
    """Student's t and the true curve on one side; a warning on the other."""
    check_point(name, x, y, outcome, message)
