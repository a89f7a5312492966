"""Where the monitor's test ends: both sides of each border."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.atlas.alarms import NORMAL
from analysis.atlas.sweep import Outcome
from analysis.shadow.monitoring.cusum import SelfStartingCusum, sight, threshold_for
from analysis.shadow.monitoring.monitor import Alarm
from tests.analysis.atlas.borders import DEGRADED, REFUSED, WORKS, place


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "said"),
    [
        ("alarms-false", 0.0, 3.0, WORKS, ""),  # heavy tails alone do no harm
        ("alarms-false", 0.5, NORMAL, DEGRADED, "if its cycles follow one another"),
        ("alarms-shift", 2.0, 20.0, WORKS, ""),
        ("alarms-shift", 1.0, 20.0, DEGRADED, "not promised to be found"),
        ("alarms-shift", 10.0, 9.0, WORKS, ""),
        ("alarms-shift", 10.0, 8.0, REFUSED, "too short"),
    ],
)
def test_borders_of_the_alarms(name: str, x: float, y: float, outcome: Outcome, said: str) -> None:
    """The stated rate and nine shifts in ten on one side; what cannot be promised is said on the other."""
    place(name, x, y, outcome, said)


def test_sight_sharpens_with_history() -> None:
    """No shift is promised after eight cycles; after more ever smaller ones, never below the reference of one half."""
    h = threshold_for(1000.0, 10)
    seen = [sight(n, h) for n in (8, 9, 20, 100, 100_000)]
    assert seen[0] == np.inf
    assert (np.diff(seen) < 0).all()
    assert 0.5 < seen[-1] < 0.52


def test_correlated_history_is_told_from_an_independent_one() -> None:
    """Before a step of five sd most independent histories are so called, and next to none of correlated ones (0.5)."""
    told = []
    for correlation in (0.0, 0.5):
        rows = np.random.default_rng(8).standard_normal((110, 400))
        for k in range(1, 110):
            rows[k] = correlation * rows[k - 1] + np.sqrt(1 - correlation**2) * rows[k]
        rows[100:] += 5.0
        cusum = SelfStartingCusum(np.full(400, 1e-9))
        for row in rows:
            cusum.update(row)
        told.append(float(cusum.dependent()[:, 0].mean()))
    assert told[0] < 0.45
    assert told[1] > 0.95


def test_an_alarm_says_its_doubt() -> None:
    """In its sentence, and only where there is one."""
    sure = Alarm("leak", "loss", "%/min", 2.0, 3, 9, 5000.0)
    unsure = Alarm("leak", "loss", "%/min", 2.0, 3, 9, 5000.0, (), independent=False)
    assert "follow one another" not in sure.sentence
    assert "once in 5,000 cycles; more often if its cycles follow one another" in unsure.sentence
