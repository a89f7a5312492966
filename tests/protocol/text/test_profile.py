"""Text profiles: lines and packets to samples, commands to text, and profiles that are refused by key."""

from __future__ import annotations

import struct
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import protocol
from protocol import (
    ClearFault,
    Heartbeat,
    Identify,
    LocalError,
    ProfileError,
    SampleFlag,
    Samples,
    SetLimits,
    SetPressure,
    Start,
    Stop,
    TextConnection,
    Vent,
    load_profile,
)
from protocol.link.events import BoardRestarted, CommandDone, CommandLost, HelloReceived, LinkEvent, SampleGap
from protocol.link.messages import AckStatus
from tests.protocol.link.streams import cut

SHIPPED = Path(protocol.__file__).parent / "profiles"
LINES = SHIPPED / "delimited_lines.toml"
RX8 = SHIPPED / "bridge_control_panel.toml"

SIGNAL = """
name = "one sensor"
kind = "lines"
[device]
n_sensors = 1
rate_hz = 10
[lines]
delimiter = ";"
decimal = ","
checksum = "nmea"
fields = ["tag", { name = "time", unit = "s" }, { name = "pressure", unit = "psi" }, { name = "s1_signal", unit = "V" }]
"""


def rows_of(events: list[LinkEvent]) -> np.ndarray:
    return np.concatenate([event.array for event in events if isinstance(event, Samples)])


def line(n: int, *, time_ms: int | None = None) -> bytes:
    """The n-th line of a device as the shipped profile describes it."""
    return f"{10 * n if time_ms is None else time_ms},{n},{n / 10},{2000 + n % 90},40,1990,37,23.4\r\n".encode()


def packet(n: int) -> bytes:
    """Return the n-th packet of the shipped RX8 profile; its data sometimes contain the header's byte 0x43."""
    return b"\x43" + struct.pack(">HhHH", 10 * n % 65_536, -4000 + n, 0x4343, n % 4096) + b"\0"


def nmea(text: str) -> bytes:
    return f"${text}*{reduce(xor, text.encode(), 0):02X}\r\n".encode()


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


def test_pressure_nan_is_kept_and_flagged() -> None:
    """With a sensor unplugged at the board the sample is kept, out of every figure, and the index is complete."""
    rows = rows_of(TextConnection(load_profile(LINES)).receive(line(0) + b"10,1,nan,3,1,5,1,7\n" + line(2), 0))
    assert ((rows["flags"] & SampleFlag.IMPLAUSIBLE) != 0).tolist() == [False, True, False]
    assert np.isnan(rows["pressure_pa"][1])


def test_the_index_of_a_text_shows_loss() -> None:
    """A gap, a repeat: as with the binary protocol."""
    link = TextConnection(load_profile(LINES))
    events = link.receive(line(0) + line(1) + line(1) + line(9), 0)
    assert [event.lost for event in events if isinstance(event, SampleGap)] == [7]
    assert (link.statistics.lost, link.statistics.duplicates) == (7, 1)


def test_half_a_first_line_is_never_a_sample() -> None:
    """A device that prints by itself: what was cut off before we listened could be half a number."""
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


def test_restarted_device_is_detected() -> None:
    """Index and clock at 0 again without a message: after 16 lines a restart is reported, and no line is lost."""
    link = TextConnection(load_profile(LINES))
    events = link.receive(b"".join(map(line, range(50))) + b"".join(map(line, range(20))), 0)
    assert [type(event) for event in events].count(BoardRestarted) == 1
    assert rows_of(events)["time_us"].tolist() == [10_000 * n for n in [*range(50), *range(20)]]


def test_without_an_index_the_clock_shows_a_restart() -> None:
    """The same for lines that carry only a time; a single wild time is dropped, not a restart."""
    text = LINES.read_text(encoding="utf-8").replace('"index"', '"ignored"')
    link = TextConnection(load_profile(text))
    lines = [*map(line, range(30)), line(30, time_ms=5), *map(line, range(31, 50)), *map(line, range(20))]
    events = link.receive(b"".join(lines), 0)
    assert link.statistics.duplicates == 1
    assert rows_of(events)["index"].tolist() == [*range(49), *range(20)]
    assert [type(event) for event in events].count(BoardRestarted) == 1


def test_own_start_is_not_a_restart() -> None:
    """The device begins again because of a START."""
    link = TextConnection(load_profile(LINES))
    link.receive(b"".join(map(line, range(50))), 0)
    assert link.send(Start(100), 0) == b"S100\n"
    events = link.receive(b"".join(map(line, range(20))), 0)
    assert not any(isinstance(event, BoardRestarted) for event in events)
    assert len(rows_of(events)) == 20


@given(st.lists(st.integers(0, 5_000), max_size=10), st.sampled_from([LINES, RX8]))
@settings(max_examples=40, deadline=None)
def test_division_into_chunks_changes_nothing(places: list[int], profile: Path) -> None:
    """Samples, gaps and counters are those of one call; a link made of the state continues like the first."""
    make = line if profile is LINES else packet
    data = b"noise" + b"".join(make(n) for n in range(60) if n % 17) + b"\x43\x00" + b"".join(map(make, range(70, 80)))
    whole, pieces = TextConnection(load_profile(profile)), TextConnection(load_profile(profile))
    expected = rows_of(whole.receive(data, 0))
    got: list[LinkEvent] = []
    for chunk in cut(data, places):
        got += pieces.receive(chunk, 0)
        statistics, pieces = (
            pieces.statistics,
            TextConnection(load_profile(profile), decoder_state=pieces.decoder_state()),
        )
        assert statistics.frames == statistics.samples
    assert rows_of(got).tobytes() == expected.tobytes()
    assert len(expected) > 60


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


def test_hello_follows_the_first_good_line() -> None:
    """A device that prints by itself is accepted at its first good line; noise alone ends in a lost IDENTIFY."""
    link = TextConnection(load_profile(RX8))
    assert link.send(Identify(), 0) == b""
    assert link.receive(b"noise", 1) == []
    first, done, *_ = link.receive(packet(0) + packet(1), 2)
    assert isinstance(first, HelloReceived)
    assert (first.hello.n_sensors, first.hello.adc_bits, first.hello.vref_mv) == (2, 12, 3300)
    assert done == CommandDone(Identify(), 0, None)
    silent = TextConnection(load_profile(RX8))
    silent.send(Identify(), 0)
    assert silent.next_deadline_ns == 2_500_000_000
    assert silent.poll(2_499_999_999) == ([], b"")
    assert silent.poll(2_500_000_000) == ([CommandLost(Identify(), 0)], b"")


def test_commands_become_text() -> None:
    """The templates' numbers are in the units they name; each is done as it is sent."""
    link = TextConnection(load_profile(LINES))
    assert link.can_command
    sent = [
        link.send(command, 0) for command in (SetPressure(-12_340, 5_000), Vent(), Start(50), Stop(), Heartbeat(900))
    ]
    assert sent == [b"P-12.3,5.0\n", b"V\n", b"S50\n", b"X\n", b"H900\n"]
    events, data = link.poll(0)
    assert [event.status for event in events if isinstance(event, CommandDone)] == [AckStatus.DONE] * 5
    assert data == b""


def test_commands_without_template_are_not_supported() -> None:
    """A session continues without a watchdog or limits on the board, and is informed of it."""
    link = TextConnection(load_profile(LINES))
    assert link.send(ClearFault(), 0) == link.send(SetLimits(-1, 1), 0) == b""
    events, _ = link.poll(0)
    assert [event.status for event in events if isinstance(event, CommandDone)] == [AckStatus.NOT_SUPPORTED] * 2


def test_profile_without_commands_gives_the_reason() -> None:
    """No template, or no limits: read-only, with the reason, and nothing is pressurised."""
    link = TextConnection(load_profile(RX8))
    assert not link.can_command
    assert "commands.set_pressure" in link.cannot_command_reason
    for command in (SetPressure(0, 0), Vent()):
        with pytest.raises(LocalError, match=r"commands\."):
            link.send(command, 0)
    limitless = (
        LINES.read_text(encoding="utf-8").replace("pressure_min_kpa = -50", "").replace("pressure_max_kpa = 60", "")
    )
    link = TextConnection(load_profile(limitless))
    assert link.cannot_command_reason.endswith("no pressure limits under `device`")
    with pytest.raises(LocalError, match="limits"):
        link.send(SetPressure(0, 0), 0)
    assert link.send(Vent(), 0) == b"V\n"


REFUSED = [
    ('name = "Delimited', 'nane = "Delimited', "unknown key nane"),
    ("n_sensors = 2", "n_sensors = 5", r"device\.n_sensors"),
    ("n_sensors = 2", 'n_sensors = "2"', r"device\.n_sensors is '2', not of type int"),
    ("n_sensors = 2", "n_sensors = true", r"device\.n_sensors is True"),
    ("rate_hz = 100 ", "", r"device\.rate_hz is missing"),
    ("rate_hz = 100 ", "rate_hz = 0", r"device\.rate_hz"),
    ("polarity = 1 ", "polarity = 2", "polarity"),
    ("adc_bits = 12", "", "adc_bits is missing"),
    ("pressure_min_kpa = -50", "pressure_min_kpa = 70", "pressure limits"),
    ("pressure_min_kpa = -50", "", "only one of"),
    ("pressure_max_kpa = 60", "pressure_max_kpa = nan", "pressure limits"),
    ('kind = "lines"', 'kind = "csv"', "kind = 'csv'"),
    ('delimiter = ","', 'delimeter = ","', r"unknown key lines\.delimeter"),
    ('delimiter = ","', 'delimiter = ",,"', "one character"),
    ('checksum = "none"', 'checksum = "crc"', "checksum"),
    ('comments = ["#", "time_ms"]', "comments = [1]", "comments"),
    ('unit = "kPa"', 'unit = "torr"', "pressure has the unit 'torr'"),
    ('unit = "ms", wraps_at = 4294967296', "wraps_at = 7", "wraps_at = 7"),
    ('unit = "ms", wraps_at', "wraps_at", "time has the unit None"),
    ('"s1_lit"', '"s1_lt"', "sensors' fields"),
    ('"s1_lit"', '"s2_lit"', "s2_lit is given twice"),
    ('name = "pressure"', 'name = "druck"', "no field is named pressure"),
    ('"index"', '{ name = "index", scale = 2 }', "index has scale 2"),
    ("P{kpa:.1f}", "P{kpa.__class__}", "unknown field"),
    ("P{kpa:.1f}", "P{kpa!r}", "unusable format"),
    ("P{kpa:.1f}", "P{kpa:{pa}}", "unusable format"),
    ("P{kpa:.1f}", "P{kpa:>99999}", "unusable format"),
    ("P{kpa:.1f}", "P{kpa:d}", "commands.set_pressure"),
    ("P{kpa:.1f}", "P{0}", "unknown field"),
    ("P{kpa:.1f}", "P{}", "unknown field"),
    ("P{kpa:.1f}", "P{kpa", "commands.set_pressure"),
    ("P{kpa:.1f}", "P{kpa[0]}", "unknown field"),
    ("P{kpa:.1f}", "PÄ{kpa}", "ascii"),
    ('vent = "V', 'went = "V', r"unknown key commands\.went"),
    ('vent = "V\\n"', "vent = 1", r"commands\.vent is 1"),
]


@pytest.mark.fault(53, how="profiles with each kind of mistake", times=35)
@pytest.mark.parametrize(("old", "new", "message"), REFUSED)
def test_a_profile_is_refused_by_key(old: str, new: str, message: str) -> None:
    """Unknown keys, wrong types, missing parts, swapped limits, templates that reach for more: named, with a remedy."""
    text = LINES.read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(ProfileError, match=message) as caught:
        load_profile(text.replace(old, new, 1))
    assert caught.value.remedy


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


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00", b"a = [", b"x" * 200_000])
def test_other_file_is_refused(tmp_path: Path, content: bytes | None) -> None:
    """Absent, not text, not TOML, far too long."""
    path = tmp_path / "profile.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ProfileError) as caught:
        load_profile(path)
    assert caught.value.remedy
