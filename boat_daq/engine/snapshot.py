"""A session's state as frozen values, taken under its lock, for pages and commands to show.

Nothing here acts. A page calls `Session.snapshot()` up to 30 times a second, compares with the one before, and shows
the difference. Pressure is in kPa (gauge), time in seconds of board time unless a name says otherwise.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from protocol.recording import RunEnd

if TYPE_CHECKING:
    from pathlib import Path

    from boat_daq.engine.plan import Plan
    from protocol.link.events import LinkStatistics
    from protocol.link.messages import Hello
    from protocol.recording import BoardState, SampleFlag


class LinkState(enum.StrEnum):
    """State of the link."""

    CLOSED = "closed"
    OPENING = "opening"  # the port opens; waiting for the board's HELLO
    UP = "up"
    SILENT = "silent"  # open, but no data for a second
    LOST = "lost"  # unplugged; sought by its board_id
    FAILED = "failed"  # refused; the reason is in `SessionSnapshot.link_error`


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
    ASSESSING = "assessing"  # the cycle is complete; its uncertainty is computed
    VENTING = "venting"


class MessageKind(enum.StrEnum):
    """What a message is about; of an event that is recorded too, its `event.kind`."""

    # the run
    RUN_STARTED = "run_started"
    RUN_ENDED = "run_ended"
    PAUSED = "paused"
    RESUMED = "resumed"
    ENOUGH_CYCLES = "enough_cycles"
    NOT_STEADY = "not_steady"
    READING_MISSING = "reading_missing"
    STEP_TIMEOUT = "step_timeout"
    VENT_TIMEOUT = "vent_timeout"
    VENT = "vent"
    FAULT_CLEARED = "fault_cleared"
    # trips
    LINK_LOST = "link_lost"
    SILENT = "silent"
    ESTOP = "estop"
    PRESSURE_INVALID = "pressure_invalid"
    IMPLAUSIBLE = "implausible"
    OVER_PRESSURE = "over_pressure"
    UNDER_PRESSURE = "under_pressure"
    BOARD_FAULT = "board_fault"
    BOARD_RESTARTED = "board_restarted"
    BOARD_CLOCK = "board_clock"
    BOARD_OVER_PRESSURE = "board_over_pressure"
    BOARD_UNDER_PRESSURE = "board_under_pressure"
    BOARD_HEARTBEAT_LOST = "board_heartbeat_lost"
    BOARD_ESTOP_PRESSED = "board_estop_pressed"
    BOARD_TARGET_NOT_REACHED = "board_target_not_reached"
    BOARD_VENTED = "board_vented"
    REFUSED = "refused"
    NO_ANSWER = "no_answer"
    # control of the elongation
    ELONGATION_CONTROL = "elongation_control"
    SENSORS_DISAGREE = "sensors_disagree"
    ELONGATION_UNKNOWN = "elongation_unknown"
    ELONGATION_UNCERTAIN = "elongation_uncertain"
    NOT_FOLLOWING = "not_following"
    STALE_SAMPLES = "stale_samples"
    LINK_DELAY = "link_delay"
    PRESSURE_AT_LIMIT = "pressure_at_limit"
    SENSOR_LOST = "sensor_lost"
    # the board and its sensors
    SAMPLES_AGAIN = "samples_again"
    FLAT_LINE = "flat_line"
    PRESSURE_OFF = "pressure_off"
    SATURATED = "saturated"
    DROPPED = "dropped"
    RATE = "rate"
    LIMITS = "limits"
    NO_WATCHDOG = "no_watchdog"
    # the session
    LINK_FAILED = "link_failed"
    BOARD_FOUND = "board_found"
    STORAGE = "storage"
    BACKUP_USED = "backup_used"
    UNIT_LIMITS = "unit_limits"
    SLOW = "slow"
    SINK_FAILED = "sink_failed"
    CAMERA = "camera"
    MARK = "mark"


@dataclass(frozen=True, slots=True)
class Message:
    """One line for the operator. `number` increases by one, so that a reader can find what is new."""

    number: int
    kind: MessageKind
    level: str  # "info", "warning" or "error"
    cause: str
    remedy: str = ""
    host_ns: int = 0
    command: str = ""  # the remedy on the command line, which the window does not show


class LinkError(NamedTuple):
    """Why a link failed; `command` is the remedy on the command line, which the window does not show."""

    cause: str
    remedy: str
    command: str = ""


@dataclass(frozen=True, slots=True)
class RunEnding:
    """How a run ended; `cause` is why one was aborted."""

    end: RunEnd
    cause: str = ""

    @property
    def aborted(self) -> bool:
        """Whether the run was ended neither by its plan nor by the operator's stop."""
        return self.end in (RunEnd.ABORTED, RunEnd.FAULT)

    @property
    def text(self) -> str:
        """The ending as `session.stop_reason` keeps it for people. "finished", "stopped", "aborted: CAUSE"."""
        return f"{RunEnd.ABORTED}: {self.cause}" if self.aborted else str(self.end)


@dataclass(frozen=True, slots=True)
class Limits:
    """The tightest limits in force, and the source of each: "board", "unit" or "plan"."""

    min_kpa: float
    max_kpa: float
    min_source: str
    max_source: str

    @property
    def pascals(self) -> list[float]:
        """The limits as `session.limits_pa` keeps them."""
        return [1000 * self.min_kpa, 1000 * self.max_kpa]


@dataclass(frozen=True, slots=True)
class LastSample:
    """The newest sample, in the lab's units."""

    time_s: float
    pressure_kpa: float  # nan where it is invalid
    target_kpa: float  # nan while nothing is commanded
    signal_mv: tuple[float, ...]
    state: BoardState
    flags: SampleFlag


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of the elongation at a plateau. A correction is a newer one for the same step."""

    step_id: int
    elongation_mm: float | None  # None withdraws the reading
    resolution_mm: float | None  # of the grid it was read from
    source: str  # "typed", "csv", "photograph", "simulated" ...
    utc: str
    reader: str = ""
    note: str = ""


@dataclass(frozen=True, slots=True)
class CameraReading:
    """The elongation of one frame. `elongation_mm`, `u_mm`: None where there is no value."""

    host_ns: int  # host monotonic clock at the frame's arrival
    elongation_mm: float | None
    u_mm: float | None
    fault: str = ""  # why there is none; empty where there is one
    dropped: int = 0  # frames missing before this one


@dataclass(frozen=True, slots=True)
class ReadingRequest:
    """The plateau that waits for its reading; `time_left_s` of board time, then the run continues without it."""

    step_id: int
    cycle: int
    branch: str
    target_kpa: float
    pressure_kpa: float
    time_left_s: float = math.inf


class LinkWarningCode(enum.StrEnum):
    """Which figure of the link is out of bounds."""

    SILENT = "silent"
    LOSS = "loss"
    RATE = "rate"
    CLOCK = "clock"


@dataclass(frozen=True, slots=True)
class LinkWarning:
    """A figure of the link that is out of bounds."""

    code: LinkWarningCode
    text: str


LATE_MS = 500.0  # `lag_ms` above which the operator is warned
NOT_SAVED_MS = 3_000.0  # waiting for the disk: it is full, or gone


@dataclass(frozen=True, slots=True)
class HealthSnapshot:
    """State of the link at one instant; counters since the link was made."""

    statistics: LinkStatistics
    rate_hz: float | None  # by the board's clock, lost samples left out, over the last 5 s of it
    asked_hz: float | None
    silent_s: float  # since the last samples
    lag_ms: float  # age of the oldest thing not yet on disk
    drift_ppm: float | None  # positive: the board's clock is slow; None while unknown, or where time is not real
    jitter_ms: float | None  # rms about the fit
    offset_ms: float | None  # host time of board time 0, from the first sample's arrival
    warnings: tuple[LinkWarning, ...]
    at_risk_ms: float = 0.0  # what a crash would cost at most: commit interval and the disk's latency, as measured

    @property
    def late(self) -> bool:
        """Whether samples wait too long for the disk."""
        return self.lag_ms > LATE_MS


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is."""

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
    target_mm: float | None = None  # of a plan in millimetres; `target_kpa` is then the pressure the step began at


@dataclass(frozen=True, slots=True)
class ElongationControl:
    """The closed loop now: setpoint, the shaped setpoint it follows, and the measured elongation with U (k = 2)."""

    target_mm: float
    setpoint_mm: float
    elongation_mm: float
    u_mm: float
    saturated: bool = False  # the pressure is at a limit, or at its ramp
    lost: tuple[int, ...] = ()  # sensors (from 1) that no longer take part
    hold: bool = False  # a stop keeps the last pressure, in place of venting
    delay_s: float = 0.0  # the slowest of the last answers


@dataclass(frozen=True, slots=True)
class SessionSnapshot:
    """Everything a page shows, at one instant."""

    state: SessionState
    link: LinkState
    port: str | None = None
    link_error: LinkError | None = None
    hello: Hello | None = None
    simulated: bool = False
    can_command: bool = False
    why_read_only: str = ""
    health: HealthSnapshot | None = None
    speed: float = 1.0  # board time per host time; 1 for a real board
    limits: Limits | None = None
    last: LastSample | None = None
    plan: Plan | None = None
    progress: Progress | None = None
    waiting_for_reading: ReadingRequest | None = None
    latched: str = ""  # why the interlock forbids pressure; empty when it does not
    alarms: tuple[str, ...] = ()  # what messages reported of sensors and pressure, and is so still
    pressure_off: bool = False  # a pressure set manually is not there, or one stays on a vented unit
    messages: tuple[Message, ...] = ()  # the newest 50
    run_ended: RunEnding | None = None  # the last run; None before the first ends, and during the next
    refused_first: bool = False  # the board refused the first pressure of the run: nothing was measured
    recording: Path | None = None
    recorded_s: float = 0.0
    not_saving: str = ""  # why the recorder saves nothing at present; empty while it does
    unit: str = ""
    elongation: ElongationControl | None = None  # while it is controlled

    @property
    def under_way(self) -> bool:
        """Whether a run is in progress, paused or at its end, until the unit is vented."""
        return self.state in (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING)

    @property
    def commanded(self) -> bool:
        """Whether the board commands a pressure, in a run or by hand."""
        return self.last is not None and math.isfinite(self.last.target_kpa)

    @property
    def saves_nothing(self) -> bool:
        """Whether the recording in progress is not saved now."""
        return bool(self.not_saving) or (self.health is not None and self.health.lag_ms > NOT_SAVED_MS)
