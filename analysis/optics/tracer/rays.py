"""What is carried from surface to surface: a ray, the rules it keeps to, and the book of what has become of all rays.

Powers are in units of one released ray until the summary divides by their number.
"""

from __future__ import annotations

from typing import NamedTuple

from analysis.arrays import FloatArray, IntArray
from analysis.optics.compiled import compiled, inner, pointer

RELEASED, DETECTED, ESCAPED, TRAPPED, CUT, CORNER, DROPPED, HITS, GRANTED, REFUSED, TALLIES = range(11)
E_DETECTED, E_ESCAPED, E_ABSORBED, E_CUT, ENERGIES = range(5)
BY_TIME, BY_BOUNCE, BY_INDEX = range(3)


class Rules(NamedTuple):
    """What the tracer keeps to: refractive index, attenuation (1/mm), path cap (mm), faintest power, corner (mm),
    order of the budget, the way along which light counts as detected, and the tick of time (mm) below which two
    flights are equal."""

    refractive: float
    attenuation: float
    path_cap: float
    faintest: float
    corner: float
    order: int
    way_x: float
    way_y: float
    tick: float


class Ray(NamedTuple):
    """A ray where it was born: place, direction, power, way and optical way so far (mm); medium (1 resin, 0 air), last
    surface, cell, number of the released ray it stems from, bounces so far."""

    x: float
    y: float
    dx: float
    dy: float
    power: float
    way: float
    optical: float
    medium: int
    last: int
    cell: int
    root: int
    bounce: int


class Book(NamedTuple):
    """What has happened: counts, energies, detections by released ray, and the drawn ways of up to `room` points."""

    counts: IntArray
    energy: FloatArray
    by_root: IntArray
    drawn: FloatArray
    drawn_by: IntArray
    room: int


@compiled
def book_of(book: Book) -> Book:
    """The same book with pointers for its arrays."""
    return Book(
        pointer(book.counts),
        pointer(book.energy),
        pointer(book.by_root),
        pointer(book.drawn),
        pointer(book.drawn_by),
        book.room,
    )


@inner
def draw(book: Book, x: float, y: float, power: float, number: int, medium: int) -> None:
    """Note a point of the way of ray `number`, while there is room."""
    n = book.counts[TALLIES]
    if n < book.room:
        book.drawn[3 * n], book.drawn[3 * n + 1], book.drawn[3 * n + 2] = x, y, power
        book.drawn_by[2 * n], book.drawn_by[2 * n + 1] = number, medium
        book.counts[TALLIES] = n + 1
