"""Extra channels: their names, units and columns."""

from __future__ import annotations

import pytest

from protocol.base.errors import RecordingError
from protocol.recording import channels_of, session_channels
from protocol.recording.channels import are_channels
from protocol.recording.checks import check_session


def test_columns_are_names_with_units() -> None:
    """As those of the samples: small letters, the unit at the end."""
    channels = channels_of(
        [("temperature", "°C"), ("Flow rate", "L/min"), ("battery", "V"), ("count", ""), ("2nd", "")]
    )
    assert [channel.column for channel in channels] == [
        "temperature_degc", "flow_rate_l_per_min", "battery_v", "count", "channel_2nd",
    ]  # fmt: skip
    assert channels[1].title == "Flow rate"


def test_a_name_twice_or_that_of_a_sample_is_numbered() -> None:
    """Every channel has a column of its own, and none replaces a column with a meaning; again, it stays as it is."""
    channels = channels_of([("a", ""), ("a", ""), ("target", "kPa"), ("s1", "mV"), ("elongation", "mm")])
    assert [channel.name for channel in channels] == ["a", "a 2", "target 2", "s1 2", "elongation 2"]
    assert len({channel.column for channel in channels}) == 5
    assert channels_of(channels) == channels == session_channels({"channels": [list(channel) for channel in channels]})


def test_a_name_cannot_hold_a_line_or_a_book() -> None:
    """Control characters and long texts of an untrusted device do not reach a table or a window."""
    ((name, unit),) = channels_of([("a\n\x1b[31m" + "b" * 500, "\x00" + "V" * 100)])
    assert name.isprintable() and len(name) <= 40 and len(unit) <= 20


@pytest.mark.parametrize("value", [{}, [["a"]], [["a", 1]], ["ab"], [["a", "b"]] * 33])
def test_what_is_no_list_of_channels_is_refused(value: object) -> None:
    """A recording is untrusted: its session is checked."""
    assert not are_channels(value)


def test_signals_have_no_converter() -> None:
    """A profile of signals states no bits: its recording opens; one of counts without them does not."""
    meta = {"sample_kind": "signal", "vref_mv": 0, "adc_bits": 0}
    check_session(meta)
    with pytest.raises(RecordingError, match="lacks the scale of its counts"):
        check_session({**meta, "sample_kind": "counts"})
