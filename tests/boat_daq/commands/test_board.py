"""`boat-daq board`: its port, JSON line, refusals and list of faults."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys

import pytest

from protocol.simulator.faults import FAULTS

BOARD = [sys.executable, "-m", "boat_daq", "board"]


def start(*arguments: str) -> subprocess.Popen[str]:
    """Start a board as a process and return it."""
    return subprocess.Popen([*BOARD, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT on Windows")
def test_port_is_the_first_line_and_ctrl_c_ends_it():
    """The port accepts a connection, and Ctrl-C exits with 130 and without a traceback."""
    board = start("--tcp", "127.0.0.1:0")
    url = board.stdout.readline().strip()
    host, _, port = url.removeprefix("socket://").rpartition(":")
    socket.create_connection((host, int(port)), timeout=5).close()
    board.send_signal(signal.SIGINT)
    rest, messages = board.communicate(timeout=20)
    assert board.returncode == 130
    assert rest == ""
    assert "SIMULATED" in messages
    assert "Traceback" not in messages


def test_json_line_has_the_true_figures():
    """One object: port, unit, and the unit's true figures."""
    board = start("--tcp", "127.0.0.1:0", "--unit", "SA1", "--json")
    printed = json.loads(board.stdout.readline())
    board.kill()
    board.communicate()
    assert printed["port"].startswith("socket://127.0.0.1:")
    assert printed["truth"]["sensors"][0]["coefficients"][0] == 1651.9842


@pytest.mark.parametrize(
    ("arguments", "code", "word"),
    [
        (["--tcp", "127.0.0.1:0", "--fault", "meteor@3"], 1, "meteor"),
        (["--tcp", "127.0.0.1:0", "--unit", "SA9"], 1, "SA9"),
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
    done = subprocess.run([*BOARD, *arguments], capture_output=True, text=True, timeout=30)
    assert done.returncode == code
    assert word in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_faults_are_listed():
    """Each with its sentence, as text and as an object."""
    text = subprocess.run([*BOARD, "--list-faults"], capture_output=True, text=True, timeout=30).stdout
    table = json.loads(subprocess.run([*BOARD, "--list-faults", "--json"], capture_output=True, timeout=30).stdout)
    assert list(table) == list(FAULTS)
    assert all(kind.sentence in text for kind in FAULTS.values())
