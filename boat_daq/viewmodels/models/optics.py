"""The optics page: a design's rays in the 15 states, the sweep over all designs, the search beyond them.

Rules: rays are traced in helper processes; the states of a design arrive together, so that the slider only selects. A
traced design is kept and not traced again; a sweep and a search are kept with their deformation curves.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from analysis.fidelity import Fidelity, fidelity
from boat_daq.viewmodels.common.formatting import count, number
from boat_daq.viewmodels.common.jobs import Job, JobRunner, JobState
from boat_daq.viewmodels.models.optics_jobs import (
    DesignResult,
    OptimumSummary,
    StateScene,
    SweepSummary,
    Values,
    search,
    sweep,
    trace_design,
)

STEPS_MM = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
CAVITIES = (3, 5, 7)
PAPER: Values = (5, 1.0, 0.5, 0.9)
STATES = 15
BY_FIDELITY = 0
RAYS = (BY_FIDELITY, 250, 1000, 2500, 10_000)
FACES = ("outer", "inner")
CURVES = {"default": "Shape from the shadow", "parametric": "Shape by formula"}
SEARCH_S = 50.0
KEPT = 12


class OpticsModel:
    """State of the page.

    Parameters
    ----------
    jobs : where rays are traced.
    """

    def __init__(self, jobs: JobRunner) -> None:
        self.jobs = jobs
        self.values: Values = PAPER
        self.face = FACES[0]
        self.curves = next(iter(CURVES))
        self.state = STATES // 2
        self.rays = BY_FIDELITY
        self.fidelity: Fidelity = fidelity()
        self.result: DesignResult | None = None
        self.problem = ""
        self.revision = 0
        self._kept: dict[tuple[Values, str, int, str], DesignResult] = {}
        self._sweeps: dict[str, SweepSummary] = {}
        self._optima: dict[str, OptimumSummary] = {}

    def running(self, name: str) -> bool:
        """Return whether rays are traced: of one design ("optics"), of a "sweep", or to "optimise"."""
        return self.jobs.get(name) is not None

    @property
    def sweep(self) -> SweepSummary | None:
        """The sweep with the chosen deformation curves."""
        return self._sweeps.get(self.curves)

    @property
    def optimum(self) -> OptimumSummary | None:
        """The result of the search with the chosen deformation curves."""
        return self._optima.get(self.curves)

    # ---- one design ----------------------------------------------------------------------------------------------

    def choose(self, values: Values, face: str = "") -> None:
        """Show a design; trace a new one in the background."""
        self.values, self.face, self.problem = values, face or self.face, ""
        key = self._key()
        self.result = self._kept.get(key)
        self.revision += 1
        if self.result is None:
            job = Job("Tracing rays", trace_design, values, self.traced_rays, self.curves, self.face)
            self.jobs.start("optics", job, lambda job: self._ended(job, self._kept, key))

    def _key(self) -> tuple[Values, str, int, str]:
        return self.values, self.face, self.traced_rays, self.curves

    @property
    def traced_rays(self) -> int:
        """Rays of one design: the chosen number, else that of the fidelity."""
        return self.rays or self.fidelity.rays

    @property
    def swept_rays(self) -> int:
        """Rays of each simulation of a sweep: the chosen number, else that of the fidelity."""
        return self.rays or self.fidelity.ranking_rays

    def set_rays(self, rays: int) -> None:
        """Trace with another number of rays; `BY_FIDELITY` leaves it to the fidelity."""
        self.rays = rays
        self.choose(self.values)

    def set_fidelity(self, level: Fidelity) -> None:
        """Set the fidelity of the next traces and sweeps."""
        self.fidelity = level
        self.revision += 1

    def set_curves(self, name: str) -> None:
        """Use other deformation curves: a key of `CURVES`, or the path of a file."""
        self.curves = name
        self.choose(self.values)

    def curves_text(self, name: str) -> str:
        """Return the label of deformation curves."""
        return CURVES.get(name) or Path(name).name

    def _ended(self, job: Job, results: dict[Any, Any], key: object) -> None:
        """Keep a job's result under `key`, or its problem."""
        self.revision += 1
        if job.failure is not None:
            self.problem = job.failure.text
        elif job.state is JobState.DONE:
            results[key] = job.result
            while len(self._kept) > KEPT:
                del self._kept[next(iter(self._kept))]
            if key == self._key():
                self.result = job.result

    def scene(self) -> StateScene | None:
        """Return the state that the slider selects."""
        return self.result.scenes[self.state] if self.result is not None else None

    def state_text(self) -> str:
        """Return the selected state as text."""
        text = f"state {self.state} of {STATES - 1}"
        if self.result is None:
            return text
        x = number(float(self.result.elongation_mm[self.state]), 2, sign=True)
        return f"{text}: {x} mm   {number(float(self.result.ndr[self.state]), 0)} of 250 rays detected"

    def design_text(self) -> str:
        """Return the design's figures in a line."""
        if self.problem:
            return f"\u25b2 {self.problem}"
        r = self.result
        if r is None:
            return "tracing \u2026" if self.running("optics") else ""
        m, rises = r.merit, count(int(r.merit.n_sign), "rise")
        range_, roughness, merit = number(float(m.delta), 1), number(float(m.rmse), 2), number(float(m.p), 2)
        return f"range {range_} rays   {rises}   roughness {roughness}   merit {merit}"

    # ---- the sweep and the search --------------------------------------------------------------------------------

    def toggle_sweep(self) -> None:
        """Start a sweep over all designs, or stop the running one."""
        args = CAVITIES, self.swept_rays, self.curves
        self._toggle("sweep", self._sweeps, lambda: Job("Sweeping 9 720 simulations", sweep, *args))

    def toggle_search(self) -> None:
        """Start the search beyond the grid, or stop the running one."""
        args = self.curves, SEARCH_S
        self._toggle("optimise", self._optima, lambda: Job("Searching beyond the grid", search, *args))

    def _toggle(self, name: str, results: dict[str, Any], make: Callable[[], Job]) -> None:
        if self.running(name):
            self.jobs.cancel(name)
            return
        curves = self.curves
        self.jobs.start(name, make(), lambda job: self._ended(job, results, curves))
        self.revision += 1

    def sweep_text(self) -> str:
        """Return the result of the sweep in a line."""
        s = self.sweep
        if s is None:
            return ""
        paper = ""
        if s.paper >= 0:
            merit = number(100 * float(s.merit.p_normalised[s.paper]), 0)
            paper = f"   paper's optimum: rank {int(s.ranks[s.paper])}, {merit} % of the best merit"
        return (
            f"{number(s.simulated, 0)} simulations of {number(s.rays, 0)} rays in {number(s.seconds, 1)} s   best: "
            f"{design_label(tuple(s.values[s.best]))}, {count(int(s.tied.sum()), 'design')} equal within noise{paper}"
        )

    def pick(self, cavities: int, width_mm: float, column: float, row: float) -> None:
        """Show the design of a cell of a map; the maps are of cavities in the outer face.

        Parameters
        ----------
        cavities, width_mm : of the map.
        column, row : coordinates in the map, in cells.
        """
        i, k = int(column), int(row)
        if 0 <= i < len(STEPS_MM) and 0 <= k < len(STEPS_MM):
            self.choose((cavities, width_mm, STEPS_MM[k], STEPS_MM[i]), FACES[0])

    def optimum_text(self) -> str:
        """Return the gain of the search in a line."""
        o = self.optimum
        if o is None:
            return ""
        end = "" if o.finished else "   (stopped by its time limit)"
        return (
            f"optimised: {design_label(o.values, 2)}, {o.face} face   {number(o.p / o.start_p, 2)} times the merit of "
            f"the grid's best (P on power: {number(o.p, 2)} against {number(o.start_p, 2)}){end}"
        )

    def show_optimum(self) -> None:
        """Show the design that the search found."""
        if self.optimum is not None:
            self.choose(self.optimum.values, self.optimum.face)


def design_label(values: tuple[float, ...], decimals: int = 1) -> str:
    """Return a design as `5 cavities 1.0 \u00d7 0.5 mm, spacing 0.9 mm`."""
    n, (width, depth, spacing) = int(values[0]), (number(v, decimals) for v in values[1:4])
    return f"{n} cavities {width} \u00d7 {depth} mm, spacing {spacing} mm"
