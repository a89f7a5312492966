"""`boat-daq serve`: its options, and one board served to a client."""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from boat_daq.cli import app
from boat_daq.engine.simulator.server import BoardSettings
from tests.boat_daq.engine.served_board import serve_in_thread


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_a_client_reads_while_it_serves(tmp_path: Path) -> None:
    """The address follows `--secop`, a client is answered, and the object at the end counts it."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    answers: list[str] = []

    def read() -> None:
        deadline = time.monotonic() + 20
        while not answers and time.monotonic() < deadline:
            try:
                with socket.create_connection(("127.0.0.1", port), timeout=5) as client, client.makefile("rw") as lines:
                    lines.write("read vent:value\n")
                    lines.flush()
                    answers.append(lines.readline())
            except OSError:
                time.sleep(0.05)

    client = threading.Thread(target=read)
    client.start()
    out = tmp_path / "served.boat"
    with serve_in_thread(BoardSettings()) as board:
        arguments = ["serve", "--port", board.url, "--secop", f"127.0.0.1:{port}", "--record", str(out)]
        found = CliRunner().invoke(app, [*arguments, "--duration", "1", "--json"])
    client.join()
    assert answers[0].startswith("reply vent:value [false")
    assert json.loads(found.stdout.splitlines()[-1])["secop"]["requests"] == 1
    assert out.exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "give --lsl"),
        (["--secop", "localhost:0", "--plans", "no_such_folder"], "no_such_folder is not a folder"),
        (["--secop", "localhost:x"], "is not a port number"),
        (["--listen", "0.0.0.0:0"], "other computers"),
    ],
)
def test_options_that_cannot_be_are_refused(arguments: list[str], text: str, tmp_path: Path) -> None:
    with serve_in_thread(BoardSettings()) as board:
        found = CliRunner().invoke(app, ["serve", "--port", board.url, "--duration", "0", *arguments])
    assert found.exit_code != 0
    assert text in found.output + str(found.exception)
