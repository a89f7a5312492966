"""The link as text."""

from __future__ import annotations

import dataclasses
import urllib.request
from importlib.util import find_spec

import pytest

from boat_daq.engine.snapshot import LinkState
from boat_daq.viewmodels.live.connection import VirtualBoardProcess, link_text
from tests.boat_daq.gui.recorded_session import idle
from tests.boat_daq.viewmodels.helpers import until


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
        ("/dev/serial/by-id/" + "x" * 40, "\u2026" + "x" * 28),
    ],
)
def test_long_port_is_shortened(port, text):
    """By its end."""
    from boat_daq.viewmodels.live.connection import short_port

    assert short_port(port) == text


@pytest.mark.skipif(find_spec("cv2") is None, reason="OpenCV is an extra")
def test_virtual_board_has_a_camera():
    """Its address is known with the board's; it gives pictures to who asks."""
    board = VirtualBoardProcess("SA1", 1.0)
    try:
        until(lambda: board.url or board.error)
        assert board.camera_url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(board.camera_url, timeout=20) as stream:
            head = [stream.readline() for _ in range(3)]
            assert (head[0], head[1]) == (b"--boat-daq-frame\r\n", b"Content-Type: image/jpeg\r\n")
            assert int(head[2].partition(b":")[2]) > 1000
    finally:
        board.close()
