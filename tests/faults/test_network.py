"""Boards and schedulers elsewhere need a word from the user."""

from __future__ import annotations

import pytest

from analysis.dask_address import check_scheduler
from analysis.errors import RequestError
from boat_daq.engine.link.transports import open_transport
from boat_daq.engine.simulator.carriers import TcpCarrier
from boat_daq.errors import DeviceError, OperatorError


@pytest.mark.parametrize(
    "address", ["tcp://10.0.0.7:8786", "scheduler.example:8786", "tls://192.0.2.1:1", "tcp://[::]:1"]
)
def test_a_scheduler_elsewhere_needs_a_word(address: str) -> None:
    """Loopback only, unless the user vouches for the network."""
    with pytest.raises(RequestError, match="not on this computer") as refusal:
        check_scheduler(address, allow_remote=False)
    assert "--allow-remote" in refusal.value.remedy
    check_scheduler(address, allow_remote=True)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "localhost:8786", "tcp://[::1]:8786", "inproc://a/b"])
def test_a_scheduler_here_needs_none(address: str) -> None:
    """This computer's own addresses."""
    check_scheduler(address, allow_remote=False)


def test_boards_are_here_by_default() -> None:
    """A host does not look elsewhere, and a virtual board does not listen elsewhere, without the word for it."""
    with pytest.raises(DeviceError, match="not this machine") as host:
        open_transport("socket://192.0.2.1:7777")
    with pytest.raises(OperatorError) as board:
        TcpCarrier("0.0.0.0:0")
    assert "--allow-remote" in host.value.remedy
    assert "--allow-remote" in board.value.remedy


@pytest.mark.parametrize("command", [["record"], ["board"], ["batch"], ["optics", "sweep"]])
def test_the_word_is_an_option(command: list[str]) -> None:
    """Each command that can leave this computer has it."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    shown = CliRunner().invoke(app, [*command, "--help"], env={"COLUMNS": "200"})
    assert "--allow-remote" in shown.stdout
