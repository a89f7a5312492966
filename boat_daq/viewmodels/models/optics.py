"""The optics page: a design's rays in the 15 states, and the sweep over all designs.

Rules: rays are traced in helper processes; the states of a design arrive together, so that the slider only selects.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from analysis.fidelity import Fidelity, fidelity
from analysis.numbers import rounded, with_uncertainty
from analysis.optics.scene.parameters import STATES, STEPS_MM
from analysis.progress import Progress, part_of
from boat_daq.engine.toml_values import read_json
from boat_daq.formatting import count, number
from boat_daq.viewmodels.common.notices import Notices, Severity, sentence
from boat_daq.workflows.jobs import Job, JobRunner, JobState
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import RequestError
from protocol.base.whole_file import write_whole

if TYPE_CHECKING:
    from analysis.optics.scene.frame import SceneFrame
    from analysis.optics.scene.parameters import Design, Light, Waveguide
    from analysis.optics.sweep.figure_of_merit import Merit


# with the paper's 250 rays and the default curves, as `sweep(CAVITIES, 250)` returns it (nightly test)
SHIPPED = Path(__file__).with_name("swept_designs.json")
_COLUMNS = ("cavities", "width_mm", "depth_mm", "spacing_mm", "delta", "n_sign", "rmse", "p", "tied", "rank")
_TEXTS = ("rays", "simulated", "rank_text", "winners", "fans", "error_text")


def shipped_sweep() -> SweepSummary:
    from analysis.optics.sweep.figure_of_merit import Merit

    stored: dict[str, Any] = read_json(SHIPPED)
    rows = np.array(stored["designs"])
    delta, n_sign, rmse, p, tied, ranks = rows[:, 4:].T
    unknown = np.full(len(rows), np.nan)
    merit = Merit(unknown, delta, n_sign, rmse, unknown, p, n_sign == 0, np.zeros(len(rows), dtype=bool))
    texts = {name: stored[name] for name in _TEXTS}
    best, ends = int(np.argmax(p)), stored["paper"]
    found = rows[:, :4], merit, tied.astype(bool), best, ends, ranks.astype(int)
    return SweepSummary(*found, seconds=0.0, **texts)


def store_sweep(sweep: SweepSummary, path: Path) -> None:
    """Write a sweep as it ships."""
    m = sweep.merit
    columns = (*sweep.values.T, m.delta, m.n_sign, m.rmse, m.p, sweep.tied, sweep.ranks)
    rows = [[float(f"{value:.7g}") for value in row] for row in zip(*columns, strict=True)]
    lines = ",\n".join(json.dumps(row) for row in rows)
    head = json.dumps({"columns": _COLUMNS, "paper": sweep.paper} | {name: getattr(sweep, name) for name in _TEXTS})
    write_whole(path, f'{head[:-1]}, "designs": [\n{lines}\n]}}\n')


Values = tuple[int, float, float, float]
"""Cavities, width, depth, spacing (mm) of a design."""
_Key = tuple[Values, str, int]  # of a traced design: with its face and rays
_GAP = np.full((1, 2), np.nan)
CAVITIES = (3, 5, 7)
MORE_RAYS = (1_000, 2_500, 10_000, 25_000, 100_000)  # of the next sweep
PAPER_DESIGN: Values = (5, 1.0, 0.5, 0.9)
FACE_NAMES = {"outer": "Outer face", "inner": "Inner face", "both": "Both faces", "midline": "Voids inside"}
MAPPED_FACE = next(iter(FACE_NAMES))
"""Face of the designs that a sweep maps."""
_KEPT = 12
DRAWN_RAYS = 250
"""Most rays that are drawn of a state; more of them only blacken the picture."""
STOPPED = "The tracing was stopped. Choose the design again to trace it."
_BEFORE = "previous design shown"


class StateScene(NamedTuple):
    """One state, mm along and across the actuator: polylines [k, 2] with NaN between their parts."""

    outline: FloatArray
    released: FloatArray
    secondary: FloatArray
    receiver: FloatArray


@dataclass(frozen=True, slots=True)
class DesignResult:
    """One design in all states; `ndr` counts rays of 250, with standard deviation and error (k = 2) of each state."""

    scenes: tuple[StateScene, ...]
    elongation_mm: FloatArray
    ndr: FloatArray
    ndr_sd: FloatArray
    merit: Merit
    error: FloatArray
    rays: int


@dataclass(frozen=True, slots=True)
class SweepSummary:
    """A sweep of designs.

    Parameters
    ----------
    values : [n, 4] cavities, width, depth, spacing. merit, tied, ranks : [n].
    best, paper : index of the best design and of the paper's, -1 without it.
    seconds, simulated, rays : duration, number of simulations, rays of each.
    rank_text, winners, fans : rank of the paper's optimum, and designs that win one of the turns of the fan.
    error_text : errors of the counts.
    """

    values: FloatArray
    merit: Merit
    tied: FloatArray
    best: int
    paper: int
    ranks: IntArray
    seconds: float
    simulated: int
    rays: int
    rank_text: str = ""
    winners: int = 0
    fans: int = 1
    error_text: str = ""

    def strip(self) -> tuple[IntArray, FloatArray]:
        """Return the designs by falling figure of merit, as indices, and that figure, best = 1."""
        order = np.argsort(-self.merit.p_normalised, kind="stable")
        return order, self.merit.p_normalised[order]

    def grid(self, cavities: int, width_mm: float, steps: tuple[float, ...]) -> FloatArray:
        """Return P, best = 1, over [spacing, depth] (mm) for a number of cavities and a width; NaN where unknown."""
        out = np.full((len(steps), len(steps)), np.nan)
        chosen = (self.values[:, 0] == cavities) & np.isclose(self.values[:, 1], width_mm)
        depth, spacing = (np.abs(self.values[chosen, k, None] - np.array(steps)).argmin(axis=1) for k in (2, 3))
        out[spacing, depth] = self.merit.p_normalised[chosen]
        return out


def trace_design(values: Values, rays: int, face: str = "outer", *, progress: Progress | None = None) -> DesignResult:
    """Return the rays and the response in every state of a design; `rays` is the number in each."""
    from analysis.optics.scene.curves import default_curves, elongations, frames_of
    from analysis.optics.scene.parameters import Design, Waveguide, light_by
    from analysis.optics.sweep.figure_of_merit import merit, resolution
    from analysis.optics.tracer.simulation import trace
    from analysis.optics.tracer.tolerance import stated_error

    design = Design(*values, face)  # type: ignore[arg-type]  # Design checks the face
    guide, light = Waveguide(), light_by("count", rays)
    frames, counts = frames_of(default_curves(), guide), []
    for done, frame in enumerate(frames):
        outcome = trace(frame, design, guide, light, progress=part_of(progress, done, 1, len(frames)))
        counts.append((outcome.ndr, outcome.ndr_sd))
        if progress is not None:
            progress(done + 1, len(frames))
    ndr, ndr_sd = np.array(counts).T
    scenes = tuple(_scene(frame, design, guide, light) for frame in frames)
    found, error = merit(ndr, resolution(light.rays)), stated_error(ndr_sd, light.rays)
    return DesignResult(scenes, np.asarray(elongations()), ndr, ndr_sd, found, error, light.rays)


def _scene(frame: SceneFrame, design: Design, guide: Waveguide, light: Light) -> StateScene:
    from analysis.optics.scene.outline import laid, outline
    from analysis.optics.tracer.simulation import ray_paths

    shape = outline(frame, design)
    rings = [laid(frame, contour.sampled()) for contour in shape.contours]
    drawn = ray_paths(frame, design, guide, light, released_rays=DRAWN_RAYS)
    paths = [(p.secondary, laid(frame, p.points)) for p in drawn]
    released, secondary = (_joined([line for second, line in paths if second is kind]) for kind in (False, True))
    receiver = laid(frame, shape.receiver) if np.isfinite(shape.receiver[0, 0]) else _GAP
    return StateScene(_joined([np.concatenate([r, r[:1]]) for r in rings]), released, secondary, receiver)


def _joined(lines: Sequence[FloatArray]) -> FloatArray:
    """Return polylines as one, a NaN between them."""
    return np.concatenate([part for line in lines for part in (line, _GAP)]) if lines else _GAP


def sweep(cavities: tuple[int, ...], rays: int, *, progress: Progress | None = None) -> SweepSummary:
    """Return the sweep of the paper's grid of designs with a number of rays."""
    from analysis.optics.scene.curves import default_curves
    from analysis.optics.scene.parameters import PAPER_OPTIMUM, light_by
    from analysis.optics.sweep.fans import compare_fans, fans_of
    from analysis.optics.sweep.report import error_text, rank_text
    from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep

    light = light_by("count", rays)
    request = SweepRequest(tuple(paper_grid(cavities)), light=light, curves=default_curves())
    fans, size = fans_of(light.rays), len(request.designs) * len(request.curves)
    result = run_sweep(request, progress=part_of(progress, 0, size, fans * size))
    turned = compare_fans(result, fans, progress=part_of(progress, size, (fans - 1) * size, fans * size))
    found = result.merit()
    paper = result.find(PAPER_OPTIMUM)
    values = np.array([d.values[:4] for d in result.designs], dtype=float)
    return SweepSummary(
        values, found, result.uncertainty().tied, int(np.argmax(found.p)), -1 if paper is None else paper,
        result.ranks(), result.seconds, result.simulated, light.rays, rank_text(turned), len(turned.winners()), fans,
        error_text(result),
    )  # fmt: skip


class OpticsModel:
    def __init__(self, jobs: JobRunner, notices: Notices) -> None:
        self.jobs, self.notices = jobs, notices
        self.values: Values = PAPER_DESIGN
        self.face = MAPPED_FACE
        self.state = STATES // 2
        self.fidelity: Fidelity = fidelity()
        self.result: DesignResult | None = None
        self.problem = ""  # why the chosen design has no result
        self.blocked = ""  # why none is traced now
        self.waits = False  # whether the chosen design waits until nothing blocks it
        self.sweep_problem = ""  # why the last sweep has none
        self.revision = 0
        self._kept: dict[_Key, DesignResult] = {}
        self.sweep: SweepSummary | None = None
        self._shown = self._key()  # of the result

    def show_shipped(self, load: Callable[[], SweepSummary]) -> None:
        """Show the sweep that ships with the program until another one is made."""
        if self.sweep is None:
            self.sweep = load()
            self.revision += 1

    def running(self, name: str) -> bool:
        """Return whether rays are traced: of one design ("optics"), or of a "sweep"."""
        return self.jobs.get(name) is not None

    def choose(self, values: Values, face: str = "") -> None:
        """Show a design; a new one is traced in the background, and the one before is shown until it is."""
        self.values, self.face, self.problem, self.waits = values, face or self.face, "", False
        key = self._key()
        self.revision += 1
        if key in self._kept:
            self.result, self._shown = self._kept[key], key
            return
        if self.blocked:
            self.problem, self.waits = self.blocked, True
            return
        job = Job("Tracing rays", trace_design, values, self.fidelity.rays, self.face)
        self.jobs.start("optics", job, lambda job: self._traced(job, key))

    def _traced(self, job: Job, key: _Key) -> None:
        """Keep a traced design; show it, or why there is none, if it is still the chosen one."""
        self.revision += 1
        if job.state is JobState.DONE:
            self._kept[key] = job.result
            while len(self._kept) > _KEPT:
                del self._kept[next(iter(self._kept))]
        if key != self._key():
            return
        if job.state is JobState.DONE:
            self.result, self._shown = job.result, key
        else:
            self.problem = self._reported(job) or STOPPED

    @property
    def outdated(self) -> bool:
        """Whether the shown result is of the design before: the chosen one is being traced, or has no result."""
        waits = self.running("optics") or bool(self.problem)
        return self.result is not None and waits and self._shown != self._key()

    def _key(self) -> _Key:
        return self.values, self.face, self.fidelity.rays

    def set_fidelity(self, level: Fidelity) -> None:
        """Set the precision of the next traces and sweeps; a trace that is running begins again."""
        self.fidelity = level
        self.revision += 1
        if self.running("optics"):
            self.choose(self.values)

    def scene(self) -> StateScene | None:
        return self.result.scenes[self.state] if self.result is not None else None

    def state_text(self) -> str:
        text = f"state {self.state} of {STATES - 1}"
        if self.result is None:
            return text
        x = number(float(self.result.elongation_mm[self.state]), 2, sign=True)
        value, error = float(self.result.ndr[self.state]), float(self.result.error[self.state])
        detected = f"{with_uncertainty(value, error)} of 250 rays detected (k = 2)"
        before = "previous design   " if self.outdated else ""  # first: it is not cut
        return f"{before}{text}: {x} mm   {detected}, {number(self.result.rays, 0)} traced"

    def drawn_text(self) -> str:
        """Return how many of the rays are drawn, where it is not all of them."""
        rays = self.result.rays if self.result is not None else 0
        return f"{DRAWN_RAYS} of {number(rays, 0)} rays drawn" if rays > DRAWN_RAYS else ""

    def design_text(self) -> str:
        """Return the design's figures in a line, or why they are not there yet."""
        r, before = self.result, f"   {_BEFORE}" if self.outdated else ""
        if self.problem:
            return f"\u25b2 {self.problem}{before}" if r is not None else ""  # else it is in place of the plot
        if r is None or self.outdated:
            return self._progress_text() + before
        m, increases = r.merit, count(int(r.merit.n_sign), "increase")
        range_, rms, merit = number(float(m.delta), 1), number(float(m.rmse), 2), number(float(m.p), 2)
        figures = f"range {range_} rays   {increases}   rms residual {rms} rays   P {merit}"
        greatest = float(np.max(r.error))
        return f"{figures}   band up to \u00b1{rounded(greatest, greatest)} (k = 2)"

    def _progress_text(self) -> str:
        """Return how much of the running trace is done."""
        job = self.jobs.get("optics")
        compiling = self.jobs.get("compiled code")
        if job is not None and job.fraction is None and compiling is not None:
            return compiling.counted or compiling.label
        done = "" if job is None or job.fraction is None else f" {number(100 * job.fraction, 0)} %"
        return "" if job is None else f"tracing \u2026{done}"

    def waiting_text(self, drawn: str) -> str:
        """Return what is being done before a plot has anything to show, and what it will draw."""
        if self.problem:
            return self.problem
        return f"{drawn} appear here. {sentence(self._progress_text() or 'Not traced yet')}"

    def toggle_sweep(self, rays: int = 0) -> None:
        """Start a sweep over all designs with this number of rays, 0 for the precision's; or stop the running one."""
        if self.running("sweep"):
            self.jobs.cancel("sweep")
            return
        if self.blocked:
            raise RequestError("nothing is traced under pressure", "Wait until the unit is vented.")
        self.sweep_problem = ""
        job = Job("Sweeping 9 720 simulations", sweep, CAVITIES, rays or self.fidelity.ranking_rays)
        self.jobs.start("sweep", job, self._swept)
        self.revision += 1

    @property
    def more_rays(self) -> int:
        """The next larger number of rays of a sweep; 0 without a sweep."""
        s = self.sweep
        return 0 if s is None else next((rays for rays in MORE_RAYS if rays > s.rays), 4 * s.rays)

    def best_text(self) -> str:
        s = self.sweep
        return "" if s is None else design_label(tuple(s.values[s.best]))

    def paper_text(self) -> str:
        """Return the paper's design and its share of the best figure of merit."""
        s = self.sweep
        if s is None or s.paper < 0:
            return ""
        share = number(100 * float(s.merit.p_normalised[s.paper]), 0)
        return f"{design_label(tuple(s.values[s.paper]))}   {share} % of the best figure of merit"

    def certainty_text(self) -> str:
        """Return how many designs cannot be told from the best, and whether the paper's is one of them."""
        s = self.sweep
        if s is None:
            return ""
        others, rays = int(s.tied.sum()) - 1, f"{number(s.rays, 0)} rays"
        if others < 1:
            return f"The best can be told from all other designs with {rays}."
        among = s.paper >= 0 and s.paper != s.best and bool(s.tied[s.paper])
        paper = " The paper's is one of them." if among else ""
        return f"{count(others, 'design')} of {len(s.tied)} cannot be told from the best with {rays}.{paper}"

    def show_best(self) -> None:
        if self.sweep is not None:
            self._show_design(self.sweep, self.sweep.best)

    def show_paper(self) -> None:
        self.choose(PAPER_DESIGN, MAPPED_FACE)

    def show_place(self, place: int) -> None:
        """Show the design at a place of the strip, from 1."""
        s = self.sweep
        if s is not None and 1 <= place <= len(s.values):
            self._show_design(s, int(s.strip()[0][place - 1]))

    def _show_design(self, s: SweepSummary, index: int) -> None:
        n, width, depth, spacing = (float(v) for v in s.values[index])
        self.choose((int(n), width, depth, spacing), MAPPED_FACE)

    def _swept(self, job: Job) -> None:
        self.revision += 1
        if job.failure is not None:
            self.sweep_problem = self._reported(job)
        elif job.state is JobState.DONE:
            self.sweep = job.result

    def _reported(self, job: Job) -> str:
        """Add the failure of a job to the notices and return it as text; nothing for a cancelled one."""
        failure = job.failure
        if failure is None:
            return ""
        self.notices.add(Severity.WARNING, failure.cause, failure.remedy, details=failure.details)
        return failure.text

    def sweep_text(self) -> str:
        """Return the details of the sweep in lines: its size, the paper's ranks, the turns, and the errors."""
        s = self.sweep
        if s is None:
            return ""
        when = f"in {number(s.seconds, 1)} s" if s.seconds else "(shipped with the program)"
        lines = [f"{number(s.simulated, 0)} simulations of {number(s.rays, 0)} rays {when}"]
        if s.paper >= 0:
            lines.append(f"Paper's rank: {s.rank_text or s.ranks[s.paper]}")
        if s.fans > 1:
            best = f"{count(s.winners, 'design')} best in at least one"
            lines.append(f"{best} of {s.fans} sweeps, each with its rays turned")
        return "\n".join([*lines, *([sentence(s.error_text).removesuffix(".")] if s.error_text else [])])

    def pick(self, cavities: int, width_mm: float, column: float, row: float) -> None:
        """Show the design of a cell of a map; the maps are of cavities in the outer face."""
        i, k = int(column), int(row)
        if 0 <= i < len(STEPS_MM) and 0 <= k < len(STEPS_MM):
            self.choose((cavities, width_mm, STEPS_MM[k], STEPS_MM[i]), MAPPED_FACE)


def design_label(values: tuple[float, ...]) -> str:
    """Return a design as `5 cavities, 1.0 \u00d7 0.5 mm, spacing 0.9 mm`."""
    n, (width, depth, spacing) = int(values[0]), (number(v, 1) for v in values[1:4])
    return f"{n} cavities, {width} \u00d7 {depth} mm, spacing {spacing} mm"
