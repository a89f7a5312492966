"""The optics page: a design's rays over the 15 states, and the sweep over all designs.

Rules: tracing and sweeping happen in a helper process; a design's states come all at once, so that the slider only
shows what is there. A design that was traced is kept and not traced again.
"""

from __future__ import annotations

from boat_daq.viewmodels.formatting import number
from boat_daq.viewmodels.optics_results import DesignResult, StateScene, SweepSummary
from boat_daq.viewmodels.work import Bench, Work, WorkState

Values = tuple[int, float, float, float]
STEPS_MM = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
CAVITIES = (3, 5, 7)
PAPER: Values = (5, 1.0, 0.5, 0.9)
STATES = 15
RAYS = (250, 1000, 2500)
KEPT = 12


class OpticsModel:
    """State of the page.

    Parameters
    ----------
    bench : where rays are traced.
    """

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.values: Values = PAPER
        self.state = STATES // 2
        self.rays = RAYS[0]
        self.result: DesignResult | None = None
        self.sweep: SweepSummary | None = None
        self.problem = ""
        self.revision = 0
        self._kept: dict[tuple[Values, int], DesignResult] = {}

    @property
    def tracing(self) -> bool:
        """Whether rays are on their way."""
        return self.bench.get("optics") is not None

    @property
    def sweeping(self) -> bool:
        """Whether a sweep is under way."""
        return self.bench.get("sweep") is not None

    def choose(self, values: Values) -> None:
        """Look at a design, traced in the background where it is new."""
        self.values, self.problem = values, ""
        self.result = self._kept.get((values, self.rays))
        self.revision += 1
        if self.result is None:
            name = "boat_daq.viewmodels.optics_work:trace_design"
            self.bench.start("optics", Work("Tracing rays", name, values, self.rays, report=True), self._traced)

    def set_rays(self, rays: int) -> None:
        """Trace with another number of rays."""
        self.rays = rays
        self.choose(self.values)

    def _traced(self, work: Work) -> None:
        if work.state is WorkState.DONE:
            self.result = work.result
            self._kept[(work.result.values, self.rays)] = work.result
            while len(self._kept) > KEPT:
                del self._kept[next(iter(self._kept))]
        elif work.failure is not None:
            self.problem = f"{work.failure.cause}. {work.failure.remedy}".strip()
        self.revision += 1

    def scene(self) -> StateScene | None:
        """Return the state that the slider is on."""
        return self.result.scenes[self.state] if self.result is not None else None

    def state_text(self) -> str:
        """Return the slider's state in words."""
        words = f"state {self.state} of 0 to {STATES - 1}"
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
            f"\u0394 = {number(r.delta, 1)}   n_sign = {r.n_sign}   RMSE = {number(r.rmse, 2)}   P = {number(r.p, 2)}"
            + ("   monotone" if r.n_sign == 0 else "")
        )

    def toggle_sweep(self) -> None:
        """Start a sweep over all designs, or stop the one under way."""
        if self.sweeping:
            self.bench.cancel("sweep")
            return
        name = "boat_daq.viewmodels.optics_work:sweep"
        work = Work("Sweeping 9 720 simulations", name, CAVITIES, self.rays, report=True)
        self.bench.start("sweep", work, self._swept)
        self.revision += 1

    def _swept(self, work: Work) -> None:
        if work.state is WorkState.DONE:
            self.sweep = work.result
        elif work.failure is not None:
            self.problem = f"{work.failure.cause}. {work.failure.remedy}".strip()
        self.revision += 1

    def sweep_text(self) -> str:
        """Return the sweep's outcome in a line."""
        s = self.sweep
        if s is None:
            return ""
        best = words(tuple(s.values[s.best]))
        paper = (
            f"   paper's optimum: rank {int(s.ranks[s.paper])}, P {number(float(s.p[s.paper]), 2)}"
            if s.paper >= 0
            else ""
        )
        tied = int(s.tied.sum())
        return (
            f"{number(s.simulated, 0)} simulations in {number(s.seconds, 1)} s   best: {best}, tied with {tied}{paper}"
        )

    def pick(self, cavities: int, width_mm: float, column: float, row: float) -> None:
        """Look at the design of a cell of a map."""
        i, k = int(column), int(row)
        if 0 <= i < len(STEPS_MM) and 0 <= k < len(STEPS_MM):
            self.choose((cavities, width_mm, STEPS_MM[k], STEPS_MM[i]))


def words(values: tuple[float, ...]) -> str:
    """Return a design as `5 x 1.0 x 0.5, spacing 0.9 mm`."""
    cavities, width, depth, spacing = values[:4]
    return f"{int(cavities)} \u00d7 {width:.1f} \u00d7 {depth:.1f}, spacing {spacing:.1f} mm"
