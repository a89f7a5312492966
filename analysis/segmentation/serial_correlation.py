"""Values that follow one another, such as those of cycles: a test for their dependence, and what it does to intervals.

The model is a first-order autoregression about a constant or a line. Its rho is tested by the restricted likelihood
(REML, which allows for the fitted line) at 20 % one-sided, since few cycles show little; if it is significant, rho is
taken at its upper 95 % limit. Source: D. A. Harville, J. Am. Stat. Assoc. 72 (1977) 320.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from protocol.base.arrays import FloatArray

_FEWEST = 8
RANDOM_WALK = 0.999
_RHO = np.asarray([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, RANDOM_WALK])
_NOTICED = 0.71  # of twice the gain in log-likelihood: 20 % one-sided, half of chi-square's being zero
_UPPER = 1.35  # of the log-likelihood: 95 %, one-sided


@dataclass(frozen=True, slots=True)
class Dependence:
    """Of `n` values about `columns` (1 for a constant, 2 for a line): rho, 0 where none was noticed."""

    n: int
    columns: int
    rho: float = 0.0

    @classmethod
    def of(cls, values: FloatArray, columns: int) -> Dependence:
        """Test values in their order."""
        n, design = values.size, _design(values.size, columns)
        if n < max(_FEWEST, columns + 2) or not float(np.ptp(values)) > 0.0:
            return cls(n, columns)
        likelihood = np.asarray([_restricted(values, design, float(rho)) for rho in _RHO])
        best = float(likelihood.max())
        if not 2.0 * (best - likelihood[0]) > _NOTICED:
            return cls(n, columns)
        return cls(n, columns, float(_RHO[np.flatnonzero(likelihood > best - _UPPER)[-1]]))

    @property
    def noticed(self) -> bool:
        """Whether the values depend on one another."""
        return self.rho > 0.0

    @property
    def dof(self) -> float:
        """Degrees of freedom of the variance about the fit (Satterthwaite)."""
        return self._traces()[0] ** 2 / self._traces()[1]

    @property
    def variance_share(self) -> float:
        """The expected variance about the fit, over that of the values themselves."""
        return self._traces()[0] / (self.n - self.columns)

    @property
    def slope_widening(self) -> float:
        """Times that the 95 % interval of the slope of a line is as wide as that of independent values."""
        if not self.noticed:
            return 1.0
        time = _design(self.n, 2)[:, 1]
        spread = float(time @ self._correlation() @ time) / float(time @ time)
        own, usual = (float(stats.t.ppf(0.975, dof)) for dof in (max(self.dof, 1.0), self.n - 2))
        return float(np.sqrt(spread / self.variance_share)) * own / usual

    @property
    def next_share(self) -> float:
        """Variance of a further value about the mean of these, over their variance about it."""
        ones, ahead = np.ones(self.n), self.rho ** np.arange(1, self.n + 1)
        about = 1.0 + float(ones @ self._correlation() @ ones) / self.n**2 - 2.0 * float(ahead.sum()) / self.n
        return about / self.variance_share

    def _correlation(self) -> FloatArray:
        at = np.arange(self.n)
        return np.asarray(self.rho ** np.abs(at[:, None] - at) if self.noticed else np.eye(self.n))

    def _traces(self) -> tuple[float, float]:
        """Return the traces of M R and of M R M R, M the projection on the residuals and R the correlation."""
        basis, r = np.linalg.qr(_design(self.n, self.columns))[0], self._correlation()
        part = basis.T @ r
        inner = part @ basis
        once = self.n - float(np.trace(inner))
        return once, float((r**2).sum()) - 2.0 * float((part**2).sum()) + float((inner**2).sum())


def _design(n: int, columns: int) -> FloatArray:
    return np.asarray(np.vander(np.arange(n) - (n - 1) / 2.0, columns, increasing=True), dtype=np.float64)


def _restricted(values: FloatArray, design: FloatArray, rho: float) -> float:
    """Return the restricted log-likelihood of rho, but for a constant."""
    own = np.sqrt(1.0 - rho**2)

    def white(column: FloatArray) -> FloatArray:
        return np.concatenate([own * column[:1], column[1:] - rho * column[:-1]])

    x, y = white(design), white(values)
    found, *_ = np.linalg.lstsq(x, y, rcond=None)
    squares = float(((y - x @ found) ** 2).sum())
    dof = values.size - design.shape[1]
    if not squares > 0.0:
        return 0.0
    return float(np.log(own) - 0.5 * np.linalg.slogdet(x.T @ x)[1] - 0.5 * dof * np.log(squares))
