"""What the sequencer asks for, and what it tells: its answers to samples and buttons, carried out by the control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from boat_daq.engine.plan import StepMark


@dataclass(frozen=True, slots=True)
class GoTo:
    """Wish for a pressure."""

    target_kpa: float
    ramp_kpa_per_s: float


@dataclass(frozen=True, slots=True)
class VentNow:
    """Wish for a vent."""


@dataclass(frozen=True, slots=True)
class Marked:
    """A step began or became something else; `new` the first time."""

    mark: StepMark
    new: bool


@dataclass(frozen=True, slots=True)
class SegmentBreak:
    """The recording's next segment begins here."""

    reason: str
    paused: bool


@dataclass(frozen=True, slots=True)
class Noted:
    """An event for the recording; `level` says how loudly the operator is told, "" not at all."""

    kind: str
    text: str
    level: str = ""
    remedy: str = ""
    value: float | None = None


@dataclass(frozen=True, slots=True)
class Ended:
    """The run is over; once for each run."""

    reason: str  # "finished", "stopped", "aborted: ..."


Action: TypeAlias = GoTo | VentNow | Marked | SegmentBreak | Noted | Ended
