"""The link as text."""

from __future__ import annotations

import dataclasses

import pytest

from boat_daq.engine.snapshot import LinkState
from boat_daq.viewmodels.live.connection import link_text
from tests.boat_daq.gui.recorded_session import idle


@pytest.mark.parametrize("link", list(LinkState))
def test_every_link_state_has_colour_shape_and_word(link):
    """No state of the link is shown by its colour alone."""
    text = link_text(dataclasses.replace(idle(), link=link))
    assert text.state
    assert text.shape
    assert text.word


@pytest.mark.parametrize(
    ("port", "text"),
    [
        ("COM3", "COM3"),
        ("replay:/a/b/SA1.boat@20", "replay of SA1.boat"),
        ("/dev/serial/by-id/" + "x" * 40, "\u2026" + "x" * 28),
    ],
)
def test_long_port_is_shortened(port, text):
    """A replay is named by its file, a long path by its end."""
    from boat_daq.viewmodels.live.connection import short_port

    assert short_port(port) == text
