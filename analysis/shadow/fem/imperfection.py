"""How far an imperfect print goes oval under vacuum, and where it collapses: Koiter's expansion about a state.

Strategy: the print is off the perfect shape by e times the buckling mode. About an axisymmetric state the response to
e is, to the first order, one linear solution, exact at every pressure; along it the energy is expanded to the fourth
order (Koiter 1945; Budiansky 1974), with the displacements of twice the wave number and of none that follow it, and
with e = xi in the terms of higher order:

    xi (1 + b xi^2) = e,   growth = gain xi + third xi^3

b > 0: the actuator stiffens and never collapses; b < 0: it does, where e^2 = -4 / (27 b).

`direct_growth` is the second method, some hundred times as dear: equilibrium of the whole series by Newton's method,
each step by GMRES with the tangents of the perfect shape as its preconditioner, in smaller steps of e where it fails.

Rule: `remainder` estimates the error of an expansion; a caller warns above `LARGEST_REMAINDER`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, gmres

from analysis.arrays import FloatArray
from analysis.errors import ConvergenceError
from analysis.shadow.fem import band
from analysis.shadow.fem.solver import Solution, factorise
from analysis.shadow.fem.stability import Stability
from analysis.shadow.fem.waves import Waves

PROBE_SHARE = 5e-3
"""Amplitude, as a share of the cavity's radius, at which terms are differenced: small, but large beside rounding."""
LINEAR_SHARE = 1e-3
"""Of that amplitude, for the linear response, which the terms of higher order are differences to."""
LEAST_RESPONSE = 1e-5
"""Response for each mm of error, without unit, below which the terms of higher order are lost in rounding."""
MODE_PASSES = 8
LARGEST_REMAINDER = 0.007
"""Up to it the growth was within 1 % of the direct solution (METHODS.md)."""
DIRECT_STEPS = 8
SMALLEST_ERROR_STEP = 1.0 / 16.0
DIFFERENCE_MM = 1e-5
DIRECT_TOLERANCE = 1e-7
GMRES_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Imperfection:
    """The worst shape of a print's error.

    Parameters
    ----------
    waves : its wave number, and the forces. shape : shape (nodes, 3), greatest radial part in the cavity 1.
    """

    waves: Waves
    shape: FloatArray


@dataclass(frozen=True, slots=True)
class OvalGrowth:
    """What one state makes of a print's error e.

    Parameters
    ----------
    gain : growth of the radius' wave for each mm of a small error, without unit; negative where pressure rounds it.
    b_per_mm2 : Koiter's coefficient b.
    third_per_mm2 : growth, for each mm^3 of xi, by displacements of the same wave number beside the first-order ones.
    second_per_mm : second-order displacements for each mm^2 of xi, relative to the first-order ones for each mm.
    """

    gain: float
    b_per_mm2: float
    third_per_mm2: float
    second_per_mm: float

    def multiplier_mm(self, error_mm: float) -> float:
        """Return xi of an error of `error_mm`; NaN where the imperfect actuator has collapsed before this state."""
        roots = np.roots([self.b_per_mm2, 0.0, 1.0, -error_mm]) if self.b_per_mm2 else np.array([error_mm])
        real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
        near = real[(real >= 0.0) & (1.0 + 3.0 * self.b_per_mm2 * real**2 > 0.0)]
        return float(near.min()) if len(near) else math.nan

    def growth_mm(self, error_mm: float) -> float:
        """Return by how much the radius' wave grows; NaN after a collapse."""
        xi = self.multiplier_mm(error_mm)
        return self.gain * xi + self.third_per_mm2 * xi**3

    def remainder(self, error_mm: float) -> float:
        """Return an estimate of the growth's relative error: the terms of the third order times the next ratio."""
        second = self.second_per_mm * self.multiplier_mm(error_mm)
        first = self.gain * error_mm
        third = abs(self.growth_mm(error_mm) / first - 1.0) if first else 0.0
        return second * max(second, third)


def worst_imperfection(stability: Stability, near_limit: Solution, wave_number: int) -> Imperfection:
    """Return the buckling mode of a state near the limit, by inverse iteration.

    Parameters
    ----------
    wave_number : of the mode, 1 or more.
    """
    harmonics = stability.harmonics
    factor = _factor(harmonics.tangent(near_limit.displacement_mm, near_limit.pressure_kpa, wave_number))
    mode = np.ones(harmonics.size) + np.random.default_rng(1).uniform(-0.5, 0.5, harmonics.size)
    for _ in range(MODE_PASSES):
        mode = _solve(factor, mode / np.linalg.norm(mode))
    waves = Waves(harmonics, wave_number)
    nodal = waves.spread(mode)
    radial = nodal[np.unique(stability.problem.cavity), 0]
    return Imperfection(waves, nodal / radial[np.abs(radial).argmax()])


def oval_growth(stability: Stability, state: Solution, imperfection: Imperfection, *, held: bool) -> OvalGrowth:
    """Expand the response to a print's error about a state.

    Parameters
    ----------
    state : stable, of the perfect shape.
    held : whether the plate is held at its place, as with pressure and elongation imposed.

    Raises
    ------
    ConvergenceError
        If the state is not stable.

    Notes
    -----
    At rest the imperfect shape is free of stress, so nothing grows. Near rest the response is proportional to the load,
    and b the quotient of two small numbers: below `LEAST_RESPONSE` it is omitted, as xi is the error itself there.
    """
    waves, problem, p, u0 = imperfection.waves, stability.problem, state.pressure_kpa, state.displacement_mm
    first, double = (_factor(stability.harmonics.tangent(u0, p, k * waves.wave_number)) for k in (1, 2))
    axial = factorise(problem, u0, p, held=held)
    if axial is None:
        raise _unstable()
    if p == 0.0 and not u0.any():
        return OvalGrowth(0.0, 0.0, 0.0, 0.0)
    base = np.zeros((3, *imperfection.shape.shape))
    base[0, :, ::2] = u0

    cavity = np.unique(problem.cavity)
    probe_mm = PROBE_SHARE * float(problem.nodes[cavity, 0].max())
    least_mm = LINEAR_SHARE * probe_mm
    pull = -waves.force(base, p, least_mm * imperfection.shape)[1] / least_mm
    answer = _solve(first, pull)
    once = waves.spread(answer)
    size = float(np.abs(once[cavity, 0]).max())
    at = cavity[np.abs(imperfection.shape[cavity, 0]).argmax()]
    gain = float(once[at, 0] / imperfection.shape[at, 0])
    if size < LEAST_RESPONSE:
        return OvalGrowth(gain, 0.0, 0.0, 0.0)
    probe = probe_mm / max(size, 1.0)  # bounds the response and the error: near rest the error is the larger
    linear, second = float(answer @ pull), np.zeros_like(base)

    def next_terms() -> list[FloatArray]:
        """Return the forces of order 0, n, 2 n by xi^2, xi^3, xi^2, from two sizes of xi (Richardson)."""
        found = []
        for xi in (probe / 2.0, probe):
            moved = base + xi**2 * second
            moved[1] = xi * once
            even, same, twice = waves.force(moved, p, xi * imperfection.shape)
            found.append([(even - still) / xi**2, same / xi**3, twice / xi**2])
        return [(4.0 * half - whole) / 3.0 for half, whole in zip(*found, strict=True)]

    still = problem.balance(u0, p).force
    even, _, twice = next_terms()
    if held:
        even[problem.plate] = 0.0
    second[0, :, ::2] = problem.spread(axial.solve(-even))
    second[2] = waves.spread(_solve(double, -twice))
    cubic = next_terms()[1]
    b = float(answer @ cubic) / linear
    third = waves.spread(b * answer - _solve(first, cubic))
    return OvalGrowth(
        gain=gain,
        b_per_mm2=b,
        third_per_mm2=float(third[at, 0] / imperfection.shape[at, 0]),
        second_per_mm=float(np.abs(second).max()) / size,
    )


def direct_growth(
    stability: Stability, state: Solution, imperfection: Imperfection, error_mm: float, *, waves: int = 4
) -> float:
    """Return the growth of an error of print by a direct solution, mm.

    Parameters
    ----------
    state : stable, of the perfect shape, its plate free.
    waves : terms of the series: orders 0, n, 2 n, ...

    Raises
    ------
    ConvergenceError
        If there is no equilibrium near the perfect one: the actuator has collapsed.
    """
    problem, shape = stability.problem, imperfection.shape
    series = _Series(stability, state, imperfection, waves)
    u = np.zeros((waves, *shape.shape))
    u[0, :, ::2] = state.displacement_mm
    done, share = 0.0, 1.0
    while done < 1.0:
        found = series.equilibrium(u, (done + share) * error_mm)
        if found is not None:
            u, done = found, done + share
        else:
            share /= 2.0
            if share < SMALLEST_ERROR_STEP:
                raise ConvergenceError(
                    f"no equilibrium of a print oval by {error_mm:g} mm at {state.pressure_kpa:.4g} kPa",
                    "choose a state with less vacuum",
                )
    at = np.unique(problem.cavity)
    at = at[np.abs(shape[at, 0]).argmax()]
    return float(u[1, at, 0] / shape[at, 0])


class _Series:
    """The equilibrium of an imperfect print at one pressure, displacements as a series: orders 0, n, 2 n, ...

    Parameters
    ----------
    state : stable, of the perfect shape, its plate free.

    Raises
    ------
    ConvergenceError
        If the state is not stable.
    """

    def __init__(self, stability: Stability, state: Solution, imperfection: Imperfection, waves: int) -> None:
        problem, harmonics, n = stability.problem, stability.harmonics, imperfection.waves.wave_number
        p, u0 = state.pressure_kpa, state.displacement_mm
        axial = factorise(problem, u0, p, held=False)
        if axial is None:
            raise _unstable()
        self._axial, self._factors = axial, [_factor(harmonics.tangent(u0, p, k * n)) for k in range(1, waves)]
        self._problem, self._imperfection, self._pressure_kpa = problem, imperfection, p
        self._ends = np.cumsum([problem.size, *([harmonics.size] * (waves - 1))])
        self._enough = DIRECT_TOLERANCE * problem.balance(u0, p).scale

    def equilibrium(self, u: FloatArray, e_mm: float) -> FloatArray | None:
        """Return the displacements (waves, nodes, 3) of one error near `u`; None if Newton's method fails."""
        for _ in range(DIRECT_STEPS):
            out = self._force(u, e_mm)
            if not np.isfinite(out).all():
                return None
            if np.linalg.norm(out) <= self._enough:
                return u

            def product(x: FloatArray, u: FloatArray = u) -> FloatArray:
                step = self._nodal(x.ravel()) * (DIFFERENCE_MM / max(float(np.abs(x).max()), DIFFERENCE_MM**2))
                change = self._force(u + step, e_mm) - self._force(u - step, e_mm)
                return np.asarray(change * (np.abs(x).max() / (2.0 * DIFFERENCE_MM)))

            size = (int(self._ends[-1]),) * 2
            operator, inverse = LinearOperator(size, product), LinearOperator(size, self._precondition)
            change, _ = gmres(operator, -out, M=inverse, rtol=GMRES_TOLERANCE, restart=40, maxiter=2)
            u = u + self._nodal(change)
        return None

    def _nodal(self, x: FloatArray) -> FloatArray:
        """Return the free displacements as (waves, nodes, 3)."""
        flat, *rest = np.split(x, self._ends[:-1])
        u = np.zeros((len(self._ends), *self._imperfection.shape.shape))
        u[0, :, ::2] = self._problem.spread(flat)
        for k, values in enumerate(rest, 1):
            u[k] = self._imperfection.waves.spread(values)
        return u

    def _force(self, u: FloatArray, e_mm: float) -> FloatArray:
        waves, shape = self._imperfection.waves, self._imperfection.shape
        with np.errstate(invalid="ignore"):  # an inverted element has no energy
            return np.concatenate(waves.force(u, self._pressure_kpa, e_mm * shape))

    def _precondition(self, x: FloatArray) -> FloatArray:
        """Return a step by the tangents of the perfect shape."""
        flat, *rest = np.split(x, self._ends[:-1])
        waves = [_solve(f, r) for f, r in zip(self._factors, rest, strict=True)]
        return np.concatenate([self._axial.solve(flat), *waves])


def _factor(matrix: FloatArray) -> FloatArray:
    """Return the Cholesky factor of a tangent, in its place.

    Raises
    ------
    ConvergenceError
        If it is not positive definite.
    """
    if band.factorise(matrix) < len(matrix):
        raise _unstable()
    return matrix


def _unstable() -> ConvergenceError:
    return ConvergenceError("this state is not stable: an oval of any size grows", "choose a state with less vacuum")


def _solve(factor: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(band.backward(factor, band.forward(factor, right)))
