"""Streams of board bytes for the tests of this folder."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import strategies as st

from protocol.link.messages import Ack, AckStatus, BoardEvent, EventCode, Hello, MessageType, Sample, encode_message

HELLO = Hello(1, 1, 4, 2, 10_000, 12, 0, 3300, -60_000, 80_000, "SIMULATED-SA1")
START_DONE = Ack(MessageType.START, 0, AckStatus.DONE)
STOP_DONE = Ack(MessageType.STOP, 1, AckStatus.DONE)
BOOTED = BoardEvent(5, EventCode.BOOTED, 0)


def sample(index: int, time_us: int | None = None, pressure_pa: int = 12_345) -> Sample:
    """A plain sample of two sensors, at 100 Hz unless its time is given."""
    time_us = index * 10_000 if time_us is None else time_us
    return Sample(index % 2**32, time_us % 2**32, pressure_pa, 2, 0, (2000 + index % 7, 2100), (40, 50))


def stream(*messages) -> bytes:
    """The bytes of messages, numbered from 0."""
    return b"".join(encode_message(message, seq) for seq, message in enumerate(messages))


def hello_and(*samples) -> bytes:
    """The bytes of a session's begin: HELLO, the answer to START, and samples."""
    return stream(HELLO, START_DONE, *samples)


def cut(data: bytes, places: list[int]) -> list[bytes]:
    """`data` cut at places, taken modulo its length."""
    edges = sorted({0, len(data), *(place % (len(data) + 1) for place in places)})
    return [data[a:b] for a, b in pairwise(edges)]


U32 = st.integers(0, 2**32 - 1)
COUNTS = st.tuples(st.integers(0, 65_535), st.integers(0, 65_535))


@st.composite
def troubled_streams(draw: st.DrawFn) -> bytes:
    """Bytes of a board with gaps, repeats, reordering, restarts, wraps, damage and garbage between its frames."""
    index, time = draw(st.sampled_from([0, 40, 2**32 - 20])), draw(st.sampled_from([0, 2**32 - 100_000, 2**31]))
    out = bytearray(encode_message(HELLO, 0)) if draw(st.booleans()) else bytearray()
    seq = 1
    recent: list[bytes] = []
    for _ in range(draw(st.integers(0, 12))):
        action = draw(
            st.sampled_from(["run", "run", "run", "gap", "repeat", "back", "clock", "boot", "other", "damage", "noise"])
        )
        if action in ("run", "gap", "back", "clock", "boot"):
            if action == "gap":
                lost = draw(st.sampled_from([1, 7, 255, 256, 70_000, 10**6]))
                index, time = index + lost, time + draw(st.sampled_from([lost, 0])) * 10_000
            elif action == "back":
                index = draw(st.sampled_from([0, max(index - 30, 0), max(index - 3, 0)]))
                time = draw(st.sampled_from([time, 0, time + 5_000_000]))
            elif action == "clock":
                time -= draw(st.sampled_from([20_000, 50_000, 3_000_000, 2**31 + 5_000_000]))
            elif action == "boot":
                index, time = 0, 0
                out += stream(
                    *draw(st.sampled_from([(HELLO,), (BOOTED,), (START_DONE,), (HELLO, START_DONE), (STOP_DONE,)]))
                )
            for _ in range(draw(st.sampled_from([1, 2, 15, 16, 17, 40]))):
                absurd = draw(st.integers(0, 30)) == 0
                message = (
                    Sample(
                        index % 2**32,
                        draw(U32),
                        draw(st.integers(-(2**31), 2**31 - 1)),
                        1,
                        255,
                        draw(COUNTS),
                        draw(COUNTS),
                    )
                    if absurd
                    else sample(index, time)
                )
                recent = [*recent[-40:], encode_message(message, seq)]
                out += recent[-1]
                index, time, seq = index + 1, time + 10_000, seq + 1
        elif action == "repeat":
            out += b"".join(recent[-draw(st.integers(1, 40)) :])
        elif action == "other":
            out += draw(
                st.sampled_from([b"\0\0\0", stream(STOP_DONE), stream(HELLO), stream(BOOTED), b"x" * 250, b"x" * 210])
            )
        elif action == "noise":
            out += draw(st.binary(max_size=40))
        elif out:
            at = draw(st.integers(0, len(out) - 1))
            del out[at]
    return bytes(out)
