"""The editor of a plan of segments: steps, ramps, sines, loops, readings. Each edit gives a plan, and can be undone.

Rules: what is shown is always a plan that could be armed; an entry that makes none is refused with the reason, and the
plan stays. Loops keep their segments when one is added, moved or removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from boat_daq.engine.plan import QUANTITIES, Loop, Plan
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import duration, plain_number
from boat_daq.viewmodels.live.sequence import SequenceModel, staircase, step_begins
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.recording import SEGMENT_KINDS, Segment

USUAL = {  # of a new segment at a value
    "step": {"hold_s": 5.0},
    "ramp": {"rate_per_s": 10.0, "hold_s": 5.0},
    "sine": {"amplitude": 10.0, "frequency_hz": 0.1, "periods": 5.0},
}
USUAL_MM = {"rate_per_s": 0.5, "amplitude": 1.0}  # in place of these where the values are millimetres
COLUMNS = {  # key of a segment -> heading, kinds that have it; with the plan's quantity for {q}
    "target": ("Target ({q})", SEGMENT_KINDS),
    "rate_per_s": ("Rate ({q}/s)", ("ramp",)),
    "hold_s": ("Hold (s)", ("step", "ramp")),
    "amplitude": ("Amplitude ({q})", ("sine",)),
    "frequency_hz": ("Frequency (Hz)", ("sine",)),
    "periods": ("Periods", ("sine",)),
}
LABELS = {"name": "Name", "cycles": "Cycles", "min_kpa": "Lowest allowed", "max_kpa": "Highest allowed"}
NEW_NAME = "own plan"


@dataclass(frozen=True, slots=True)
class PlanCurve:
    """A plan over time: the values, the places of readings, and the limits that hold for it."""

    time_s: FloatArray
    value: FloatArray
    readings_s: FloatArray
    readings: FloatArray
    limits: tuple[float, ...]


class PlanEditor:
    def __init__(self, sequence: SequenceModel) -> None:
        self._sequence = sequence

    @property
    def plan(self) -> Plan:
        return self._sequence.plan

    @property
    def revision(self) -> int:
        return self._sequence.revision

    @property
    def editable(self) -> bool:
        return self.plan.kind == "profile"

    def locked(self, snapshot: SessionSnapshot) -> bool:
        return snapshot.progress is not None and "arm" not in self._sequence.allowed(snapshot) and snapshot.can_command

    def _take(self, text: str, **values: Any) -> None:
        self._sequence.take(replace(self.plan, **values), f"{text} of the plan")

    def new(self) -> None:
        segments = (Segment("step", 0.0, hold_s=5.0),)
        self._sequence.take(Plan(NEW_NAME, "profile", 1, segments=segments), "a new plan")

    def from_chosen(self) -> None:
        """Take the chosen plan as segments: a ramp to each target, a reading at each plateau."""
        plan = self.plan
        if self.editable:
            return
        hold_s = plan.min_dwell_s if plan.kind == "staircase" else 0.0
        rate = plan.ramp_kpa_per_s
        reading = plan.kind == "staircase"
        ramps = (Segment("ramp", to, rate_per_s=rate, hold_s=hold_s, reading=reading) for to in plan.targets_kpa)
        first = Segment("ramp", plan.high_kpa, rate_per_s=rate, hold_s=max(hold_s, 0.1), reading=reading)
        segments = (first, *ramps)
        loops = (Loop(2, len(segments), plan.cycles),) if plan.cycles > 1 else ()
        name = f"{plan.name} as segments"[:100]
        self._sequence.take(replace(plan, name=name, kind="profile", cycles=1, segments=segments, loops=loops))

    def add(self, kind: str, at: int | None = None) -> None:
        """Add a segment behind one, or at the end; it begins where the one before leads."""
        segments = list(self.plan.segments)
        at = len(segments) if at is None else at + 1
        values = self._usual(kind)
        target = segments[at - 1].target if at else 0.0
        if kind == "sine" and not self.plan.controls_elongation:
            reach = min(self.plan.max_kpa - target, target - self.plan.min_kpa)
            values["amplitude"] = max(0.1, min(values["amplitude"], reach))
        segments.insert(at, Segment(kind, target, **values))
        loops = [self._shifted(loop, at + 1, 1) for loop in self.plan.loops]
        self._take(f"a {kind}", segments=tuple(segments), loops=tuple(filter(None, loops)))

    def _usual(self, kind: str) -> dict[str, Any]:
        values: dict[str, Any] = dict(USUAL[kind])
        if self.plan.controls_elongation:
            values |= {key: value for key, value in USUAL_MM.items() if key in values}
        return values

    def remove(self, at: int) -> None:
        """Remove a segment; a loop with no other one goes with it."""
        if len(self.plan.segments) == 1:
            raise RequestError("a plan has at least one segment", "Add another one first.")
        segments = (*self.plan.segments[:at], *self.plan.segments[at + 1 :])
        loops = [self._shifted(loop, at + 1, -1) for loop in self.plan.loops]
        self._take("without a segment", segments=segments, loops=_apart(loops))

    def move(self, at: int, by: int) -> None:
        """Move a segment up or down by one place; the places of loops stay."""
        segments = list(self.plan.segments)
        if 0 <= at + by < len(segments):
            segments.insert(at + by, segments.pop(at))
            self._take("the order", segments=tuple(segments))

    @staticmethod
    def _shifted(loop: Loop, number: int, by: int) -> Loop | None:
        """Return a loop where a segment with this number was added (by 1) or removed (by -1)."""
        first = loop.first + (by if loop.first > number or (by > 0 and loop.first >= number) else 0)
        last = loop.last + (by if loop.last >= number else 0)
        return replace(loop, first=first, last=last) if last >= first else None

    def set_kind(self, at: int, kind: str) -> None:
        """Make a segment one of another kind, at the same target."""
        before = self.plan.segments[at]
        if kind == before.kind:
            return
        self._replace(at, Segment(kind, before.target, **{**self._usual(kind), "reading": before.reading}), "the kind")

    def set_value(self, at: int, key: str, text: str) -> None:
        """Set a value of a segment, one of `COLUMNS`."""
        value = _number(text, COLUMNS[key][0].partition(" ")[0])
        if value != getattr(self.plan.segments[at], key):
            change: dict[str, Any] = {key: value}
            self._replace(at, replace(self.plan.segments[at], **change), COLUMNS[key][0].partition(" ")[0])

    def set_reading(self, at: int, wanted: bool) -> None:
        if wanted != self.plan.segments[at].reading:
            self._replace(at, replace(self.plan.segments[at], reading=wanted), "a reading")

    def _replace(self, at: int, segment: Segment, text: str) -> None:
        segments = (*self.plan.segments[:at], segment, *self.plan.segments[at + 1 :])
        self._take(text, segments=segments)

    def add_loop(self, first: str, last: str, times: str) -> None:
        """Repeat segments, numbered from 1."""
        numbers = [_number(text, "the loop") for text in (first, last, times)]
        if any(number != int(number) for number in numbers):
            raise RequestError("a loop takes whole numbers", "Type first and last segment and how often, such as 2.")
        self._take("a loop", loops=(*self.plan.loops, Loop(*map(int, numbers))))

    def remove_loop(self, at: int) -> None:
        """Remove a loop; its segments stay."""
        self._take("without a loop", loops=(*self.plan.loops[:at], *self.plan.loops[at + 1 :]))

    def set_plan(self, key: str, text: str) -> None:
        """Set a value of the plan, one of `LABELS`."""
        if key == "name":
            value: Any = text.strip()
        else:
            value = _number(text, LABELS[key].lower())
            if key == "cycles" and value == int(value):
                value = int(value)
        if value != getattr(self.plan, key):
            self._take(LABELS[key].lower(), **{key: value})

    def set_quantity(self, quantity: str) -> None:
        if quantity in QUANTITIES and quantity != self.plan.quantity:
            self._take("the quantity", quantity=quantity)

    def headings(self) -> list[str]:
        return [heading.format(q=self.plan.quantity) for heading, _ in COLUMNS.values()]

    @property
    def summary(self) -> str:
        """Return how long the plan takes, and how many segments and readings it has."""
        plan, run = self.plan, self.plan.unrolled
        readings = sum(segment.reading for segment in run) * plan.cycles
        waits = f", {readings} readings" if readings else ""
        return f"{len(run) * plan.cycles} segments run{waits}, about {duration(plan.duration_s)}"

    def curve(self, limits_kpa: tuple[float, float] | None) -> PlanCurve:
        """Return the plan over time with its limits: those of the plan, and those in force at the board."""
        x, y = staircase(self.plan)
        ends_s = step_begins(self.plan)[1:]
        read = [(t, step.target_kpa) for t, step in zip(ends_s.tolist(), self.plan.steps, strict=True) if step.plateau]
        readings = np.array(read).reshape(-1, 2).T
        limits = () if self.plan.controls_elongation else (self.plan.min_kpa, self.plan.max_kpa, *(limits_kpa or ()))
        return PlanCurve(x, y, readings[0], readings[1], tuple(dict.fromkeys(limits)))


def _apart(loops: Sequence[Loop | None]) -> tuple[Loop, ...]:
    """Return the loops that are left, without one of the same segments as another."""
    found = {(loop.first, loop.last): loop for loop in loops if loop is not None}
    return tuple(found.values())


def _number(text: str, what: str) -> float:
    try:
        return plain_number(text)
    except ValueError:
        raise RequestError(f"{what}: {text!r:.40} is not a number", "Type a number, such as 20.") from None
