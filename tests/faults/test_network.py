"""Boards and schedulers on other computers must be allowed."""

from __future__ import annotations

import pytest

from analysis.cluster import check_scheduler
from boat_daq.engine.link.ports import open_transport
from boat_daq.engine.simulator.server import TcpCarrier
from protocol.base.errors import DeviceError, RequestError


@pytest.mark.parametrize(
    "address", ["tcp://10.0.0.7:8786", "scheduler.example:8786", "tls://192.0.2.1:1", "tcp://[::]:1"]
)
def test_remote_scheduler_needs_allow_remote(address: str) -> None:
    """Only loopback addresses are accepted without the option."""
    with pytest.raises(RequestError, match="not on this computer") as refusal:
        check_scheduler(address, allow_remote=False)
    assert "--allow-remote" in refusal.value.command
    check_scheduler(address, allow_remote=True)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "localhost:8786", "tcp://[::1]:8786", "inproc://a/b"])
def test_local_scheduler_needs_no_option(address: str) -> None:
    """Addresses of this computer are accepted."""
    try:
        check_scheduler(address, allow_remote=False)
    except RequestError as refusal:
        pytest.fail(refusal.cause)


def test_boards_are_local_by_default() -> None:
    """Unless allowed, a host connects, and a virtual board listens, on this computer only."""
    with pytest.raises(DeviceError, match="another machine") as host:
        open_transport("socket://192.0.2.1:7777")
    with pytest.raises(RequestError) as board:
        TcpCarrier("0.0.0.0:0")
    assert "allow_remote=true" in host.value.command
    assert "--allow-remote" in board.value.remedy


@pytest.mark.parametrize("command", [["board"], ["batch"], ["optics", "sweep"]])
def test_commands_have_the_option_allow_remote(command: list[str]) -> None:
    """Each command that can connect to another computer has it."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    shown = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"})
    assert "--allow-remote" in shown.stdout
