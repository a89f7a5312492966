"""Spread within and between runs against the closed form and against a simulation."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.history.between_runs import one_way
from protocol.base.errors import RequestError


def test_within_and_between_runs_by_hand() -> None:
    """Three runs of two values: s_r^2 = 1/2 and s_L^2 = MS_between / n - s_r^2 / n, computed on paper."""
    spread = one_way([np.asarray([0.0, 1.0]), np.asarray([2.0, 3.0]), np.asarray([4.0, 5.0])])
    assert spread.repeatability**2 == pytest.approx(0.5)
    assert spread.between**2 == pytest.approx((8.0 - 0.5) / 2)
    assert spread.reproducibility**2 == pytest.approx(0.5 + 3.75)
    with pytest.raises(RequestError):
        one_way([np.asarray([1.0, 2.0])])


def test_between_run_spread_is_found_again() -> None:
    """200 runs of 5 cycles with s_r = 1 and s_L = 2: both estimated within 12 %."""
    rng = np.random.default_rng(0)
    spread = one_way([rng.normal(rng.normal(0, 2), 1, 5) for _ in range(200)])
    assert spread.repeatability == pytest.approx(1.0, rel=0.12)
    assert spread.between == pytest.approx(2.0, rel=0.12)
