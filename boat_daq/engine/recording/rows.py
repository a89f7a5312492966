"""From blocks to rows: which part of a stream goes into which table. Pure, used by the one writing thread.

Rules: bytes are stored before what was decoded from them, in the same transaction. Samples are stored exactly as the
link gave them. Keys are counted here, so that a statement tried twice is the same statement.
"""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.block import Block, EngineEvent, PortLost, PortSilent, SinkFailed
from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.file import Statement
from boat_daq.engine.sample_columns import mv_per_count
from boat_daq.engine.snapshot import CameraReading, HealthSnapshot, Reading
from protocol.base.errors import RequestError
from protocol.link import events as link
from protocol.link.framing import FrameReader
from protocol.link.messages import AckStatus, EventCode, Heartbeat, Identify, MessageType, SetPressure, Start
from protocol.recording import BRANCHES, CAMERA_TABLE, dtype_from_description, fitted, overview_extremes

LONGEST_MM = 1000.0
BLOCK_SAMPLES_MAX = 20_000  # of one row; keeps a row below a megabyte
OVERVIEW_SAMPLES = 1_000

INSERT_CHUNK = "INSERT OR IGNORE INTO chunk VALUES (?, ?, ?, ?, ?)"
INSERT_SEGMENT = "INSERT OR IGNORE INTO segment VALUES (?, ?, ?, ?, ?, ?)"
INSERT_BLOCK = "INSERT OR IGNORE INTO block VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
INSERT_OVERVIEW = "INSERT OR IGNORE INTO overview VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
INSERT_EVENT = "INSERT OR IGNORE INTO event VALUES (?, ?, ?, ?, ?, ?, ?, ?)"
INSERT_STEP = """INSERT OR IGNORE INTO step
    (id, segment, number, cycle, branch, target_kpa, ramp_kpa_per_s, started_us, status)
    VALUES (?, ?, ?, ?, ?, ?, ?, ?, 'running')"""
UPDATE_STEP = """UPDATE step SET arrived_us = coalesce(?, arrived_us), settled_us = coalesce(?, settled_us),
    ended_us = coalesce(?, ended_us), status = coalesce(?, status), detail = coalesce(?, detail) WHERE id = ?"""
INSERT_READING = "INSERT INTO reading VALUES (NULL, ?, ?, ?, ?, ?, ?, ?)"
INSERT_CAMERA = "INSERT INTO camera VALUES (NULL, ?, ?, ?, ?, ?, ?)"
INSERT_HEALTH = "INSERT INTO health VALUES (NULL, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"

# `event.kind` of what a board reports: its end is the unit of the value
BOARD_EVENT_KINDS: dict[int, str] = {
    EventCode.BOOTED: "booted",
    EventCode.OVER_PRESSURE: "over_pressure_pa",
    EventCode.UNDER_PRESSURE: "under_pressure_pa",
    EventCode.HEARTBEAT_LOST: "heartbeat_lost_ms",
    EventCode.ESTOP_PRESSED: "estop_pressed",
    EventCode.ESTOP_RELEASED: "estop_released",
    EventCode.SENSOR_SATURATED: "sensor_saturated",  # value: the sensor, from 1
    EventCode.TARGET_NOT_REACHED: "target_not_reached_pa",
    EventCode.SAMPLES_DROPPED: "samples_dropped",
}


def step_row(mark: StepMark, segment: int, *, new: bool) -> Statement:
    """Return the row of a step that begins, or the update of one. RequestError: a branch that is none."""
    if mark.branch not in BRANCHES:
        raise RequestError(f"a step's branch is one of {', '.join(BRANCHES)}, not {mark.branch!r}")
    if new:
        values = (mark.number, mark.cycle, mark.branch, mark.target_kpa, mark.ramp_kpa_per_s, mark.started_us)
        return INSERT_STEP, (mark.number, segment, *values)
    times = (mark.arrived_us, mark.settled_us, mark.ended_us)
    return UPDATE_STEP, (*times, mark.status, json.dumps(dict(mark.detail)), mark.number)


def reading_row(reading: Reading) -> Statement:
    """Return the row of a reading. RequestError: not an elongation, or not a resolution."""
    x, resolution = reading.elongation_mm, reading.resolution_mm
    if x is not None and not abs(x) <= LONGEST_MM:
        raise RequestError(f"{x} is not an elongation in mm", f"give a number within ±{LONGEST_MM:g}")
    if resolution is not None and not 0 < resolution <= LONGEST_MM:
        raise RequestError(f"{resolution} mm is not a resolution", "give that of the grid, such as 0.5")
    return INSERT_READING, (reading.utc, reading.step_id, x, resolution, reading.source, reading.reader, reading.note)


def camera_row(reading: CameraReading, segment: int | None) -> Iterator[Statement]:
    """Give the row of a camera's reading; the first one makes its table."""
    r = reading
    yield CAMERA_TABLE, ()
    yield INSERT_CAMERA, (r.host_ns, segment, r.elongation_mm, r.u_mm, r.fault, r.dropped)


def health_row(host_ns: int, health: HealthSnapshot, segment: int | None, time_us: int | None) -> Iterator[Statement]:
    """Give the row of the link's counters at one instant."""
    s = health.statistics
    counters = (s.bytes, s.frames, s.samples, s.lost, s.crc_errors, s.malformed, s.oversize, s.duplicates, s.unknown)
    yield INSERT_HEALTH, (host_ns, segment, time_us, *counters, health.rate_hz, health.lag_ms)


class OverviewRows:
    """Gathers blocks until about a thousand samples are one row of `overview`."""

    def __init__(self, scale_mv: float, *, next_id: int = 1) -> None:
        self._scale_mv = scale_mv
        self._next_id = next_id
        self._held: list[tuple[int, int, NDArray[np.void]]] = []  # (block, segment, samples)
        self._n = 0

    def add(self, block: int, segment: int, samples: NDArray[np.void]) -> Iterator[Statement]:
        """Take a block; give the rows that are complete with it."""
        if self._held and self._held[0][1] != segment:
            yield from self.finish()
        self._held.append((block, segment, samples))
        self._n += len(samples)
        if self._n >= OVERVIEW_SAMPLES:
            yield from self.finish()

    def finish(self) -> Iterator[Statement]:
        """Give the row of what is held."""
        if not self._held:
            return
        samples = np.concatenate([held for _, _, held in self._held])
        first, last = self._held[0], self._held[-1]
        times = (int(samples["time_us"][0]), int(samples["time_us"][-1]))
        extremes = overview_extremes(samples, self._scale_mv)
        yield INSERT_OVERVIEW, (self._next_id, first[1], first[0], last[0], self._n, *times, *extremes)
        self._next_id += 1
        self._held, self._n = [], 0


@dataclass(frozen=True, slots=True)
class Counters:
    """What a recording holds already. The newest key of each table, its bytes and its samples."""

    segment: int = 0
    chunks: int = 0
    bytes: int = 0
    samples: int = 0
    block: int = 0
    event: int = 0
    overview: int = 0
    step: int = 0
    result: int = 0


class RowMaker:
    """Turns blocks, in order, into statements. Keeps the counters of what went by, from `before` on."""

    def __init__(self, meta: Mapping[str, Any], before: Counters = Counters()) -> None:
        self._dtype = dtype_from_description(meta["sample_dtype"])
        self._overview = OverviewRows(mv_per_count(meta), next_id=before.overview + 1)
        self._held: list[NDArray[np.void]] = []  # samples of the current segment without a row yet
        self._last_block = before.block
        self._last_event = before.event
        self._time_us: int | None = None
        self._before = before.segment
        self._start_due = self._start_unanswered = False  # START left; index 0 came before its answer
        self.segment = before.segment
        self.chunks = before.chunks
        self.bytes = before.bytes
        self.samples = before.samples

    def block(self, block: Block) -> Iterator[Statement]:
        """Give the rows of a block: its bytes, then what was decoded from them, in order."""
        if block.raw:
            self.chunks += 1
            self.bytes += len(block.raw)
            yield INSERT_CHUNK, (self.chunks, block.host_ns, int(block.sent), block.raw, crc32(block.raw))
            if block.sent and any(frame.type == MessageType.START for frame in FrameReader().receive(block.raw)):
                self._start_due = True
        for event in block.events:
            if isinstance(event, link.Samples):
                yield from self._samples(event.array, block.host_ns)
            else:
                yield from self._event_rows(event, block.host_ns)

    def attached(self, decoder_state: Mapping[str, Any], host_ns: int) -> Iterator[Statement]:
        """Give the row of the segment that begins with a link, with its decoder's state."""
        first = "resumed after a break" if self._before else "opened"
        reason = "reconnected" if self.segment > self._before else first
        yield from self.begin_segment(reason, host_ns, decoder=json.dumps(decoder_state))

    def begin_segment(
        self, reason: str, host_ns: int, *, paused: bool = False, here: bool = False, decoder: str | None = None
    ) -> Iterator[Statement]:
        """Give the row of a new segment."""
        yield from self.flush()
        self.segment += 1
        self._time_us = None
        first_chunk = self.chunks if here else self.chunks + 1
        yield INSERT_SEGMENT, (self.segment, host_ns, first_chunk, reason, int(paused), decoder)

    def event(
        self, host_ns: int, source: str, kind: str, value: float | None, text: str, time_us: int | None = None
    ) -> Iterator[Statement]:
        """Give the row of an event. `time_us`: board time; the newest sample's when None."""
        self._last_event += 1
        time_us = self._time_us if time_us is None else time_us
        segment = self.segment or None
        yield INSERT_EVENT, (self._last_event, host_ns, segment, time_us, source, kind, value, text)

    def flush(self, *, last: bool = False) -> Iterator[Statement]:
        """Give the rows of the samples that are held. Of the overview too when they were the last."""
        if self._held:
            samples = np.concatenate(self._held) if len(self._held) > 1 else self._held[0]
            self._held = []
            for start in range(0, len(samples), BLOCK_SAMPLES_MAX):
                yield from self._block_row(samples[start : start + BLOCK_SAMPLES_MAX])
        if last:
            yield from self._overview.finish()

    @property
    def here(self) -> tuple[int | None, int | None]:
        """Segment and board time of the newest sample."""
        return self.segment or None, self._time_us

    def _block_row(self, samples: NDArray[np.void]) -> Iterator[Statement]:
        self._last_block += 1
        times = (int(samples["time_us"][0]), int(samples["time_us"][-1]))
        content = samples.tobytes()
        row = (self._last_block, self.segment, self.chunks, len(samples), *times, content, crc32(content))
        yield INSERT_BLOCK, row
        yield from self._overview.add(self._last_block, self.segment, samples)

    def _samples(self, samples: NDArray[np.void], host_ns: int) -> Iterator[Statement]:
        samples = fitted(samples, self._dtype)
        if samples.dtype != self._dtype:
            text = "samples of another layout than the session's: kept as bytes only"
            yield from self.event(host_ns, "host", "other_layout", len(samples), text)
            return
        if not len(samples):
            return
        if self.segment == self._before:
            yield from self.begin_segment("opened", host_ns, here=True)
        if self._start_due and not samples["index"].all():
            samples = yield from self._started_unanswered(samples, host_ns)
        self._held.append(samples)
        self._time_us = int(samples["time_us"][-1])
        self.samples += len(samples)

    def _started_unanswered(
        self, samples: NDArray[np.void], host_ns: int
    ) -> Generator[Statement, None, NDArray[np.void]]:
        """Begin the segment of a START whose answer is late with its first sample. Return the samples from there on."""
        first = int(np.argmin(samples["index"]))
        if first:
            self._held.append(samples[:first])
            self.samples += first
        yield from self.begin_segment("started", host_ns, here=True)
        self._start_due, self._start_unanswered = False, True
        return samples[first:]

    def _event_rows(self, event: link.LinkEvent | EngineEvent, host_ns: int) -> Iterator[Statement]:
        """Give the rows of an event that is not samples."""
        match event:
            case link.BoardRestarted(hello):
                yield from self.begin_segment("board restarted", host_ns, here=True)
                self._start_due = self._start_unanswered = False
                reason = None if hello is None else hello.boot_reason
                yield from self.event(host_ns, "board", "restarted", reason, "" if hello is None else str(hello))
            case link.ClockWentBack(by_us):
                yield from self.begin_segment("clock went back", host_ns, here=True)
                yield from self.event(host_ns, "board", "clock_back_us", by_us, "")
            case link.CommandDone(Start() as command, _, AckStatus.DONE):
                if not self._start_unanswered:
                    yield from self.begin_segment("started", host_ns, here=True)
                self._start_due = self._start_unanswered = False
                yield from self.event(host_ns, "host", "start_hz", command.rate_hz, "")
            case link.CommandDone(Heartbeat() | Identify(), _, AckStatus.DONE | None):
                return  # the bytes have them; a row every half second would hide the others
            case link.CommandDone(SetPressure() as command, _, AckStatus.DONE):
                yield from self.event(host_ns, "host", "set_pressure_pa", command.target_pa, str(command))
            case link.CommandDone(command, _, AckStatus.DONE):
                yield from self.event(host_ns, "host", "command", None, str(command))
            case link.CommandDone(command, _, status):
                yield from self.event(host_ns, "board", "refused", status, f"{command}: {status!r}")
            case link.CommandLost(command, _):
                yield from self.event(host_ns, "host", "command_lost", None, str(command))
            case link.SampleGap(lost, before_index, time_us):
                text = f"before index {before_index}"
                yield from self.event(host_ns, "host", "gap", lost, text, time_us)
            case link.BoardEventReceived(received, time_us):
                kind = BOARD_EVENT_KINDS.get(received.code, f"code_{int(received.code)}")
                value = received.value + 1 if received.code == EventCode.SENSOR_SATURATED else received.value
                yield from self.event(host_ns, "board", kind, value, "", time_us)
            case PortLost(error):
                yield from self.event(host_ns, "host", "port_lost", None, error.cause)
            case PortSilent(silent_s):
                yield from self.event(host_ns, "host", "silent_s", silent_s, "")
            case SinkFailed(sink, error):
                yield from self.event(host_ns, "host", "sink_failed", None, f"{sink}: {error!r}")
            case link.HelloReceived(hello):
                yield from self.event(host_ns, "board", "hello", None, str(hello))
            case link.WrongProtocol(board_version, program_version):
                text = f"this program uses version {program_version}"
                yield from self.event(host_ns, "board", "wrong_protocol_version", board_version, text)
