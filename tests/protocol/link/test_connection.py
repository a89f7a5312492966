"""The connection against a second decoder, and against itself with the bytes cut anywhere."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from protocol import BoardRestarted, ClockWentBack, Connection, SampleGap, Samples, decode_samples
from protocol.link.framing import FrameReader, encode_frame
from protocol.link.messages import encode_message
from protocol.recording import channels_of
from tests.protocol.link.plain_decoder import PlainDecoder
from tests.protocol.link.streams import HELLO, START_DONE, cut, hello_and, sample, stream, troubled_streams

COUNTERS = ("crc_errors", "malformed", "oversize", "unknown", "duplicates")


def decoded(events) -> tuple[list[tuple], list[tuple[int, int, int]], int]:
    """Samples as plain tuples, gaps, and how many restarts only the index showed."""
    rows = [row for event in events if isinstance(event, Samples) for row in event.array]
    samples = [
        (
            int(r["index"]),
            int(r["time_us"]),
            int(r["pressure_pa"]),
            int(r["state"]),
            int(r["flags"]),
            (*r["lit"],),
            (*r["dark"],),
        )
        for r in rows
    ]
    gaps = [(event.lost, event.before_index, event.time_us) for event in events if isinstance(event, SampleGap)]
    return samples, gaps, len(rows)


def rows_of(events) -> np.ndarray:
    """The samples of all events."""
    return np.concatenate([event.array for event in events if isinstance(event, Samples)])


def check_against_plain(data: bytes, chunks: list[bytes]) -> None:
    """Samples, times, flags, gaps and every counter are those of the plain decoder."""
    plain, link = PlainDecoder(), Connection()
    plain.receive(data)
    events = [event for chunk in chunks for event in link.receive(chunk, 7)]
    samples, gaps, _ = decoded(events)
    assert samples == plain.samples
    assert gaps == plain.gaps
    assert [event.by_us for event in events if isinstance(event, ClockWentBack)] == plain.went_back
    statistics = link.statistics
    assert {name: getattr(statistics, name) for name in COUNTERS} == {
        name: getattr(plain, name) + (len(plain.held) if name == "duplicates" else 0) for name in COUNTERS
    }
    assert statistics.lost == sum(lost for lost, _, _ in gaps)
    assert statistics.samples == len(samples)
    assert statistics.bytes == len(data)


@given(troubled_streams(), st.lists(st.integers(0, 10_000), max_size=8))
@settings(max_examples=120, deadline=None)
@example(hello_and(*[sample(i) for i in range(5)], *[sample(i, 50_000 + i * 10_000) for i in range(20)]), [60])
def test_agrees_with_a_plain_decoder_for_any_chunks(data: bytes, places: list[int]) -> None:
    """Vectorised and chunked equals one frame at a time: samples, flags, gaps, counters."""
    check_against_plain(data, cut(data, places))


@given(troubled_streams())
@settings(max_examples=40, deadline=None)
def test_byte_by_byte_equals_all_at_once(data: bytes) -> None:
    """One byte a call gives what one call gives."""
    check_against_plain(data, [data[i : i + 1] for i in range(len(data))])


@given(troubled_streams(), st.lists(st.integers(0, 10_000), max_size=8))
@settings(max_examples=60, deadline=None)
def test_bulk_gives_the_same_samples_bit_for_bit(data: bytes, places: list[int]) -> None:
    """A whole recording decoded at once has the streaming path's samples, host times, gaps and counters."""
    chunks = [(1_000 * at, chunk) for at, chunk in enumerate(cut(data, places))]
    link = Connection()
    events = [event for now_ns, chunk in chunks for event in link.receive(chunk, now_ns)]
    bulk = decode_samples(chunks, Connection())
    streamed = [event.array for event in events if isinstance(event, Samples)]
    assert bulk.samples.tobytes() == b"".join(array.tobytes() for array in streamed)
    assert list(bulk.gaps) == [event for event in events if isinstance(event, SampleGap)]
    assert list(bulk.events) == [event for event in events if not isinstance(event, SampleGap | Samples)]
    assert bulk.statistics == link.statistics


@given(troubled_streams(), st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_link_continues_from_a_decoder_state(data: bytes, place: int) -> None:
    """A recording begun at any byte is derived again from its own bytes and the state kept with it."""
    place %= len(data) + 1
    link = Connection()
    link.receive(data[:place], 0)
    heir = Connection(decoder_state=link.decoder_state())
    assert decoded(heir.receive(data[place:], 0)) == decoded(link.receive(data[place:], 0))


@pytest.mark.fault(1, how="1e6 frames with 1 % of their bytes flipped or lost", times=1000000)
def test_million_damaged_frames_give_no_wrong_sample() -> None:
    """Flipped bits, lost bytes and lost heads in 1 % of the bytes: what is delivered was sent, and no other."""
    n, rng = 1_000_000, random.Random(1)
    frames = [stream(sample(index)) for index in range(2_000)]
    link = Connection()
    link.receive(stream(HELLO), 0)
    delivered = 0
    for _ in range(n // len(frames)):
        link.receive(stream(HELLO), 0)  # so that the index may begin again
        data = bytearray(b"".join(frames))
        for _ in range(len(data) // 100):
            at = rng.randrange(len(data))
            kind = rng.random()
            if kind < 0.6:
                data[at] ^= 1 << rng.randrange(8)
            elif kind < 0.9:
                del data[at]
            else:
                del data[at : at + rng.randrange(12)]
        for event in link.receive(bytes(data), 0):
            if isinstance(event, Samples):
                rows = event.array
                index = rows["index"].astype(np.int64)
                delivered += len(rows)
                assert (rows["lit"][:, 0] == 2000 + index % 7).all()
                assert (rows["lit"][:, 1] == 2100).all()
                assert (rows["dark"] == [40, 50]).all()
                assert (rows["pressure_pa"] == 12_345).all()
                assert (index < len(frames)).all()
    assert 0.5 * n < delivered < n
    assert link.statistics.crc_errors + link.statistics.malformed > 0.1 * n


def test_index_that_stays_back_is_a_restart_without_loss() -> None:
    """The clock runs on, the index begins again unannounced: after 16 in a row all are kept, behind a restart."""
    link = Connection()
    data = hello_and(*[sample(i) for i in range(50)], *[sample(i, 500_000 + i * 10_000) for i in range(20)])
    events = link.receive(data, 0)
    restart = next(at for at, event in enumerate(events) if isinstance(event, BoardRestarted))
    assert [len(event.array) for event in events if isinstance(event, Samples)] == [50, 20]
    assert isinstance(events[restart + 1], Samples)
    assert link.statistics.duplicates == 0


def test_channels_of_a_hello_are_read_from_its_samples() -> None:
    """A board that names channels in its HELLO sends their values behind the sensors, and a resumed link knows them."""
    channels = channels_of([("temperature", "degC"), ("flow", "L/min")])
    hello = replace(HELLO, channels=channels)
    samples = [replace(sample(n), channel=(20.0 + n, -0.5)) for n in range(6)]
    data = stream(hello, START_DONE, *samples)
    link, again = Connection(), Connection()
    rows = rows_of(link.receive(data, 0))
    assert link.channels == channels
    assert rows["channel"].tolist() == [[20.0 + n, -0.5] for n in range(6)]
    again.receive(data[:150], 0)
    rest = rows_of(Connection(decoder_state=again.decoder_state()).receive(data[150:], 0))
    assert np.array_equal(rest, rows[-len(rest) :]) and 0 < len(rest) < 6


@pytest.mark.parametrize("tail", [b"\0", b"7", b"newer", b"a:b;", b"\x01\x02:\xff", b"1:V"])
def test_another_end_of_a_hello_is_of_a_newer_version(tail: bytes) -> None:
    """It names no channels, and the samples behind it are read as they were."""
    (frame,) = FrameReader().receive(encode_message(HELLO, 0))
    data = encode_frame(frame.type, 0, frame.payload + tail) + stream(START_DONE, sample(0))
    link = Connection()
    assert len(rows_of(link.receive(data, 0))) == 1
    assert (link.hello, link.channels) == (HELLO, ())


def test_a_sample_without_its_channels_is_malformed() -> None:
    """A payload shorter than its HELLO declares."""
    link = Connection()
    link.receive(stream(replace(HELLO, channels=channels_of([("temperature", "degC")])), START_DONE, sample(0)), 0)
    assert (link.statistics.samples, link.statistics.malformed) == (0, 1)
