"""SAMPLE bodies packed by hand: their fields, and what is longer or shorter than the layout."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from protocol import BoardRestarted, Connection, Samples
from protocol.link.framing import encode_frame
from protocol.link.messages import MessageType
from protocol.link.sample_stream import SampleFlag
from tests.protocol.link.streams import HELLO, stream


def body(index: int, sensors: int, *, add: int = 0) -> bytes:
    """Return the frame of a SAMPLE whose fields all differ, lengthened or shortened by `add` bytes."""
    counts = [1000 * (sensor + 1) + index + (500 if dark else 0) for sensor in range(sensors) for dark in (0, 1)]
    payload = struct.pack(f"<IIiBB{2 * sensors}H", index, 10_000 * index, -70_000 - index, 3, 4, *counts)
    return encode_frame(
        MessageType.SAMPLE, index & 0xFF, payload + bytes(range(1, add + 1)) if add >= 0 else payload[:add]
    )


def taken(link: Connection, *frames: bytes) -> np.ndarray:
    """Return the samples of frames that arrive in one read at 7 ns."""
    arrays = [event.array for event in link.receive(b"".join(frames), 7) if isinstance(event, Samples)]
    return np.concatenate(arrays) if arrays else np.empty(0)


def check(rows: np.ndarray, indices: list[int], sensors: int) -> None:
    index = np.array(indices)
    assert rows["index"].tolist() == indices
    assert rows["time_us"].tolist() == (10_000 * index).tolist()
    assert rows["pressure_pa"].tolist() == (-70_000 - index).tolist()
    assert (rows["state"] == 3).all()
    assert (rows["flags"] & 0xFF == 4).all()
    assert (rows["host_ns"] == 7).all()
    lit = 1000 * (1 + np.arange(sensors)) + index[:, None]
    assert rows["lit"].tolist() == lit.tolist()
    assert rows["dark"].tolist() == (lit + 500).tolist()


@pytest.mark.parametrize("sensors", [1, 2, 3, 4])
@pytest.mark.parametrize("add", [0, 1, 5])
def test_fields_are_at_their_places(sensors: int, add: int) -> None:
    """Every field apart; the bytes that a newer minor version adds are passed over."""
    link = Connection(n_sensors=sensors)
    check(taken(link, *(body(index, sensors, add=add) for index in range(3, 9))), [*range(3, 9)], sensors)
    assert link.statistics.malformed == 0


def test_lengths_may_differ_within_a_read() -> None:
    """As laid out, longer by 3 bytes, and shorter by one: the last is malformed, the others are taken."""
    link = Connection(n_sensors=2)
    frames = [body(3, 2), body(4, 2, add=3), body(5, 2, add=-1), body(6, 2), body(7, 2, add=1), body(8, 2, add=-4)]
    check(taken(link, *frames), [3, 4, 6, 7], 2)
    assert link.statistics.malformed == 2


def test_longer_and_longer_ones_are_cut_to_the_layout() -> None:
    """Two lengths in one read, neither of them the layout's."""
    link = Connection(n_sensors=2)
    check(taken(link, body(3, 2, add=2), body(4, 2, add=6)), [3, 4], 2)
    assert link.statistics.malformed == 0


def test_short_ones_alone_give_no_sample() -> None:
    """All of one length, a byte less than the layout."""
    link = Connection(n_sensors=2)
    assert len(taken(link, body(3, 2, add=-1), body(4, 2, add=-1))) == 0
    assert (link.statistics.malformed, link.statistics.samples) == (2, 0)


@pytest.mark.parametrize(("bits", "implausible"), [(None, False), (15, True)])
def test_converter_has_16_bits_unless_stated(bits: int | None, implausible: bool) -> None:
    """A count of 40,000 is beyond 15 bits."""
    link = Connection(n_sensors=1) if bits is None else Connection(n_sensors=1, adc_bits=bits)
    (row,) = taken(link, encode_frame(MessageType.SAMPLE, 0, struct.pack("<IIiBBHH", 0, 0, 0, 1, 0, 40_000, 9)))
    assert bool(row["flags"] & SampleFlag.IMPLAUSIBLE) is implausible


def test_samples_of_unknown_sensors_are_counted() -> None:
    """Before the HELLO the number of sensors is not known."""
    link = Connection()
    assert len(taken(link, body(3, 2), body(4, 2))) == 0
    assert (link.statistics.unknown, link.statistics.malformed) == (2, 0)


def test_samples_are_what_a_restart_would_lose() -> None:
    """A HELLO that nobody asked for, after samples and no answered command: the board has restarted."""
    link = Connection()
    link.receive(stream(HELLO), 0)
    assert not any(isinstance(event, BoardRestarted) for event in link.receive(stream(HELLO), 0))
    link.receive(body(3, 2), 0)
    assert any(isinstance(event, BoardRestarted) for event in link.receive(stream(HELLO), 0))
