"""The reduced model (METHODS.md): any state over (pressure, elongation) from a handful of shapes.

A state outside the rectangle is rejected; `Shadow` in frames.py then uses the full model.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from analysis.shadow.model import chebyshev
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import RequestError


@dataclass(frozen=True, slots=True)
class TableSettings:
    """Resolution of the table, up to `highest_pressure_kpa`, down to a little short of the critical pressure."""

    pressures: int = 7  # with elongations: Chebyshev points along each side
    elongations: int = 7
    modes: int = 8
    held_out: int = 64  # full solutions, not used for the table, that its error is measured on
    highest_pressure_kpa: float = 55.0
    margin_mm: float = 0.6  # how far the rectangle reaches beyond the nominal elongations of its pressures


@dataclass(frozen=True, slots=True)
class ReducedModel:
    """The table."""

    pressure_range_kpa: FloatArray  # with elongation_range_mm: shape (2,), the rectangle
    elongation_range_mm: FloatArray
    mean: FloatArray  # with shapes: shape (2 nodes,), mm, and (2 nodes, modes), mm per unit amplitude
    shapes: FloatArray
    # amplitudes, force: (pressures, elongations, modes) and (pressures, elongations), Chebyshev coefficients, mm and mN
    amplitudes: FloatArray
    force: FloatArray
    tracked_mean: FloatArray  # with tracked_shapes: the same for the seven points, (14,) and (14, modes)
    tracked_shapes: FloatArray
    nominal_mm: FloatArray  # with nominal_sd_mm: Chebyshev coefficients of x_nom(p) and of its standard uncertainty
    nominal_sd_mm: FloatArray
    nominal_kpa: FloatArray  # Chebyshev coefficients of p_nom(x)
    errors_mm: FloatArray  # (modes,), greatest error of a held-out state's tracked point with 1, 2, ... modes
    critical_kpa: FloatArray  # the critical pressure under vacuum

    @property
    def error_bound_mm(self) -> float:
        """Return twice the greatest error of a tracked point on held-out states, mm."""
        return 2.0 * float(self.errors_mm[-1])

    def holds(self, pressure_kpa: FloatArray, elongation_mm: FloatArray) -> BoolArray:
        """Return whether each state lies in the rectangle (NaN does not)."""
        (p0, p1), (q0, q1) = self.pressure_range_kpa, self.elongation_range_mm
        p, q = np.asarray(pressure_kpa), np.asarray(elongation_mm)
        return np.asarray((p >= p0) & (p <= p1) & (q >= q0) & (q <= q1))

    @property
    def rectangle(self) -> str:
        (p0, p1), (q0, q1) = self.pressure_range_kpa, self.elongation_range_mm
        return f"{p0:.1f} .. {p1:.1f} kPa, {q0:.2f} .. {q1:.2f} mm"

    def truncated(self, modes: int) -> ReducedModel:
        """Return the same table with fewer shapes."""
        names = ("shapes", "amplitudes", "tracked_shapes", "errors_mm")
        return replace(self, **{name: getattr(self, name)[..., :modes] for name in names})

    def _products(self, pressure_kpa: FloatArray, elongation_mm: FloatArray) -> FloatArray:
        """Return all products of the two bases, shape (n, pressures * elongations)."""
        p, q = np.atleast_1d(pressure_kpa), np.atleast_1d(elongation_mm)
        inside = self.holds(p, q)
        if not inside.all():
            worst = int(np.flatnonzero(~inside)[0])
            cause = f"{p[worst]:g} kPa with {q[worst]:g} mm is outside the table ({self.rectangle})"
            raise RequestError(cause, "use the full model there")
        along = chebyshev.basis(p, self.pressure_range_kpa, self.amplitudes.shape[0])
        across = chebyshev.basis(q, self.elongation_range_mm, self.amplitudes.shape[1])
        products: FloatArray = np.einsum("ni,nj->nij", along, across).reshape(len(p), -1)
        return products

    def tracked(self, pressure_kpa: FloatArray, elongation_mm: FloatArray) -> FloatArray:
        """Return the deformed tracked points of one guide, shape (n, 7, 2), (r, z) in mm."""
        products = self._products(pressure_kpa, elongation_mm)
        matrix = self.amplitudes.reshape(products.shape[1], -1) @ self.tracked_shapes.T
        return (self.tracked_mean + products @ matrix).reshape(len(products), -1, 2)

    def displacement(self, pressure_kpa: float, elongation_mm: float) -> tuple[FloatArray, float]:
        """Return the nodal displacements, shape (nodes, 2), mm, and the force on the plate, mN, of one state."""
        products = self._products(np.array([pressure_kpa]), np.array([elongation_mm]))[0]
        amplitudes = products @ self.amplitudes.reshape(len(products), -1)
        return (self.mean + self.shapes @ amplitudes).reshape(-1, 2), float(products @ self.force.ravel())

    def nominal_elongation(self, pressure_kpa: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x_nom(p) and its standard uncertainty from the lattice's modulus, mm; NaN outside the range."""
        p = np.asarray(pressure_kpa, dtype=float)
        low, high = self.pressure_range_kpa
        inside = np.where((p >= low) & (p <= high), p, np.nan)
        base = chebyshev.basis(inside, self.pressure_range_kpa, len(self.nominal_mm))
        return (base @ self.nominal_mm).reshape(p.shape), np.abs(base @ self.nominal_sd_mm).reshape(p.shape)

    def nominal_pressure(self, elongation_mm: FloatArray) -> FloatArray:
        """Return p_nom(x), kPa; NaN outside the elongations that the range of pressures reaches."""
        x = np.asarray(elongation_mm, dtype=float)
        low, high = ends = self.nominal_range_mm
        inside = np.where((x >= low) & (x <= high), x, np.nan)
        return np.reshape(chebyshev.basis(inside, ends, len(self.nominal_kpa)) @ self.nominal_kpa, x.shape)

    @property
    def nominal_range_mm(self) -> FloatArray:
        """Return the nominal elongations at both ends of the range of pressures, shape (2,), mm."""
        return self.nominal_elongation(self.pressure_range_kpa)[0]

    def states_per_second(self) -> float:
        """Measure how many states (tracked points of a batch) are evaluated a second."""
        rng, states = np.random.default_rng(1), 20_000
        (p0, p1), (q0, q1) = self.pressure_range_kpa, self.elongation_range_mm
        pressures, elongations = rng.uniform(p0, p1, states), rng.uniform(q0, q1, states)
        self.tracked(pressures[:10], elongations[:10])
        begun = time.perf_counter()
        self.tracked(pressures, elongations)
        return states / (time.perf_counter() - begun)
