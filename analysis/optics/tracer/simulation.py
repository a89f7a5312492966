"""From a scene and its light to counts and powers: releasing the fan, spending the budget, many scenes in a row.

Strategy: released rays are followed in blocks of fixed size, each with its own book and queue; blocks are joined in
their order, whoever computed them, so that one core, many cores and a cluster give the same bits. The budget's
queue keeps only as many secondaries as may still be followed, which is exact: a secondary's key is never below its
parent's, so one that is refused could never have been reached.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.optics.compiled import compiled
from analysis.optics.scene.frame import NO_CELL, Frame, check_row
from analysis.optics.scene.geometry import Geometry, build, geometry_of, room_for, tables_of
from analysis.optics.scene.parameters import ORDERS, Design, Light, Waveguide
from analysis.optics.tracer.budget import (
    Queue,
    anything_left,
    begin_spending,
    end_spending,
    hand_over,
    new_queue,
    next_secondary,
    open_queue,
    queue_of,
)
from analysis.optics.tracer.rays import (
    DETECTED,
    ENERGIES,
    GRANTED,
    HITS,
    REFUSED,
    RELEASED,
    TALLIES,
    Book,
    Ray,
    Rules,
    book_of,
)
from analysis.optics.tracer.tracer import follow

BLOCK = 4096
LEDGER = ("released", "detected", "escaped", "trapped", "cut", "corner", "dropped")
ENERGY = ("detected", "escaped", "absorbed", "cut")
_DB_PER_CM = math.log(10.0) / 100.0
_CORNER = 1e-9
_TICK = 1e-7


class Fan(NamedTuple):
    """The released rays: place, middle direction, half the cone (rad), number, Lambertian or not, phase, first cell."""

    x: float
    y: float
    way_x: float
    way_y: float
    half: float
    rays: int
    lambertian: bool
    phase: float
    cell: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """One simulation.

    Parameters
    ----------
    ledger : rays by their end; released is the sum of the others.
    energy : parts of the emitted power by their end; they sum to 1.
    hits : surfaces met. granted, refused : secondaries that were followed, and that the budget could not afford.
    ndr : rays that reach the receiver, secondaries included, scaled to 250 emitted.
    ndr_sd : its standard deviation if the fan were turned at random (successive differences along the fan).
    power : detected power, emitted = 1.
    """

    ledger: dict[str, int]
    energy: dict[str, float]
    hits: int
    granted: int
    refused: int
    ndr: float
    ndr_sd: float
    power: float


@compiled
def new_book(by_root: IntArray, drawn: FloatArray, drawn_by: IntArray) -> Book:
    """An empty book over a shared count by released ray."""
    return Book(np.zeros(TALLIES + 1, dtype=np.int64), np.zeros(ENERGIES), by_root, drawn, drawn_by, len(drawn))


@compiled
def released(fan: Fan, i: int) -> Ray:
    """The ray of the fan with number `i`."""
    part = (2.0 * (i + 0.5 + fan.phase)) / fan.rays - 1.0
    angle = math.asin(math.sin(fan.half) * part) if fan.lambertian else fan.half * part
    c, s = math.cos(angle), math.sin(angle)
    return Ray(
        fan.x, fan.y, c * fan.way_x - s * fan.way_y, c * fan.way_y + s * fan.way_x, 1.0, 0.0, 0.0, 1, -1, fan.cell, i, 0
    )


@compiled
def release(fan: Fan, out: FloatArray) -> None:
    """Write place and direction of all released rays to out (rays, 4)."""
    for i in range(fan.rays):
        ray = released(fan, i)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = ray.x, ray.y, ray.dx, ray.dy


@compiled
def follow_block(g: Geometry, rules: Rules, fan: Fan, first: int, budget: int, q: Queue, book: Book) -> None:
    """Follow one block of released rays; what the budget may afford of their secondaries is left in the queue."""
    open_queue(q, budget, first)
    tables, queue, pages = tables_of(g), queue_of(q), book_of(book)
    last = min(first + BLOCK, fan.rays)
    book.counts[RELEASED] += last - first
    for i in range(first, last):
        follow(tables, rules, released(fan, i), queue, pages, i)


@compiled
def join(book: Book, q: Queue, other: Book, others: Queue) -> None:
    """Add a later block's book and queue to the first."""
    for i in range(TALLIES):
        book.counts[i] += other.counts[i]
    book.counts[TALLIES] = other.counts[TALLIES]
    for i in range(ENERGIES):
        book.energy[i] += other.energy[i]
    hand_over(queue_of(q), queue_of(others), book_of(book))


@compiled
def spend(g: Geometry, rules: Rules, rays: int, q: Queue, book: Book) -> None:
    """Follow secondaries in the order of their rank until the budget or the queue is empty."""
    tables, queue, pages = tables_of(g), queue_of(q), book_of(book)
    begin_spending(queue, rays, pages)
    while anything_left(queue):
        ray = next_secondary(queue)
        book.counts[RELEASED] += 1
        book.counts[GRANTED] += 1
        follow(tables, rules, ray, queue, pages, rays + book.counts[GRANTED] - 1)
    end_spending(queue, pages)


@compiled
def simulate(g: Geometry, rules: Rules, fan: Fan, budget: int, q: Queue, others: Queue, book: Book) -> None:
    """The whole of one simulation, block after block; `others` is a second queue, needed from the second block on."""
    follow_block(g, rules, fan, 0, budget, q, book)
    for first in range(BLOCK, fan.rays, BLOCK):
        other = new_book(book.by_root, book.drawn, book.drawn_by)
        other.counts[TALLIES] = book.counts[TALLIES]
        follow_block(g, rules, fan, first, budget, others, other)
        join(book, q, other, others)
    spend(g, rules, fan.rays, q, book)


@compiled
def switches(by_root: IntArray) -> float:
    """Sum of squared differences between neighbouring rays of the fan."""
    total = 0.0
    for i in range(1, len(by_root)):
        total += float(by_root[i] - by_root[i - 1]) ** 2
    return total


class Stack(NamedTuple):
    """The frames of several states as arrays of equal length; state first."""

    nodes: FloatArray
    curvature: FloatArray
    ends: FloatArray
    outer: FloatArray
    half: float
    free: IntArray
    fork: FloatArray
    kinds: IntArray
    owners: IntArray
    corners: IntArray
    emitter: FloatArray
    way: FloatArray
    cell: int


@compiled
def simulate_many(
    stack: Stack,
    patterns: FloatArray,
    rules: Rules,
    fan: Fan,
    budget: int,
    counts: IntArray,
    energy: FloatArray,
    changes: FloatArray,
) -> None:
    """Every pattern in every state: counts (p, s, 10), energy (p, s, 4), changes (p, s) along the fan."""
    no_lines, no_names = np.empty((0, 3)), np.empty((0, 2), dtype=np.int64)
    room = room_for(stack.nodes[0], stack.fork[0], int(np.max(patterns[:, 0])))
    q, others, by_root = new_queue(budget), new_queue(budget), np.empty(fan.rays, dtype=np.int64)
    for p in range(len(patterns)):
        for s in range(len(stack.nodes)):
            g = build(
                room,
                stack.nodes[s],
                stack.curvature[s],
                stack.ends[s],
                stack.outer[s],
                stack.half,
                stack.free[s],
                stack.fork[s],
                stack.kinds[s],
                stack.owners[s],
                stack.corners[s],
                patterns[p],
            )
            e, way = stack.emitter[s], stack.way[s]
            here = Fan(e[0], e[1], e[2], e[3], fan.half, fan.rays, fan.lambertian, fan.phase, stack.cell)
            kept = Rules(
                rules.refractive,
                rules.attenuation,
                rules.path_cap,
                rules.faintest,
                rules.corner,
                rules.order,
                way[0],
                way[1],
                rules.tick,
            )
            by_root[:] = 0
            book = new_book(by_root, no_lines, no_names)
            simulate(g, kept, here, budget, q, others, book)
            counts[p, s] = book.counts[:TALLIES]
            energy[p, s] = book.energy / fan.rays
            changes[p, s] = switches(book.by_root)


def stacked(frames: Sequence[Frame]) -> Stack:
    """Put frames side by side, padding the junctions' surfaces with absent ones."""
    most = max(len(f.kinds) for f in frames)

    def padded(array: Any, value: int) -> Any:
        out = np.full((most, *array.shape[1:]), value, dtype=array.dtype)
        out[: len(array)] = array
        return out

    first = frames[0]
    return Stack(
        np.stack([f.nodes for f in frames]),
        np.stack([f.curvature for f in frames]),
        np.stack([f.ends for f in frames]),
        np.stack([f.outer for f in frames]),
        first.half_mm,
        np.stack([f.free for f in frames]),
        np.stack([padded(f.surfaces, 1) for f in frames]),
        np.stack([padded(f.kinds, 0) for f in frames]),
        np.stack([padded(f.owners, NO_CELL) for f in frames]),
        np.stack([padded(f.corners, 0) for f in frames]),
        np.stack([f.emitter for f in frames]),
        np.stack([f.receiver_way for f in frames]),
        first.source_cell,
    )


def rules_of(guide: Waveguide, light: Light, frame: Frame) -> Rules:
    """The tracer's rules for a frame."""
    return Rules(
        guide.index,
        guide.attenuation_db_per_cm * _DB_PER_CM,
        light.path_cap_mm,
        light.faintest,
        _CORNER * frame.half_mm,
        ORDERS.index(light.order),
        float(frame.receiver_way[0]),
        float(frame.receiver_way[1]),
        _TICK * frame.half_mm,
    )


def fan_of(light: Light, frame: Frame) -> Fan:
    """The released rays of a frame."""
    x, y, way_x, way_y = (float(v) for v in frame.emitter)
    return Fan(
        x,
        y,
        way_x,
        way_y,
        math.radians(light.cone_deg) / 2,
        light.rays,
        light.emission == "lambertian",
        light.phase,
        frame.source_cell,
    )


def outcome_of(counts: IntArray, energy: FloatArray, changes: float, rays: int) -> Outcome:
    """Read one row of a simulation's arrays."""
    scale = 250.0 / rays
    sd = scale * math.sqrt(rays * changes / (2 * (rays - 1))) if rays > 1 else math.nan
    return Outcome(
        {name: int(counts[i]) for i, name in enumerate(LEDGER)},
        {name: float(energy[i]) for i, name in enumerate(ENERGY)},
        int(counts[HITS]),
        int(counts[GRANTED]),
        int(counts[REFUSED]),
        float(counts[DETECTED]) * scale,
        sd,
        float(energy[0]),
    )


def trace(
    frame: Frame,
    design: Design,
    guide: Waveguide,
    light: Light,
    *,
    threads: int | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Outcome:
    """Trace one scene; blocks of rays run side by side.

    Parameters
    ----------
    frame, design, guide, light : the scene and its light.
    threads : how many cores; all by default. The result does not depend on it, bit for bit.
    progress : called with (rays done, rays); raising from it cancels.

    Raises
    ------
    RequestError : the cavities do not fit the guide.
    """
    check_row(frame, design.row_mm, design.depth_mm if design.cavities else 0.0, "this state")
    g, rules, fan = geometry_of(frame, design), rules_of(guide, light, frame), fan_of(light, frame)
    by_root = np.zeros(light.rays, dtype=np.int64)
    nothing = np.empty((0, 3)), np.empty((0, 2), dtype=np.int64)

    def one(first: int) -> tuple[Book, Queue]:
        book, q = new_book(by_root, *nothing), new_queue(light.secondary)
        follow_block(g, rules, fan, first, light.secondary, q, book)
        return book, q

    starts = range(0, light.rays, BLOCK)
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        blocks = pool.map(one, starts)
        book, q = next(blocks)
        for done, (other, others) in enumerate(blocks, start=2):
            join(book, q, other, others)
            if progress is not None:
                progress(min(done * BLOCK, light.rays), light.rays)
    spend(g, rules, light.rays, q, book)
    return outcome_of(book.counts, book.energy / light.rays, switches(by_root), light.rays)


@dataclass(frozen=True, slots=True)
class RayPath:
    """The way of one ray: vertices (n, 2) in mm, power at each (n,), which stretches ran in resin (n - 1,)."""

    points: FloatArray
    power: FloatArray
    in_resin: IntArray
    secondary: bool


def ray_paths(frame: Frame, design: Design, guide: Waveguide, light: Light, most: int = 2_000_000) -> list[RayPath]:
    """The ways of all rays of a simulation, for drawing; an escaping ray's last stretch out is not part of it.

    Raises
    ------
    RequestError : the cavities do not fit the guide.
    """
    check_row(frame, design.row_mm, design.depth_mm if design.cavities else 0.0, "this state")
    g, rules, fan = geometry_of(frame, design), rules_of(guide, light, frame), fan_of(light, frame)
    drawn, by = np.empty((most, 3)), np.empty((most, 2), dtype=np.int64)
    book, q = new_book(np.zeros(light.rays, dtype=np.int64), drawn, by), new_queue(light.secondary)
    simulate(g, rules, fan, light.secondary, q, new_queue(light.secondary), book)
    n = int(book.counts[TALLIES])
    cuts = np.flatnonzero(np.diff(by[:n, 0])) + 1
    return [
        RayPath(p[:, :2].copy(), p[:, 2].copy(), b[1:, 1].copy(), bool(b[0, 0] >= light.rays))
        for p, b in zip(np.split(drawn[:n], cuts), np.split(by[:n], cuts), strict=True)
    ]
