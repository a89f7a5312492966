"""Wrong input at the command line: two lines with cause and remedy, exit 1, nothing pressurised."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from boat_daq.engine.simulator.server import BoardSettings
from tests.boat_daq.commands.calls import program
from tests.boat_daq.engine.served_board import serve_in_thread

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")

ROOT = Path(__file__).resolve().parents[2]


def refused(*arguments: str, own_process: bool = False) -> str:
    """Run boat-daq here, or in a process of its own; check that it fails with a short message, and return it."""
    if own_process:
        command = [sys.executable, "-m", "boat_daq", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT, check=False)
        code, err = done.returncode, done.stderr
    else:
        code, _, err = program(*arguments)
    assert code == 1, err
    assert "Traceback" not in err
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith("SIMULATED")]
    assert 1 <= len(lines) <= 3, err
    assert lines[0].startswith("error: ")
    return err


@pytest.fixture(scope="module")
def board() -> Iterator[str]:
    """A virtual board in real time: no test waits for it."""
    with serve_in_thread(BoardSettings()) as served:
        yield served.url


@pytest.fixture
def chatter() -> Iterator[str]:
    """A device that prints text: not a board."""
    master, slave = os.openpty()
    stop = threading.Event()

    def print_lines() -> None:
        while not stop.wait(0.05):
            os.write(master, b"temperature 21.4\r\n")

    thread = threading.Thread(target=print_lines)
    thread.start()
    yield os.ttyname(slave)
    stop.set()
    thread.join()
    os.close(master)
    os.close(slave)


@pytest.mark.fault(13, how="`record` on a port that is not there", times=1)
def test_missing_port_is_named(tmp_path: Path) -> None:
    """The port is named, and no recording is left behind."""
    message = refused("record", "--port", "/dev/ttyNOWHERE", "--out", str(tmp_path / "a.boat"), own_process=True)
    assert "/dev/ttyNOWHERE" in message
    assert "try:" in message
    assert not list(tmp_path.iterdir())


@pytest.mark.fault(13, how="`record` on a port that another program holds", times=1)
def test_busy_port_is_named(board: str, tmp_path: Path) -> None:
    """A port that another program holds is named as busy."""
    import serial

    with serial.Serial(board, exclusive=True):
        message = refused("record", "--port", board, "--out", str(tmp_path / "a.boat"))
    assert board in message
    assert "try:" in message


@pytest.mark.fault(14, how="`record` on a pseudo-terminal that prints text", times=1)
def test_device_that_prints_text_is_refused(chatter: str, tmp_path: Path) -> None:
    """A device that sends text is refused in seconds; the message names baud rate and profiles."""
    message = refused("record", "--port", chatter, "--plan", "calibration", "--out", str(tmp_path / "a.boat"))
    assert "not a BOAT board" in message
    assert not list(tmp_path.iterdir())


@pytest.mark.fault(14, how="`record` on a board of protocol version 2", times=1)
def test_other_protocol_version_is_refused(tmp_path: Path) -> None:
    """Both versions are named, and the board is not started."""
    with serve_in_thread(BoardSettings(faults=("wrong_protocol@0",))) as served:
        message = refused("record", "--port", served.url, "--plan", "calibration", "--out", str(tmp_path / "a.boat"))
    assert "version" in message
    assert "1" in message


def test_plan_outside_the_limits_is_refused(board: str, tmp_path: Path) -> None:
    """A plan beyond the board's limits is refused with the limit, before any pressure."""
    plan = tmp_path / "high.toml"
    plan.write_text(
        'name = "high"\nkind = "continuous"\ncycles = 1\nhigh_kpa = 80.0\nmax_kpa = 80.0\nlow_kpa = 0.0\nmin_kpa = 0.0'
    )
    message = refused("record", "--port", board, "--plan", str(plan), "--out", str(tmp_path / "a.boat"))
    assert "80" in message


def test_plan_with_unknown_key_is_refused(tmp_path: Path) -> None:
    """A mistyped key is refused by name; no default is used in its place."""
    plan = tmp_path / "typo.toml"
    plan.write_text('name = "typo"\nkind = "continuous"\ncycles = 1\nmax_kap = 60.0\n')
    assert "max_kap" in refused("record", "--port", "/dev/null", "--plan", str(plan))


@pytest.mark.parametrize("command", ["info", "verify", "recover", "analyze"])
def test_text_file_is_refused_as_a_recording(command: str, tmp_path: Path) -> None:
    """A text file with a recording's suffix is refused by name."""
    file = tmp_path / "notes.boat"
    file.write_text("not a recording\n" * 100)
    assert "notes.boat" in refused(command, str(file))


def test_readings_that_do_not_fit_the_plan_are_refused(board: str, tmp_path: Path) -> None:
    """An elongation file that does not fit the plan's plateaus is refused before any pressure."""
    readings = tmp_path / "readings.csv"
    readings.write_text("pressure_kpa,elongation_mm\n50,3.8\n40,3.1\n")
    out = tmp_path / "a.boat"
    message = refused(
        "record", "--port", board, "--plan", "calibration", "--elongation", str(readings), "--out", str(out)
    )
    assert "readings" in message
    assert not out.exists()


def test_existing_recording_is_not_overwritten(board: str, tmp_path: Path) -> None:
    """A recording is never overwritten."""
    out = tmp_path / "a.boat"
    out.write_bytes(b"precious")
    assert "a.boat" in refused("record", "--port", board, "--duration", "1", "--out", str(out))
    assert out.read_bytes() == b"precious"


def test_unknown_option_is_a_usage_error() -> None:
    """An option that does not exist is exit 2, not 1."""
    assert program("record", "--prt", "x").code == 2
