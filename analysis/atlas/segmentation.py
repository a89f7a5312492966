"""Where a staircase is no longer found in its pressure: noise, short holds, lost samples, a loose wire, small steps."""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.arrays import BoolArray
from analysis.atlas.runs import Stairs, compared_with_truth
from analysis.atlas.sweep import Axis, Study, StudyResult

TRUTH = "full scale, sensitivity and hysteresis of the formula that made the run"
TOLERANCE = 0.5
"""% FSO; a tenth of the hysteresis that is measured."""


def noisy(noise_kpa: float, dwell_s: float, *, readings: bool) -> StudyResult:
    """Analyse white noise on the pressure, holds of a given length."""
    return compared_with_truth(Stairs(pressure_noise_kpa=noise_kpa, dwell_s=dwell_s), readings=readings)


def lost(share_percent: float, length: float) -> StudyResult:
    """Analyse a run with lost samples, `share_percent` of it in holes of `length` samples."""
    run = Stairs()
    rows = np.arange(run.trace[0].size)
    return compared_with_truth(run, run.recording(rows[~_holes(rows.size, share_percent, length)]))


def loose_wire(share_percent: float, length: float) -> StudyResult:
    """Analyse a pressure sensor that reads zero for `length` samples at a time."""
    run = Stairs()
    time, pressure, _ = run.columns
    pressure[_holes(time.size, share_percent, length)] = 0.0
    return compared_with_truth(run)


def small(span_kpa: float, noise_kpa: float) -> StudyResult:
    """Analyse a staircase of ten levels over a small span of pressure."""
    return compared_with_truth(Stairs(span_kpa=span_kpa, pressure_noise_kpa=noise_kpa), readings=False)


def _holes(samples: int, share_percent: float, length: float) -> BoolArray:
    """Mark holes of `length` samples at random places, `share_percent` of all samples, one at least."""
    rng, found = np.random.default_rng(5), np.zeros(samples, dtype=bool)
    count = max(round(share_percent / 100.0 * samples / length), int(share_percent > 0))
    for first in rng.integers(0, samples - int(length), count):
        found[first : first + int(length)] = True
    return found


_NOISE = Axis("noise of the pressure, sd", "kPa", (0.0, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0))
_DWELL = Axis("length of a hold", "s", (0.1, 0.2, 0.3, 0.5, 0.8, 1.0, 1.5, 2.0, 5.0))
_HOLES = Axis("samples in a hole", "", (1.0, 3.0, 10.0, 30.0, 100.0, 300.0))
STUDIES = (
    Study(
        "segmentation-noise", "segmentation", "Noise and short holds, with readings", TRUTH, "% FSO", TOLERANCE,
        _NOISE, _DWELL, partial(noisy, readings=True),
    ),
    Study(
        "segmentation-alone", "segmentation", "Noise and short holds, no readings", TRUTH, "% FSO", TOLERANCE,
        _NOISE, _DWELL, partial(noisy, readings=False),
    ),
    Study(
        "segmentation-lost", "segmentation", "Lost samples", TRUTH, "% FSO", TOLERANCE,
        Axis("samples lost", "%", (0.0, 0.1, 1.0, 5.0, 10.0, 20.0, 40.0, 70.0)), _HOLES, lost,
    ),
    Study(
        "segmentation-wire", "segmentation", "A loose wire: pressure reads zero", TRUTH, "% FSO", TOLERANCE,
        Axis("samples at zero", "%", (0.0, 0.1, 1.0, 3.0, 5.0, 10.0, 20.0, 40.0)), _HOLES, loose_wire,
    ),
    Study(
        "segmentation-small", "segmentation", "Small steps of pressure, no readings", TRUTH, "% FSO", 1.0,
        Axis("span of ten levels", "kPa", (90.0, 60.0, 40.0, 30.0, 20.0, 15.0, 10.0, 5.0, 2.0, 1.0, 0.5)),
        Axis("noise of the pressure, sd", "kPa", (0.0, 0.05, 0.2, 0.5, 1.0, 2.0)), small,
    ),
)  # fmt: skip
