"""Where the monitor's sequential test breaks down: heavy tails, cycles that follow one another, small shifts.

Truth: simulated figures, healthy by construction, or with a shift of known size at a known cycle.
"""

from __future__ import annotations

import numpy as np

from analysis.arrays import FloatArray
from analysis.atlas.sweep import Answer, Axis, Study
from analysis.shadow.monitoring.cusum import SelfStartingCusum, sight, threshold_for
from analysis.shadow.monitoring.monitor import HEALTHY_CYCLES_BETWEEN_ALARMS, NOT_INDEPENDENT

SUMS = 10
"""One-sided sums that share the stated rate of false alarms."""
RUNS, CYCLES = 800, 250
SHIFTED_RUNS, AFTER = 200, 300
NORMAL = 1e9
"""Degrees of freedom of Student's t that are as good as none."""


def healthy(degrees: float, correlation: float, cycles: int, runs: int) -> FloatArray:
    """Figures of healthy actuators, (cycles, runs): a first-order autoregression driven by Student's t, sd 1."""
    rng = np.random.default_rng(0)
    if degrees >= NORMAL:
        driven = rng.standard_normal((cycles, runs))
    else:
        driven = rng.standard_t(degrees, (cycles, runs)) / np.sqrt(degrees / (degrees - 2.0))
    found = driven.copy()
    for k in range(1, cycles):
        found[k] = correlation * found[k - 1] + np.sqrt(1.0 - correlation**2) * driven[k]
    return np.asarray(found)


def false_alarms(correlation: float, degrees: float) -> Answer:
    """False alarms over all sums in 1,000 healthy cycles, counted where nothing was said against them."""
    threshold = threshold_for(HEALTHY_CYCLES_BETWEEN_ALARMS, SUMS)
    cusum, up = SelfStartingCusum(np.full(RUNS, 1e-9)), np.zeros((RUNS, 2), dtype=bool)
    silent, doubted = 0, 0
    for row in healthy(degrees, correlation, CYCLES, RUNS):
        sums = cusum.update(row)
        fresh = (sums > threshold) & ~up
        up = (up | fresh) & (sums > 0)
        doubt = cusum.dependent()
        silent += int((fresh & ~doubt).sum())
        doubted += int((fresh & doubt).sum())
    per_thousand = 1000.0 * SUMS / 2.0 / (RUNS * CYCLES)
    return Answer(per_thousand * silent, NOT_INDEPENDENT if doubted > silent else "")


def shift(size: float, history: float) -> Answer:
    """A lasting shift of `size` standard deviations after `history` healthy cycles: the share of runs without alarm."""
    threshold, n = threshold_for(HEALTHY_CYCLES_BETWEEN_ALARMS, SUMS), int(history)
    smallest = sight(n, threshold)
    if not np.isfinite(smallest):
        return Answer(float("nan"), "the history is too short to find any shift")
    cusum, found = SelfStartingCusum(np.full(SHIFTED_RUNS, 1e-9)), np.zeros(SHIFTED_RUNS, dtype=bool)
    rows = np.random.default_rng(1).standard_normal((n + AFTER, SHIFTED_RUNS))
    rows[n:] += size
    for k, row in enumerate(rows):
        sums = cusum.update(row)
        found |= (sums[:, 0] > threshold) & (k >= n)
    said = f"a shift below {smallest:.1f} standard deviations is not promised to be found" if size < smallest else ""
    return Answer(float(1.0 - found.mean()), said)


STUDIES = (
    Study(
        "alarms-false", "alarms", "Heavy tails, and cycles that follow one another", "simulated healthy figures",
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
