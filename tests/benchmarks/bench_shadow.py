"""The shadow's speed: full solutions, reduced states and whole frames a second, and the ratio to scikit-fem."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from analysis.shadow.fem.solver import Solver, factorise
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.table import build_table
from analysis.studies.tradeoff.measure import measure
from analysis.studies.tradeoff.mechanics import MESH
from tests.benchmarks.lengths import WHOLE, benchmark_shadow, length
from tests.verification.scikit_fem import make_scikit_fem_problem

PAPER_FRAMES_PER_S = 2.0  # of its full model, on 16 cores
SCREEN_FRAMES_PER_S = 60.0


def test_newton_step_against_scikit_fem() -> None:
    """Assembly and factorisation, compiled, against the same assembly by scikit-fem."""
    model = FullModel()
    u, problem = model.solve(pressure_kpa=30.0).displacement_mm, model.problem
    scikit_fem = make_scikit_fem_problem(problem)
    ours = best_seconds(lambda: (problem.balance(u, 30.0), factorise(problem, u, 30.0, held=False)), length(50, 2))
    plain = best_seconds(lambda: (scikit_fem.internal_force(u), scikit_fem.internal_tangent(u)), length(5, 1))
    print(f"\nNewton step: {1e3 * ours:.2f} ms for {problem.size} unknowns")
    print(f"scikit-fem's assembly alone: {1e3 * plain:.0f} ms, {plain / ours:.0f} times as long")
    assert ours < plain


def test_full_solutions() -> None:
    """Warm-started solutions over a slow cycle; the window shows the reduced model."""
    model = FullModel()
    rate = max(solutions_per_second(model.solver, length(200, 4)) for _ in range(length(3, 1)))
    print(
        f"\nfull model: {rate:.0f} solutions/s of processor time, {rate / SCREEN_FRAMES_PER_S:.1f} times a screen's 60"
    )
    assert rate > length(SCREEN_FRAMES_PER_S, PAPER_FRAMES_PER_S)


def test_reduced_states() -> None:
    """Building, a batch, one by one, and whole frames."""
    begun = time.perf_counter()
    table = build_table() if WHOLE else benchmark_shadow().table
    built = time.perf_counter() - begun
    batch = max(table.states_per_second() for _ in range(length(5, 1)))
    single = 1.0 / best_seconds(lambda: table.tracked(np.array([20.0]), np.array([1.0])), length(500, 2))
    shadow = Shadow(table=table) if WHOLE else benchmark_shadow()
    _ = shadow.topology
    frame = 1.0 / best_seconds(lambda: shadow.state(elongation_mm=1.0, pressure_kpa=20.0), length(300, 2))
    print(f"\nreduced model: built in {built:.1f} s, error bound {table.error_bound_mm:.1e} mm")
    print(f"{batch:,.0f} states/s in a batch, {single:,.0f} one by one; {frame:,.0f} whole frames/s,")
    print(f"{frame / SCREEN_FRAMES_PER_S:,.0f} times the {SCREEN_FRAMES_PER_S:.0f} of the window's pane")
    assert frame > length(SCREEN_FRAMES_PER_S, PAPER_FRAMES_PER_S)
    assert table.error_bound_mm < length(3.8e-3, 0.5)


def test_mesh_against_error() -> None:
    """The trade-off's points of the full model: error against CalculiX and time a solution."""
    default = [setting for setting in MESH.settings(True) if setting.name == MESH.default]
    method = MESH if WHOLE else replace(MESH, settings=lambda _: default)
    measured = measure(method, quick=True)
    print()
    for point in measured.points:
        print(f"  {point.setting:28} {point.error:.4f} mm  {1e3 * point.seconds:6.2f} ms")
    assert min(point.error for point in measured.points) < MESH.tolerance


def solutions_per_second(solver: Solver, solutions: int) -> float:
    """Measure warm-started solutions a second of processor time over one slow cycle of -40 .. +50 kPa."""
    state = solver.solve(pressure_kpa=5.0)
    begun = time.process_time()
    for k in range(1, solutions + 1):
        state = solver.solve(pressure_kpa=5.0 + 45.0 * float(np.sin(2.0 * np.pi * k / solutions)), start=state)
    return solutions / (time.process_time() - begun)


def best_seconds(work: object, repeats: int) -> float:
    """The best time of some calls."""
    best = np.inf
    for _ in range(repeats):
        begun = time.perf_counter()
        work()  # type: ignore[operator]
        best = min(best, time.perf_counter() - begun)
    return float(best)
