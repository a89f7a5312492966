"""Calibration sessions as tables of readings, with a truth in closed form: +50 to -40 kPa and back, read on a grid."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import Polynomial, chebyshev

from analysis import fit_calibration
from analysis.calibration.fit import Calibration, fit_by_branch
from analysis.calibration.joint_fit import JointFit, PolynomialBasis, joint_fit, position_means
from tests.analysis.boat_builder import PAPER

LOW, HIGH = -2.7, 3.8
MIDDLE, HALF = (LOW + HIGH) / 2, (HIGH - LOW) / 2
MEAN_NOISE_MV = 0.15  # of a plateau's mean signal
GRIDS = ((0.02, 0.005), (0.1, 0.03), (0.5, 0.15))
CUBIC = Polynomial(PAPER[0])


def scaled(x: np.ndarray) -> np.ndarray:
    """Map the range to -1..1."""
    return (np.asarray(x, float) - MIDDLE) / HALF


def _quintic(x: np.ndarray) -> np.ndarray:
    return 1650 + 125 * (0.1 * scaled(x) + 0.9 * scaled(x) ** 5)


def _dead_zone(x: np.ndarray) -> np.ndarray:
    away = np.asarray(x, float) - 0.5
    return 1650 + 46 * np.sign(away) * np.maximum(np.abs(away) - 0.8, 0.0)


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 1650 + 125 * np.tanh(2.0 * scaled(x)) / np.tanh(2.0)


def _wavy(x: np.ndarray) -> np.ndarray:
    return CUBIC(x) + 3.0 * chebyshev.chebval(scaled(x), [0, 0, 0, 0, 0, 1])


TRUTHS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "cubic": CUBIC, "quintic": _quintic, "dead zone": _dead_zone, "sigmoid": _sigmoid, "cubic + T5": _wavy,
}  # fmt: skip


@dataclass(frozen=True)
class Session:
    """Readings of one calibration: of every plateau x, y, position and branch; the shift of its range."""

    x: np.ndarray
    y: np.ndarray
    position: np.ndarray
    branch: np.ndarray
    shift_mm: float
    grid_mm: float

    @property
    def reading_sd(self) -> float:
        """Of one reading within the grid."""
        return self.grid_mm / np.sqrt(12.0)

    def fit(self, degree: int | Literal["spline"] = 3) -> Calibration:
        """Return the joint fit."""
        return fit_by_branch(
            self.x, self.y, degree, positions=self.position, branch=self.branch, reading_sd=self.reading_sd
        )

    def joint(self) -> JointFit:
        """Return the cubic of `fit` without its verdict, which takes seven fits more."""
        plain = self.plain_fit().with_reading(self.reading_sd, self.position)
        means = position_means(plain.fit, plain.x, plain.y, self.position, self.branch, plain.reading)
        return joint_fit(means, PolynomialBasis(3))

    def plain_fit(self) -> Calibration:
        """Return the fit through points."""
        return fit_calibration(self.x, self.y)

    @property
    def grid_of_x(self) -> np.ndarray:
        """Points of the range."""
        return MIDDLE + self.shift_mm + HALF * np.linspace(-0.98, 0.98, 99)


def session(
    truth: Callable[[np.ndarray], np.ndarray], grid_mm: float = 0.02, scatter_mm: float = 0.005, *, seed: int = 0,
    loop_mv: float = 0.0, cycles: int = 5, actuator_mm: float = 0.25, offset_mv: float = 0.0,
) -> Session:  # fmt: skip
    """Return a session of `cycles`: the actuator's loop is a parabola in pressure, the sensor's one in x."""
    rng = np.random.default_rng((seed, round(1e4 * grid_mm), round(1e4 * scatter_mm)))
    down, up = np.arange(8, -1, -1), np.arange(1, 10)
    level = np.concatenate([[9], *[np.concatenate([down, up])] * cycles])
    loading = np.concatenate([[0], *[np.repeat([-1, 1], 9)] * cycles])
    branch = np.where((level == 0) | (level == 9), 0, loading)
    shift = float(rng.uniform(-0.5, 0.5)) * max(grid_mm, 0.05)
    share = level / 9.0
    x = LOW + shift + (HIGH - LOW) * share - 2.0 * share * (1.0 - share) * actuator_mm * branch
    bow = 0.5 * branch * loop_mv * (1.0 - scaled(x - shift) ** 2)
    y = truth(x) + bow + offset_mv + MEAN_NOISE_MV * rng.standard_normal(x.size)
    read = x + scatter_mm * rng.standard_normal(x.size)
    read = np.round(read / grid_mm) * grid_mm if grid_mm > 0 else read
    return Session(read, y, 2 * level + (branch > 0), branch, shift, grid_mm)


def sessions(
    count: int, truth: Callable[[np.ndarray], np.ndarray] = CUBIC, *args: float, **options: float
) -> Iterator[Session]:
    """Yield sessions that differ by their seeds."""
    for seed in range(count):
        yield session(truth, *args, seed=seed, **options)
