"""From a scene and its light to counts and powers: releasing the fan, following secondaries, many scenes in a row.

Strategy: released rays are followed in blocks of fixed size, each with its own tally and queue; blocks are joined in
their order, whichever thread computed them, so that one core, many cores and a cluster give the same bits.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from analysis.compiled import compile_ahead, compiled, inside, interpreted, pointers
from analysis.optics.scene.frame import NO_CELL, SceneFrame
from analysis.optics.scene.geometry import Geometry, allocate, build, geometry_of
from analysis.optics.scene.parameters import ALL, PAPER_RAYS, Design, Light, Waveguide
from analysis.optics.tracer import tally as ledger
from analysis.optics.tracer.budget import (
    Queue,
    begin_secondaries,
    has_secondary,
    latest_secondary,
    merge,
    new_queue,
    next_secondary,
    open_queue,
    prune,
)
from analysis.optics.tracer.rays import Fan, Ray, Rules, fan_of, released, rules_of, share_of
from analysis.optics.tracer.tally import COUNTS, DETECTED, Tally, add_tally, add_twins, clear, new_tally
from analysis.optics.tracer.tracer import follow
from analysis.progress import Progress
from protocol.base.arrays import BoolArray, FloatArray, IntArray

BLOCK = 4096
CORRELATION_DEG_PER_MM2 = 0.03
"""Over this angle, times the thickness squared, neighbouring rays end alike: fitted to counts, see METHODS.md."""
_SURE, _LEAST_ALIKE, _SMALL_STEP, _LARGE_STEP, _HALVINGS = 2.0, 0.001, 1e-3, 1e3, 40
_QUICK_SUM = 1_000  # a sum along a fan of as many rays is no work for Python
_OF_ALL = 4  # rays that are followed of each released one where all are
_SCALARS = ("half_mm", "source_cell")  # of a frame, the same in every state


_left = [2_000]  # rays that Python may still follow in this process: as many as take the time of loading machine code


@dataclass(frozen=True, slots=True)
class TraceResult:
    """One simulation."""

    ledger: dict[str, int]  # rays by their end; released is the sum of the others
    energy: dict[str, float]  # parts of the emitted power by their end; they sum to 1
    hits: int
    granted: int  # with refused: secondaries that were followed, and that were beyond the budget
    refused: int
    ndr: float  # rays that reach the receiver, secondaries included, scaled to 250 emitted
    ndr_sd: float  # its standard deviation, see `fan_sd`; NaN for a single ray
    power: float  # with power_sd: detected power, emitted = 1, and its standard deviation
    power_sd: float


@inside
def _follow_block(
    g: Geometry, rules: Rules, fan: Fan, first: int, budget: int, q: Queue, tally: Tally, last: bool
) -> None:
    """Follow one block of released rays; secondaries within a budget are left in the queue, all others follow them.

    `last`: also follow the queue's secondaries, in the order of their rank until the budget or the queue is empty, and
    count mirror images. With `first` beyond the fan that alone is done.
    """
    tables, queue, counts = pointers(g), pointers(q), pointers(tally)
    after = min(first + BLOCK, fan.followed)
    if first < after:
        open_queue(q, budget, first)
        tally.counts[ledger.RELEASED] += after - first
    for i in range(first, after):
        follow(tables, rules, released(tables, fan, i), queue, counts, i)
        while budget == ALL and has_secondary(queue):
            _follow_secondary(tables, rules, latest_secondary(queue), queue, counts, fan.rays)
    if not last:
        return
    begin_secondaries(queue, fan.rays, counts)
    while has_secondary(queue):
        _follow_secondary(tables, rules, next_secondary(queue), queue, counts, fan.rays)
    prune(queue, counts)
    if fan.followed < fan.rays:
        add_twins(tally, fan.followed)


@inside
def _follow_secondary(g: Geometry, rules: Rules, ray: Ray, q: Queue, tally: Tally, rays: int) -> None:
    """Follow a secondary and count it; all tables are pointers."""
    tally.counts[ledger.RELEASED] += 1
    tally.counts[ledger.GRANTED] += 1
    follow(g, rules, ray, q, tally, rays + tally.counts[ledger.GRANTED] - 1)


@inside
def _join(tally: Tally, q: Queue, later_tally: Tally, later: Queue) -> None:
    """Add a later block's tally and queue to the first."""
    add_tally(tally, later_tally)
    merge(pointers(q), pointers(later), pointers(tally))


@compiled
def follow_block(
    g: Geometry, rules: Rules, fan: Fan, first: int, budget: int, q: Queue, tally: Tally, last: bool
) -> None:
    """Follow one block of released rays from Python."""
    _follow_block(g, rules, fan, first, budget, q, tally, last)


@compiled
def join(tally: Tally, q: Queue, later_tally: Tally, later: Queue) -> None:
    """Add a later block from Python."""
    _join(tally, q, later_tally, later)


_follow_quick, _join_quick = interpreted(_follow_block), interpreted(_join)


def _is_quick(rays: int, budget: int) -> bool:
    """Return whether Python is to follow these rays, the first few of the process: the same bits, uncompiled."""
    _left[0] -= rays + (budget if budget != ALL else _OF_ALL * rays)
    return _left[0] > 0


@inside
def simulate(work: Work, rules: Rules, fan: Fan, budget: int) -> None:
    """Trace one scene, block after block."""
    g, q, tally = work.g, work.q, work.tally
    start, more = min(0, fan.followed), fan.followed > BLOCK  # no literals, for which numba would compile copies
    _follow_block(g, rules, fan, start, budget, q, tally, not more)
    for first in range(BLOCK, fan.followed, BLOCK):
        clear(work.later_tally)
        _follow_block(g, rules, fan, first, budget, work.later, work.later_tally, not more)
        _join(tally, q, work.later_tally, work.later)
    if more:
        _follow_block(g, rules, fan, fan.followed, budget, q, tally, more)


@compiled
def changes_along_fan(by_root: FloatArray, step: float, shift: float, jittered: bool) -> FloatArray:
    """Return the sums (2,) of squared differences between neighbouring rays of the fan, in number and in power.

    Differences of the next but one have squares 1 + `_alike` times as large. Where they are significantly (two standard
    deviations) smaller, neighbours are less alike than supposed, and the sums are raised to those that leave the error
    of that relation in `fan_sd`; of scenes that are and that are not their own mirror image, the greater.
    """
    total = np.zeros(2)
    for kind in range(2):
        apart, fourth = 0.0, 0.0
        for i in range(1, len(by_root)):
            away = by_root[i, kind] - by_root[i - 1, kind]
            square = away * away
            total[kind] += square
            fourth += square * square
            if i > 1:
                away = by_root[i, kind] - by_root[i - 2, kind]
                apart += away * away
        if total[kind] > 0.0:
            supposed = _alike(step, jittered)
            sd = math.sqrt(2.0 * (1.0 - supposed) * fourth) / total[kind]
            alike = max(apart / total[kind] - 1.0 + _SURE * sd, _LEAST_ALIKE)
            if alike < supposed:
                own, lone = _step_of(alike, jittered), _shared(step, 0.0, jittered)
                raised = _shared(own, 0.0, jittered) / lone
                both = _shared(own, 0.0, jittered) + _shared(own, shift, jittered)
                both /= lone + _shared(step, shift, jittered)
                total[kind] *= max(raised, both) * _unlike(step, jittered) / _unlike(own, jittered)
    return total


@inside
def _unlike(step: float, jittered: bool) -> float:
    """Return half the mean squared difference of neighbours, of a process of unit variance."""
    kept = math.expm1(-step) / step
    return 1.0 - kept * kept if jittered else -math.expm1(-step)


@inside
def _alike(step: float, jittered: bool) -> float:
    """Return the part by which squared differences of the next but one are larger than those of neighbours."""
    if not jittered:
        return math.exp(-step)
    return (1.0 - _unlike(step, jittered)) * -math.expm1(-step) / _unlike(step, jittered)


@inside
def _step_of(alike: float, jittered: bool) -> float:
    """Return the step at which the next but one differ by such a part."""
    low, high = _SMALL_STEP, _LARGE_STEP
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if _alike(middle, jittered) < alike else (middle, high)
    return high


@inside
def _shared(step: float, at: float, jittered: bool) -> float:
    """Return the variance of a ray's part in the sum, or its covariance with a ray shifted by `at` steps.

    Of an even fan it is the sum of covariances with samples a step apart, less that of their mean; of random places,
    that within a step, less that of its mean.
    """
    if step < _SMALL_STEP:
        return step * (1.0 / 6.0 - at * (1.0 - at)) * (2.0 if jittered else 1.0)
    if jittered:
        together = (1.0 - at) * math.exp(-at * step) + at * math.exp((at - 1.0) * step)
        return together - 2.0 * (step + math.expm1(-step)) / (step * step)
    return (math.exp(-at * step) + math.exp((at - 1.0) * step)) / -math.expm1(-step) - 2.0 / step


@compiled
def fan_step(cone_deg: float, rays: int, thickness_mm: float) -> float:
    """Return the step of a fan over the angle within which neighbouring rays end alike."""
    return cone_deg / rays / (CORRELATION_DEG_PER_MM2 * (thickness_mm * thickness_mm))


@inside
def _frame_at(frames: SceneFrame, s: int) -> SceneFrame:
    """Return one state of stacked frames."""
    return SceneFrame(
        frames.nodes[s],
        frames.curvature[s],
        frames.ends[s],
        frames.outer[s],
        frames.half_mm,
        frames.free[s],
        frames.surfaces[s],
        frames.kinds[s],
        frames.owners[s],
        frames.corners[s],
        frames.emitter[s],
        frames.receiver_direction[s],
        frames.source_cell,
    )


class Work(NamedTuple):
    """Memory of `simulate_many`, made by `memory_of`: numba compiles for long what allocates."""

    g: Geometry
    q: Queue
    later: Queue  # with later_tally: of the second block of a scene and of those after it
    tally: Tally
    later_tally: Tally


def memory_of(frames: SceneFrame, patterns: FloatArray, rules: Rules, rays: int, shares: IntArray) -> Work:
    """Return memory for every pattern in every state."""
    guides, arcs = frames.curvature[0].shape
    most, face = int(patterns[:, 0].max()), int(patterns[:, 4].max())
    g = allocate(guides, arcs, len(frames.surfaces[0]), most, frames.source_cell, face)
    budget, by_root = int(shares[:, 1].max()), np.empty((rays, 2))
    nothing = np.empty((0, 3)), np.empty((0, 2), dtype=np.int64)
    q, later = (new_queue(budget, rules.faintest) for _ in range(2))
    return Work(g, q, later, new_tally(by_root, *nothing), new_tally(by_root, *nothing))


@compiled
def simulate_many(
    frames: SceneFrame,
    patterns: FloatArray,
    rules: Rules,
    fan: Fan,
    shares: IntArray,
    work: Work,
    counts: IntArray,
    energy: FloatArray,
    changes: FloatArray,
) -> None:
    """Simulate every pattern (p, 5) in every state; `shares` (s, 2) from `share_of`; the last three are filled."""
    jittered = len(fan.places) > 0
    shift = 0.5 if jittered else (2.0 * fan.phase) % 1.0
    step = fan_step(math.degrees(2.0 * fan.half), fan.rays, 2.0 * frames.half_mm)
    tally, by_root = work.tally, work.tally.by_root
    for p in range(len(patterns)):
        for s in range(len(frames.nodes)):
            build(work.g, _frame_at(frames, s), patterns[p])
            for i in range(fan.rays):
                by_root[i, 0], by_root[i, 1] = 0.0, 0.0
            clear(tally)
            followed = Fan(fan.half, fan.rays, fan.lambertian, fan.phase, shares[s, 0], fan.places)
            simulate(work, rules, followed, shares[s, 1])
            change = changes_along_fan(by_root, step, shift, jittered)
            for i in range(COUNTS):
                counts[p, s, i] = tally.counts[i]
            for i in range(ledger.ENERGIES):
                energy[p, s, i] = tally.energy[i] / fan.rays
            for i in range(2):
                changes[p, s, i] = change[i]


def stacked(frames: Sequence[SceneFrame]) -> SceneFrame:
    """Return the frames of several states as one, state first, the junctions' surfaces padded with absent ones."""
    most = max(len(f.kinds) for f in frames)
    fill = {"surfaces": 1, "kinds": 0, "owners": NO_CELL, "corners": 0}

    def stack(name: str) -> Any:
        arrays = [getattr(f, name) for f in frames]
        if name in fill:
            pads = [[(0, most - len(a)), *[(0, 0)] * (a.ndim - 1)] for a in arrays]
            arrays = [np.pad(a, pad, constant_values=fill[name]) for a, pad in zip(arrays, pads, strict=True)]
        return np.stack(arrays)

    return frames[0]._replace(**{name: stack(name) for name in SceneFrame._fields if name not in _SCALARS})


def states_of(frames: SceneFrame, states: slice) -> SceneFrame:
    """Return some states of stacked frames."""
    stacks = {name: getattr(frames, name)[states] for name in SceneFrame._fields if name not in _SCALARS}
    return frames._replace(**stacks)


def trace(
    frame: SceneFrame,
    design: Design,
    guide: Waveguide,
    light: Light,
    *,
    threads: int | None = None,
    progress: Progress | None = None,
) -> TraceResult:
    """Trace one scene; blocks of rays run side by side, with the same bits on any number of threads."""
    followed, budget = share_of(frame, light)
    g, rules, fan = geometry_of(frame, design), rules_of(guide, light), fan_of(light)._replace(followed=followed)
    quick = _is_quick(followed, budget)
    follow = _follow_quick if quick else follow_block
    by_root = np.zeros((light.rays, 2))
    nothing = np.empty((0, 3)), np.empty((0, 2), dtype=np.int64)

    def one(first: int) -> tuple[Tally, Queue]:
        tally, q = new_tally(by_root, *nothing), new_queue(budget, light.faintest)
        follow(g, rules, fan, first, budget, q, tally, followed <= BLOCK)
        return tally, q

    tally, q = new_tally(by_root, *nothing), new_queue(budget, light.faintest)
    if not quick:
        compile_ahead(follow_block, g, rules, fan, 0, budget, q, tally, True)
    pool = ThreadPoolExecutor(threads or os.cpu_count() or 1)
    try:
        blocks = pool.map(one, range(0, followed, BLOCK))
        tally, q = next(blocks)
        for done, later in enumerate(blocks, start=2):
            join(tally, q, *later)
            if progress is not None:
                progress(min(done * BLOCK, followed), followed)
    finally:
        pool.shutdown(cancel_futures=True)
    if followed > BLOCK:
        follow_block(g, rules, fan, followed, budget, q, tally, True)
    counts, energy = tally.counts.tolist(), (tally.energy / light.rays).tolist()
    ends = dict(zip(ledger.LEDGER, counts, strict=False)), dict(zip(ledger.ENERGY, energy, strict=True))
    secondaries = counts[ledger.GRANTED], counts[ledger.REFUSED]
    ndr = counts[DETECTED] * (PAPER_RAYS / light.rays)
    step = _step(light, 2 * frame.half_mm)
    alone = light.rays == 1
    along = interpreted(changes_along_fan) if light.rays <= _QUICK_SUM else changes_along_fan
    changes = np.full(2, math.nan) if alone else along(by_root, step, light.shift, light.jittered)
    sd = fan_sd(changes, light, 2 * frame.half_mm, np.array(frame.mirrored))
    return TraceResult(
        *ends, counts[ledger.HITS], *secondaries, ndr, float(sd[0]), energy[0], float(sd[1]) / PAPER_RAYS
    )


def fan_sd(changes: FloatArray, light: Light, thickness_mm: float, mirrored: BoolArray) -> FloatArray:
    """Return the standard deviation of what a fan, turned or jittered at random, delivers, scaled to 250 rays.

    Detections along the fan are a process with covariance exp(-angle / angle0), of which neighbouring rays give the
    variance; `sd_of_sum` has the rest.
    """
    variance = changes / max(light.rays - 1, 1) / (2 * interpreted(_unlike)(_step(light, thickness_mm), light.jittered))
    return np.asarray(np.sqrt(variance) * sd_of_sum(light, thickness_mm, mirrored))


def sd_of_sum(light: Light, thickness_mm: float, mirrored: BoolArray) -> FloatArray:
    """Return the standard deviation of the sum of a fan's rays, scaled to 250, for a process of unit variance.

    The sum of samples a step apart has variance coth(x / 2) - 2 / x a ray, x = step / angle0: 1 where neighbours are
    unrelated, x / 6 where each change is resolved (systematic sampling: Cochran, Sampling Techniques, 3rd edition,
    1977, chapter 8); x / 3 there with random places (stratified sampling, chapter 5).
    """
    x, jittered = _step(light, thickness_mm), light.jittered
    shared = interpreted(_shared)
    a_ray = shared(x, 0.0, jittered) + mirrored * shared(x, light.shift, jittered)
    return np.asarray(PAPER_RAYS / light.rays * np.sqrt(light.rays * a_ray))


def _step(light: Light, thickness_mm: float) -> float:
    """Return the step of a light's fan over the angle within which neighbouring rays end alike."""
    return float(interpreted(fan_step)(light.cone_deg, light.rays, thickness_mm))


@dataclass(frozen=True, slots=True)
class RayPath:
    """The path of one ray."""

    points: FloatArray  # with power: (n, 2) vertices in mm, and the power at each (n,)
    power: FloatArray
    in_resin: IntArray  # (n - 1,) which stretches ran in resin
    secondary: bool  # whether it is a reflected part


_DRAWN = 2_000_000  # points of paths, at most


def ray_paths(
    frame: SceneFrame,
    design: Design,
    guide: Waveguide,
    light: Light,
    *,
    released_rays: int | None = None,
) -> list[RayPath]:
    """Return the paths of the rays of a simulation, for drawing, without the last stretch of one that escapes."""
    g, rules, fan = geometry_of(frame, design), rules_of(guide, light), fan_of(light)
    drawn, by = np.empty((_DRAWN, 3)), np.empty((_DRAWN, 2), dtype=np.int64)
    tally = new_tally(np.zeros((light.rays, 2)), drawn, by)
    few = min(released_rays or light.rays, light.rays)
    budget = light.secondary if light.secondary == ALL else round(light.secondary * few / light.rays)
    q, later = (new_queue(budget, light.faintest) for _ in range(2))
    blocks = [(first, min(first + BLOCK, light.rays)) for first in range(0, light.rays, BLOCK)]
    if few < light.rays:
        chosen = ((np.arange(few) + 0.5) * fan.rays / few).astype(int).tolist()
        blocks = [(i, i + 1) for i in chosen]
    _simulate_blocks(g, rules, fan, blocks, budget, q, later, tally)
    n = int(tally.counts[COUNTS])
    cuts = np.flatnonzero(np.diff(by[:n, 0])) + 1
    return [
        RayPath(p[:, :2].copy(), p[:, 2].copy(), b[1:, 1].copy(), bool(b[0, 0] >= light.rays))
        for p, b in zip(np.split(drawn[:n], cuts), np.split(by[:n], cuts), strict=True)
    ]


def _simulate_blocks(
    g: Geometry, rules: Rules, fan: Fan, blocks: list[tuple[int, int]], budget: int, q: Queue, later: Queue,
    tally: Tally,
) -> None:  # fmt: skip
    """Trace the rays of a fan that are in blocks (first ray, ray after the last), of BLOCK rays at most."""
    (first, after), *others = blocks
    quick = _is_quick(sum(after - first for first, after in blocks), budget)
    follow, add = (_follow_quick, _join_quick) if quick else (follow_block, join)
    follow(g, rules, fan._replace(followed=after), first, budget, q, tally, False)
    for first, after in others:
        one = new_tally(tally.by_root, tally.drawn, tally.drawn_by)
        one.counts[COUNTS] = tally.counts[COUNTS]
        follow(g, rules, fan._replace(followed=after), first, budget, later, one, False)
        add(tally, q, one, later)
    follow(g, rules, fan, fan.followed, budget, q, tally, True)
