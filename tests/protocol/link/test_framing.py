"""Frames against the definitions of COBS and CRC-32, and against damage."""

from __future__ import annotations

import random
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.base.errors import RequestError
from protocol.link.framing import COLLECT_MAX, RESIDUE, Frame, FrameReader, encode_frame

FRAMES = st.builds(Frame, st.integers(0, 255), st.integers(0, 255), st.binary(max_size=194))


def test_the_checksum_is_crc32_iso_hdlc() -> None:
    """The check value of "123456789" is the published 0xCBF43926."""
    assert zlib.crc32(b"123456789") == 0xCBF43926


@given(st.binary(max_size=300))
def test_the_residue_marks_a_body_with_its_own_checksum(data: bytes) -> None:
    """Anything followed by its CRC-32 has the one residue; followed by another it has not."""
    good = data + zlib.crc32(data).to_bytes(4, "little")
    assert zlib.crc32(good) == RESIDUE
    assert zlib.crc32(good[:-1] + bytes((good[-1] ^ 1,))) != RESIDUE


@given(st.lists(FRAMES, max_size=20))
def test_frames_survive_encoding_and_decoding(frames: list[Frame]) -> None:
    """Any frames in a row come out as they went in, and each costs its body, two bytes and nothing more."""
    data = b"".join(encode_frame(frame.type, frame.seq, frame.payload) for frame in frames)
    reader = FrameReader()
    assert reader.receive(data) == frames
    assert len(data) == sum(len(frame.payload) + 8 for frame in frames)
    assert (reader.frames, reader.crc_errors, reader.malformed, reader.oversize) == (len(frames), 0, 0, 0)


@pytest.mark.parametrize(("type_", "size"), [(256, 0), (-1, 0), (1, 195)])
def test_impossible_frame_is_refused(type_: int, size: int) -> None:
    """A type beyond a byte and a payload beyond 194 bytes are this side's fault."""
    with pytest.raises(RequestError, match="no frame can hold"):
        encode_frame(type_, 0, bytes(size))


@pytest.mark.fault(2, how="every byte of six frames lost, one at a time", times=78)
def test_every_single_byte_deletion_costs_the_frame_it_hits_and_no_other() -> None:
    """A byte lost anywhere: the frames around it are found; a lost 00 joins two frames, and costs both."""
    frames = [Frame(2, seq, bytes((seq, 0, 255, seq, 0))) for seq in range(6)]
    encoded = [encode_frame(frame.type, frame.seq, frame.payload) for frame in frames]
    data = b"".join(encoded)
    ends = [sum(map(len, encoded[: n + 1])) for n in range(len(encoded))]
    for at in range(len(data)):
        hit = next(n for n, end in enumerate(ends) if at < end)
        lost = {hit, hit + 1} if at == ends[hit] - 1 else {hit}
        found = FrameReader().receive(data[:at] + data[at + 1 :])
        assert found == [frame for n, frame in enumerate(frames) if n not in lost]


@pytest.mark.fault(1, how="every bit of a frame flipped, one at a time", times=296)
def test_every_flipped_bit_is_found() -> None:
    """No single bit error passes, at any place of a frame; the frame behind is found unless its 00 was hit."""
    frame, follower = encode_frame(2, 7, bytes(range(30))), encode_frame(3, 8, b"abc")
    for bit in range(8 * (len(frame) - 1)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        assert FrameReader().receive(bytes(damaged) + follower) == [Frame(3, 8, b"abc")]


@pytest.mark.fault(3, how="1 MB of random bytes, boot text, a run of NULs", times=1)
def test_garbage_and_boot_text_hold_no_frame() -> None:
    """1 MB of random bytes, text and a run of NULs are counted and give no frame; the first frame after is found."""
    rng = random.Random(5)
    reader = FrameReader()
    text = b"Bootloader v1.2\r\nready\r\n"
    garbage = rng.randbytes(1_000_000) + text + bytes(1000)
    assert reader.receive(garbage + encode_frame(1, 0, b"hello")) == [Frame(1, 0, b"hello")]
    runs = [run for run in garbage.split(b"\0") if run]
    assert reader.crc_errors + reader.malformed + reader.oversize == len(runs)
    assert reader.oversize == sum(len(run) > COLLECT_MAX for run in runs)


@given(st.integers(COLLECT_MAX - 3, COLLECT_MAX + 300), st.integers(1, 80))
def test_a_long_run_is_one_oversize_however_it_is_cut(length: int, chunk: int) -> None:
    """More than 210 bytes without a 00 count once, up to 210 as malformed; memory stays bounded meanwhile."""
    reader = FrameReader()
    data = b"A" * length + b"\0" + encode_frame(3, 1)
    found = [frame for at in range(0, len(data), chunk) for frame in reader.receive(data[at : at + chunk])]
    assert found == [Frame(3, 1, b"")]
    assert (reader.oversize, reader.malformed + reader.crc_errors) == ((1, 0) if length > COLLECT_MAX else (0, 1))
    reader.receive(b"A" * 100_000)
    assert len(reader.state()["rest"]) <= 2 * COLLECT_MAX


@given(st.lists(FRAMES, max_size=8), st.integers(1, 50))
def test_ends_are_the_last_bytes_of_frames(frames: list[Frame], chunk: int) -> None:
    """The place given for each frame is that of its 00, in the chunk that brought it."""
    data = b"".join(b"\0" + encode_frame(frame.type, frame.seq, frame.payload) for frame in frames)
    reader = FrameReader()
    for at in range(0, len(data), chunk):
        ends: list[int] = []
        bodies = reader.receive_bodies(data[at : at + chunk], ends)
        assert len(ends) == len(bodies)
        for body, end in zip(bodies, ends, strict=True):
            whole = encode_frame(body[0], body[1], body[2:-4])
            assert data[: at + end].endswith(whole)
