"""Text connections: flags, losses, restarts, HELLO and commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from protocol import (
    ClearFault,
    Heartbeat,
    Identify,
    SampleFlag,
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
from tests.protocol.text.devices import LINES, RX8, line, packet, rows_of


def test_pressure_nan_is_kept_and_flagged() -> None:
    """With a sensor unplugged at the board the sample is kept, out of every figure, and the index is complete."""
    rows = rows_of(TextConnection(load_profile(LINES)).receive(line(0) + b"10,1,nan,3,1,5,1,7\n" + line(2), 0))
    assert ((rows["flags"] & SampleFlag.IMPLAUSIBLE) != 0).tolist() == [False, True, False]
    assert np.isnan(rows["pressure_pa"][1])


def test_a_field_without_a_meaning_is_a_channel() -> None:
    """It is recorded in its unit; text or nothing there is NaN and loses no sample; `_` leaves a field out."""
    text = LINES.read_text(encoding="utf-8").replace(
        'unit = "degC" }', 'unit = "degC", scale = 0.1, offset = 1.0 }, "_"'
    )
    link = TextConnection(load_profile(text))
    assert link.channels == (("temperature", "degC"),)
    ends = (b"234,OK", b"ERR,OK", b",OK", b"235,")
    lines = [line(n).rpartition(b",")[0] + b"," + end + b"\n" for n, end in enumerate(ends)]
    rows = rows_of(link.receive(b"".join([line(99), *lines]), 0))
    assert np.allclose(rows["channel"][:, 0], [24.4, np.nan, np.nan, 24.5], equal_nan=True)
    assert link.statistics.malformed == 1  # line(99), which has a field less


def test_a_variable_of_a_packet_without_a_meaning_is_a_channel() -> None:
    """An RX8 format's own name names it; before there were channels it was left out, and still can be."""
    text = RX8.read_text(encoding="utf-8").replace("@1S2 @0S2", "@1S2 @0S2 @1Flow @0Flow")
    profile = load_profile(text)
    assert profile.channels == (("Flow", ""),)
    packets = [packet(n)[:-1] + (300 + n).to_bytes(2, "big") + b"\0" for n in range(5)]
    rows = rows_of(TextConnection(profile).receive(b"".join(packets), 0))
    assert rows["channel"][:, 0].tolist() == [300.0, 301.0, 302.0, 303.0]
    older = rows_of(TextConnection(profile.without_channels()).receive(b"".join(packets), 0))
    assert "channel" not in older.dtype.names and (older["signal_mv"] == rows["signal_mv"]).all()


def test_the_index_of_a_text_shows_loss() -> None:
    """A gap, a repeat: as with the binary protocol."""
    link = TextConnection(load_profile(LINES))
    events = link.receive(line(0) + line(1) + line(1) + line(9), 0)
    assert [event.lost for event in events if isinstance(event, SampleGap)] == [7]
    assert (link.statistics.lost, link.statistics.duplicates) == (7, 1)


def test_restarted_device_is_detected() -> None:
    """Index and clock at 0 again without a message: after 16 lines a restart is reported, and no line is lost."""
    link = TextConnection(load_profile(LINES))
    events = link.receive(b"".join(map(line, range(50))) + b"".join(map(line, range(20))), 0)
    assert [type(event) for event in events].count(BoardRestarted) == 1
    assert rows_of(events)["time_us"].tolist() == [10_000 * n for n in [*range(50), *range(20)]]


def test_without_an_index_the_clock_shows_a_restart() -> None:
    """The same for lines that carry only a time; a single outlying time is dropped, not a restart."""
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
