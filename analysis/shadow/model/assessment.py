"""The margin of one state of the shadow, and the warnings that its reader needs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from analysis.published import LOOP_HALF_WIDTH_MM
from analysis.shadow.fem.solver import Solution, Solver
from analysis.shadow.model.full import FullModel, actuator_problem
from analysis.warning import Warning, WarningCode


@dataclass(frozen=True, slots=True)
class Assessment:
    """The margin of one state: its lowest eigenvalue is 1 at rest and 0 where the actuator buckles."""

    lowest_eigenvalue: float
    warnings: tuple[Warning, ...]


def assess(model: FullModel, state: Solution) -> Assessment:
    """Return the margin of a state, with warnings about the mesh, the imposed values and the stability."""
    lowest = model.stability.lowest_eigenvalue(state)
    warnings = [*model.warnings, *_contradiction(model, state)]
    if lowest <= 0.0:  # with both values imposed there is no critical pressure to refuse it by
        text = "this state is an unstable equilibrium: a real actuator would buckle"
        warnings.append(Warning(WarningCode.UNSTABLE_STATE, "", text))
    return Assessment(lowest, tuple(warnings))


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
