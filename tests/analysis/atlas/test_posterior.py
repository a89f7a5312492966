"""Where the posterior ends: both sides of each border."""

from __future__ import annotations

import pytest

from analysis.atlas.sweep import Outcome
from tests.analysis.atlas.borders import DEGRADED, REFUSED, WORKS, place


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "said"),
    [
        ("posterior-start", 10.0, 400.0, WORKS, ""),
        ("posterior-start", 1e3, 100.0, DEGRADED, "not converged"),
        ("posterior-start", 1.0, 20.0, DEGRADED, "not converged"),
        ("posterior-reading", 0.02, 50.0, WORKS, ""),
        ("posterior-reading", 0.7, 1.49, WORKS, ""),
        ("posterior-reading", 0.0, 1e-6, WORKS, ""),
        ("posterior-reading", 0.0, 0.0, REFUSED, "no noise to sample"),
    ],
)
def test_borders_of_the_posterior(name: str, x: float, y: float, outcome: Outcome, said: str) -> None:
    """Student's t and the true curve on one side; "not converged" is said on the other."""
    place(name, x, y, outcome, said)
