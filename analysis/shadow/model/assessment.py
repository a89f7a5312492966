"""What a reader of one state has to know besides: its margin, what it makes of an imperfect print, its warnings.

Strategy: the eigenvalue is the margin of the perfect shape; the growth of a print's oval is that of a real one, by
Koiter's expansion about the state (`fem/imperfection.py`). The pressure at which an imperfect actuator collapses is
found by bisection over the logarithm of its distance to the critical pressure, which falls with a power of the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from analysis.published import LOOP_HALF_WIDTH_MM
from analysis.shadow.fem.imperfection import LARGEST_REMAINDER, OvalGrowth, oval_growth
from analysis.shadow.fem.solver import Solution, Solver
from analysis.shadow.model.full import FullModel, actuator_problem
from analysis.warning import Warning, WarningCode

PRINT_ERROR_MM = 0.01
NEAREST_COLLAPSE, FARTHEST_COLLAPSE = 1e-3, 0.3
"""Shares of the critical pressure by which an imperfect actuator may collapse earlier."""
BISECTIONS = 7


@dataclass(frozen=True, slots=True)
class Assessment:
    """The margin of one state.

    Parameters
    ----------
    lowest_eigenvalue : 1 at rest, 0 where the perfect shape buckles.
    error_mm : half the difference of the radii that the print's error makes, along two diameters.
    growth_mm : by how much the state enlarges it; NaN without an expansion: an unstable state, or no waves found.
    gain, b_per_mm2 : growth of a small error for each mm, and Koiter's coefficient; NaN likewise.
    """

    lowest_eigenvalue: float
    error_mm: float
    growth_mm: float
    gain: float
    b_per_mm2: float
    warnings: tuple[Warning, ...]


def assess(model: FullModel, state: Solution, error_mm: float = PRINT_ERROR_MM) -> Assessment:
    """Return the margin of a state and what a reader has to know.

    Parameters
    ----------
    model, state : of the perfect shape.
    """
    lowest = model.stability.lowest_eigenvalue(state)
    warnings = [*model.warnings, *_contradiction(model, state)]
    if lowest <= 0.0:  # with both values imposed there is no critical pressure to refuse it by
        text = "this state is an unstable equilibrium: a real actuator would buckle"
        warnings.append(Warning(WarningCode.UNSTABLE_STATE, "", text))
    growth = growth_at(model, state) if lowest > 0.0 else None
    if growth is None:
        return Assessment(lowest, error_mm, math.nan, math.nan, math.nan, tuple(warnings))
    grown = growth.growth_mm(error_mm)
    if math.isnan(grown):
        text = f"a print that is oval by {error_mm:g} mm collapses before this state"
        warnings.append(Warning(WarningCode.COLLAPSE, "", text))
    elif growth.remainder(error_mm) > LARGEST_REMAINDER:
        text = f"the oval of {grown:.2g} mm may be off by more than 1 %: it is large for the expansion that computes it"
        warnings.append(Warning(WarningCode.LARGE_OVAL, "", text))
    return Assessment(lowest, error_mm, grown, growth.gain, growth.b_per_mm2, tuple(warnings))


def growth_at(model: FullModel, state: Solution) -> OvalGrowth | None:
    """Return what a stable state makes of a print's error; None where no waves end the stability."""
    if model.imperfection is None:
        return None
    return oval_growth(model.stability, state, model.imperfection, held=state.tip_force_mn != 0.0)


def collapse_kpa(model: FullModel, error_mm: float) -> float:
    """Return the pressure at which an actuator with this error of print collapses, kPa; NaN for none found.

    Parameters
    ----------
    model : of the perfect shape.
    """
    critical = model.vacuum_limit.pressure_kpa

    def collapsed(share: float) -> bool:
        growth = growth_at(model, model.solver.solve(pressure_kpa=critical * (1.0 - share)))
        return growth is not None and math.isnan(growth.growth_mm(error_mm))

    near, far = NEAREST_COLLAPSE, FARTHEST_COLLAPSE
    if not collapsed(near):
        return math.nan
    for _ in range(BISECTIONS):
        middle = math.sqrt(near * far)
        near, far = (middle, far) if collapsed(middle) else (near, middle)
    return critical * (1.0 - math.sqrt(near * far))


def nominal_band(model: FullModel, pressure_kpa: float) -> tuple[float, float]:
    """Return the free actuator's elongation at a pressure, and half its band: modulus (k = 2) and loop, mm."""
    p = model.parameters
    stiffer = replace(p, lattice_modulus_kpa=p.lattice_modulus_kpa + p.lattice_modulus_sd_kpa)
    problems = model.problem, actuator_problem(stiffer, model.mesh)
    free, stiff = (Solver(problem).solve(pressure_kpa=pressure_kpa).elongation_mm for problem in problems)
    return free, 2.0 * abs(free - stiff) + LOOP_HALF_WIDTH_MM


def _contradiction(model: FullModel, state: Solution) -> list[Warning]:
    """Return a warning if pressure and elongation are both imposed, and outside the band of each other."""
    if state.tip_force_mn == 0.0:
        return []
    p, q = state.pressure_kpa, state.elongation_mm
    free, half = nominal_band(model, p)
    if abs(q - free) <= half:
        return []
    text = (
        f"{p:g} kPa and {q:g} mm contradict each other: the free actuator is at {free:+.2f} mm \N{PLUS-MINUS SIGN} "
        f"{half:.2f} mm; a force of {state.tip_force_mn / 1e3:+.3g} N at the tip holds this state"
    )
    return [Warning(WarningCode.CONTRADICTORY_STATE, "", text)]
