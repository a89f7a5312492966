"""The sequencer's actions: what it requests and reports in answer to samples and operator; the controller acts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import MessageKind, RunEnding


@dataclass(frozen=True, slots=True)
class GoTo:
    """Request a pressure."""

    target_kpa: float
    ramp_kpa_per_s: float


@dataclass(frozen=True, slots=True)
class VentNow:
    """Request a vent."""


@dataclass(frozen=True, slots=True)
class StepChanged:
    """A step began (`new`), or more is known of it."""

    mark: StepMark
    new: bool


@dataclass(frozen=True, slots=True)
class SegmentBreak:
    """The recording's next segment begins here."""

    reason: str
    paused: bool


@dataclass(frozen=True, slots=True)
class ControlEvent:
    """An event for the recording; with a level, a message for the operator too."""

    kind: MessageKind
    text: str
    level: str = ""
    remedy: str = ""
    value: float | None = None


Action: TypeAlias = GoTo | VentNow | StepChanged | SegmentBreak | ControlEvent | RunEnding  # which comes once a run
