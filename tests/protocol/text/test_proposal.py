"""Profiles proposed from the outputs of made-up firmware, tried by the decoder of the program itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import tomli_w

from protocol.base.errors import ProfileError
from protocol.link.events import Samples
from protocol.text.connection import TextConnection
from protocol.text.profile import load_profile
from protocol.text.proposal import Proposal, propose, propose_packets, split_unit
from protocol.text.readers import CHECKSUMS
from tests.protocol.text.firmwares import COUNTS, OUTPUTS, PACKETS, PACKETS_WITH_TAIL, PRESSURE_KPA, SECONDS

TENTHS = ("hexadecimal with separators", "hexadecimal of one width")  # of a kPa: which no text tells
NO_TIME = ("Arduino plotter with labels", "Arduino plotter without labels", "units behind the numbers")


def decoded(proposal: Proposal, data: bytes) -> np.ndarray:
    """Return the samples that the proposed profile reads from the data."""
    link = TextConnection(load_profile(tomli_w.dumps(proposal.content("made up"))))
    events = link.receive(data, 0)
    return np.concatenate([event.array for event in events if isinstance(event, Samples)])


def with_field(proposal, at, **values):
    """Return the proposal with other values of a field."""
    fields = list(proposal.fields)
    fields[at] = replace(fields[at], **values)
    return replace(proposal, fields=tuple(fields))


@pytest.mark.parametrize("name", OUTPUTS)
def test_proposed_profile_reads_what_was_printed(name):
    """Every line but the first gives pressure and signals as they were; the rate is that of the time or the host."""
    data = OUTPUTS[name]
    proposal = propose(b"cut\n" + data + b"12", SECONDS)
    if name in TENTHS:
        at = [field.name for field in proposal.fields].index("pressure")
        proposal = with_field(proposal, at, scale=0.1)
    assert proposal.rate_hz == pytest.approx(100, rel=0.03)
    assert proposal.fitting >= 58
    samples = decoded(proposal, b"cut\n" + data if b"\n" in data else b"cut\r" + data)
    pressure = samples["pressure_pa"] / 1000
    np.testing.assert_allclose(pressure, PRESSURE_KPA[-len(pressure) :], atol=1e-6)
    assert len(pressure) == 60
    signals = COUNTS if name == "units behind the numbers" else COUNTS * proposal.vref_mv / 2**proposal.adc_bits
    np.testing.assert_allclose(samples["signal_mv"], signals, rtol=1e-6)
    assert (name in NO_TIME) is ("time" not in [field.name for field in proposal.fields])


def test_what_the_text_states_is_told_from_what_its_numbers_suggest():
    """Headings and labels are stated; columns without either are guessed."""
    stated = propose(OUTPUTS["columns with a heading"], SECONDS)
    assert [(f.name, f.unit, f.guessed) for f in stated.fields[:2]] == [
        ("time", "ms", False),
        ("pressure", "kPa", False),
    ]
    guessed = propose(OUTPUTS["Arduino plotter without labels"], SECONDS)
    assert [(field.name, field.guessed) for field in guessed.fields] == [
        ("pressure", True),
        ("s1_signal", True),
        ("s2_signal", True),
    ]


def test_checksums_are_those_of_their_standards():
    """The check values of the catalogue of CRC algorithms for "123456789", and of NMEA 0183."""
    assert (CHECKSUMS["crc16"][0](b"123456789"), CHECKSUMS["crc16_modbus"][0](b"123456789")) == (0x29B1, 0x4B37)
    assert CHECKSUMS["nmea"][0](b"GPGLL,5300.97914,N,00259.98174,E,125926,A") == 0x28
    assert propose(OUTPUTS["checksum crc16"], SECONDS).lines["checksum"] == "crc16"
    altered = OUTPUTS["checksum sum"].replace(b",500,", b",501,", 1)
    link = TextConnection(load_profile(tomli_w.dumps(propose(altered, SECONDS).content("x"))))
    link.receive(altered, 0)
    assert link.statistics.crc_errors == 1


def test_fields_without_a_meaning_are_kept_as_channels():
    """A temperature is a channel with its unit, text is left out."""
    units = propose(OUTPUTS["units behind the numbers"], SECONDS)
    assert [(f.name, f.unit) for f in units.fields][-1] == ("Temp", "degC")
    assert propose(OUTPUTS["checksum"], SECONDS).fields[0].name == "_"
    assert load_profile(tomli_w.dumps(units.content("x"))).channels[0].column == "temp_degc"


def test_a_damaged_line_changes_no_proposal():
    """A text that was cut or altered on the way is left out: its column is still one of numbers."""
    whole = OUTPUTS["columns with a heading"]
    damaged = whole.replace(b",500,", b",5?0,", 1)
    names = [[field.name for field in propose(data, SECONDS).fields] for data in (whole, damaged)]
    assert names[0] == names[1] == ["time", "pressure", "s1_signal", "s2_signal"]


def test_rate_is_the_mean_one_of_an_uneven_clock():
    """Steps of 5 and 25 ms in turn are 67 Hz; a gap of seconds is none of them."""
    times = np.cumsum(np.tile([5, 25], 30)) + np.repeat([0, 9000], 30)
    lines = "".join(f"t={t} p=1.5 s1={400 + i % 5}\n" for i, t in enumerate(times)).encode()
    assert propose(lines).rate_hz == pytest.approx(1000 / 15, rel=0.02)


def test_sensors_numbered_from_zero_are_numbered_from_one():
    """ch0 and ch1 are the sensors 1 and 2."""
    names = [field.name for field in propose(OUTPUTS["comments and aligned columns"], SECONDS).fields]
    assert names == ["time", "pressure", "s1_signal", "s2_signal"]


@pytest.mark.parametrize(
    ("label", "expected"),
    [
        ("p_kPa", ("p", "kPa")),
        ("Pressure (mbar)", ("Pressure", "mbar")),
        ("temp[C]", ("temp", "degC")),
        ("ch_1", ("ch_1", "")),
        ("millis", ("millis", "ms")),
        ("valve state", ("valve state", "")),
    ],
)
def test_unit_in_a_label(label, expected):
    """In parentheses, in brackets, or behind an underscore where it is a unit."""
    assert split_unit(label) == expected


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"", "only 0 whole lines"),
        (b"1,2\n3,4\n", "only 1 whole lines"),
        (b"hello there\nthis is a poem\nand it does not rhyme\nat all\nnowhere\n", "fit most of the lines"),
        (bytes(range(256)) * 20, "whole lines|fit most"),
    ],
)
def test_what_is_no_table_of_numbers_is_refused(data, cause):
    """Too few lines, prose, bytes: the cause and a remedy."""
    with pytest.raises(ProfileError, match=cause):
        propose(data)


def test_proposal_without_a_pressure_says_so():
    """A table of names alone cannot be recorded; nothing is invented."""
    proposal = propose(b"x\n" + b"".join(b"temp=%d hum=%d\n" % (20 + i % 3, 40) for i in range(20)))
    assert "pressure" in proposal.missing
    named = with_field(proposal, 0, name="pressure")
    assert "sensor" in named.missing
    assert not with_field(named, 1, name="s1_signal").missing


@pytest.mark.parametrize(
    ("data", "packet"),
    [
        (PACKETS, "RX8 [h=43] @1P @0P @1S1 @0S1 @1S2 @0S2"),
        (PACKETS_WITH_TAIL, "RX8 [h=AA 43] @1P @0P @1S1 @0S1 @1S2 @0S2 [t=0D 0A]"),
    ],
)
def test_packets_are_proposed_as_rx8(data, packet):
    """Header, tail, length and the order of the bytes; the pressure is hundredths of a kPa with a sign, as usual."""
    proposal = propose_packets(b"\x01\x02" + data + b"\x43", SECONDS)
    assert proposal.rx8 == packet
    assert proposal.rate_hz == pytest.approx(100, rel=0.03)
    samples = decoded(proposal, data)
    np.testing.assert_allclose(samples["pressure_pa"] / 1000, PRESSURE_KPA[: len(samples)], atol=1e-6)
    counts = samples["signal_mv"] * 2**proposal.adc_bits / proposal.vref_mv
    np.testing.assert_allclose(counts, COUNTS[: len(samples)], rtol=1e-6)
    assert len(samples) >= 58


def test_bytes_without_a_period_are_no_packets():
    """Noise has no header, and is refused with what to do."""
    noise = np.random.default_rng(1).integers(0, 256, 2000, dtype=np.uint8).tobytes()
    with pytest.raises(ProfileError, match="no byte comes back"):
        propose_packets(noise)
