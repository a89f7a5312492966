"""`boat-daq board`: its port, JSON line, refusals and list of faults."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys

import pytest

from boat_daq.engine.simulator.server import BoardServer
from protocol.simulator.faults import FAULTS
from protocol.text.profile import load_profile
from tests.boat_daq.commands.calls import program
from tests.protocol.text.firmwares import OUTPUTS

BOARD = [sys.executable, "-m", "boat_daq", "board"]


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT on Windows")
def test_port_is_the_first_line_and_ctrl_c_ends_it():
    """The port accepts a connection, and Ctrl-C exits with 130 and without a traceback."""
    command, pipe = [*BOARD, "--tcp", "127.0.0.1:0"], subprocess.PIPE
    board = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True)
    url = board.stdout.readline().strip()
    host, _, port = url.removeprefix("socket://").rpartition(":")
    socket.create_connection((host, int(port)), timeout=5).close()
    board.send_signal(signal.SIGINT)
    rest, messages = board.communicate(timeout=20)
    assert board.returncode == 130
    assert rest == ""
    assert "SIMULATED" in messages
    assert "Traceback" not in messages


def test_json_line_has_the_true_figures(monkeypatch):
    """One object: port, unit, and the unit's true figures."""
    monkeypatch.setattr(BoardServer, "run", lambda *_: None)
    printed = json.loads(program("board", "--tcp", "127.0.0.1:0", "--unit", "SA1", "--json").out)
    assert printed["port"].startswith("socket://127.0.0.1:")
    assert printed["truth"]["sensors"][0]["coefficients"][0] == 1651.9842


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["--tcp", "127.0.0.1:0", "--fault", "meteor@3"], 2, "meteor"),
        (["--tcp", "127.0.0.1:0", "--unit", "SA9"], 2, "SA9"),
        (["--tcp", "10.0.0.1:5000"], 1, "--allow-remote"),
        ([], 2, "--pty"),
        (["--pty", "--tcp", "127.0.0.1:0"], 2, "--pty"),
        (["--tcp", "127.0.0.1:0", "--link", "x"], 2, "--link"),
        (["--pty", "--speed", "0"], 2, "--speed"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_refusal_names_the_option(arguments, code, word):
    """Usage errors exit with 2, other failures with 1, both with a message and an empty standard output."""
    done = program("board", *arguments)
    assert done.code == code
    assert word in done.err
    assert "Traceback" not in done.err
    assert done.out == ""


def test_faults_are_listed():
    """Each with its sentence, as text and as an object."""
    text = program("board", "--fault", "list").out
    table = json.loads(program("board", "--fault", "list", "--json").out)
    assert list(table) == list(FAULTS)
    assert all(kind.sentence in text for kind in FAULTS.values())


def test_profile_is_proposed_from_a_file(tmp_path):
    """The TOML is printed or written; what is only a guess is said; a file that is no table is refused."""
    path, out = tmp_path / "printed.txt", tmp_path / "board.toml"
    path.write_bytes(OUTPUTS["Arduino plotter without labels"])
    done = program("profile", str(path), "--out", str(out), "--seconds", "0.6")
    assert load_profile(out).rate_hz == pytest.approx(100, rel=0.05)
    assert "a guess: a field without a label is pressure in kPa" in done.err
    printed = json.loads(program("profile", str(path), "--json").out)
    assert [field["guessed"] for field in printed["fields"]] == [True] * 3
    path.write_text("no table\n" * 9, encoding="utf-8")
    assert "fit most of the lines" in program("profile", str(path)).err
    assert program("profile").code == 2
