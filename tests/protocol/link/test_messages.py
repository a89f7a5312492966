"""Messages: round trips, newer and shorter payloads, boards that cannot be. The bytes themselves: test_vectors."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.base.errors import RemoteError, RequestError
from protocol.link.framing import Frame, FrameReader
from protocol.link.messages import (
    Ack,
    AckStatus,
    BoardEvent,
    ClearFault,
    EventCode,
    Heartbeat,
    Hello,
    Identify,
    Sample,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    Vent,
    decode_command,
    decode_message,
    encode_command,
    encode_message,
)
from tests.protocol.link.streams import HELLO

U8, U16, U32 = st.integers(0, 255), st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1)
I32 = st.integers(-(2**31), 2**31 - 1)
COMMANDS = st.one_of(
    st.sampled_from([Identify(), Stop(), Vent(), ClearFault()]),
    st.builds(Start, U16),
    st.builds(SetPressure, I32, U32),
    st.builds(Heartbeat, U16),
    st.builds(SetLimits, I32, I32),
)
IDENTITIES = st.text("ABCxyz0189-_ ", max_size=16)
HELLOS = st.builds(
    Hello, st.just(1), U8, U8, st.integers(1, 4), st.integers(1, 65_535), st.integers(1, 16), U8,
    st.integers(1, 65_535), st.integers(-(2**31), 0), st.integers(1, 2**31 - 1), IDENTITIES,
)  # fmt: skip


def frame_of(data: bytes) -> Frame:
    (frame,) = FrameReader().receive(data)
    return frame


@given(COMMANDS, U8)
def test_commands_survive_encoding_and_decoding(command: Any, seq: int) -> None:
    """Encode and decode are each other's inverse for every command."""
    frame = frame_of(encode_command(command, seq))
    assert decode_command(frame) == command
    assert frame.seq == seq
    assert decode_command(Frame(frame.type, seq, frame.payload + b"newer")) == command


@given(st.one_of(HELLOS, st.builds(Ack, U8, U8, U8), st.builds(BoardEvent, U32, U8, I32)))
def test_messages_survive_encoding_and_decoding(message: Any) -> None:
    """Encode and decode are inverse, also for unknown codes; a longer payload is a newer version."""
    frame = frame_of(encode_message(message, 3))
    assert decode_message(frame, 2) == message
    assert decode_message(Frame(frame.type, 3, frame.payload + b"newer"), 2) == message


@given(st.integers(1, 4), U32, U32, I32, U8, U8, st.data())
def test_a_sample_survives_for_one_to_four_sensors(n, index, time_us, pressure_pa, state, flags, data) -> None:
    """Lit and dark come back in their order, whatever follows them."""
    counts = st.lists(U16, min_size=n, max_size=n).map(tuple)
    message = Sample(index, time_us, pressure_pa, state, flags, data.draw(counts), data.draw(counts))
    frame = frame_of(encode_message(message, 0))
    assert decode_message(frame, n) == message
    assert decode_message(Frame(frame.type, 0, frame.payload + b"newer"), n) == message


@pytest.mark.parametrize(
    "message", [HELLO, Sample(0, 0, 0, 0, 0, (1, 2), (3, 4)), Ack(1, 2, 3), BoardEvent(1, EventCode.BOOTED, 0)]
)
def test_short_payload_is_a_remote_error(message: Any) -> None:
    """One byte less than specified is malformed, for every message."""
    frame = frame_of(encode_message(message, 0))
    with pytest.raises(RemoteError, match="only"):
        decode_message(Frame(frame.type, 0, frame.payload[:-1]), 2)


@pytest.mark.parametrize(
    "command", [Start(100), SetPressure(1, 2), Heartbeat(500), SetLimits(-1, 1)], ids=lambda c: type(c).__name__
)
def test_a_command_too_short_is_answered_with_wrong_length(command: Any) -> None:
    """The board's half returns the status that refuses it."""
    frame = frame_of(encode_command(command, 0))
    assert decode_command(Frame(frame.type, 0, frame.payload[:-1])) is AckStatus.WRONG_LENGTH


@pytest.mark.parametrize("type_", [0x00, 0x02, 0x80, 0x89, 0xFF])
def test_unknown_type_is_not_an_error(type_: int) -> None:
    """The host passes over it, the board answers "unknown command"; a board's own type is no command either."""
    assert decode_command(Frame(type_, 0, b"")) is AckStatus.UNKNOWN_COMMAND
    if type_ != 0x02:
        assert decode_message(Frame(type_, 0, b""), 2) is None


def test_known_codes_have_their_names() -> None:
    """A code of the page comes as its name, another as its number."""
    event = decode_message(frame_of(encode_message(BoardEvent(0, 4, 0), 0)), 2)
    assert isinstance(event, BoardEvent)
    assert event.code is EventCode.HEARTBEAT_LOST
    newer = decode_message(frame_of(encode_message(BoardEvent(0, 99, 0), 0)), 2)
    assert isinstance(newer, BoardEvent)
    assert newer.code == 99


def test_hello_of_another_version_has_only_its_version() -> None:
    """Version 2 may have any layout: one byte is enough, and the others are ignored."""
    hello = decode_message(Frame(1, 0, b"\x02"), 2)
    assert isinstance(hello, Hello)
    assert (hello.protocol, hello.n_sensors) == (2, 0)


@pytest.mark.parametrize(
    "change",
    [{"n_sensors": 0}, {"n_sensors": 5}, {"adc_bits": 0}, {"adc_bits": 17}, {"vref_mv": 0}, {"rate_max_hz": 0},
     {"pressure_min_pa": 80_000}],
)  # fmt: skip
def test_a_hello_of_an_impossible_board_is_refused(change: dict[str, int]) -> None:
    """No sensors, no converter, no rate, limits swapped: a good checksum does not make it a board."""
    values = {field: getattr(HELLO, field) for field in Hello.__dataclass_fields__}
    frame = frame_of(encode_message(Hello(**{**values, **change}), 0))
    with pytest.raises(RemoteError, match="HELLO"):
        decode_message(frame, 2)


def test_an_identity_that_is_not_ascii_is_shown_escaped() -> None:
    """Bytes from a damaged chip cannot break a log or a report."""
    frame = frame_of(encode_message(HELLO, 0))
    hello = decode_message(Frame(1, 0, frame.payload[:-16] + b"\xff\xfeSA1" + bytes(11)), 2)
    assert isinstance(hello, Hello)
    assert hello.board_id == "\\xff\\xfeSA1"


@pytest.mark.parametrize(
    "command",
    [Start(70_000), SetPressure(2**31, 0), SetPressure(0, -1), Heartbeat(-1), SetPressure(1.5, 0)],  # type: ignore[arg-type]
)
def test_value_that_its_field_cannot_hold_is_a_local_error(command: Any) -> None:
    """Nothing is cut to fit: a pressure that does not fit must never become another pressure."""
    with pytest.raises(RequestError, match="cannot carry"):
        encode_command(command, 0)


def test_an_identity_too_long_is_refused() -> None:
    """Seventeen characters do not become sixteen."""
    values = {field: getattr(HELLO, field) for field in Hello.__dataclass_fields__}
    with pytest.raises(RequestError, match="16 ASCII"):
        encode_message(Hello(**{**values, "board_id": "x" * 17}), 0)
