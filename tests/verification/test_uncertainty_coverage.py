"""U holds for sound sensors and for faults that it knows, and is refused or marked for others."""

from __future__ import annotations

import numpy as np
import pytest

from tests.verification.uncertainty_coverage import KINDS, LOW, Row, outcome, table


def test_one_cycle_and_one_branch_have_no_u() -> None:
    """Refused, where the readings of a sound sensor would be far less often within what is known."""
    assert np.isnan([outcome(kind, 0).within for kind in ("one cycle", "one branch")]).all()


def test_a_row_holds_if_u_does_or_all_are_told() -> None:
    """The rule of the table."""
    assert Row("a", 4, 0, 0, 0.95, 0.01).holds
    assert Row("a", 4, 4, 0, float("nan"), float("nan")).holds
    assert Row("a", 4, 0, 4, 0.5, 0.01).holds
    assert not Row("a", 4, 2, 0, LOW - 0.01, 0.01).holds


@pytest.mark.nightly
def test_u_holds_or_is_refused_or_marked() -> None:
    """40 sensors of each of nine kinds."""
    assert [row.kind for row in table(40) if not row.holds] == []
    assert len(KINDS) == 9
