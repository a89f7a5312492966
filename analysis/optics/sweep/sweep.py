"""All designs in all states: in threads here, or on a cluster, with the same bits.

Strategy: the frames of the states are computed once, then a work item is a few designs in all states, or one design in
some states where the rays are many: one compiled call of a second or less, after which a stop takes effect. A
simulation's result does not depend on which item, thread or machine computed it. Results are written as designs
finish; a sweep that was stopped reads the finished designs from its file.
"""

from __future__ import annotations

import hashlib
import importlib
import itertools
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.cluster import check_scheduler, connect
from analysis.compiled import compile_ahead
from analysis.optics.scene.curves import default_curves, frames_of
from analysis.optics.scene.frame import SceneFrame, check_design
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, PAPER_RAYS, STEPS_MM, By, Design, Face, Light, Waveguide
from analysis.optics.sweep.figure_of_merit import Merit, Uncertainty, merit, ranks_within, resolution, uncertainty
from analysis.optics.sweep.sweep_file import SweepFile
from analysis.optics.tracer.rays import Fan, Rules, fan_of, rules_of, share_of
from analysis.optics.tracer.simulation import Work, fan_sd, memory_of, simulate_many, stacked, states_of
from analysis.optics.tracer.tally import COUNTS, DETECTED, E_CUT, E_DETECTED, ENERGIES, HITS
from analysis.progress import Progress
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import ChoiceError, RequestError

Results = tuple[IntArray, FloatArray, FloatArray]
Common = tuple[SceneFrame, Rules, Fan, IntArray]
Item = tuple[FloatArray, slice]
FILE_NAME = "sweep.sqlite"
EVERY = slice(None)
_RAYS_PER_ITEM = 60_000
_POLL_S, _TRIES = 2.0, 5
"""How often a cluster without results is asked for its workers; tries of a task whose workers died four at a time."""


def paper_grid(cavities: Sequence[int] = (3, 5, 7), face: Face = "outer") -> list[Design]:
    """Return the paper's designs: width, depth and spacing 0.5 to 1.0 mm by 0.1, for each number of cavities."""
    return [Design(*values, face) for values in itertools.product(cavities, STEPS_MM, STEPS_MM, STEPS_MM)]


@dataclass(frozen=True, slots=True)
class SweepRequest:
    """Everything that determines a sweep's result.

    `curves`: (15, 2, points, 2) in mm; the shadow's states by default. `by`: what designs are ranked by, the number of
    detected rays or their power; see `parameters.light_by`.
    """

    designs: tuple[Design, ...] = field(default_factory=lambda: tuple(paper_grid()))
    guide: Waveguide = field(default_factory=Waveguide)
    light: Light = field(default_factory=Light)
    curves: FloatArray = field(default_factory=default_curves)
    by: By = "count"

    def described(self) -> dict[str, object]:
        """Return what a results file records and compares: all that determines a simulation but its design."""
        shape = np.ascontiguousarray(self.curves)
        return {
            "guide": asdict(self.guide),
            "light": {name: value for name, value in asdict(self.light).items() if (name, value) != ("jitter", None)},
            "states": len(shape),
            "curves_sha256": hashlib.sha256(shape.tobytes()).hexdigest(),
        }


@dataclass(frozen=True, slots=True)
class SweepResult:
    """Results of a sweep; first axis the designs (n), second the states (s)."""

    request: SweepRequest
    ndr: FloatArray  # with ndr_sd: (n, s) rays that reach the receiver scaled to 250, and their standard deviation
    ndr_sd: FloatArray
    power: FloatArray  # with power_sd: (n, s) detected power, emitted = 1, and its standard deviation
    power_sd: FloatArray
    mirrored: BoolArray  # (s,) whether a state is its own mirror image
    counts: IntArray  # with energy: (n, s, 10) and (n, s, 4) ledgers, see `sweep_file.COUNT_NAMES` and `tally.ENERGY`
    energy: FloatArray
    seconds: float  # with simulated: time taken by, and number of, the simulations of this run
    simulated: int

    @property
    def designs(self) -> tuple[Design, ...]:
        return self.request.designs

    @property
    def hits(self) -> int:
        return int(self.counts[..., HITS].sum())

    @property
    def floor(self) -> float:
        """Return the smallest RMSE that this fan resolves: its counts rise in twos where its halves are mirrored."""
        light = self.request.light
        in_pairs = light.shift == 0.0 and bool(np.all(self.mirrored))
        return float(resolution(light.rays)) * (2 if in_pairs else 1)

    @property
    def response(self) -> tuple[FloatArray, FloatArray]:
        """Return (n, s) what designs are ranked by and its standard deviation: counts, or power of 250 emitted."""
        by_count = self.request.by == "count"
        return (self.ndr, self.ndr_sd) if by_count else (PAPER_RAYS * self.power, PAPER_RAYS * self.power_sd)

    @property
    def given_up(self) -> FloatArray:
        """Return (n, s) the power that was not followed to an end: the detected power misses no more."""
        return np.asarray(self.energy[..., E_CUT])

    def merit(self) -> Merit:
        return merit(self.response[0], self.floor)

    def merit_of_power(self) -> Merit:
        """Return the same on detected power, whatever the designs are ranked by."""
        return replace(self, request=replace(self.request, by="power")).merit()

    def uncertainty(self) -> Uncertainty:
        """Return intervals of P and the designs that tie with the best."""
        return uncertainty(*self.response, self.floor)

    def ranks(self) -> IntArray:
        """Return (n,) the rank of each design by P, 1 the best; equal P share the better rank."""
        return ranks_within(self.merit().p, np.ones(len(self.designs), dtype=bool))

    def find(self, design: Design = PAPER_OPTIMUM) -> int | None:
        """Return the index of a design in whichever face it is cut, or None."""
        return find_design(self.designs, design)


def find_design(designs: Sequence[Design], design: Design = PAPER_OPTIMUM) -> int | None:
    """Return the index of the first design with the same cavities, in whichever face, or None."""
    return next((i for i, each in enumerate(designs) if each.values == design.values), None)


def common_of(frames: Sequence[SceneFrame], guide: Waveguide, light: Light) -> Common:
    """Return the common arguments of all work items of a sweep: stacked frames, rules, fan and its followed part."""
    shares = np.array([share_of(frame, light) for frame in frames])
    return stacked(frames), rules_of(guide, light), fan_of(light), shares


def run_item(common: Common, patterns: FloatArray, states: slice = EVERY) -> Results:
    """Simulate a few patterns in some states: the work item of a thread or of a cluster's worker.

    `patterns`: (p, 5) from `geometry.pattern_of`. `states`: all by default.
    Returns counts (p, s, 10), energy (p, s, 4), changes (p, s, 2) along the fan, in number and in power.
    """
    arguments = _arguments(common, patterns, states)
    simulate_many(*arguments)
    return arguments[-3:]


def compile_tracer(common: Common) -> None:
    """Compile what `run_item` calls, before a pool of threads does; see `compiled.compile_ahead`."""
    compile_ahead(simulate_many, *_arguments(common, np.array([pattern_of(PAPER_OPTIMUM)]), EVERY))


def _arguments(
    common: Common, patterns: FloatArray, states: slice
) -> tuple[SceneFrame, FloatArray, Rules, Fan, IntArray, Work, IntArray, FloatArray, FloatArray]:
    """Return the arguments of `simulate_many`; the last three are to be filled."""
    frames, rules, fan, shares = common
    frames, shares = states_of(frames, states), shares[states]
    shape = (len(patterns), len(frames.nodes))
    counts = np.zeros((*shape, COUNTS), dtype=np.int64)
    work = memory_of(frames, patterns, rules, fan.rays, shares)
    return frames, patterns, rules, fan, shares, work, counts, np.zeros((*shape, ENERGIES)), np.zeros((*shape, 2))


def run_sweep(
    request: SweepRequest,
    *,
    file: Path | None = None,
    scheduler: str | None = None,
    allow_remote: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SweepResult:
    """Simulate every design in every state.

    `file`: results file, written as results arrive; finished designs in it are not simulated again. `allow_remote`:
    whether the scheduler may be on another computer; see `analysis.cluster`.
    """
    if scheduler is not None:
        check_scheduler(scheduler, allow_remote=allow_remote)
    frames = frames_of(request.curves, request.guide)
    check_designs(request.designs, frames)
    store = SweepFile(file, request.described()) if file is not None else None
    done = store.read(len(frames)) if store is not None else {}
    todo = [d for d in dict.fromkeys(request.designs) if d not in done]
    started, finished = time.perf_counter(), len(request.designs) - len(todo)
    for designs, (counts, energy, changes) in _work(request, frames, todo, scheduler, threads):
        if store is not None:
            store.write(designs, counts, energy, changes)
        done.update(zip(designs, zip(counts, energy, changes, strict=True), strict=True))
        finished += len(designs)
        if progress is not None:
            progress(finished * len(frames), len(request.designs) * len(frames))
    mirrored = np.array([frame.mirrored for frame in frames])
    counts, energy, changes = map(np.stack, zip(*(done[d] for d in request.designs), strict=True))
    seconds, simulated = time.perf_counter() - started, len(todo) * len(frames)
    return result_of(request, mirrored, (counts, energy, changes), seconds, simulated)


def check_designs(designs: Sequence[Design], frames: Sequence[SceneFrame]) -> None:
    """Reject, by name, a design that does not fit one of the states.

    Raises RequestError: there are no designs, or one cuts through the guide or does not fit it.
    """
    if not designs:
        raise ChoiceError("a sweep without designs", "give at least one number of cavities")
    tightest = min(range(len(frames)), key=lambda s: frames[s].free_mm)
    for design in designs:
        check_design(frames[tightest], design, f"state {tightest}")


def result_of(
    request: SweepRequest, mirrored: BoolArray, results: Results, seconds: float = 0.0, simulated: int = 0
) -> SweepResult:
    """Return the result of simulations. `results`: results of `run_item` for all designs."""
    counts, energy, changes = results
    ndr = np.asarray(PAPER_RAYS / request.light.rays * counts[..., DETECTED], dtype=np.float64)
    sd, power_sd = fan_sd(np.moveaxis(changes, -1, 0), request.light, request.guide.thickness_mm, mirrored)
    power = energy[..., E_DETECTED], power_sd / PAPER_RAYS
    return SweepResult(request, ndr, sd, *power, mirrored, counts, energy, seconds, simulated)


def _work(
    request: SweepRequest,
    frames: Sequence[SceneFrame],
    todo: Sequence[Design],
    scheduler: str | None,
    threads: int | None,
) -> Iterator[tuple[Sequence[Design], Results]]:
    """Yield designs with their results in all states, in the order in which they finish."""
    common = common_of(frames, request.guide, request.light)
    size = max(1, min(16, _RAYS_PER_ITEM // (request.light.rays * len(frames))))
    some = max(1, min(len(frames), _RAYS_PER_ITEM // request.light.rays))
    groups = [todo[i : i + size] for i in range(0, len(todo), size)]
    parts = [slice(s, s + some) for s in range(0, len(frames), some)]
    items = [(np.array([pattern_of(d) for d in group]), part) for group in groups for part in parts]
    if scheduler is None:
        finished = _in_threads(common, items, threads or os.cpu_count() or 1)
    else:
        finished = _on_cluster(common, items, scheduler)
    waiting: dict[int, dict[int, Results]] = {}
    for number, results in finished:
        group, part = divmod(number, len(parts))
        done = waiting.setdefault(group, {})
        done[part] = results
        if len(done) == len(parts):
            whole = zip(*(each for _, each in sorted(waiting.pop(group).items())), strict=True)
            counts, energy, changes = (np.concatenate(each, axis=1) for each in whole)
            yield groups[group], (counts, energy, changes)


def _in_threads(common: Common, items: list[Item], threads: int) -> Iterator[tuple[int, Results]]:
    if items:
        compile_tracer(common)
    pool = ThreadPoolExecutor(threads)
    futures: dict[Future[Results], int] = {pool.submit(run_item, common, *item): i for i, item in enumerate(items)}
    try:
        yield from ((futures[future], future.result()) for future in as_completed(futures))
    finally:
        pool.shutdown(cancel_futures=True)


def _on_cluster(common: Common, items: list[Item], address: str) -> Iterator[tuple[int, Results]]:
    """Yield the results of a cluster, while it has a worker: what a lost one had is computed by another.

    `common` goes with every task: data that is scattered is lost with the workers that hold it.
    """
    library = importlib.import_module("distributed")
    with connect(address) as client:
        if not client.nthreads():
            raise _cluster_lost(f"the Dask scheduler at {address} has no worker")
        futures: dict[Any, int] = {}
        again = dict.fromkeys(range(len(items)), _TRIES)
        try:
            futures |= {client.submit(run_item, common, *item, pure=False): i for i, item in enumerate(items)}
            while futures:
                try:
                    finished = library.wait(list(futures), timeout=_POLL_S, return_when="FIRST_COMPLETED").done
                except TimeoutError:
                    if not client.nthreads():
                        raise
                    continue
                for future in finished:
                    number = futures.pop(future)
                    try:
                        results = future.result()
                    except library.KilledWorker:
                        again[number] -= 1
                        if not again[number]:
                            raise
                        futures[client.submit(run_item, common, *items[number], pure=False)] = number
                        continue
                    yield number, results
        except (TimeoutError, OSError, CancelledError, library.CancelledError, library.KilledWorker) as error:
            raise _cluster_lost(f"the Dask scheduler at {address}, or its workers, were lost") from error
        finally:
            client.cancel(list(futures))


def _cluster_lost(cause: str) -> RequestError:
    """Return the error of a cluster that computes no longer."""
    remedy = "start a worker, or repeat the sweep on this computer into the same folder: finished designs are kept"
    return RequestError(cause, remedy, command="dask worker, or omit --scheduler and keep --out")
