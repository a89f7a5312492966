"""The optics page: a design's rays over the 15 states, the sweep over all designs, the search beyond them.

Rules: tracing, sweeping and searching happen in helper processes; a design's states come all at once, so that the
slider only shows what is there. A design that was traced is kept and not traced again, a sweep and a search are kept
with the curves they were made for.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from analysis.fidelity import Fidelity, fidelity
from boat_daq.viewmodels.common.formatting import count, number
from boat_daq.viewmodels.common.jobs import Job, JobRunner, JobState
from boat_daq.viewmodels.models.optics_jobs import search, sweep, trace_design
from boat_daq.viewmodels.models.optics_results import DesignResult, OptimumSummary, StateScene, SweepSummary

Values = tuple[int, float, float, float]
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
T = TypeVar("T")


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

    @property
    def tracing(self) -> bool:
        """Whether rays are on their way."""
        return self.jobs.get("optics") is not None

    @property
    def sweeping(self) -> bool:
        """Whether a sweep is under way."""
        return self.jobs.get("sweep") is not None

    @property
    def searching(self) -> bool:
        """Whether a search is under way."""
        return self.jobs.get("optimise") is not None

    @property
    def sweep(self) -> SweepSummary | None:
        """The sweep over the curves that are chosen."""
        return self._sweeps.get(self.curves)

    @property
    def optimum(self) -> OptimumSummary | None:
        """What the search over the curves that are chosen found."""
        return self._optima.get(self.curves)

    # ---- one design ----------------------------------------------------------------------------------------------

    def choose(self, values: Values, face: str = "") -> None:
        """Look at a design, traced in the background where it is new."""
        self.values, self.face, self.problem = values, face or self.face, ""
        key = (values, self.face, self.traced_rays, self.curves)
        self.result = self._kept.get(key)
        self.revision += 1
        if self.result is None:
            job = Job("Tracing rays", trace_design, values, self.traced_rays, self.curves, self.face)

            def traced(done: Job) -> None:
                self._traced(done, key)

            self.jobs.start("optics", job, traced)

    @property
    def traced_rays(self) -> int:
        """Rays of one design: what was set by hand, else what the fidelity says."""
        return self.rays or self.fidelity.rays

    @property
    def swept_rays(self) -> int:
        """Rays of each simulation of a sweep: what was set by hand, else what the fidelity says."""
        return self.rays or self.fidelity.ranking_rays

    def set_rays(self, rays: int) -> None:
        """Trace with another number of rays; `BY_FIDELITY` leaves it to the fidelity."""
        self.rays = rays
        self.choose(self.values)

    def set_fidelity(self, level: Fidelity) -> None:
        """Trace and sweep as finely as this from now on; what is shown stays until it is asked for again."""
        self.fidelity = level
        self.revision += 1

    def set_curves(self, name: str) -> None:
        """Take other deformation curves: a key of `CURVES`, or the path of a file."""
        self.curves = name
        self.choose(self.values)

    def curves_text(self, name: str) -> str:
        """Return the words for a set of curves."""
        return CURVES.get(name) or Path(name).name

    def _traced(self, job: Job, key: tuple[Values, str, int, str]) -> None:
        found = self._outcome(job, DesignResult)
        if found is not None:
            self._kept[key] = found
            while len(self._kept) > KEPT:
                del self._kept[next(iter(self._kept))]
            if key == (self.values, self.face, self.traced_rays, self.curves):
                self.result = found

    def _outcome(self, job: Job, kind: type[T]) -> T | None:
        """Return what the work has brought; say why where it failed."""
        self.revision += 1
        if job.failure is not None:
            self.problem = job.failure.text
        return job.result if job.state is JobState.DONE and isinstance(job.result, kind) else None

    def scene(self) -> StateScene | None:
        """Return the state that the slider is on."""
        return self.result.scenes[self.state] if self.result is not None else None

    def state_text(self) -> str:
        """Return the slider's state in words."""
        words = f"state {self.state} of {STATES - 1}"
        if self.result is None:
            return words
        x = number(float(self.result.elongation_mm[self.state]), 2, sign=True)
        return f"{words}: {x} mm   {number(float(self.result.ndr[self.state]), 0)} of 250 rays detected"

    def design_text(self) -> str:
        """Return the design's figures in a line."""
        if self.problem:
            return f"\u25b2 {self.problem}"
        r = self.result
        if r is None:
            return "tracing \u2026" if self.tracing else ""
        return (
            f"range (\u0394) {number(r.delta, 1)} rays   {count(r.n_sign, 'rise')}   "
            f"roughness (RMSE) {number(r.rmse, 2)}   merit (P) {number(r.p, 2)}"
        )

    # ---- the sweep -----------------------------------------------------------------------------------------------

    def toggle_sweep(self) -> None:
        """Start a sweep over all designs, or stop the one under way."""
        if self.sweeping:
            self.jobs.cancel("sweep")
            return
        curves = self.curves
        job = Job("Sweeping 9 720 simulations", sweep, CAVITIES, self.swept_rays, curves)

        def swept(done: Job) -> None:
            found = self._outcome(done, SweepSummary)
            if found is not None:
                self._sweeps[curves] = found

        self.jobs.start("sweep", job, swept)
        self.revision += 1

    def sweep_text(self) -> str:
        """Return the sweep's outcome in a line."""
        s = self.sweep
        if s is None:
            return ""
        best = words(tuple(s.values[s.best]))
        paper = (
            f"   paper's optimum: rank {int(s.ranks[s.paper])}, {number(float(s.p[s.paper]), 2)} of the best's merit"
            if s.paper >= 0
            else ""
        )
        tied = int(s.tied.sum())
        return (
            f"{number(s.simulated, 0)} simulations of {number(s.rays, 0)} rays in {number(s.seconds, 1)} s   "
            f"best: {best}, {count(tied, 'design')} as good within the noise{paper}"
        )

    def pick(self, cavities: int, width_mm: float, column: float, row: float) -> None:
        """Look at the design of a cell of a map; the maps are of cavities in the outer face."""
        i, k = int(column), int(row)
        if 0 <= i < len(STEPS_MM) and 0 <= k < len(STEPS_MM):
            self.choose((cavities, width_mm, STEPS_MM[k], STEPS_MM[i]), FACES[0])

    # ---- the search ----------------------------------------------------------------------------------------------

    def toggle_search(self) -> None:
        """Start the search beyond the grid, or stop the one under way."""
        if self.searching:
            self.jobs.cancel("optimise")
            return
        curves = self.curves
        job = Job("Searching beyond the grid", search, curves, SEARCH_S)

        def searched(done: Job) -> None:
            found = self._outcome(done, OptimumSummary)
            if found is not None:
                self._optima[curves] = found

        self.jobs.start("optimise", job, searched)
        self.revision += 1

    def optimum_text(self) -> str:
        """Return what the search gained, in a line."""
        o = self.optimum
        if o is None:
            return ""
        end = "" if o.finished else "   (time ran out before it settled)"
        return (
            f"optimised: {words(o.values, 2)}, {o.face} face   {number(o.p / o.start_p, 2)} times the merit of the "
            f"grid's best (P on power: {number(o.p, 2)} against {number(o.start_p, 2)}){end}"
        )

    def look_at_optimum(self) -> None:
        """Look at the design that the search found."""
        if self.optimum is not None:
            self.choose(self.optimum.values, self.optimum.face)


def words(values: tuple[float, ...], decimals: int = 1) -> str:
    """Return a design as `5 cavities 1.0 x 0.5 mm, spacing 0.9 mm`."""
    n, (width, depth, spacing) = int(values[0]), (number(v, decimals) for v in values[1:4])
    return f"{n} cavities {width} \u00d7 {depth} mm, spacing {spacing} mm"
