"""The layout of the live plots: which quantities share a plot, and their axes; kept for each unit.

A quantity is a column of the ring buffer, or `elongation_mm`. Rules: an axis has one unit of measurement, so a plot has
at most two. A quantity that a layout does not name has a plot of its own, at its usual place.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial

from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import Change, UndoHistory
from protocol.base.errors import RequestError
from protocol.base.units import find_unit

ELONGATION, PRESSURE, CAMERA = "elongation_mm", "pressure_kpa", "camera_mm"
_UNIT = {ELONGATION: "mm", PRESSURE: "kPa", CAMERA: "mm"}
_KEY = "layouts"  # of the preferences: unit -> "" -> layout

Rows = tuple[tuple[str, ...], ...]


@cache
def is_signal(quantity: str) -> bool:
    return re.fullmatch(r"s\d_mv", quantity) is not None


def difference_of(signal: str) -> str:
    """Return the quantity that is a signal less the one predicted for it."""
    return signal.replace("_mv", "_difference_mv")


@cache
def is_difference(quantity: str) -> bool:
    """Return whether a quantity is the difference of a measured and a predicted signal."""
    return re.fullmatch(r"s\d_difference_mv", quantity) is not None


def title(quantity: str) -> str:
    """Return the name of a quantity as the plots show it; of an extra channel its column."""
    if is_difference(quantity):
        return f"Sensor {quantity[1]} less predicted"
    if quantity in _UNIT:
        return quantity.rpartition("_")[0].capitalize()
    return f"Sensor {quantity[1:-3]}" if is_signal(quantity) else quantity


@cache
def unit(quantity: str) -> str:
    """Return the unit of a quantity; that of an extra channel without a known one is its own."""
    tail = quantity.rpartition("_")[2]
    if is_signal(quantity) or is_difference(quantity):
        return "mV"
    return _UNIT.get(quantity) or (tail if find_unit(tail) else quantity)


def titles(quantities: Sequence[str], name: Callable[[str], str] = title) -> str:
    """Return the names of quantities that share an axis: `Sensors 1, 2`."""
    if len(quantities) > 1 and all(map(is_signal, quantities)):
        return f"Sensors {', '.join(quantity[1:-3] for quantity in quantities)}"
    return ", ".join(map(name, quantities))


def _rank(quantity: str) -> tuple[int, str]:
    """Return the usual place of a quantity: signals, elongations, pressure, extra channels."""
    place = {CAMERA: 1, ELONGATION: 1, PRESSURE: 2}.get(quantity, 3)
    return (0 if is_signal(quantity) else place, quantity)


@dataclass(frozen=True, slots=True)
class Axes:
    """The quantities of one plot on its left and on its right axis; the left one has at least one."""

    left: tuple[str, ...]
    right: tuple[str, ...] = ()

    @property
    def all(self) -> tuple[str, ...]:
        """Return every quantity of the plot."""
        return self.left + self.right


@dataclass(frozen=True, slots=True)
class Layout:
    """Which plot shows what; `right` are quantities on the right axis of their plot."""

    rows: Rows = ()
    hidden: tuple[str, ...] = ()
    right: tuple[str, ...] = ()

    def complete(self, quantities: Sequence[str]) -> Layout:
        """Return the layout with a place for each of these quantities; a difference is hidden until it is chosen."""
        rows = list(self.rows)
        named = {quantity for row in rows for quantity in row} | set(self.hidden)
        new = tuple(q for q in quantities if is_difference(q) and q not in named)
        if new:
            return replace(self, hidden=(*self.hidden, *new)).complete(quantities)
        known = {quantity for row in rows for quantity in row} | set(self.hidden)
        for quantity in sorted(set(quantities) - known, key=_rank):
            later = (at for at, row in enumerate(rows) if _rank(row[0]) > _rank(quantity))
            rows.insert(next(later, len(rows)), (quantity,))
        return replace(self, rows=tuple(rows))

    def plots(self, quantities: Sequence[str]) -> tuple[Axes, ...]:
        """Return what the plots show where only these quantities are available, from the top."""
        shown = [tuple(q for q in row if q in quantities) for row in self.complete(quantities).rows]
        return tuple(self._axes(row) for row in shown if row)

    def _axes(self, row: tuple[str, ...]) -> Axes:
        """Return the axes of a plot: another unit than that of the left axis is on the right."""
        left = next((q for q in row if q not in self.right), row[0])
        right = tuple(q for q in row if q != left and (q in self.right or unit(q) != unit(left)))
        return Axes(tuple(q for q in row if q not in right), right)

    def placed(self, quantity: str, host: str = "") -> Layout:
        """Return the layout with a quantity in the plot of `host`, or in one of its own at its place."""
        at = next((i for i, row in enumerate(self.rows) if quantity in row), len(self.rows))
        rows = [tuple(q for q in row if q != quantity) for row in self.rows]
        if host:
            rows = [(*row, quantity) if host in row else row for row in rows]
        else:
            rows.insert(min(at + 1, len(rows)), (quantity,))
        hidden, right = (tuple(q for q in kept if q != quantity) for kept in (self.hidden, self.right))
        return replace(self, rows=tuple(filter(None, rows)), hidden=hidden, right=right)

    def without(self, quantity: str) -> Layout:
        rows = (tuple(q for q in row if q != quantity) for row in self.rows)
        return replace(self, rows=tuple(filter(None, rows)), hidden=(*self.hidden, quantity))

    def with_axis(self, quantity: str, *, right: bool) -> Layout:
        """Return the layout with a quantity on the left or on the right axis of its plot."""
        others = tuple(q for q in self.right if q != quantity)
        return replace(self, right=(*others, quantity) if right else others)

    def check(self) -> None:
        """Refuse a plot with three units."""
        for row in self.rows:
            units = {unit(q) for q in self._axes(row).right}
            if len(units) > 1:
                cause = f"a plot with {', '.join(map(title, row))} would need a third axis"
                raise RequestError(cause, "Show one of them in a plot of its own.")


def layout_of(stored: object) -> Layout | None:
    """Return the layout that was stored as JSON; None where it is not one."""
    if not isinstance(stored, dict):
        return None
    try:
        rows = tuple(tuple(map(str, row)) for row in stored["rows"] if row)
        layout = Layout(rows, *(tuple(map(str, stored[key])) for key in ("hidden", "right")))
        layout.check()
    except (AttributeError, KeyError, RequestError, TypeError, ValueError):
        return None
    placed = [*(q for row in rows for q in row), *layout.hidden]
    return layout if len(set(placed)) == len(placed) else None


class Layouts:
    """The layout of each unit; that of the unit on the bench is in use."""

    def __init__(self, preferences: Preferences, undo: UndoHistory, unit: Callable[[], str]) -> None:
        self._preferences, self._undo, self._unit = preferences, undo, unit
        self._read_for: str | None = None
        self._current = Layout()

    @property
    def current(self) -> Layout:
        name = self._unit()
        if name != self._read_for:
            self._read_for, self._current = name, self._stored(name)
        return self._current

    def change(self, layout: Layout) -> None:
        layout.check()
        before, use = self.current, partial(self.use, name=self._unit())
        if layout != before:
            self._undo.push(Change("the layout of the plots", partial(use, layout), partial(use, before)))

    def use(self, layout: Layout, name: str) -> None:
        """Use a layout without a step of the undo history, and keep it for the unit `name`."""
        kept = {"": asdict(layout)}
        self._preferences.change(_KEY, lambda stored: {**(stored if isinstance(stored, dict) else {}), name: kept})
        if name == self._unit():
            self._read_for, self._current = name, layout

    def _stored(self, unit: str) -> Layout:
        kept = self._preferences.get(_KEY, {}).get(unit)
        return (layout_of(kept.get("")) if isinstance(kept, dict) else None) or Layout()
