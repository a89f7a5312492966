"""What a user can get wrong at the command line: two lines with cause and remedy, exit 1, nothing pressurised."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from boat_daq.engine.simulator.server import BoardSettings, serve

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")

ROOT = Path(__file__).resolve().parents[2]


def refused(*arguments: str) -> str:
    """Run boat-daq, check that it fails in few words, and return them."""
    command = [sys.executable, "-m", "boat_daq", *arguments]
    env = {**os.environ, "COLUMNS": "400"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT, check=False, env=env)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    said = [line for line in done.stderr.splitlines() if line.strip() and not line.startswith("SIMULATED")]
    assert 1 <= len(said) <= 3, done.stderr
    assert said[0].startswith("error: ")
    return done.stderr


@pytest.fixture(scope="module")
def board() -> Iterator[str]:
    """A virtual board at its own pace: nothing here waits for it."""
    with serve(BoardSettings()) as served:
        yield served.url


@pytest.fixture
def chatter() -> Iterator[str]:
    """A device that prints text: something else than a board."""
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
def test_no_such_port(tmp_path: Path) -> None:
    """The port is named, and no recording is left behind."""
    said = refused("record", "--port", "/dev/ttyNOWHERE", "--out", str(tmp_path / "a.boat"))
    assert "/dev/ttyNOWHERE" in said
    assert "try:" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.fault(13, how="`record` on a port that another program holds", times=1)
def test_busy_port(board: str, tmp_path: Path) -> None:
    """A port that another program holds is named as busy."""
    import serial

    with serial.Serial(board, exclusive=True):
        said = refused("record", "--port", board, "--out", str(tmp_path / "a.boat"))
    assert board in said
    assert "try:" in said


@pytest.mark.fault(14, how="`record` on a pseudo-terminal that prints text", times=1)
def test_a_device_that_is_no_board(chatter: str, tmp_path: Path) -> None:
    """Text on the line is refused in seconds, with a word about baud rate and profiles."""
    said = refused("record", "--port", chatter, "--plan", "calibration", "--out", str(tmp_path / "a.boat"))
    assert "not a BOAT board" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.fault(14, how="`record` on a board of protocol version 2", times=1)
def test_another_protocol_version(tmp_path: Path) -> None:
    """Both versions are named, and the board is not started."""
    with serve(BoardSettings(faults=("wrong_protocol@0",))) as served:
        said = refused("record", "--port", served.url, "--plan", "calibration", "--out", str(tmp_path / "a.boat"))
    assert "version" in said
    assert "1" in said


def test_a_plan_outside_the_limits(board: str, tmp_path: Path) -> None:
    """A plan beyond the board's limits is refused with the limit, before any pressure."""
    plan = tmp_path / "high.toml"
    plan.write_text(
        'name = "high"\nkind = "continuous"\ncycles = 1\nhigh_kpa = 80.0\nmax_kpa = 80.0\nlow_kpa = 0.0\nmin_kpa = 0.0'
    )
    said = refused("record", "--port", board, "--plan", str(plan), "--out", str(tmp_path / "a.boat"))
    assert "80" in said


def test_a_plan_with_an_unknown_key(tmp_path: Path) -> None:
    """A mistyped key is refused by name; no default is used in its place."""
    plan = tmp_path / "typo.toml"
    plan.write_text('name = "typo"\nkind = "continuous"\ncycles = 1\nmax_kap = 60.0\n')
    assert "max_kap" in refused("record", "--port", "/dev/null", "--plan", str(plan))


@pytest.mark.parametrize("command", ["info", "verify", "recover", "analyze"])
def test_a_file_that_is_not_a_recording(command: str, tmp_path: Path) -> None:
    """A text file in a recording's clothes is named for what it is not."""
    file = tmp_path / "notes.boat"
    file.write_text("not a recording\n" * 100)
    assert "notes.boat" in refused(command, str(file))


def test_readings_that_do_not_fit_the_plan(board: str, tmp_path: Path) -> None:
    """An elongation file that does not fit the plan's plateaus is refused before anything moves."""
    readings = tmp_path / "readings.csv"
    readings.write_text("pressure_kpa,elongation_mm\n50,3.8\n40,3.1\n")
    out = tmp_path / "a.boat"
    said = refused("record", "--port", board, "--plan", "calibration", "--elongation", str(readings), "--out", str(out))
    assert "readings" in said
    assert not out.exists()


def test_an_existing_recording_is_not_overwritten(board: str, tmp_path: Path) -> None:
    """A recording is never written over."""
    out = tmp_path / "a.boat"
    out.write_bytes(b"precious")
    assert "a.boat" in refused("record", "--port", board, "--duration", "1", "--out", str(out))
    assert out.read_bytes() == b"precious"


def test_a_wrong_call_is_a_usage_error() -> None:
    """An option that does not exist is exit 2, not 1."""
    command = [sys.executable, "-m", "boat_daq", "record", "--prt", "x"]
    assert subprocess.run(command, capture_output=True, timeout=60, cwd=ROOT, check=False).returncode == 2
