"""All designs in all states: in threads here, or on a cluster, with the same bits.

Strategy: the frames of the states are worked out once, then a work item is a few designs in all states, one compiled
call. A simulation's result does not depend on which item, thread or machine it fell to. Results are written as they
come; a sweep that was stopped takes the finished designs from its file.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.dask_address import check_scheduler
from analysis.errors import RequestError
from analysis.optics.scene.curves import default_curves, frames_of
from analysis.optics.scene.frame import Frame, check_row
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Face, Light, Waveguide
from analysis.optics.sweep.figure_of_merit import Merit, Uncertainty, merit, resolution, uncertainty
from analysis.optics.sweep.sweep_file import SweepFile
from analysis.optics.tracer.rays import DETECTED, ENERGIES, HITS, TALLIES, Rules
from analysis.optics.tracer.simulation import Fan, Stack, fan_of, rules_of, simulate_many, stacked

Progress = Callable[[float, float], None]
Results = tuple[IntArray, FloatArray, FloatArray]
Common = tuple[Stack, Rules, Fan, int]
STEPS_MM = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
FILE_NAME = "sweep.sqlite"
_RAYS_AN_ITEM = 60_000
_CONNECT_S = 10.0


def paper_grid(cavities: Sequence[int] = (3, 5, 7), face: Face = "outer") -> list[Design]:
    """The paper's designs: width, depth and spacing 0.5 to 1.0 mm by 0.1, for each number of cavities."""
    return [
        Design(n, width, depth, spacing, face)
        for n in cavities
        for width in STEPS_MM
        for depth in STEPS_MM
        for spacing in STEPS_MM
    ]


@dataclass(frozen=True, slots=True)
class SweepRequest:
    """Everything that decides a sweep's result.

    Parameters
    ----------
    designs : what is simulated.
    guide, light : see `parameters.py`.
    curves : [15][2][points][2] in mm; the shadow's states by default.
    """

    designs: tuple[Design, ...] = field(default_factory=lambda: tuple(paper_grid()))
    guide: Waveguide = field(default_factory=Waveguide)
    light: Light = field(default_factory=Light)
    curves: FloatArray = field(default_factory=default_curves)

    def described(self) -> dict[str, object]:
        """What a results file records and compares: all but the designs."""
        shape = np.ascontiguousarray(self.curves)
        return {
            "guide": asdict(self.guide),
            "light": asdict(self.light),
            "states": len(shape),
            "curves_sha256": hashlib.sha256(shape.tobytes()).hexdigest(),
        }


@dataclass(frozen=True, slots=True)
class SweepResult:
    """What a sweep found; first axis the designs, second the states.

    Parameters
    ----------
    ndr, ndr_sd : rays that reach the receiver scaled to 250, and their standard deviation.
    power : detected power, emitted = 1.
    counts, energy : ledgers, see `sweep_file.COUNTS` and `simulation.ENERGY`.
    seconds : taken by what was simulated now; `simulated` says how many.
    """

    request: SweepRequest
    ndr: FloatArray
    ndr_sd: FloatArray
    power: FloatArray
    counts: IntArray
    energy: FloatArray
    seconds: float
    simulated: int

    @property
    def designs(self) -> tuple[Design, ...]:
        """The designs, in the order of the arrays."""
        return self.request.designs

    @property
    def hits(self) -> int:
        """Surfaces met in the whole sweep."""
        return int(self.counts[..., HITS].sum())

    @property
    def floor(self) -> float:
        """Smallest RMSE that this number of rays resolves."""
        return float(resolution(self.request.light.rays))

    def merit(self) -> Merit:
        """Figures of merit of all designs on counted rays."""
        return merit(self.ndr, self.floor)

    def merit_of_power(self) -> Merit:
        """The same on detected power, scaled to 250 rays of power 1."""
        return merit(250.0 * self.power, self.floor)

    def uncertainty(self) -> Uncertainty:
        """Intervals of P and the designs that tie with the best."""
        return uncertainty(self.ndr, self.ndr_sd, self.floor)

    def ranks(self) -> IntArray:
        """(n,) rank of each design by P, 1 the best; equal P share the better rank."""
        p = self.merit().p
        return np.asarray(1 + np.sum(p[None, :] > p[:, None], axis=1))

    def find(self, design: Design = PAPER_OPTIMUM) -> int | None:
        """Index of a design, or None."""
        return self.designs.index(design) if design in self.designs else None


def run_item(stack: Stack, rules: Rules, fan: Fan, budget: int, patterns: FloatArray) -> Results:
    """Simulate a few patterns in all states: what a thread or a cluster's worker is given."""
    shape = (len(patterns), len(stack.nodes))
    counts = np.zeros((*shape, TALLIES), dtype=np.int64)
    energy, changes = np.zeros((*shape, ENERGIES)), np.zeros(shape)
    simulate_many(stack, patterns, rules, fan, budget, counts, energy, changes)
    return counts, energy, changes


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

    Parameters
    ----------
    request : what to simulate.
    file : results file, written as results come; finished designs in it are not simulated again.
    scheduler : address of a Dask scheduler; None runs here.
    allow_remote : whether the scheduler may be on another computer; see `analysis.dask_address`.
    threads : how many cores to use here; all by default.
    progress : called with (simulations done, all); raising from it stops the sweep, what is finished stays in the file.

    Raises
    ------
    RequestError : a design does not fit, the scheduler does not answer, or the file belongs to another sweep.
    DataError : a state cannot be built.
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
    return _result(request, done, time.perf_counter() - started, len(todo) * len(frames))


def check_designs(designs: Sequence[Design], frames: Sequence[Frame]) -> None:
    """Refuse, by name, a design that does not fit one of the states.

    Raises
    ------
    RequestError : there are no designs, or one cuts through the guide or does not fit it.
    """
    if not designs:
        raise RequestError("a sweep without designs", "name at least one number of cavities")
    tightest = min(range(len(frames)), key=lambda s: frames[s].free_mm)
    for design in designs:
        if design.cavities:
            check_row(frames[tightest], design.row_mm, design.depth_mm, f"state {tightest}")


def _result(request: SweepRequest, done: dict[Design, Results], seconds: float, simulated: int) -> SweepResult:
    counts = np.stack([done[d][0] for d in request.designs])
    energy = np.stack([done[d][1] for d in request.designs])
    changes = np.stack([done[d][2] for d in request.designs])
    rays = request.light.rays
    scale = 250.0 / rays
    sd = np.asarray(scale * np.sqrt(changes * rays / (2 * max(rays - 1, 1))), dtype=np.float64)
    ndr = np.asarray(scale * counts[..., DETECTED], dtype=np.float64)
    return SweepResult(request, ndr, sd, energy[..., 0], counts, energy, seconds, simulated)


def _work(
    request: SweepRequest, frames: Sequence[Frame], todo: Sequence[Design], scheduler: str | None, threads: int | None
) -> Iterator[tuple[Sequence[Design], Results]]:
    """Yield finished work items in the order in which they finish."""
    common = (
        stacked(frames),
        rules_of(request.guide, request.light, frames[0]),
        fan_of(request.light, frames[0]),
        request.light.secondary,
    )
    size = max(1, min(16, _RAYS_AN_ITEM // (request.light.rays * len(frames))))
    items = [todo[i : i + size] for i in range(0, len(todo), size)]
    patterns = [np.array([pattern_of(d) for d in item]) for item in items]
    if scheduler is None:
        yield from _in_threads(common, items, patterns, threads or os.cpu_count() or 1)
    else:
        yield from _on_cluster(common, items, patterns, scheduler)


def _in_threads(
    common: Common, items: list[Sequence[Design]], patterns: list[FloatArray], threads: int
) -> Iterator[tuple[Sequence[Design], Results]]:
    pool = ThreadPoolExecutor(threads)
    futures: dict[Future[Results], int] = {pool.submit(run_item, *common, p): i for i, p in enumerate(patterns)}
    try:
        for future in as_completed(futures):
            yield items[futures[future]], future.result()
    finally:
        pool.shutdown(cancel_futures=True)


def _on_cluster(
    common: Common, items: list[Sequence[Design]], patterns: list[FloatArray], address: str
) -> Iterator[tuple[Sequence[Design], Results]]:
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        raise RequestError("running on a cluster needs Dask", "install boat-daq with its extra 'cluster'") from error
    try:
        client = distributed.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:
        raise RequestError(
            f"no Dask scheduler answers at {address}",
            "start one with `dask scheduler` and give its address, as tcp://HOST:8786",
        ) from error
    with client:
        shared = client.scatter(common, broadcast=True)
        futures = {client.submit(_on_worker, shared, p, pure=False): i for i, p in enumerate(patterns)}
        try:
            for future in distributed.as_completed(list(futures)):
                yield items[futures[future]], future.result()
        finally:
            client.cancel(list(futures))


def _on_worker(common: Common, patterns: FloatArray) -> Results:
    return run_item(*common, patterns)
