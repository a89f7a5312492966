"""Monotone cubic splines: integrated B-splines with coefficients of one sign.

Source: J. O. Ramsay, Monotone regression splines in action, Statistical Science 3 (1988) 425.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import BSpline

from protocol.base.arrays import BoolArray, FloatArray

ORDER = 3
WITHOUT_KNOT = 3  # levels of a cubic spline that have no knot of their own


@dataclass(frozen=True, slots=True)
class MonotoneSplineBasis:
    """A constant and cubic I-splines over z = -1..1 with interior `knots`; falling curves where `falls`."""

    knots: tuple[float, ...]
    falls: bool = False

    @classmethod
    def through(cls, z: FloatArray, falls: bool) -> MonotoneSplineBasis:
        """Return the basis with as many knots as the levels in z carry, at its quantiles; z of both branches."""
        count = max((z.size + 2) // 2 - WITHOUT_KNOT, 1)
        knots = np.quantile(np.clip(z, -1.0, 1.0), np.linspace(0.0, 1.0, count + 2)[1:-1])
        return cls(tuple(float(knot) for knot in np.unique(knots) if -1.0 < knot < 1.0), falls)

    @property
    def complexity(self) -> int:
        return len(self.knots) + ORDER + 1

    @property
    def _splines(self) -> BSpline:
        knots = np.concatenate([np.full(ORDER + 1, -1.0), self.knots, np.full(ORDER + 1, 1.0)])
        return BSpline(knots, np.eye(self.complexity), ORDER)

    def _within(self, z: npt.ArrayLike) -> FloatArray:
        return np.clip(np.atleast_1d(np.asarray(z, dtype=np.float64)), -1.0, 1.0)

    def design(self, z: npt.ArrayLike) -> FloatArray:
        """Return the design matrix [points, coefficients]; z beyond -1..1 is taken for the end, NaN gives NaN."""
        return self._integrated(np.asarray(self._splines(self._within(z))))

    def slope_design(self, z: npt.ArrayLike) -> FloatArray:
        return self._integrated(np.asarray(self._splines.derivative()(self._within(z))))

    def _integrated(self, rows: FloatArray) -> FloatArray:
        sums = np.cumsum(rows[:, ::-1], axis=1)[:, ::-1]
        sums[:, 1:] *= -1.0 if self.falls else 1.0
        return np.asarray(sums, dtype=np.float64)

    def constrained(self, loop_terms: int) -> BoolArray:
        """All but the constant and the loop's terms may not be negative."""
        return np.concatenate([[False], np.ones(self.complexity - 1, dtype=bool), np.zeros(loop_terms, dtype=bool)])
