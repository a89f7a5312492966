"""The budget of secondary rays: which reflected rays are followed, and in which order.

Strategy: secondaries rank by key, then by the released ray they stem from, then by their birth. While released rays are
followed, secondaries within the budget are only collected; when the collection is full, a partial sort (quickselect)
keeps as many as the budget allows, and whatever ranks behind the last of them is refused from then on at the cost of
one comparison. Then the collection becomes a heap, and the first in rank is followed until the budget or the heap is
empty. This is exact: a secondary's key is never below its parent's, so one that is refused could never have been
reached.

Where every secondary is followed, rank does not matter: those of a released ray are followed directly after it, the
latest first, so that few wait at a time. Their powers sum to one ray's at most, which bounds how many.

Rules: births are counted from the number of the block's first ray times 2^20, so that a later block's secondaries
are born later on any number of threads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.compiled import inner, inside
from analysis.optics.scene.parameters import ALL
from analysis.optics.tracer.rays import Ray
from analysis.optics.tracer.tally import E_CUT, REFUSED, Tally
from protocol.base.arrays import FloatArray, IntArray

_NUMBERS, _LABELS = 8, 6
_KEY, _ROOT, _BIRTH = 7, 3, 5
_N, _LEFT, _NEXT, _HEAP, _TOUCHED, _STATES = range(6)
_BIRTHS_A_RAY, _NO_LIMIT = 1 << 20, 1 << 62
_MOST_WAITING = 100_000


class Queue(NamedTuple):
    """Secondaries that may yet be followed.

    `state`: (5,) slots in use, secondaries left in the budget, the next birth, whether `rank` is a heap, and how many
    slots have ever been in use (memory beyond them is untouched).
    """

    numbers: FloatArray  # with labels: (slots, 8) and (slots, 6), the rays
    labels: IntArray
    rank: IntArray  # (slots,) slots in use, then the free ones
    state: IntArray
    limit: FloatArray  # (2,) key and root of the last that is within the budget
    slots: int


def new_queue(budget: int, faintest: float) -> Queue:
    """Return a queue for `budget` secondaries of `faintest` power or more, to be opened before use."""
    slots = 2 * budget + 16 if budget > 0 else 0
    if budget == ALL:
        slots = int(min(1.0 / max(faintest, 1.0 / _MOST_WAITING), _MOST_WAITING)) + 1
    return Queue(
        np.empty((slots, _NUMBERS)),
        np.empty((slots, _LABELS), dtype=np.int64),
        np.empty(slots, dtype=np.int64),
        np.zeros(_STATES, dtype=np.int64),
        np.empty(2),
        slots,
    )


@inside
def open_queue(q: Queue, budget: int, first: int) -> None:
    """Empty the queue for a block that begins with released ray `first`."""
    q.state[_N], q.state[_NEXT] = 0, first * _BIRTHS_A_RAY
    q.state[_LEFT] = budget if budget != ALL else _NO_LIMIT
    q.state[_HEAP], q.state[_TOUCHED] = 0, 0
    q.limit[0], q.limit[1] = math.inf, math.inf


@inner
def _before(q: Queue, a: int, b: int) -> bool:
    """Return whether the secondary in slot a ranks before that in slot b."""
    key, other = q.numbers[_NUMBERS * a + _KEY], q.numbers[_NUMBERS * b + _KEY]
    if key != other:
        return bool(key < other)
    i, j = _LABELS * a, _LABELS * b
    if q.labels[i + _ROOT] != q.labels[j + _ROOT]:
        return bool(q.labels[i + _ROOT] < q.labels[j + _ROOT])
    return bool(q.labels[i + _BIRTH] < q.labels[j + _BIRTH])


@inner
def _swap(q: Queue, i: int, j: int) -> None:
    q.rank[i], q.rank[j] = q.rank[j], q.rank[i]


@inside
def _sink(q: Queue, at: int) -> None:
    """Restore the heap below `at`."""
    n = q.state[_N]
    while True:
        child = 2 * at + 1
        if child >= n:
            return
        if child + 1 < n and _before(q, q.rank[child + 1], q.rank[child]):
            child += 1
        if not _before(q, q.rank[child], q.rank[at]):
            return
        _swap(q, at, child)
        at = child


@inside
def _rise(q: Queue, at: int) -> None:
    while at > 0 and _before(q, q.rank[at], q.rank[(at - 1) // 2]):
        _swap(q, at, (at - 1) // 2)
        at = (at - 1) // 2


@inside
def _first(q: Queue, k: int) -> None:
    """Bring the k first in rank to the front, in any order (quickselect)."""
    low, high = 0, q.state[_N] - 1
    while low < high:
        pivot, i, j = q.rank[(low + high) // 2], low, high
        while i <= j:
            while _before(q, q.rank[i], pivot):
                i += 1
            while _before(q, pivot, q.rank[j]):
                j -= 1
            if i <= j:
                _swap(q, i, j)
                i, j = i + 1, j - 1
        if k - 1 <= j:
            high = j
        elif k - 1 >= i:
            low = i
        else:
            return


@inside
def prune(q: Queue, tally: Tally) -> None:
    """Refuse what is beyond the budget."""
    n, k = q.state[_N], q.state[_LEFT]
    if n <= k:
        return
    if k > 0:
        _first(q, k)
    for i in range(k, n):
        tally.counts[REFUSED] += 1
        tally.energy[E_CUT] += q.numbers[_NUMBERS * q.rank[i] + 4]
    last = q.rank[0]
    for i in range(1, k):
        if _before(q, last, q.rank[i]):
            last = q.rank[i]
    q.limit[0] = q.numbers[_NUMBERS * last + _KEY] if k > 0 else -math.inf
    q.limit[1] = q.labels[_LABELS * last + _ROOT]
    q.state[_N] = k


@inside
def _heap(q: Queue) -> None:
    q.state[_HEAP] = 1
    for at in range(q.state[_N] // 2 - 1, -1, -1):
        _sink(q, at)


@inside
def _put(q: Queue, ray: Ray, key: float, birth: int, tally: Tally) -> None:
    if q.state[_N] == q.slots:
        prune(q, tally)
        if q.state[_HEAP] == 1:
            _heap(q)
    n = q.state[_N]
    if n == q.slots:  # of all that are followed, more wait than there is memory for
        tally.counts[REFUSED] += 1
        tally.energy[E_CUT] += ray.power
        return
    if n == q.state[_TOUCHED]:
        q.rank[n], q.state[_TOUCHED] = n, n + 1
    slot = q.rank[n]
    v, w, i, j = q.numbers, q.labels, slot * _NUMBERS, slot * _LABELS
    v[i], v[i + 1], v[i + 2], v[i + 3], v[i + 4] = ray.x, ray.y, ray.dx, ray.dy, ray.power
    v[i + 5], v[i + 6], v[i + 7] = ray.path_mm, ray.optical_path_mm, key
    w[j], w[j + 1], w[j + 2], w[j + 3] = ray.medium, ray.last, ray.cell, ray.root
    w[j + 4], w[j + 5] = ray.bounce, birth
    q.state[_N] = n + 1
    if q.state[_HEAP] == 1:
        _rise(q, n)


@inner
def offer(q: Queue, ray: Ray, key: float, birth: int, tally: Tally) -> None:
    """Put a secondary into the queue, or refuse it where the budget cannot reach it.

    `key`: first criterion of its rank. `birth`: last one; -1 for the next.
    """
    if key > q.limit[0] or (key == q.limit[0] and ray.root >= q.limit[1]) or q.state[_LEFT] == 0:
        tally.counts[REFUSED] += 1
        tally.energy[E_CUT] += ray.power
        return
    if birth < 0:
        birth = q.state[_NEXT]
        q.state[_NEXT] += 1
    _put(q, ray, key, birth, tally)


@inside
def _read(q: Queue, slot: int) -> Ray:
    v, w, i, j = q.numbers, q.labels, slot * _NUMBERS, slot * _LABELS
    x, y, dx, dy, power, path, optical = v[i], v[i + 1], v[i + 2], v[i + 3], v[i + 4], v[i + 5], v[i + 6]
    return Ray(x, y, dx, dy, power, path, optical, w[j], w[j + 1], w[j + 2], w[j + 3], w[j + 4])


@inside
def merge(q: Queue, later: Queue, tally: Tally) -> None:
    """Offer a later block's secondaries to the first block's queue."""
    for i in range(later.state[_N]):
        slot = later.rank[i]
        birth = later.labels[_LABELS * slot + _BIRTH]
        offer(q, _read(later, slot), later.numbers[_NUMBERS * slot + _KEY], birth, tally)


@inside
def begin_secondaries(q: Queue, rays: int, tally: Tally) -> None:
    """Turn the collection into a heap once all released rays have been followed."""
    prune(q, tally)
    q.state[_NEXT] = rays * _BIRTHS_A_RAY
    _heap(q)


@inside
def has_secondary(q: Queue) -> bool:
    """Return whether a secondary is waiting and within the budget."""
    return bool(q.state[_N] > 0 and q.state[_LEFT] > 0)


@inside
def next_secondary(q: Queue) -> Ray:
    """Take the first in rank out of the heap and off the budget."""
    slot, n = q.rank[0], q.state[_N] - 1
    ray = _read(q, slot)
    q.rank[0], q.rank[n] = q.rank[n], slot
    q.state[_N] = n
    q.state[_LEFT] -= 1
    _sink(q, 0)
    return ray


@inside
def latest_secondary(q: Queue) -> Ray:
    """Take the latest out of a queue whose every secondary is followed."""
    n = q.state[_N] - 1
    q.state[_N] = n
    return _read(q, q.rank[n])
