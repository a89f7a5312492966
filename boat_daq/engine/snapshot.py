"""What a session shows of itself: frozen values, taken under its lock and handed to whoever draws or prints.

Nothing here acts. A page or a command asks `Session.snapshot()` as often as it likes (30 times a second costs
nothing), compares with the one before, and shows the difference. Pressure is in kPa (gauge), time in seconds of
board time unless a name says otherwise.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from protocol.link.messages import Hello
    from protocol.recording import BoardState, SampleFlag


class LinkState(enum.StrEnum):
    """What is known of the port."""

    CLOSED = "closed"
    OPENING = "opening"  # the port opens; waiting for the board to say who it is
    UP = "up"
    SILENT = "silent"  # open, but no data for a second
    LOST = "lost"  # unplugged; looked for again by its board_id
    FAILED = "failed"  # refused: `SessionSnapshot.link_error` says why


class SessionState(enum.StrEnum):
    """States of a run."""

    IDLE = "idle"
    ARMED = "armed"
    RUNNING = "running"
    PAUSED = "paused"
    FINISHING = "finishing"
    ABORTED = "aborted"
    FAULT = "fault"


class Phase(enum.StrEnum):
    """Where in its step a run is."""

    RAMPING = "ramping"
    SETTLING = "settling"
    DWELLING = "dwelling"
    WAITING_FOR_READING = "waiting for reading"
    VENTING = "venting"


@dataclass(frozen=True, slots=True)
class Message:
    """One line for the operator; `number` grows by one each, so that a reader knows what is new."""

    number: int
    level: str  # "info", "warning" or "error"
    cause: str
    remedy: str = ""
    host_ns: int = 0


@dataclass(frozen=True, slots=True)
class Limits:
    """The tightest limits in force, and whose each is: "board", "unit" or "plan"."""

    min_kpa: float
    max_kpa: float
    min_source: str
    max_source: str


@dataclass(frozen=True, slots=True)
class LastSample:
    """The newest sample, in the lab's units."""

    time_s: float
    pressure_kpa: float
    target_kpa: float  # nan while nothing is commanded
    signal_mv: tuple[float, ...]
    state: BoardState
    flags: SampleFlag


@dataclass(frozen=True, slots=True)
class StepMark:
    """One step of a run as the recording's table `step` keeps it; `number` is its `step_id`. Times are board time."""

    number: int
    cycle: int
    branch: str
    target_kpa: float
    ramp_kpa_per_s: float
    started_us: int
    arrived_us: int | None = None
    settled_us: int | None = None
    ended_us: int | None = None
    status: str = "running"  # running, reached, timeout, aborted
    detail: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of the elongation at a plateau; a correction is a newer one for the same step."""

    step_id: int
    elongation_mm: float | None  # None withdraws the reading
    resolution_mm: float
    source: str  # "typed", "csv", "photograph", "simulated" ...
    utc: str
    reader: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class ReadingRequest:
    """The plateau that waits for its reading."""

    step_id: int
    cycle: int
    branch: str
    target_kpa: float
    pressure_kpa: float
    waits_until_s: float  # board time at which the run goes on without it


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is."""

    plan_name: str
    step: int  # steps begun, from 1
    steps: int  # steps expected in all
    cycle: int
    cycles: int  # the highest cycle number expected
    complete_cycles: int
    incomplete_cycles: tuple[int, ...]
    branch: str
    phase: Phase
    target_kpa: float
    step_time_s: float
    elapsed_s: float
    time_left_s: float


@dataclass(frozen=True, slots=True)
class SessionSnapshot:
    """Everything a page shows, at one instant."""

    state: SessionState
    link: LinkState
    port: str | None = None
    link_error: tuple[str, str] | None = None  # cause and remedy
    hello: Hello | None = None
    simulated: bool = False
    can_command: bool = False
    why_read_only: str = ""
    health: Any = None  # the link's figures: rate, lost, CRC errors, lag (engine/link_health.py)
    speed: float = 1.0  # board time per host time; 1 for a real board
    heartbeat_ms: int = 0  # 0: not armed
    limits: Limits | None = None
    last: LastSample | None = None
    plan: Any = None  # engine.plan.Plan
    progress: Progress | None = None
    waiting_for_reading: ReadingRequest | None = None
    latched: str = ""  # why the interlock forbids pressure; empty when it does not
    alarms: tuple[str, ...] = ()
    messages: tuple[Message, ...] = ()  # the newest 50
    run_ended: str = (
        ""  # how the last run ended: "finished", "stopped", "aborted: ..."; empty before, and while one goes
    )
    recording: Path | None = None
    recorded_s: float = 0.0
    unit: str = ""
