"""`-` is standard input and standard output of every command that reads or writes one file."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from boat_daq.cli import app
from tests.conftest import ROOT

RUN = ROOT / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.mark.parametrize(
    ("words", "content", "key", "value"),
    [
        ("info -", RUN.read_bytes(), "status", "closed"),
        ("fit - --x x --y y --degree 1", b"x,y\n0,1\n1,3\n2,5\n3,7\n", "n", 4),
    ],
)
def test_standard_input_is_recognised_by_its_content(words: str, content: bytes, key: str, value: object) -> None:
    """A recording and a table."""
    result = CliRunner().invoke(app, [*words.split(), "--json"], input=content)
    assert json.loads(result.stdout)[key] == value


@pytest.mark.skipif(sys.platform == "win32", reason="/dev/stdout")
@pytest.mark.parametrize("name", [pytest.param("-", marks=pytest.mark.nightly), "/dev/stdout"])
def test_a_file_is_written_to_standard_output(name: str, tmp_path: Path) -> None:
    """The file alone, byte for byte; what the command prints is on standard error."""
    words = ["calibration", str(RUN), "--format", "c", "--out"]
    program = [sys.executable, "-m", "boat_daq", *words, name]
    ended = subprocess.run(program, cwd=ROOT, capture_output=True, timeout=60, check=True)
    assert CliRunner().invoke(app, [*words, str(tmp_path / "c.h")]).exit_code == 0
    assert ended.stdout == (tmp_path / "c.h").read_bytes()
    assert b"wrote" in ended.stderr
