"""Profiles from a pasted RX8 line."""

from __future__ import annotations

import pytest

from protocol.base.errors import RequestError


def test_rx8_line_becomes_a_profile():
    """The line of the shipped profile, pasted bare, describes the same columns; other variables are extra channels."""
    from boat_daq.viewmodels.live.connection import profile_text
    from protocol.text.profile import load_profile

    line = "RX8 [h=43] @1T @0T @1P @0P @1S1 @0S1 @1S2 @0S2 @0Aux [t=00]"
    profile = load_profile(profile_text(line))
    assert sorted(column.name for column in profile.columns[:-1]) == ["pressure", "s1_signal", "s2_signal", "time"]
    assert profile.channels == (("Aux", ""),)
    assert profile.n_sensors == 2
    assert profile_text(" some/profile.toml ") == "some/profile.toml"
    with pytest.raises(RequestError, match="no sensor"):
        profile_text("RX8 [h=43] @0A [t=00]")
    with pytest.raises(RequestError, match="no pressure"):
        profile_text("RX8 [h=43] @1S1 @0S1 [t=00]")
