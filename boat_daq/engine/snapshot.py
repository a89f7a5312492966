"""What a session shows of itself: frozen values, taken under its lock and handed to whoever draws or prints.

Nothing here acts. A page or a command asks `Session.snapshot()` as often as it likes (30 times a second costs
nothing), compares with the one before, and shows the difference. Pressure is in kPa (gauge), time in seconds of
board time unless a name says otherwise.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from boat_daq.engine.plan import Plan
    from protocol.link.events import LinkStatistics
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
class HealthSnapshot:
    """State of the link at one instant; counters since the link was made."""

    statistics: LinkStatistics
    rate_hz: float | None  # by the board's clock, lost samples left out, over the last 5 s of it
    asked_hz: float | None
    silent_s: float  # since the last byte
    lag_ms: float  # age of the oldest thing not yet on disk
    drift_ppm: float | None  # positive: the board's clock is slow; None while unknown, or where time is not real
    jitter_ms: float | None  # rms about the fit
    offset_ms: float | None  # host time of board time 0, from the first sample's arrival
    warnings: tuple[str, ...]


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
    health: HealthSnapshot | None = None
    speed: float = 1.0  # board time per host time; 1 for a real board
    heartbeat_ms: int = 0  # 0: not armed
    limits: Limits | None = None
    last: LastSample | None = None
    plan: Plan | None = None
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
