"""Messages: payloads of frames to values and back, for both sides of the link (protocol/SPEC.md, "Messages").

A payload longer than its layout is a newer minor version: its known head is used. A shorter one is malformed:
`RemoteError` from a board, `AckStatus.WRONG_LENGTH` for a command. An unknown code (event, boot reason, status) remains
an integer. Values are those of the frame: Pa, counts, microseconds of the board's 32-bit clock.
"""

from __future__ import annotations

import enum
import re
import struct
from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import Any, TypeVar

from protocol.base.errors import RemoteError, RequestError
from protocol.link.framing import Frame, encode_frame
from protocol.recording import CHANNELS_MAX, ExtraChannel, channels_of

PROTOCOL_VERSION = 1
SENSORS_MAX = 4
SIMULATED_PREFIX = "SIMULATED-"  # begins the identity of every virtual board, and of no other


class MessageType(enum.IntEnum):
    """0x01..0x7F come from the board, 0x81..0xFF from the host."""

    HELLO = 0x01
    SAMPLE = 0x02
    ACK = 0x03
    EVENT = 0x04
    IDENTIFY = 0x81
    START = 0x82
    STOP = 0x83
    SET_PRESSURE = 0x84
    VENT = 0x85
    HEARTBEAT = 0x86
    CLEAR_FAULT = 0x87
    SET_LIMITS = 0x88


class BootReason(enum.IntEnum):
    """Why the board booted."""

    POWER = 0
    WATCHDOG = 1
    BROWN_OUT = 2
    RESET_PIN = 3
    SOFTWARE = 4


class AckStatus(enum.IntEnum):
    """How the board answered a command."""

    DONE = 0
    UNKNOWN_COMMAND = 1
    WRONG_LENGTH = 2
    OUT_OF_LIMITS = 3
    NOT_IN_THIS_STATE = 4
    FAULT_LATCHED = 5
    NOT_SUPPORTED = 6


class EventCode(enum.IntEnum):
    """What the board reports of itself; the comment gives the meaning of `value`."""

    BOOTED = 1  # boot reason
    OVER_PRESSURE = 2  # Pa; vented
    UNDER_PRESSURE = 3  # Pa; vented
    HEARTBEAT_LOST = 4  # ms since the last frame; vented
    ESTOP_PRESSED = 5
    ESTOP_RELEASED = 6
    SENSOR_SATURATED = 7  # sensor, counted from 0
    TARGET_NOT_REACHED = 8  # Pa reached; vented
    SAMPLES_DROPPED = 9  # how many


# ---- board to host -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Hello:
    """Who the board is and what it can do."""

    protocol: int
    fw_major: int
    fw_minor: int
    n_sensors: int
    rate_max_hz: int
    adc_bits: int
    boot_reason: int
    vref_mv: int
    pressure_min_pa: int
    pressure_max_pa: int
    board_id: str
    channels: tuple[ExtraChannel, ...] = ()  # what a SAMPLE carries behind its sensors, in this order

    @property
    def simulated(self) -> bool:
        """Whether the board is a virtual one."""
        return self.board_id.startswith(SIMULATED_PREFIX)


@dataclass(frozen=True, slots=True)
class Sample:
    """One sampling instant; `lit` and `dark` are ADC counts, one for each sensor."""

    index: int
    time_us: int
    pressure_pa: int
    state: int
    flags: int
    lit: tuple[int, ...]
    dark: tuple[int, ...]
    channel: tuple[float, ...] = ()  # the extra channels, each in its unit


@dataclass(frozen=True, slots=True)
class Ack:
    """The answer to every command but IDENTIFY."""

    command_type: int
    command_seq: int
    status: int


@dataclass(frozen=True, slots=True)
class BoardEvent:
    """Something that happened on the board, at `time_us` of its 32-bit clock."""

    time_us: int
    code: int
    value: int


BoardMessage = Hello | Sample | Ack | BoardEvent


# ---- host to board -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Identify:
    """Request a HELLO."""


@dataclass(frozen=True, slots=True)
class Start:
    """Send samples, index from 0."""

    rate_hz: int


@dataclass(frozen=True, slots=True)
class Stop:
    """Send no more samples."""


@dataclass(frozen=True, slots=True)
class SetPressure:
    """Regulate to a gauge pressure; ramp 0 is as fast as the pumps can."""

    target_pa: int
    ramp_pa_per_s: int = 0


@dataclass(frozen=True, slots=True)
class Vent:
    """Let the pressure out; obeyed in every state."""


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Arm the board's watchdog with 100 to 5000 ms, or disarm it with 0."""

    timeout_ms: int


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Leave FAULT for VENTED, if its cause is gone."""


@dataclass(frozen=True, slots=True)
class SetLimits:
    """Tighten the board's pressure limits."""

    min_pa: int
    max_pa: int


Command = Identify | Start | Stop | SetPressure | Vent | Heartbeat | ClearFault | SetLimits

_COMMANDS: dict[int, tuple[type[Command], struct.Struct]] = {
    MessageType.IDENTIFY: (Identify, struct.Struct("<")),
    MessageType.START: (Start, struct.Struct("<H")),
    MessageType.STOP: (Stop, struct.Struct("<")),
    MessageType.SET_PRESSURE: (SetPressure, struct.Struct("<iI")),
    MessageType.VENT: (Vent, struct.Struct("<")),
    MessageType.HEARTBEAT: (Heartbeat, struct.Struct("<H")),
    MessageType.CLEAR_FAULT: (ClearFault, struct.Struct("<")),
    MessageType.SET_LIMITS: (SetLimits, struct.Struct("<ii")),
}
COMMAND_TYPES = {command: MessageType(type_) for type_, (command, _) in _COMMANDS.items()}
_HELLO = struct.Struct("<BBBBHBBHii16s")
_SAMPLE_HEAD = struct.Struct("<IIiBB")
_ACK = struct.Struct("<BBB")
_EVENT = struct.Struct("<IBi")
_CHANNEL = re.compile(r"[^\W\d][^:;\ufffd\x00-\x1f]*:[^:;\ufffd\x00-\x1f]*")  # NAME:UNIT

_Code = TypeVar("_Code", bound=enum.IntEnum)


def encode_command(command: Command, seq: int) -> bytes:
    """Return the frame of a command. RequestError: a value does not fit its field."""
    type_ = COMMAND_TYPES[type(command)]
    return _encode(type_, seq, _COMMANDS[type_][1].pack, *astuple(command))


def decode_command(frame: Frame) -> Command | AckStatus:
    """Return the command in a frame, or the status that refuses it: unknown, or too short."""
    if frame.type not in _COMMANDS:
        return AckStatus.UNKNOWN_COMMAND
    command, payload = _COMMANDS[frame.type]
    if len(frame.payload) < payload.size:
        return AckStatus.WRONG_LENGTH
    return command(*payload.unpack_from(frame.payload))


def encode_message(message: BoardMessage, seq: int) -> bytes:
    """Return the frame of a board's message. RequestError: a value does not fit (identity: 16 ASCII characters)."""
    match message:
        case Hello():
            if len(message.board_id) > 16 or not message.board_id.isascii():
                raise RequestError(f"a board_id is up to 16 ASCII characters, not {message.board_id!r}")
            head = astuple(message)[:-2]
            table = ";".join(":".join(channel) for channel in message.channels).encode()
            return _encode(
                MessageType.HELLO,
                seq,
                struct.Struct(f"{_HELLO.format}{len(table)}s").pack,
                *head,
                message.board_id.encode("ascii"),
                table,
            )
        case Sample():
            counts = [count for pair in zip(message.lit, message.dark, strict=True) for count in pair]
            head = (message.index, message.time_us, message.pressure_pa, message.state, message.flags)
            layout = struct.Struct(f"<IIiBB{len(counts)}H{len(message.channel)}f")
            return _encode(MessageType.SAMPLE, seq, layout.pack, *head, *counts, *message.channel)
        case Ack():
            return _encode(MessageType.ACK, seq, _ACK.pack, *astuple(message))
        case BoardEvent():
            return _encode(MessageType.EVENT, seq, _EVENT.pack, *astuple(message))


def decode_message(frame: Frame, n_sensors: int, n_channels: int = 0) -> BoardMessage | None:
    """Return the message in a frame (None: unknown type; zeros: a HELLO of another version). RemoteError: malformed."""
    payload = frame.payload
    try:
        match frame.type:
            case MessageType.HELLO:
                return _decode_hello(payload)
            case MessageType.SAMPLE:
                values = struct.unpack_from(f"<{2 * n_sensors}H{n_channels}f", payload, _SAMPLE_HEAD.size)
                counts, channel = values[: 2 * n_sensors], values[2 * n_sensors :]
                index, time_us, pressure_pa, state, flags = _SAMPLE_HEAD.unpack_from(payload)
                return Sample(index, time_us, pressure_pa, state, flags, counts[0::2], counts[1::2], channel)
            case MessageType.ACK:
                type_, seq, status = _ACK.unpack_from(payload)
                return Ack(type_, seq, _known(AckStatus, status))
            case MessageType.EVENT:
                time_us, code, value = _EVENT.unpack_from(payload)
                return BoardEvent(time_us, _known(EventCode, code), value)
    except struct.error:
        raise RemoteError(f"frame of type 0x{frame.type:02X} with only {len(payload)} bytes of payload") from None
    return None


def _decode_hello(payload: bytes) -> Hello:
    if payload and payload[0] != PROTOCOL_VERSION:
        return Hello(payload[0], 0, 0, 0, 0, 0, 0, 0, 0, 0, "")
    fields = list(_HELLO.unpack_from(payload))
    fields[-1] = fields[-1].split(b"\0")[0].decode("ascii", "backslashreplace")
    fields.append(_channel_table(payload[_HELLO.size :]))
    hello = Hello(*fields)
    if not (1 <= hello.n_sensors <= SENSORS_MAX and 1 <= hello.adc_bits <= 16 and hello.vref_mv and hello.rate_max_hz):
        raise RemoteError(f"HELLO with impossible values: {hello}")
    if hello.pressure_min_pa >= hello.pressure_max_pa:
        raise RemoteError(f"HELLO with its pressure limits swapped: {hello}")
    return hello


def _channel_table(tail: bytes) -> tuple[ExtraChannel, ...]:
    """Return the channels that the end of a HELLO names; none where it is something else, of a newer version."""
    text = tail.split(b"\0")[0].decode("utf-8", "replace")
    entries = text.split(";")
    if len(entries) > CHANNELS_MAX or not all(_CHANNEL.fullmatch(entry) for entry in entries):
        return ()
    return channels_of((name, unit) for name, _, unit in (entry.partition(":") for entry in entries))


def _known(codes: type[_Code], value: int) -> _Code | int:
    try:
        return codes(value)
    except ValueError:
        return value


def _encode(type_: MessageType, seq: int, pack: Callable[..., bytes], *values: Any) -> bytes:
    try:
        payload = pack(*values)
    except struct.error as error:
        raise RequestError(f"{type_.name} cannot carry {values}: {error}") from None
    return encode_frame(type_, seq, payload)
