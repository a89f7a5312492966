"""The link supervisor on a clock of its own: how long it waits for a board, however busy the computer is."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest

from boat_daq.engine.session.link_supervisor import SUPERVISION_S
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import LinkState
from protocol.link.messages import SetPressure, Start
from tests.boat_daq.engine.other_devices import Chatter
from tests.boat_daq.engine.served_board import serve_in_thread

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

ASKED_S = 3.0


class Clock:
    """Time that passes only as the supervisor turns."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@contextmanager
def port_of(kind: str) -> Iterator[str]:
    """A port with something on it that is not a BOAT board."""
    if kind == "chatter":
        with closing(Chatter()) as device:
            yield device.url
    else:
        with serve_in_thread(BoardSettings(faults=(kind,))) as board:
            yield board.url


@pytest.mark.fault(
    14, how="wrong baud rate, another device, another version and silence, on the supervisor's clock", times=4
)
@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("wrong_baud@0:0", "not a BOAT board"),
        ("chatter", "not a BOAT board"),
        ("wrong_protocol@0:2", "version 2"),
        ("silent@0:0", "no data"),
    ],
)
def test_what_is_no_board_is_refused_within_three_seconds(
    monkeypatch: pytest.MonkeyPatch, kind: str, text: str
) -> None:
    """Within 3 s of opening, with half a second to spare; neither samples nor a pressure were requested."""
    clock, sent = Clock(), []
    session = Session(Settings(), UnitLibrary())
    link = session._link
    link._clock_s = clock
    link._ending = True  # no thread: stepped by the test
    plain_send = link.send
    monkeypatch.setattr(link, "send", lambda command, **more: sent.append(command) or plain_send(command, **more))
    with port_of(kind) as url:
        session.connect(url)
        link._turn()
        for _ in range(20):  # what comes at all is there by now
            time.sleep(0.02)
            link._turn()
        while link.state is LinkState.OPENING and clock.now_s < 100.0 + 2 * ASKED_S:
            clock.now_s += SUPERVISION_S
            link._turn()
        assert link.state is LinkState.FAILED
        assert clock.now_s - 100.0 <= ASKED_S - 0.4
        assert link.error is not None and text in link.error[0] and link.error[1]
        assert not [command for command in sent if isinstance(command, SetPressure | Start)]
        session.close()
