"""The self-starting CUSUM: rate of false alarms, thresholds, scores, dependence."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.monitoring.cusum import SelfStartingCusum, cycles_between_alarms, smallest_shift, threshold_for


def test_smallest_shift_falls_with_history() -> None:
    """No shift is stated after eight cycles; after more ever smaller ones, never below the reference of one half."""
    h = threshold_for(1000.0, 10)
    seen = [smallest_shift(n, h) for n in (8, 9, 20, 100, 100_000)]
    assert seen[0] == np.inf
    assert (np.diff(seen) < 0).all()
    assert 0.5 < seen[-1] < 0.52


def test_correlated_history_is_recognised() -> None:
    """Before a step of five sd most independent histories are so called, and next to none of correlated ones (0.5)."""
    found = []
    for correlation in (0.0, 0.5):
        rows = np.random.default_rng(8).standard_normal((110, 400))
        for k in range(1, 110):
            rows[k] = correlation * rows[k - 1] + np.sqrt(1 - correlation**2) * rows[k]
        rows[100:] += 5.0
        cusum = SelfStartingCusum(np.full(400, 1e-9))
        for row in rows:
            cusum.update(row)
        found.append(float(cusum.dependent()[:, 0].mean()))
    assert found[0] < 0.45
    assert found[1] > 0.95


def false_alarms(runs: int, cycles: int, seed: int) -> float:
    """Healthy cycles for each false alarm, over `runs` actuators of which each starts anew after an alarm."""
    watched = np.array([[1, 0], [1, 0], [1, 1], [1, 1], [1, 1], [1, 1]], dtype=bool)
    threshold = threshold_for(1000.0, int(watched.sum()))
    rng, cusum, alarms = np.random.default_rng(seed), SelfStartingCusum(np.full((runs, 6), 1e-12)), 0
    for _ in range(cycles):
        hit = ((cusum.update(rng.standard_normal((runs, 6))) > threshold) & watched).any(axis=(1, 2))
        alarms += int(hit.sum())
        for name in ("count", "mean", "squares", "sums", "length", "shift"):
            getattr(cusum, name)[hit] = 0.0
    return runs * cycles / alarms


def test_one_false_alarm_in_a_thousand_healthy_cycles() -> None:
    """Over all ten one-sided sums together, with the baseline learnt on the way, to the simulation's own error."""
    assert 850.0 < false_alarms(100, 1200, 0) < 1250.0


@pytest.mark.nightly
def test_one_false_alarm_in_a_thousand_healthy_cycles_closely() -> None:
    """The same over two million cycles."""
    assert 950.0 < false_alarms(500, 4000, 1) < 1120.0


def test_threshold_and_interval_are_inverse() -> None:
    """Siegmund's formula and its inverse; h = 5 and k = 1/2 give 938.2 cycles (D. Montgomery's textbook)."""
    assert cycles_between_alarms(5.0) == pytest.approx(938.2, rel=1e-4)
    assert cycles_between_alarms(threshold_for(1000.0, 4)) == pytest.approx(4000.0, rel=1e-6)


def test_scores_are_standard_normal_from_the_start() -> None:
    """Whatever mean and spread the healthy values have, the first sums are those of standard normal scores."""
    values = 7.0 + 3.0 * np.random.default_rng(0).standard_normal((20, 4000))
    cusum, first = SelfStartingCusum(np.full(4000, 1e-12)), np.zeros(4000)
    for row in values[:5]:
        sums = cusum.update(row)
        first = np.maximum(sums[:, 0], sums[:, 1])
    assert (first > 1.5).mean() == pytest.approx(0.065, abs=0.03)
    assert first.max() < 8.0
