"""The messages of a session as text: link warnings once each, and the remedy of an error with its command."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from boat_daq.engine.snapshot import (
    LinkState,
    LinkWarning,
    LinkWarningCode,
    Message,
    MessageKind,
    SessionSnapshot,
    SessionState,
)
from boat_daq.workflows.session_messages import MessagePrinter


@pytest.mark.fault(8, how="a link warning of the board's clock in a terminal", times=1)
def test_link_warning_is_printed_once_for_each_code(capsys: pytest.CaptureFixture[str]) -> None:
    """New numbers are the same warning, a drift is another; silence has its own message, a brief warning none."""
    print_new = MessagePrinter(print)
    looks = (
        (0.0, {LinkWarningCode.SILENT: "2 s", LinkWarningCode.LOSS: "3 lost", LinkWarningCode.RATE: "102.7 Hz"}),
        (5.0, {LinkWarningCode.SILENT: "7 s", LinkWarningCode.LOSS: "3 lost"}),
        (6.0, {LinkWarningCode.SILENT: "8 s", LinkWarningCode.LOSS: "17 lost", LinkWarningCode.RATE: "99.1 Hz"}),
        (7.0, {LinkWarningCode.LOSS: "18 lost", LinkWarningCode.CLOCK: "0.9 % fast"}),
        (13.0, {LinkWarningCode.LOSS: "18 lost", LinkWarningCode.CLOCK: "0.8 % fast"}),
        (14.0, {LinkWarningCode.CLOCK: "0.8 % fast"}),
    )
    for recorded_s, texts in looks:
        health = SimpleNamespace(warnings=tuple(LinkWarning(code, text) for code, text in texts.items()))
        print_new(SessionSnapshot(SessionState.IDLE, LinkState.UP, recorded_s=recorded_s, health=health))
    assert capsys.readouterr().out.splitlines() == ["warning: 17 lost", "warning: 0.8 % fast"]


def test_message_shows_its_command_on_the_command_line(capsys):
    """The remedy of an error that a live session passes on ends with its command, which the window does not show."""
    message = Message(1, MessageKind.LINK_FAILED, "error", "no port", "Choose a port of the list.", 0, "boat-daq ports")
    MessagePrinter(print)(SessionSnapshot(SessionState.IDLE, LinkState.FAILED, messages=(message,)))
    assert "try: Choose a port of the list.: boat-daq ports" in capsys.readouterr().out
