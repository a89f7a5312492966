"""Where the monitor's sequential test breaks down: heavy tails, correlated cycles, small shifts.

Truth: simulated figures, healthy by construction, or with a shift of known size at a known cycle.
"""

from __future__ import annotations

import numpy as np

from analysis.shadow.monitoring.cusum import SelfStartingCusum, smallest_shift, threshold_for
from analysis.shadow.monitoring.monitor import HEALTHY_CYCLES_BETWEEN_ALARMS, NOT_INDEPENDENT
from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult
from protocol.base.arrays import FloatArray

SUMS = 10  # one-sided sums that share the stated rate of false alarms
RUNS, _CYCLES = 800, 250
SHIFTED_RUNS, _AFTER = 200, 300
NORMAL = 1e9  # degrees of freedom of Student's t that make it normal


def healthy(degrees: float, correlation: float, cycles: int, runs: int) -> FloatArray:
    """Return figures of healthy actuators: a first-order autoregression driven by Student's t, sd 1.

    `cycles`, `runs`: shape of the result.
    """
    rng = np.random.default_rng(0)
    if degrees >= NORMAL:
        driven = rng.standard_normal((cycles, runs))
    else:
        driven = rng.standard_t(degrees, (cycles, runs)) / np.sqrt(degrees / (degrees - 2.0))
    found = driven.copy()
    for k in range(1, cycles):
        found[k] = correlation * found[k - 1] + np.sqrt(1.0 - correlation**2) * driven[k]
    return np.asarray(found)


def false_alarms(correlation: float, degrees: float) -> StudyResult:
    """Count false alarms without warning over all sums in 1,000 healthy cycles."""
    threshold = threshold_for(HEALTHY_CYCLES_BETWEEN_ALARMS, SUMS)
    cusum, up = SelfStartingCusum(np.full(RUNS, 1e-9)), np.zeros((RUNS, 2), dtype=bool)
    unwarned, warned = 0, 0
    for row in healthy(degrees, correlation, _CYCLES, RUNS):
        sums = cusum.update(row)
        fresh = (sums > threshold) & ~up
        up = (up | fresh) & (sums > 0)
        dependent = cusum.dependent()
        unwarned += int((fresh & ~dependent).sum())
        warned += int((fresh & dependent).sum())
    per_thousand = 1000.0 * SUMS / 2.0 / (RUNS * _CYCLES)
    return StudyResult(per_thousand * unwarned, NOT_INDEPENDENT if warned > unwarned else "")


def shift(size: float, history: float) -> StudyResult:
    """Return the share of runs without alarm after a lasting shift of `size` sd, `history` healthy cycles before it."""
    threshold, n = threshold_for(HEALTHY_CYCLES_BETWEEN_ALARMS, SUMS), int(history)
    smallest = smallest_shift(n, threshold)
    if not np.isfinite(smallest):
        return StudyResult(float("nan"), "the history is too short to find any shift")
    cusum, found = SelfStartingCusum(np.full(SHIFTED_RUNS, 1e-9)), np.zeros(SHIFTED_RUNS, dtype=bool)
    rows = np.random.default_rng(1).standard_normal((n + _AFTER, SHIFTED_RUNS))
    rows[n:] += size
    for k, row in enumerate(rows):
        found |= (cusum.update(row)[:, 0] > threshold) & (k >= n)
    warning = f"a shift below {smallest:.1f} standard deviations is not promised to be found" if size < smallest else ""
    return StudyResult(float(1.0 - found.mean()), warning)


ALARM_STUDIES = (
    Study(
        "alarms-false", "alarms", "Heavy tails, and correlated cycles", "simulated healthy figures",
        "unqualified false alarms in 1,000 cycles", 2.0,
        Axis("correlation of neighbouring cycles", "", (-0.5, -0.2, 0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9)),
        Axis("degrees of freedom of the tails", "", (2.1, 3.0, 5.0, 10.0, NORMAL), ("2.1", "3", "5", "10", "normal")),
        false_alarms,
    ),
    Study(
        "alarms-shift", "alarms", "Small shifts, short histories", "a shift put in at a known cycle",
        "of the runs without alarm", 0.1,
        Axis("shift, standard deviations", "", (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)),
        Axis("healthy cycles before", "", (0.0, 3.0, 8.0, 9.0, 10.0, 15.0, 20.0, 50.0, 100.0, 300.0)), shift,
    ),
)  # fmt: skip
