"""The tracer as others would have built it: chords in place of arcs, single precision in place of double.

For the chart of time against error only; results come from `simulation.py`. One thread.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np

from analysis.arrays import FloatArray
from analysis.optics.scene.frame import Frame, check_row
from analysis.optics.scene.geometry import Geometry, geometry_of, tables_of
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.budget import LABELS, NUMBERS, STATES, new_queue
from analysis.optics.tracer.budget import Queue as Queue64
from analysis.optics.tracer.rays import GRANTED, RELEASED, Book, Rules, book_of
from analysis.optics.tracer.simulation import (
    Fan,
    Outcome,
    fan_of,
    new_book,
    outcome_of,
    release,
    rules_of,
    simulate,
    switches,
)
from analysis.tradeoff.chords import bag_of
from analysis.tradeoff.single import twins


def trace_variant(
    frame: Frame,
    design: Design,
    guide: Waveguide,
    light: Light,
    *,
    chord_mm: float | None = None,
    single: bool = False,
) -> Outcome:
    """Trace one scene as `simulation.trace` does, by another way.

    Parameters
    ----------
    chord_mm : arcs become chords of at most this length, searched by a tree of boxes; 0 searches the exact arcs so;
        None walks the exact cells.
    single : tables, rays and arithmetic in float32. Compiled at the first call of a process, some 10 s.

    Raises
    ------
    RequestError : the cavities do not fit the guide, or the chord's length makes no sense.
    """
    check_row(frame, design.row_mm, design.depth_mm if design.cavities else 0.0, "this state")
    g = geometry_of(frame, design) if chord_mm is None else bag_of(frame, design, chord_mm)
    rules, fan = rules_of(guide, light, frame), fan_of(light, frame)
    by_root = np.zeros(light.rays, dtype=np.int64)
    book = new_book(by_root, np.empty((0, 3)), np.empty((0, 2), dtype=np.int64))
    if single:
        _simulate_single(g, rules, fan, light.secondary, book)
    else:
        simulate(g, rules, fan, light.secondary, new_queue(light.secondary), new_queue(light.secondary), book)
    return outcome_of(book.counts, book.energy / light.rays, switches(by_root), light.rays)


def _simulate_single(g: Geometry, rules: Rules, fan: Fan, budget: int, book: Book) -> None:
    def narrow(value: Any) -> Any:
        wide = isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype == np.float64)
        return np.asarray(value, dtype=np.float32)[()] if wide else value

    slots = 2 * budget + 16 if budget else 0
    q = Queue64(
        np.empty((slots, NUMBERS), dtype=np.float32),
        np.empty((slots, LABELS), dtype=np.int64),
        np.empty(slots, dtype=np.int64),
        np.zeros(STATES, dtype=np.int64),
        np.empty(2, dtype=np.float32),
        slots,
    )
    start = np.empty((fan.rays, 4))
    release(fan, start)
    with np.errstate(over="ignore"):  # what has not been filled holds anything
        tables, kept = Geometry(*map(narrow, g)), Rules(*map(narrow, rules))
    _single_loop()(tables, kept, narrow(start), fan.cell, budget, q, book)


@cache
def _single_loop() -> Any:
    budgets, _, tracer = twins()
    queue_of, open_queue, begin, more, take, end = (
        budgets.queue_of,
        budgets.open_queue,
        budgets.begin_spending,
        budgets.anything_left,
        budgets.next_secondary,
        budgets.end_spending,
    )
    follow, ray_of, one, zero = tracer.follow, tracer.Ray, np.float32(1), np.float32(0)

    @numba.njit(nogil=True, error_model="numpy")
    def loop(g: Geometry, rules: Rules, start: FloatArray, cell: int, budget: int, q: Queue64, book: Book) -> None:
        open_queue(q, budget, 0)
        tables, queue, pages, rays = tables_of(g), queue_of(q), book_of(book), len(start)
        for i in range(rays):
            ray = ray_of(start[i, 0], start[i, 1], start[i, 2], start[i, 3], one, zero, zero, 1, -1, cell, i, 0)
            follow(tables, rules, ray, queue, pages, i)
        book.counts[RELEASED] += rays
        begin(queue, rays, pages)
        while more(queue):
            ray = take(queue)
            book.counts[RELEASED] += 1
            book.counts[GRANTED] += 1
            follow(tables, rules, ray, queue, pages, rays)
        end(queue, pages)

    return loop
