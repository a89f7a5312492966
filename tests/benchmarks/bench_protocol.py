"""How many SAMPLE frames a second one core decodes: streaming, in bulk, and by a plain decoder."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from itertools import count
from zlib import crc32

import pytest
from cobs import cobs

from protocol import Connection, decode_samples
from tests.benchmarks.lengths import length
from tests.protocol.link.streams import hello_and, sample

N = length(200_000, 2_000)
REPEATS = length(3, 1)


@pytest.fixture(scope="module")
def data() -> bytes:
    return hello_and(*[sample(index) for index in range(N)])


def frames_per_second(work: Callable[[], int]) -> float:
    """The best of some runs of a function that returns how many frames it decoded."""
    best = 0.0
    for _ in range(REPEATS):
        began = time.perf_counter()
        frames = work()
        best = max(best, frames / (time.perf_counter() - began))
    return best


def pieces(data: bytes, size: int) -> Iterator[bytes]:
    return (data[at : at + size] for at in range(0, len(data), size))


def streamed(data: bytes, size: int) -> int:
    link = Connection()
    for now_ns, piece in zip(count(), pieces(data, size), strict=False):
        link.receive(piece, now_ns)
    assert link.statistics.lost == 0
    return link.statistics.samples


def plain_loop(data: bytes) -> int:
    """Bare `cobs`, `zlib` and `struct`, no accounts, no flags, no arrays."""
    layout, frames = struct.Struct("<BBIIiBBHHHH"), 0
    for run in data.split(b"\0"):
        if run:
            body = cobs.decode(run)
            if crc32(body[:-4]) == int.from_bytes(body[-4:], "little") and body[0] == 2:
                layout.unpack_from(body)
                frames += 1
    return frames


def test_streaming(data: bytes) -> None:
    """Loss accounts and flags included, for the sizes in which a port gives its bytes."""
    plain = frames_per_second(lambda: plain_loop(data))
    print(f"\nplain loop over cobs, zlib, struct: {plain:12,.0f} frames/s")
    for size in (30, 256, 1024, 4096, 16_384, 65_536):
        rate = frames_per_second(lambda size=size: streamed(data[: 2000 * size], size))
        print(f"streaming, chunks of {size:6} bytes:   {rate:12,.0f} frames/s, {rate / plain:5.2f} of the plain loop")
        assert rate > 0


def test_bulk(data: bytes) -> None:
    """Whole recordings, for verify and replay: host times of small chunks included."""
    plain = frames_per_second(lambda: plain_loop(data))
    print()
    for size in (256, 4096, 262_144):
        chunks = list(enumerate(pieces(data, size)))
        rate = frames_per_second(lambda chunks=chunks: len(decode_samples(chunks, Connection()).samples))
        print(f"bulk, recorded in {size:6} bytes:      {rate:12,.0f} frames/s, {rate / plain:5.2f} of the plain loop")
        assert rate > 0
