"""U holds for sound sensors and for faults that it knows, and is refused or marked for others."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import mostly_at_night
from tests.verification.uncertainty_coverage import LOW, Row, outcome


@pytest.mark.parametrize(
    "kind", mostly_at_night("one cycle and creep", "lost sensor and one branch", "one branch and creep")
)
def test_one_cycle_and_one_branch_have_no_u(kind: str) -> None:
    """Refused, where the readings would be far less often within what is known, whatever else is wrong."""
    assert np.isnan(outcome(kind, 0).within)


@pytest.mark.parametrize(
    "kind",
    mostly_at_night(
        "lost sensor and drift", "lost sensor and growing noise", "drift and growing noise", "quintic and drift",
        "dead zone and growing noise", "dead zone and lost sensor", "drift and creep",
    ),
)  # fmt: skip
def test_two_faults_at_once_leave_a_u_that_holds(kind: str) -> None:
    """Of each of two sensors at least nine tenths of the new readings are within U."""
    assert min(outcome(kind, seed).within for seed in range(2)) > 0.9


def test_a_row_holds_if_u_does_or_all_are_told() -> None:
    """The rule of the table."""
    assert Row("a", 4, 0, 0, 0.95, 0.01).holds
    assert Row("a", 4, 4, 0, float("nan"), float("nan")).holds
    assert Row("a", 4, 0, 4, 0.5, 0.01).holds
    assert not Row("a", 4, 2, 0, LOW - 0.01, 0.01).holds
