"""RX8 packets: samples, synchronisation, and formats that are refused."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from protocol import (
    ProfileError,
    TextConnection,
    load_profile,
)
from tests.protocol.text.devices import RX8, packet, rows_of


def test_packets_become_samples_in_the_recordings_units() -> None:
    """High byte first, a signed pressure in hundredths of kPa, counts to mV by the profile's converter."""
    link = TextConnection(load_profile(RX8))
    rows = rows_of(link.receive(packet(0) + packet(1) + b"\x43", 0))
    assert rows["pressure_pa"].tolist() == [-40_000, -39_990]
    assert rows["signal_mv"][1].tolist() == [0x4343 * 3300 / 4096, 1 * 3300 / 4096]
    assert rows["time_us"].tolist() == [0, 10_000]


def test_a_two_byte_clock_is_unwrapped() -> None:
    """65.536 s and more: a day of it at 100 Hz would wrap 1318 times; 20,000 samples wrap it three times."""
    rows = rows_of(TextConnection(load_profile(RX8)).receive(b"".join(map(packet, range(20_000))), 0))
    assert (np.diff(rows["time_us"]) == 10_000).all()
    assert len(rows) == 19_999  # the last one waits for the next header


@pytest.mark.fault(2, how="a byte of an RX8 packet stream lost or added", times=3)
@pytest.mark.parametrize("added", [None, b"\x43", b"\x00"])
def test_a_packet_stream_resynchronises_at_once(added: bytes | None) -> None:
    """A byte lost or added anywhere, header bytes among the data: at most two packets are gone, no value is wrong."""
    stream = b"".join(packet(n) for n in range(60))
    profile = load_profile(RX8)
    sent = {(10_000 * n, -40_000 + 10 * n, (0x4343 * 3300 / 4096, n * 3300 / 4096)) for n in range(59)}
    for at in range(200):
        damaged = stream[:at] + (stream[at + 1 :] if added is None else added + stream[at:])
        rows = rows_of(TextConnection(profile).receive(damaged, 0))
        got = {(int(row["time_us"]), round(float(row["pressure_pa"])), tuple(row["signal_mv"])) for row in rows}
        assert len(sent - got) <= 2
        assert got <= sent


@pytest.mark.parametrize("garbage", [b"", b"\x43", b"Boot 1.0\r\n", bytes(range(256))])
def test_packets_are_found_behind_garbage(garbage: bytes) -> None:
    """The search continues one byte after each failed start."""
    rows = rows_of(TextConnection(load_profile(RX8)).receive(garbage + packet(5) + packet(6) + packet(7) + b"\x43", 0))
    assert rows["time_us"].tolist()[-3:] == [50_000, 60_000, 70_000]


def test_packets_wait_for_the_next_header() -> None:
    """What no checksum closes is closed by what follows it, with a tail or without."""
    text = RX8.read_text(encoding="utf-8").replace(" [t=00]", "")
    link = TextConnection(load_profile(text))
    bare = [packet(n)[:-1] for n in range(4)]
    assert len(rows_of(link.receive(b"".join(bare), 0))) == 3
    assert len(rows_of(link.receive(b"\x43", 0))) == 1


RX8_REFUSED = [
    ("RX8 [h=43]", "TX8 [h=43]", "not an RX8 format"),
    ("[h=43]", "[h=4X]", "not hexadecimal"),
    ("@1P @0P", "@1P", "leaves out a byte of P"),
    ("@1P @0P", "@0P @0P", "@0P twice"),
    ("@1P @0P", "1P @0P", "unknown mark '1P'"),
    ("[h=43] @1T", "@1T", None),
    ("P = {", "Q = {", r"rx8\.variables\.Q is not in"),
    ('unit = "counts"', 'unit = "kPa"', "s1_signal has the unit"),
]


@pytest.mark.parametrize(("old", "new", "message"), RX8_REFUSED)
def test_a_packet_format_is_refused_by_its_part(old: str, new: str, message: str | None) -> None:
    """What the format string leaves out or gives twice is named; a tail alone is enough to find packets by."""
    text = RX8.read_text(encoding="utf-8")
    assert old in text
    if message is None:
        assert load_profile(text.replace(old, new, 1)).n_sensors == 2
        return
    with pytest.raises(ProfileError, match=message) as caught:
        load_profile(text.replace(old, new, 1))
    assert caught.value.remedy


def test_format_of_the_control_panel_is_parsed() -> None:
    """Lower case, several header bytes, skipped bytes, low byte first, four-byte variables."""
    text = """
name = "x"
kind = "rx8"
[device]
n_sensors = 1
rate_hz = 50
[rx8]
format = "rx8 [h=0D 0a] x @0p @1p @2p @3p @0s @1s [t=00 FF FF]"
[rx8.variables]
p = { name = "pressure", unit = "Pa", signed = true }
s = { name = "s1_signal", unit = "mV" }
"""
    packets = b"".join(b"\r\nz" + struct.pack("<iH", -40_000 - n, 1600 + n) + b"\0\xff\xff" for n in range(3))
    rows = rows_of(TextConnection(load_profile(text)).receive(packets + b"\r\n", 0))
    assert rows["pressure_pa"].tolist() == [-40_000, -40_001, -40_002]
    assert rows["signal_mv"][:, 0].tolist() == [1600, 1601, 1602]
    assert rows["time_us"].tolist() == [0, 20_000, 40_000]  # no clock: evenly spaced at the profile's rate
