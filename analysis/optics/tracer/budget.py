"""The budget of secondary rays: which reflected rays are followed, and in which order.

Strategy: secondaries rank by key, then by the released ray they stem from, then by their birth. While released rays are
followed, what may still be afforded is only collected; when the collection is full, a partial sort (quickselect) keeps
what the budget affords, and whatever ranks behind the last of it is refused from then on at the cost of one comparison.
Then the collection becomes a heap, and the first in rank is followed until the budget or the heap is empty. This is
exact: a secondary's key is never below its parent's, so one that is refused could never have been reached.

Rules: births are counted from the number of the block's first ray times 2^20, so that a later block's secondaries
are born later on any number of threads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.optics.compiled import compiled, inner, pointer
from analysis.optics.tracer.rays import E_CUT, REFUSED, Book, Ray

NUMBERS, LABELS = 8, 6
_KEY, _ROOT, _BIRTH = 7, 3, 5
_N, AFFORDED, _NEXT, _HEAP, _TOUCHED, STATES = range(6)
_BIRTHS_A_RAY = 1 << 20


class Queue(NamedTuple):
    """Secondaries that may yet be followed: `rank[:n]` are their slots, what follows the free ones.

    `numbers` (slots, 8) and `labels` (slots, 6) hold the rays; `state` is n, how many the budget still affords, the
    next birth, whether `rank` is a heap, and how many slots have ever been in use (memory beyond them is untouched);
    `limit` is key and root of the last that is still affordable.
    """

    numbers: FloatArray
    labels: IntArray
    rank: IntArray
    state: IntArray
    limit: FloatArray
    slots: int


@compiled
def new_queue(budget: int) -> Queue:
    """A queue for `budget` secondaries, to be opened before use."""
    slots = 2 * budget + 16 if budget > 0 else 0
    return Queue(
        np.empty((slots, NUMBERS)),
        np.empty((slots, LABELS), dtype=np.int64),
        np.empty(slots, dtype=np.int64),
        np.zeros(STATES, dtype=np.int64),
        np.empty(2),
        slots,
    )


@compiled
def open_queue(q: Queue, budget: int, first: int) -> None:
    """Empty the queue for a block that begins with released ray `first`."""
    q.state[_N], q.state[AFFORDED], q.state[_NEXT] = 0, budget, first * _BIRTHS_A_RAY
    q.state[_HEAP], q.state[_TOUCHED] = 0, 0
    q.limit[0], q.limit[1] = math.inf, math.inf


@compiled
def queue_of(q: Queue) -> Queue:
    """The same queue with pointers for its arrays."""
    return Queue(pointer(q.numbers), pointer(q.labels), pointer(q.rank), pointer(q.state), pointer(q.limit), q.slots)


@inner
def _before(q: Queue, a: int, b: int) -> bool:
    """Whether the secondary in slot a ranks before that in slot b."""
    key, other = q.numbers[NUMBERS * a + _KEY], q.numbers[NUMBERS * b + _KEY]
    if key != other:
        return bool(key < other)
    i, j = LABELS * a, LABELS * b
    if q.labels[i + _ROOT] != q.labels[j + _ROOT]:
        return bool(q.labels[i + _ROOT] < q.labels[j + _ROOT])
    return bool(q.labels[i + _BIRTH] < q.labels[j + _BIRTH])


@inner
def _swap(q: Queue, i: int, j: int) -> None:
    q.rank[i], q.rank[j] = q.rank[j], q.rank[i]


@compiled
def _sink(q: Queue, at: int) -> None:
    """Let the secondary at a place of the heap sink to where it belongs."""
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


@compiled
def _rise(q: Queue, at: int) -> None:
    while at > 0 and _before(q, q.rank[at], q.rank[(at - 1) // 2]):
        _swap(q, at, (at - 1) // 2)
        at = (at - 1) // 2


@compiled
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


@compiled
def _prune(q: Queue, book: Book) -> None:
    """Refuse what the budget cannot afford any more."""
    n, k = q.state[_N], q.state[AFFORDED]
    if n <= k:
        return
    if k > 0:
        _first(q, k)
    for i in range(k, n):
        book.counts[REFUSED] += 1
        book.energy[E_CUT] += q.numbers[NUMBERS * q.rank[i] + 4]
    last = q.rank[0]
    for i in range(1, k):
        if _before(q, last, q.rank[i]):
            last = q.rank[i]
    q.limit[0] = q.numbers[NUMBERS * last + _KEY] if k > 0 else -math.inf
    q.limit[1] = q.labels[LABELS * last + _ROOT]
    q.state[_N] = k


@compiled
def _heap(q: Queue) -> None:
    q.state[_HEAP] = 1
    for at in range(q.state[_N] // 2 - 1, -1, -1):
        _sink(q, at)


@compiled
def _put(q: Queue, ray: Ray, key: float, birth: int, book: Book) -> None:
    if q.state[_N] == q.slots:
        _prune(q, book)
        if q.state[_HEAP] == 1:
            _heap(q)
    n = q.state[_N]
    if n == q.state[_TOUCHED]:
        q.rank[n], q.state[_TOUCHED] = n, n + 1
    slot = q.rank[n]
    i, j = slot * NUMBERS, slot * LABELS
    q.numbers[i], q.numbers[i + 1], q.numbers[i + 2], q.numbers[i + 3] = ray.x, ray.y, ray.dx, ray.dy
    q.numbers[i + 4], q.numbers[i + 5], q.numbers[i + 6], q.numbers[i + 7] = ray.power, ray.way, ray.optical, key
    q.labels[j], q.labels[j + 1], q.labels[j + 2], q.labels[j + 3] = ray.medium, ray.last, ray.cell, ray.root
    q.labels[j + 4], q.labels[j + 5] = ray.bounce, birth
    q.state[_N] = n + 1
    if q.state[_HEAP] == 1:
        _rise(q, n)


@inner
def offer(q: Queue, ray: Ray, key: float, birth: int, book: Book) -> None:
    """Put a secondary into the queue, or refuse it where the budget cannot reach it; `birth` -1 is the next one."""
    if key > q.limit[0] or (key == q.limit[0] and ray.root >= q.limit[1]) or q.state[AFFORDED] == 0:
        book.counts[REFUSED] += 1
        book.energy[E_CUT] += ray.power
        return
    if birth < 0:
        birth = q.state[_NEXT]
        q.state[_NEXT] += 1
    _put(q, ray, key, birth, book)


@compiled
def _read(q: Queue, slot: int) -> Ray:
    i, j = slot * NUMBERS, slot * LABELS
    return Ray(
        q.numbers[i],
        q.numbers[i + 1],
        q.numbers[i + 2],
        q.numbers[i + 3],
        q.numbers[i + 4],
        q.numbers[i + 5],
        q.numbers[i + 6],
        q.labels[j],
        q.labels[j + 1],
        q.labels[j + 2],
        q.labels[j + 3],
        q.labels[j + 4],
    )


@compiled
def hand_over(q: Queue, later: Queue, book: Book) -> None:
    """Offer a later block's secondaries to the first block's queue."""
    for i in range(later.state[_N]):
        slot = later.rank[i]
        birth = later.labels[LABELS * slot + _BIRTH]
        offer(q, _read(later, slot), later.numbers[NUMBERS * slot + _KEY], birth, book)


@compiled
def begin_spending(q: Queue, rays: int, book: Book) -> None:
    """Turn the collection into a heap once all released rays have been followed."""
    _prune(q, book)
    q.state[_NEXT] = rays * _BIRTHS_A_RAY
    _heap(q)


@compiled
def anything_left(q: Queue) -> bool:
    """Whether a secondary waits and the budget still affords it."""
    return bool(q.state[_N] > 0 and q.state[AFFORDED] > 0)


@compiled
def next_secondary(q: Queue) -> Ray:
    """Take the first in rank out of the heap; it is paid for."""
    slot, n = q.rank[0], q.state[_N] - 1
    ray = _read(q, slot)
    q.rank[0], q.rank[n] = q.rank[n], slot
    q.state[_N] = n
    q.state[AFFORDED] -= 1
    _sink(q, 0)
    return ray


@compiled
def end_spending(q: Queue, book: Book) -> None:
    """Refuse what the budget did not reach."""
    _prune(q, book)
