"""Commands found by a few letters."""

from __future__ import annotations

from boat_daq.gui.command_palette import ranked


def test_beginnings_of_words_rank_first():
    """Words' beginnings come before letters inside; letters in order count where nothing else is found."""
    names = ["Save the plot as PNG", "Show the whole session", "Paste readings"]
    assert ranked("sa pl", names, str) == ["Save the plot as PNG"]
    assert ranked("plot", [*names, "Copy the last note"], str) == ["Save the plot as PNG"]
    assert ranked("whs", names, str) == ["Show the whole session"]
    assert ranked("", names, str) == names
    assert ranked("xyz", names, str) == []
