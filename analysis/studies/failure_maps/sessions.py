"""Where a calibration session breaks down: curves that are no cubic, and loops, read on ever coarser grids.

A session is a table of readings: ten levels, two branches, five cycles. Its truth is the paper's cubic with a term of
Chebyshev's T5 added, or with a parabolic loop of known width.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.fit import Calibration, fit_by_branch
from analysis.calibration.joint_fit import greatest_loop_width, loop_is_represented
from analysis.published import RANGE_MM
from analysis.studies.failure_maps.fit import SENSOR_NOISE_MV, cubic
from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult, joined
from protocol.base.arrays import FloatArray

SEEDS = 12
_LEVELS, _CYCLES = 10, 5
SAMPLES_PER_HOLD = 100
READER_SHARE = 0.3  # of the grid: sd of a reader who finds the mark to a third
ACTUATOR_MM = 0.25


@dataclass(frozen=True)
class ReadSession:
    """Readings of every plateau: a sensor that deviates by `wave_mv` T5 from the cubic, with a loop of `loop_mv`.

    Of each of the `levels` of every branch in each of the `cycles`; in the middle the actuator's own loop is
    `actuator_mm` wide.
    """

    grid_mm: float
    wave_mv: float = 0.0
    loop_mv: float = 0.0
    seed: int = 0
    levels: int = _LEVELS
    cycles: int = _CYCLES
    noise_mv: float = SENSOR_NOISE_MV
    actuator_mm: float = ACTUATOR_MM

    def signal(self, x: FloatArray) -> FloatArray:
        """Return the true curve, the middle between the branches."""
        return cubic(x) + self.wave_mv * chebyshev.chebval(_scaled(x), [0.0, 0.0, 0.0, 0.0, 0.0, 1.0])

    def calibration(self) -> Calibration:
        rng = np.random.default_rng(self.seed)
        down, up = np.arange(self.levels - 2, -1, -1), np.arange(1, self.levels)
        level = np.concatenate([[self.levels - 1], *[down, up] * self.cycles])
        way = np.concatenate([[0], *[np.repeat([-1, 1], self.levels - 1)] * self.cycles])
        branch = np.where((level == 0) | (level == self.levels - 1), 0, way)
        share = level / (self.levels - 1.0)
        loop = 2.0 * share * (1.0 - share) * self.actuator_mm * branch
        x = RANGE_MM[0] + (RANGE_MM[1] - RANGE_MM[0]) * share - loop
        x = x + self.grid_mm * float(rng.uniform(-0.5, 0.5))
        y = self.signal(x) + 0.5 * branch * self.loop_mv * (1.0 - _scaled(x) ** 2)
        y = y + self.noise_mv / np.sqrt(SAMPLES_PER_HOLD) * rng.standard_normal(x.size)
        if self.grid_mm > 0:
            x = np.round((x + READER_SHARE * self.grid_mm * rng.standard_normal(x.size)) / self.grid_mm) * self.grid_mm
        sd = self.grid_mm / np.sqrt(12.0)
        return fit_by_branch(x, y, positions=2 * level + (branch > 0), branch=branch, reading_sd=sd)


def _scaled(x: FloatArray) -> FloatArray:
    return np.asarray((2.0 * x - sum(RANGE_MM)) / (RANGE_MM[1] - RANGE_MM[0]))


def not_a_cubic(wave_mv: float, grid_mm: float) -> StudyResult:
    """Return the share of the range in which the truth lies outside U of the cubic; the message of most sessions."""
    outside, messages = [], []
    for seed in range(SEEDS):
        run = ReadSession(grid_mm, wave_mv, seed=seed)
        fit = run.calibration()
        at = np.linspace(*fit.x_range, 61)
        outside.append(np.mean(np.abs(fit.predict(at) - run.signal(at)) > fit.expanded_u(at)))
        verdict = fit.adequacy
        messages.append("" if verdict is None or verdict.verdict is CurveVerdict.ADEQUATE else verdict.sentence)
    warned = sorted(messages)[SEEDS // 2]
    return StudyResult(float(np.mean(outside)), joined([warned]))


def loop(loop_mv: float, grid_mm: float) -> StudyResult:
    """Return the share of sessions whose interval of the loop's width does not hold the width put in."""
    missed, messages = [], []
    for seed in range(SEEDS):
        joint = ReadSession(grid_mm, loop_mv=loop_mv, seed=seed).calibration().joint
        if joint is None or not loop_is_represented(joint):
            messages.append("the loop is read from the points")
            continue
        found = greatest_loop_width(joint, np.random.default_rng(seed))
        missed.append(not found.low <= loop_mv <= found.high)
    most = sorted(messages)[0] if 2 * len(messages) > SEEDS else ""
    return StudyResult(float(np.mean(missed)) if missed else float("nan"), joined([most]))


_GRIDS = Axis("grid of the readings", "mm", (0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0))
SESSION_STUDIES = (
    Study(
        "fit-adequacy", "fit", "A cubic through what is no cubic", "the curve that the readings were made from",
        "share of the range outside U", 0.15,
        Axis("amplitude of T5 beside the cubic", "mV", (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)), _GRIDS, not_a_cubic,
    ),
    Study(
        "fit-loop", "fit", "The loop of a sensor", "the width of the loop put in", "share of intervals missing it", 0.2,
        Axis("width of the loop", "mV", (0.0, 0.3, 1.0, 3.0, 10.0, 30.0)), _GRIDS, loop,
    ),
)  # fmt: skip
