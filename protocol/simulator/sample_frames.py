"""SAMPLE frames by the block: `messages.encode_message` as array operations; tests compare every frame with it.

A CRC-32 is affine: the CRC of a body of fixed length is a constant, xor one table entry for each byte and position. The
body is shorter than 254 bytes, so COBS adds one byte: each 00 becomes the distance to the next.
"""

from __future__ import annotations

import functools
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from protocol.link.messages import MessageType

Bytes = NDArray[np.uint8]
CRC_LENGTH = 4


@functools.cache
def body_dtype(n_sensors: int) -> np.dtype[np.void]:
    """Return the record of a SAMPLE body without its CRC; `counts` is (lit, dark) for each sensor."""
    head = [("type", "u1"), ("seq", "u1"), ("index", "<u4"), ("time_us", "<u4"), ("pressure_pa", "<i4")]
    return np.dtype([*head, ("state", "u1"), ("flags", "u1"), ("counts", "<u2", (n_sensors, 2))])


def frame_length(n_sensors: int) -> int:
    """Return the transmitted bytes of one SAMPLE frame."""
    return body_dtype(n_sensors).itemsize + CRC_LENGTH + 2


def encode_samples(bodies: NDArray[np.void], first_seq: int) -> Bytes:
    """Return the frames [n, frame_length] of records [n] of `body_dtype`; sets `type` and `seq`."""
    n, size = bodies.size, bodies.dtype.itemsize
    bodies["type"] = MessageType.SAMPLE
    bodies["seq"] = (first_seq + np.arange(n)) & 0xFF
    places = np.empty((size + CRC_LENGTH, n), np.uint8)  # one row a position, so that each step is one long operation
    places[:size] = bodies.view(np.uint8).reshape(n, size).T
    constant, tables = _crc_tables(size)
    crc = np.full(n, constant, "<u4")
    for place, table in zip(places, tables, strict=False):
        crc ^= table[place]
    places[size:] = crc.view(np.uint8).reshape(n, CRC_LENGTH).T
    return _cobs(places)


def _cobs(places: Bytes) -> Bytes:
    """Return COBS(body) 00 for bodies of shape (length, n), length < 254; result shape (n, length + 2)."""
    length, n = places.shape
    place = np.arange(1, length + 1, dtype=np.uint8)[:, None]
    zero = places == 0
    here_or_after = np.full((length + 1, n), length + 1, np.uint8)  # position of the next 00; the last is the delimiter
    here_or_after[:length] = np.where(zero, place, length + 1)
    here_or_after = np.minimum.accumulate(here_or_after[::-1], axis=0)[::-1]
    frames = np.zeros((length + 2, n), np.uint8)
    frames[0] = here_or_after[0]
    frames[1:-1] = np.where(zero, here_or_after[1:] - place, places)
    return np.ascontiguousarray(frames.T)


@functools.cache
def _crc_tables(length: int) -> tuple[int, NDArray[np.uint32]]:
    """Return the CRC of `length` zeros, and the change by each byte value at each position, shape (length, 256)."""
    constant = crc32(bytes(length))
    changes = [
        [crc32(bytes((value,)) + bytes(length - place - 1), crc32(bytes(place))) ^ constant for value in range(256)]
        for place in range(length)
    ]
    return constant, np.array(changes, np.uint32)
