"""The link to firmware that prints text (or RX8 packets): the same interface as `Connection`, described by a profile.

HELLO is made from the profile: after IDENTIFY and one good line; at once if the profile has a `start` command, since
such a device is silent until started. There are no answers: a command with a template counts as done when it is sent.
Without one, HEARTBEAT, CLEAR_FAULT and SET_LIMITS are answered "not supported", START and STOP are done at once, VENT
and SET_PRESSURE cannot be sent. Without an index, loss cannot be detected; without a time, samples are assumed to be
evenly spaced.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.base.clock_wraps import usual_wraps, wrap_between
from protocol.base.errors import RequestError
from protocol.link import messages
from protocol.link.events import BoardRestarted, CommandDone, CommandLost, HelloReceived, LinkEvent, LinkStatistics
from protocol.link.messages import AckStatus, Command, Identify
from protocol.link.sample_stream import NO_WRAP, WRAP, Rows, SampleStream, implausible
from protocol.recording import SampleFlag, SampleKind, sample_dtype
from protocol.text.packets import PacketFormat, PacketReader
from protocol.text.profile import COMMANDS, ProfileColumn, TextProfile
from protocol.text.readers import LineReader

IDENTIFY_NS = 2_500_000_000  # a device without a good line for so long does not match the profile
_FREE = (0.0, 0.0, False, True)  # any value is accepted
_KEYS = {type(example): key for key, example in COMMANDS.items()}


class TextConnection:
    """A device described by a text profile, host side: a `protocol.link.events.Link`."""

    def __init__(self, profile: TextProfile, *, decoder_state: dict[str, Any] | None = None) -> None:
        self.profile = profile
        self.cannot_command_reason = profile.cannot_command_reason
        self.can_command = not self.cannot_command_reason
        self.n_sensors = profile.n_sensors
        self.sample_kind: SampleKind = profile.sample_kind
        self.hello: messages.Hello | None = None  # made from the profile once the device has sent a good line
        self.channels = profile.channels
        self._dtype = sample_dtype(profile.n_sensors, profile.sample_kind, len(profile.channels))
        self._reader: LineReader | PacketReader
        if isinstance(profile.format, PacketFormat):
            self._reader = PacketReader(profile.format, profile.signed)
        else:
            self._reader = LineReader(profile.format, first_is_whole="start" in profile.templates)
        self._stream = _make_stream(profile)
        time = profile.column("time")
        self._clock = _Clock(time.factor) if time is not None and not time.wraps_at else None
        self._seq = 0
        self._number = 0
        self._factors, self._offsets = np.array([(c.factor, c.offset) for c in profile.columns]).T
        used = profile.columns[: len(profile.columns) - len(profile.channels)]
        bounds = [*map(_bounds, used), *([_FREE] * len(profile.channels))]
        self._lows, self._highs, whole, free = np.array(bounds).T
        self._whole, self._free = whole.astype(bool), free.astype(bool)
        self._sensor_fields = (
            (("signal_mv", "signal"),) if profile.sample_kind == "signal" else (("lit", "lit"), ("dark", "dark"))
        )
        self._start_sent = False
        self._identifying: list[tuple[Identify, int, int]] = []  # command, seq, deadline
        self._answers: list[LinkEvent] = []
        if decoder_state is not None:
            self._reader.restore(decoder_state["reader"])
            self._stream.restore(decoder_state["samples"], self._dtype)
            self._number = decoder_state["number"]
            if self._clock is not None and "clock" in decoder_state:  # not in recordings of older versions
                self._clock.state = list(decoder_state["clock"])

    @property
    def statistics(self) -> LinkStatistics:
        return LinkStatistics(**self._reader.counters, **self._stream.counters)

    @property
    def next_deadline_ns(self) -> int | None:
        """Latest time for the next `poll`; 0 while answers are pending, None while nothing is."""
        if self._answers:
            return 0
        return min((deadline for _, _, deadline in self._identifying), default=None)

    def decoder_state(self) -> dict[str, Any]:
        """Return the decoder's memory of the bytes so far, ready for JSON; see `Link`."""
        clock = {} if self._clock is None else {"clock": self._clock.state}
        return {"reader": self._reader.state(), "samples": self._stream.state(), "number": self._number, **clock}

    def send(self, command: Command, now_ns: int) -> bytes:
        """Return the text of a command; empty if none is needed. RequestError: the profile cannot command pressure."""
        seq, self._seq = self._seq, (self._seq + 1) & 0xFF
        template = self.profile.templates.get(_KEYS[type(command)])
        if isinstance(command, messages.SetPressure) and not self.can_command:
            raise RequestError(self.cannot_command_reason, "complete the profile, or record without a plan")
        if template is None and isinstance(command, messages.Vent):
            raise RequestError(f"the profile {self.profile.name!r} has no `commands.vent`", "open the valve manually")
        if isinstance(command, Identify):
            if "start" in self.profile.templates:
                self._identify([(command, seq)])
            else:
                self._identifying.append((command, seq, now_ns + IDENTIFY_NS))
        else:
            done = template is not None or isinstance(command, messages.Start | messages.Stop)
            self._answers.append(CommandDone(command, seq, AckStatus.DONE if done else AckStatus.NOT_SUPPORTED))
        self._start_sent |= template is not None and isinstance(command, messages.Start)
        return b"" if template is None else template(command)

    def feed(self, command: messages.Heartbeat, now_ns: int) -> bytes:
        """Return the text that feeds the watchdog, where the firmware has one."""
        return self.send(command, now_ns)

    def poll(self, now_ns: int, heard_ns: int | None = None) -> tuple[list[LinkEvent], bytes]:
        """Return the pending answers, and the IDENTIFYs that no good line followed; never bytes."""
        answers, self._answers = self._answers, []
        late = [entry for entry in self._identifying if now_ns >= entry[2]]
        self._identifying = [entry for entry in self._identifying if now_ns < entry[2]]
        return [*answers, *(CommandLost(command, seq) for command, seq, _ in late)], b""

    def receive(self, data: bytes, now_ns: int) -> list[LinkEvent]:
        """Return the events in the bytes; damaged lines are counted in `statistics`, never raised."""
        values = self._reader.receive(data)
        rows = self._to_rows(np.array(values), now_ns) if values else np.empty(0, self._dtype)
        if len(rows) and self._identifying:
            self._identify([(command, seq) for command, seq, _ in self._identifying])
            self._identifying = []
        answers, self._answers = self._answers, []
        events = self._stream.accept(rows)
        if self._start_sent and BoardRestarted(None) in events:  # the START of this link restarted its samples
            events.remove(BoardRestarted(None))
            self._start_sent = False
        return [*answers, *events]

    def receive_chunks(self, chunks: Sequence[tuple[int, bytes]]) -> list[LinkEvent]:
        """Return the same for many chunks (now_ns, data)."""
        return [event for now_ns, data in chunks for event in self.receive(data, now_ns)]

    def _identify(self, requests: list[tuple[Identify, int]]) -> None:
        low, high = self.profile.limits_pa or (0, 0)
        self.hello = messages.Hello(
            protocol=messages.PROTOCOL_VERSION,
            fw_major=0,
            fw_minor=0,
            n_sensors=self.profile.n_sensors,
            rate_max_hz=max(1, round(self.profile.rate_hz)),
            adc_bits=self.profile.adc_bits,
            boot_reason=messages.BootReason.POWER,
            vref_mv=self.profile.vref_mv,
            pressure_min_pa=low,
            pressure_max_pa=high,
            board_id=self.profile.name,
        )
        self._answers.append(HelloReceived(self.hello))
        self._answers += [CommandDone(command, seq, None) for command, seq in requests]

    def _to_rows(self, values: np.ndarray[Any, np.dtype[np.float64]], now_ns: int) -> Rows:
        """Return the samples in the values of lines, shape (n, columns); lines with impossible numbers are left out."""
        values = values * self._factors + self._offsets
        with np.errstate(invalid="ignore"):
            possible = (values >= self._lows) & (values <= self._highs) & (~self._whole | (values == np.rint(values)))
        possible = (possible | self._free).all(axis=1)
        self._reader.malformed += int((~possible).sum())
        values, used = values[possible], len(self.profile.columns) - len(self.channels)
        columns = dict(zip((column.name for column in self.profile.columns[:used]), values.T, strict=False))
        if self._clock is not None and len(values):
            columns["time"] = self._clock.unwrapped(columns["time"])
        rows = np.zeros(len(values), self._dtype)
        rows["host_ns"] = now_ns
        rows["pressure_pa"] = columns["pressure"]
        index = columns.get("index", np.arange(self._number, self._number + len(rows)) % WRAP)
        self._number = (self._number + len(rows)) % WRAP
        rows["index"] = index
        rows["time_us"] = np.rint(columns.get("time", index * (1e6 / self.profile.rate_hz)))
        for sensor in range(self.profile.n_sensors):
            for field, name in self._sensor_fields:
                rows[field][:, sensor] = columns[f"s{sensor + 1}_{name}"]
        if self.channels:
            rows["channel"] = values[:, used:]
        rows["flags"][implausible(rows, self.profile.adc_bits)] |= np.uint16(SampleFlag.IMPLAUSIBLE)
        return rows


class _Clock:
    """A clock whose wrap the profile does not state; `state` : time added, the last time as sent, the last step, us."""

    def __init__(self, tick_us: float) -> None:
        self._wraps = [1e6 * wrap for wrap in usual_wraps(tick_us / 1e6)]
        self.state = [0.0, 0.0, 0.0]

    def unwrapped(self, raw_us: FloatArray) -> FloatArray:
        """Return times as sent on a clock that does not wrap."""
        added, last, step = self.state
        steps = np.diff(raw_us, prepend=last)
        if (steps >= 0).all():
            self.state = [added, float(raw_us[-1]), float(steps[-1]) or step]
            return raw_us + added
        times = []
        for raw in raw_us.tolist():
            if raw < last and (wrap := wrap_between(last, raw, step, self._wraps)):
                added += wrap
            elif raw > last:
                step = raw - last
            last = raw
            times.append(raw + added)
        self.state = [added, last, step]
        return np.asarray(times)


def _bounds(column: ProfileColumn) -> tuple[float, float, bool, bool]:
    """Return the lowest and highest value of a column, whether it is whole, and whether any value is accepted."""
    if column.name == "time":
        return 0, 2.0**53, False, False
    if column.name == "index":
        return 0, WRAP - 1, True, False
    if column.name.endswith(("_lit", "_dark")):
        return 0, 65_535, True, False
    return _FREE  # pressure and signal: always kept, and flagged where impossible


def _make_stream(profile: TextProfile) -> SampleStream:
    index, time = profile.column("index"), profile.column("time")
    index_wrap = (index and index.wraps_at) or WRAP
    if time is None:
        time_wrap = round(index_wrap * 1e6 / profile.rate_hz)
    else:
        time_wrap = round(time.wraps_at * time.factor) if time.wraps_at else NO_WRAP
    by_time = index is None and time is not None
    return SampleStream(index_wrap=None if by_time else index_wrap, time_wrap_us=time_wrap, announces_restart=False)
