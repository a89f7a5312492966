"""Delimited lines: samples, checksums, invalid and incomplete lines."""

from __future__ import annotations

import pytest

from protocol import (
    TextConnection,
    load_profile,
)
from tests.protocol.text.devices import LINES, SIGNAL, line, nmea, rows_of


def test_lines_become_samples_in_the_recordings_units() -> None:
    """Milliseconds to us, kPa to Pa, counts as they are; comments and the ignored field leave no trace."""
    link = TextConnection(load_profile(LINES))
    (row,) = rows_of(
        link.receive(b"# boot\r\n\r\ntime_ms,index,...\r\n120340,12034,49.83,2107,41,1988,37,23.4\r\n", 77)
    )
    assert (row["index"], row["time_us"], row["host_ns"], row["flags"]) == (12_034, 120_340_000, 77, 0)
    assert row["pressure_pa"] == pytest.approx(49_830, abs=1e-6)
    assert (row["lit"].tolist(), row["dark"].tolist()) == ([2107, 1988], [41, 37])
    assert link.statistics.malformed == 0


def test_decimal_commas_checksums_and_other_units() -> None:
    """Semicolons, decimal commas, *hh, psi and volts: every part of a line's description works."""
    link = TextConnection(load_profile(SIGNAL))
    rows = rows_of(link.receive(nmea("X;1,5;10,0;1,25") + nmea("X;1,6;-1,0;0,5"), 0))
    assert rows["time_us"].tolist() == [1_500_000, 1_600_000]
    assert rows["pressure_pa"].tolist() == pytest.approx([68_947.57293168, -6_894.757293168])
    assert rows["signal_mv"][:, 0].tolist() == [1250, 500]
    assert rows["index"].tolist() == [0, 1]


def test_a_wrong_checksum_is_a_lost_line() -> None:
    """One digit changed: counted as a checksum error, and not a sample."""
    link = TextConnection(load_profile(SIGNAL))
    bad = nmea("X;1,5;10,0;1,25").replace(b"1,25", b"1,35")
    assert link.receive(bad + b"$X;1;1;1\r\n$X;1;1;1*\r\n$X;1;1;1*zz\r\n", 0) == []
    assert link.statistics.crc_errors == 4


@pytest.mark.parametrize(
    "text",
    ["1,2,3", "1,2,3,4,5,6,7,8,9", "a,1,2,3,4,5,6,7", "1,1,2,3.5,4,5,6,7", "1,1,2,70000,4,5,6,7", "1,-1,2,3,4,5,6,7",
     "1,4294967296,2,3,4,5,6,7", "nan,1,2,3,4,5,6,7", "1,inf,2,3,4,5,6,7", "1_0,1,2,3,4,5,6,7", "-5,1,2,3,4,5,6,7",
     "1,1,2,3,4,5,6,71,1,2,3,4,5,6,7"],
)  # fmt: skip
def test_invalid_line_is_only_counted(text: str) -> None:
    """Missing and surplus fields, half counts, numbers beyond their range, two lines run together."""
    link = TextConnection(load_profile(LINES))
    assert link.receive(text.encode() + b"\n" + line(5), 0) != []
    assert (link.statistics.malformed, link.statistics.samples) == (1, 1)


def test_half_a_first_line_is_never_a_sample() -> None:
    """A device that prints by itself: the first line after connecting could be half a number."""
    profile = load_profile(LINES.read_text(encoding="utf-8").replace('start = "S{rate_hz}\\n"', ""))
    link = TextConnection(profile)
    rows = rows_of(link.receive(line(0)[1:] + line(1), 0))
    assert rows["index"].tolist() == [1]


def test_an_endless_line_is_counted_in_bounded_memory() -> None:
    """A megabyte without a line end is one oversize, and the line behind it is read."""
    link = TextConnection(load_profile(LINES))
    for _ in range(100):
        link.receive(b"7" * 10_000, 0)
    rows = rows_of(link.receive(b"7\n" + line(3), 0))
    assert rows["index"].tolist() == [3]
    assert link.statistics.oversize == 1
